"""What an edit leaves of a file's lines: those that it does not concern stay byte for byte, however they are laid out.

A writer of YAML lays a file out in its own way. So it writes twice, before the edit and after it, and what differs between the
two is taken over into the file as it was (a merge of three texts, as diff3's).
"""

from __future__ import annotations

import re
from difflib import SequenceMatcher
from typing import Any

from ruamel.yaml.comments import CommentedMap, CommentedSeq

Lines = list[str]


def merged(original: str, before: str, after: str) -> str:
    """`original` with what differs between `before` (the same file as its writer lays it out) and `after` (the file edited).

    New lines end as the original's first line does; a last line that has no end keeps none.
    """
    end = "\r\n" if original.partition("\n")[0].endswith("\r") else "\n"
    kept = _lines(original)
    old = [line.rstrip("\r\n") for line in kept]
    base, new = ([line.removesuffix("\n") for line in _lines(text)] for text in (before, after))
    laid_out = _same([_bare(line) for line in base], [_bare(line) for line in old]) | {len(base): len(old)}
    edited = _same(base, new) | {len(base): len(new)}
    result: Lines = []
    o = b = n = 0
    for line in sorted(laid_out.keys() & edited.keys()):
        there, here = laid_out[line], edited[line]
        if base[b:line] == new[n:here]:
            result += kept[o:there]
        else:
            result += [each + end for each in new[n:here]]
        result += kept[there : there + 1]
        o, b, n = there + 1, line + 1, here + 1
    ended = [each if each.endswith("\n") else each + end for each in result]
    if result and kept and not kept[-1].endswith("\n"):
        ended[-1] = ended[-1].removesuffix(end)
    return "".join(ended)


def indents(data: Any) -> tuple[int, int, int]:
    """A file's own indentation, as its first block of each kind has it: of a mapping, of what stands in a list, of its dash."""
    mapping: int | None = None
    sequence: tuple[int, int] | None = None
    todo: list[Any] = [data]
    seen: set[int] = set()
    while todo and (mapping is None or sequence is None):
        node = todo.pop(0)
        if not _block(node) or id(node) in seen:
            continue
        seen.add(id(node))  # an alias is met again, perhaps for ever
        if isinstance(node, CommentedSeq):
            todo += node
            continue
        for each in filter(_block, node.values()):
            todo.append(each)
            by = each.lc.col - node.lc.col  # of an alias it says nothing, and may be less than 0
            if isinstance(each, CommentedMap) and mapping is None and by > 0:
                mapping = by
            elif isinstance(each, CommentedSeq) and sequence is None and by >= 0:
                sequence = by + each.lc.item(0)[1] - each.lc.col, by
    return mapping or 2, *(sequence or (4, 2))


def _block(node: Any) -> bool:
    """A mapping or a list that has something on lines of its own."""
    return isinstance(node, CommentedMap | CommentedSeq) and bool(node) and not node.fa.flow_style()


def _lines(text: str) -> Lines:
    """With their ends; unlike str.splitlines, at newlines only."""
    return [line for line in re.split(r"(?<=\n)", text) if line]


def _same(ours: Lines, theirs: Lines) -> dict[int, int]:
    """Number of a line → that of the same line in the other text."""
    matcher = SequenceMatcher(None, ours, theirs, autojunk=False)
    return {m.a + i: m.b + i for m in matcher.get_matching_blocks() for i in range(m.size)}


def _bare(line: str) -> str:
    return " ".join(line.split())
