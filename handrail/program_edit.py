"""Edits of a program's file by a tool: what was not edited stays as it was written, comments, order and quotes among it.

States are cut, moved and put by their lines; what is in one state is edited by ruamel.yaml, which keeps comments. Whether the
result is a program is for `handrail program check`, or the engine that it is saved to, to say.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ruamel.yaml.comments import CommentedMap, CommentedSeq

from handrail.yaml_edit import STEP, Null, block_lines, dumped, kept, loaded, shifted

Path = Sequence[str | int]


@dataclass(frozen=True)
class _Block:
    """A state's lines, with the comments right above it."""

    name: str
    first: int
    key: int
    """the line of its name"""
    end: int
    indent: int
    parent: str


class ProgramText:
    """A program's file that is being edited. Every edit raises ValueError, naming what is wrong, and then changes nothing."""

    def __init__(self, text: str):
        self._lines = text.splitlines()
        self._blocks = self._read(self._lines)

    @property
    def text(self) -> str:
        return "\n".join(self._lines) + "\n"

    def states(self, within: str = "") -> list[str]:
        """Names of the states in a state (empty: of the program), in order."""
        return [block.name for block in self._blocks.values() if block.parent == within]

    def add_state(
        self, name: str, fields: Mapping[str, Any] | None = None, *, within: str = "", after: str = ""
    ) -> None:
        """A new state, after one of those beside it, else as the last one."""
        self._new(name)
        lines = dumped(CommentedMap({name: kept(fields) if fields else Null("")})).splitlines()
        self._put(lines, within, after)

    def rename_state(self, name: str, to: str) -> None:
        """In transitions, events, `In()` and `retries_of_`, too."""
        self._new(to)
        block, lines = self._block(name), list(self._lines)
        data = loaded("\n".join(lines))
        word = re.escape(name)
        target = re.compile(rf"(?<![\w.]){word}(?!\w)")
        event = re.compile(rf"(?<=done\.invoke\.){word}(?!\w)|(?<=done\.state\.){word}(?!\w)")
        value = re.compile(rf"(?<=[Ii]n\(['\"]){word}(?=['\"]\))|(?<=\bretries_of_){word}(?!\w)")
        edits: dict[tuple[int, int], tuple[int, re.Pattern[str]]] = {}
        for line, column, key, text in _texts(data):
            edits[line, column] = (len(text) + 2, {"target": target, "event": event}.get(key, value))
        for (line, column), (length, pattern) in sorted(edits.items(), reverse=True):
            old = lines[line]
            lines[line] = old[:column] + pattern.sub(to, old[column : column + length]) + old[column + length :]
        lines[block.key] = re.sub(rf"^(\s*['\"]?){word}(?=['\"]?\s*:)", rf"\g<1>{to}", lines[block.key])
        self._become(lines)

    def remove_state(self, name: str) -> None:
        """With all that is in it, and the transitions that lead there."""
        block = self._block(name)
        gone = {name, *(each.name for each in self._inside(name))}
        lines = self._without(block)
        kept = ProgramText("\n".join(lines))
        for other in kept.states_everywhere():
            way = kept._fields(other).get("transitions", [])
            odd = [k for k, each in enumerate(way) if gone & set(str(each.get("target", "")).split())]
            for k in reversed(odd):
                kept.disconnect(other, k)
        self._become(kept._lines)

    def states_everywhere(self) -> list[str]:
        """Names of all states, as they stand in the file."""
        return list(self._blocks)

    def move_state(self, name: str, *, within: str = "", after: str = "") -> None:
        """To another place, after one of those that are there, else as the last one."""
        block = self._block(name)
        if within == name or within in {each.name for each in self._inside(name)} or after == name:
            raise ValueError(f"move_state: got {within or after!r}; expected a place that is not in {name!r} itself")
        lines = [line[block.indent :] for line in self._lines[block.first : block.end]]
        moved = ProgramText("\n".join(self._without(block)))
        moved._put(lines, within, after)
        self._become(moved._lines)

    def nest(self, names: Sequence[str], into: str) -> None:
        """A new state in the place of the first of those that stand beside each other, with them in it."""
        blocks = [self._block(name) for name in names]
        if not blocks or len({block.parent for block in blocks}) != 1:
            raise ValueError(f"nest: got {', '.join(names) or 'none'}; expected states that stand beside each other")
        self._new(into)
        copy = ProgramText(self.text)
        siblings = copy.states(blocks[0].parent)
        before = siblings[: siblings.index(names[0])]
        copy.add_state(into, within=blocks[0].parent, after=before[-1] if before else names[0])
        for name in names:
            copy.move_state(name, within=into)
        self._become(copy._lines)

    def connect(self, source: str, target: str, **fields: Any) -> int:
        """A way out, tried after those that there are; its place. `fields`: as a transition has them (event, cond, ...)."""
        self._block(target)
        state = self._fields(source)
        ways = state.setdefault("transitions", CommentedSeq())
        ways.append(kept({**fields, "target": target}))
        ways.fa.set_block_style()
        self._replace(source, state)
        return len(ways) - 1

    def disconnect(self, source: str, place: int) -> None:
        """Take a way out away."""
        state = self._fields(source)
        ways = state.get("transitions", [])
        if not 0 <= place < len(ways):
            raise ValueError(f"disconnect: got {place}; expected one of {source}'s {len(ways)} ways, counted from 0")
        del ways[place]
        if not ways:
            del state["transitions"]
        self._replace(source, state)

    def set_field(self, state: str, path: Path, value: Any) -> None:
        """E.g. ``set_field("asking", ["with", "text"], "Go on?")``; a number in the path is a place in a list."""
        fields = self._fields(state)
        *above, last = path
        inner = _at(fields, above, make=True)
        if isinstance(inner, CommentedSeq) and not (isinstance(last, int) and 0 <= last < len(inner)):
            raise ValueError(f"set_field: got {last!r}; expected a place from 0 to {len(inner) - 1}")
        if isinstance(inner, CommentedMap) and not isinstance(last, str):
            raise ValueError(f"set_field: got {last!r}; expected a field's name")
        if path[0] == "states":
            raise ValueError("set_field: got 'states'; expected a field of the state itself")
        inner[last] = kept(value)
        self._replace(state, fields)

    def remove_field(self, state: str, path: Path) -> None:
        """Take a field away."""
        fields = self._fields(state)
        *above, last = path
        inner = _at(fields, above)
        if path[0] == "states" or (
            last not in inner if isinstance(inner, CommentedMap) else not _is_place(inner, last)
        ):
            raise ValueError(f"remove_field: got {list(path)!r}; expected a field that {state!r} has")
        del inner[last]
        self._replace(state, fields)

    # ----------------------------------------------------------------------------------------------------------------- lines

    @staticmethod
    def _read(lines: list[str]) -> dict[str, _Block]:
        data = loaded("\n".join(lines))
        if not isinstance(data, CommentedMap) or not isinstance(data.get("states"), CommentedMap):
            raise ValueError("states: missing; expected a program's file")
        return {block.name: block for block in _blocks(lines, data["states"], "")}

    def _become(self, lines: list[str]) -> None:
        self._blocks = self._read(lines)  # raises where that is no program any more
        self._lines = lines

    def _new(self, name: str) -> None:
        if not name.isidentifier():
            raise ValueError(f"state: got {name!r}; expected a name of letters, digits and _")
        if name in self._blocks:
            raise ValueError(f"state: {name!r} is there already; expected another name")

    def _block(self, name: str) -> _Block:
        if name not in self._blocks:
            raise ValueError(f"state: got {name!r}; expected one of {', '.join(self._blocks)}")
        return self._blocks[name]

    def _inside(self, name: str) -> Iterator[_Block]:
        for block in self._blocks.values():
            if block.parent == name:
                yield block
                yield from self._inside(block.name)

    def _without(self, block: _Block) -> list[str]:
        lines = self._lines[: block.first] + self._lines[block.end :]
        if len(self.states(block.parent)) > 1:
            return lines
        if not block.parent:
            raise ValueError(f"state: {block.name!r} is the only one; expected another one beside it")
        key = max(k for k in range(block.first) if re.match(r"\s*states\s*:", self._lines[k]))
        del lines[key]
        return lines

    def _put(self, lines: list[str], within: str, after: str) -> None:
        """Lines of a state, from column 0 on, to where they belong."""
        siblings = self.states(within)
        if after and after not in siblings:
            raise ValueError(f"after: got {after!r}; expected one of {', '.join(siblings) or 'none: the first there'}")
        copy = ProgramText(self.text)
        if siblings:
            beside = copy._blocks[after or siblings[-1]]
            at, indent = beside.end, beside.indent
        else:
            copy._open(within)
            outer = copy._block(within)
            at, indent = outer.end, outer.indent + 2 * STEP
            copy._lines.insert(at, shifted("states:", indent - STEP))
            at += 1
        self._become(copy._lines[:at] + [shifted(line, indent) for line in lines] + copy._lines[at:])

    def _open(self, name: str) -> None:
        """Let a state that stands on one line have lines of its own."""
        fields = self._fields(name)
        if fields:
            fields.fa.set_block_style()
            self._replace(name, fields)
        else:
            block = self._block(name)
            lines = list(self._lines)
            lines[block.key] = re.sub(r":\s*(\{\s*\}|null|~)", ":", lines[block.key], count=1)
            self._lines = lines

    # ------------------------------------------------------------------------------------------------------- what is in a state

    def _fields(self, name: str) -> CommentedMap:
        block = self._block(name)
        fields = loaded("\n".join(line[block.indent :] for line in self._lines[block.key : block.end]))[name]
        return fields if isinstance(fields, CommentedMap) else CommentedMap()

    def _replace(self, name: str, fields: CommentedMap) -> None:
        block = self._block(name)
        old = [line[block.indent :] for line in self._lines[block.key : block.end]]
        whole = loaded("\n".join(old))
        whole[name] = fields if fields else Null("")
        new = [shifted(line, block.indent) for line in dumped(whole).splitlines()]
        self._become(self._lines[: block.key] + new + self._lines[block.end :])


