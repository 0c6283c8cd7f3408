"""What Tab, Shift+Tab and Enter do in code: which part of a text is replaced by what, and what is selected then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

WIDTH = {".py": 4}
_OTHER = 2
_OPENERS = {".py": (":", "(", "[", "{"), ".yaml": (":",), ".yml": (":",)}


@dataclass(frozen=True)
class Change:
    """`start` to `end` of the text becomes `text`; then `selected` (start, end) is."""

    start: int
    end: int
    text: str
    selected: tuple[int, int]


def width(suffix: str) -> int:
    """Spaces of one step."""
    return WIDTH.get(suffix, _OTHER)


def tab(text: str, start: int, end: int, suffix: str) -> Change:
    """Spaces up to the next step; lines that are selected are moved in, whole."""
    step = width(suffix)
    if "\n" not in text[start:end]:
        column = start - _begin(text, start)
        spaces = " " * (step - column % step)
        return Change(start, end, spaces, (start + len(spaces),) * 2)
    return _lines(text, start, end, lambda line: " " * step + line if line.strip() else line)


def back(text: str, start: int, end: int, suffix: str) -> Change:
    """The lines that are touched are moved out by one step, as far as there are spaces."""
    step = width(suffix)
    return _lines(text, start, end, lambda line: line[min(step, len(line) - len(line.lstrip(" "))) :])


def enter(text: str, start: int, end: int, suffix: str) -> Change:
    """A new line as far in as this one, one step further after what opens a block."""
    begin = _begin(text, start)
    before = text[begin:start]
    indent = before[: len(before) - len(before.lstrip(" "))]
    code = before.split("#")[0].rstrip()
    if code.endswith(_OPENERS.get(suffix, ())):
        indent += " " * width(suffix)
    return Change(start, end, "\n" + indent, (start + 1 + len(indent),) * 2)


def _begin(text: str, at: int) -> int:
    return text.rfind("\n", 0, at) + 1


def _lines(text: str, start: int, end: int, move: Callable[[str], str]) -> Change:
    begin = _begin(text, start)
    last = end - 1 if end > start and text[end - 1] == "\n" else end  # a line of which nothing is selected stays
    stop = text.find("\n", last)
    stop = len(text) if stop < 0 else stop
    lines = [move(line) for line in text[begin:stop].split("\n")]
    moved = "\n".join(lines)
    if start == end:
        place = max(begin, start + len(moved) - (stop - begin))
        return Change(begin, stop, moved, (place, place))
    return Change(begin, stop, moved, (begin, begin + len(moved)))