def _blocks(lines: list[str], states: CommentedMap, parent: str) -> Iterator[_Block]:
    if states.fa.flow_style() and states:
        raise ValueError(f"{parent or 'states'}: states on one line; expected each on a line of its own")
    for name, fields in states.items():
        key, indent = states.lc.key(name)
        yield _Block(str(name), *block_lines(lines, key, indent), indent, parent)
        if isinstance(fields, CommentedMap) and isinstance(fields.get("states"), CommentedMap):
            yield from _blocks(lines, fields["states"], str(name))


def _texts(data: Any, key: str = "") -> Iterator[tuple[int, int, str, str]]:
    """Line, column, the field that it is of, and the text of each text in a document."""
    places = data.items() if isinstance(data, CommentedMap) else enumerate(data)
    for name, each in places:
        field = str(name) if isinstance(data, CommentedMap) else key
        if isinstance(each, CommentedMap | CommentedSeq):
            yield from _texts(each, field)
        elif isinstance(each, str):
            line, column = data.lc.value(name) if isinstance(data, CommentedMap) else data.lc.item(name)
            yield line, column, field, each


def _at(fields: Any, path: Path, *, make: bool = False) -> Any:
    for step in path:
        if isinstance(fields, CommentedMap) and isinstance(step, str) and step not in fields and make:
            fields[step] = CommentedMap()
        there = step in fields if isinstance(fields, CommentedMap) else _is_place(fields, step)
        if not there or not isinstance(fields[step], CommentedMap | CommentedSeq):
            raise ValueError(f"path: got {step!r}; expected a field with others in it")
        fields = fields[step]
    return fields


def _is_place(fields: Any, step: str | int) -> bool:
    return isinstance(fields, CommentedSeq) and isinstance(step, int) and 0 <= step < len(fields)
