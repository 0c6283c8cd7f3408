"""Where everything of a program's picture is: boxes in boxes, and curved lines with words. Units are pixels at zoom 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from tablet_client.models.canvas.chart import Chart
from tablet_client.models.canvas.layers import Edge, Size, draw

Point = tuple[float, float]
_CHARACTER, _TITLE = 6.7, 7.6
"""width of a small character, of one of a title: wide enough for any font that the window has"""
LEAST, MOST, HEIGHT = 120.0, 240.0, 52.0
"""widths of a state with none in it, its height"""
HEAD, PADDING = 46.0, 16.0
"""of a state with others in it: the room for its title, and around them"""
_GAP, _RISE = 22.0, 15.0
LABEL, LINE = 30, 16.0
"""characters of a line's words, their height"""
_LOOP = 30.0


@dataclass(frozen=True)
class Box:
    x: float
    y: float
    width: float
    height: float

    @property
    def middle(self) -> Point:
        return self.x + self.width / 2, self.y + self.height / 2

    def has(self, point: Point) -> bool:
        return self.x <= point[0] <= self.x + self.width and self.y <= point[1] <= self.y + self.height


@dataclass(frozen=True)
class Curve:
    """From `start` by cubic Bézier pieces (two handles, an end); it has an arrow's head at its end."""

    source: str
    target: str
    places: tuple[int, ...]
    """the transitions that it stands for"""
    start: Point
    pieces: tuple[tuple[Point, Point, Point], ...]
    words: str
    at: Point
    """the middle of the words"""


@dataclass(frozen=True)
class Picture:
    width: float
    height: float
    boxes: Mapping[str, Box]
    """outer ones before those in them"""
    curves: Sequence[Curve]

    def state_at(self, point: Point) -> str:
        """The innermost state there; empty: none."""
        return next((name for name, box in reversed(list(self.boxes.items())) if box.has(point)), "")


def of(chart: Chart) -> Picture:
    """The picture of a program."""
    drawn = _Drawn(chart)
    size = drawn.arrange("")
    boxes: dict[str, Box] = {}
    drawn.place("", (PADDING, PADDING), boxes)
    return Picture(size.width + 2 * PADDING, size.height + 2 * PADDING, boxes, list(drawn.curves(boxes)))


def words(label: str) -> str:
    return label if len(label) <= LABEL else label[: LABEL - 1] + "…"


class _Drawn:
    def __init__(self, chart: Chart):
        self._chart = chart
        self._places: dict[str, Mapping[str, Point]] = {}
        self._sizes: dict[str, Size] = {}
        self._widths: dict[str, float] = {}
        """of what is in a state"""
        self._lines: dict[str, list[tuple[tuple[str, str], list[Point], Point]]] = {}
        """state → what runs in it: source and target, bends, the middle of its words"""
        self._bends: dict[tuple[str, str], tuple[list[Point], Point]] = {}
        """source and target → the same in the whole picture"""
        self._ways: dict[tuple[str, str], list[int]] = {}
        for state in chart.states.values():
            for way in state.ways:
                for target in way.targets:
                    if target in chart.states:
                        self._ways.setdefault((state.name, target), []).append(way.place)

    def _words(self, pair: tuple[str, str]) -> str:
        ways, places = self._chart.states[pair[0]].ways, self._ways[pair]
        labels = [way.label for way in ways if way.place in places and way.label]
        return words(" / ".join(dict.fromkeys(labels)))

    def _beside(self, pair: tuple[str, str]) -> tuple[str, str, str] | None:
        """The state in which a line runs, and the two in it that it runs between; None: one end is in the other."""
        source, target = (self._chart.above(name)[::-1] for name in pair)
        same = 0
        while same < min(len(source), len(target)) and source[same] == target[same]:
            same += 1
        if same in (len(source), len(target)):
            return None
        return (source[same - 1] if same else ""), source[same], target[same]

    def arrange(self, parent: str) -> Size:
        """What is in a state, by itself; its size."""
        inside = self._chart.within(parent)
        sizes = {name: self._size(name) for name in inside}
        inner = [(pair, found) for pair in self._ways if (found := self._beside(pair)) and found[0] == parent]
        edges = []
        for pair, (_, source, target) in inner:
            text = self._words(pair)
            edges.append(
                Edge(source, target, Size(_CHARACTER * len(text) + 8.0 if text else _GAP / 2, LINE if text else 0.0))
            )
        first = sorted(inside, key=lambda name: not self._chart.states[name].initial)
        drawing = draw({name: sizes[name] for name in first}, edges, gap=_GAP, rise=_RISE)
        self._places[parent], self._widths[parent] = drawing.places, drawing.width
        self._lines[parent] = [
            (pair, bends, at) for (pair, _), bends, at in zip(inner, drawing.bends, drawing.labels, strict=True)
        ]
        return Size(drawing.width, drawing.height)

    def _size(self, name: str) -> Size:
        state = self._chart.states[name]
        title = max(_TITLE * len(state.title), _CHARACTER * len(state.does)) + 36.0
        width, height = min(max(LEAST, title), MOST), HEIGHT
        if self._chart.within(name):
            inner = self.arrange(name)
            width, height = max(width, inner.width + 2 * PADDING), inner.height + HEAD + PADDING
        self._sizes[name] = Size(width, height)
        return self._sizes[name]

    def place(self, parent: str, origin: Point, boxes: dict[str, Box]) -> None:
        """Where what is in a state is in the whole picture; `origin`: where that begins."""
        for pair, bends, at in self._lines.get(parent, ()):
            moved = [(x + origin[0], y + origin[1]) for x, y in bends]
            self._bends[pair] = moved, (at[0] + origin[0], at[1] + origin[1])
        for name, (x, y) in self._places.get(parent, {}).items():
            size = self._sizes[name]
            box = boxes[name] = Box(origin[0] + x, origin[1] + y, size.width, size.height)
            if self._chart.within(name):
                spare = (box.width - 2 * PADDING - self._widths[name]) / 2
                self.place(name, (box.x + PADDING + spare, box.y + HEAD), boxes)

    def curves(self, boxes: Mapping[str, Box]) -> Iterator[Curve]:
        shares = self._shares(boxes)
        for pair, places in self._ways.items():
            source, target = boxes[pair[0]], boxes[pair[1]]
            if pair in self._bends:
                bends, at = self._bends[pair]
                start = _port(source, shares[*pair, 0], bends[0])
                points = [start, *bends, _port(target, shares[*pair, -1], bends[-1])]
                pieces = tuple(_piece(a, b) for a, b in pairwise(points))
            else:
                start, pieces, at = _aside(source, target)
            yield Curve(*pair, tuple(places), start, pieces, self._words(pair), at)

    def _shares(self, boxes: Mapping[str, Box]) -> dict[tuple[str, str, int], float]:
        """Source, target and which of a line's ends (0, -1) → how far from the middle it is, of the box's width: lines leave and
        arrive side by side, in the order of where they lead.
        """
        sides: dict[tuple[str, bool], list[tuple[float, tuple[str, str, int]]]] = {}
        for pair, (bends, _) in self._bends.items():
            for end in (0, -1):
                x, y = bends[end]
                above = y < boxes[pair[end]].middle[1]
                sides.setdefault((pair[end], above), []).append((x, (*pair, end)))
        return {
            key: (number + 1) / (len(side) + 1) - 0.5
            for side in sides.values()
            for number, (_, key) in enumerate(sorted(side))
        }


def _port(box: Box, share: float, to: Point) -> Point:
    """Where a line leaves or meets a box, above or below, `share` of its width from the middle."""
    return box.middle[0] + share * min(box.width, LEAST), box.y if to[1] < box.middle[1] else box.y + box.height


def _piece(a: Point, b: Point) -> tuple[Point, Point, Point]:
    half = (a[1] + b[1]) / 2
    return (a[0], half), (b[0], half), b


def _aside(source: Box, target: Box) -> tuple[Point, tuple[tuple[Point, Point, Point], ...], Point]:
    """Around the right side: a state to itself, to one in it, or to one around it."""
    start = source.x + source.width, source.middle[1] - (0.2 * HEIGHT if source == target else 0.0)
    end = target.x + target.width, target.middle[1] + (0.2 * HEIGHT if source == target else 0.0)
    if source != target and target.height > source.height:
        end = target.x + target.width, target.y + HEAD / 2
    elif source != target:
        start = source.x + source.width, source.y + HEAD / 2
    out = max(start[0], end[0]) + _LOOP
    piece = ((out, start[1]), (out, end[1]), end)
    return start, (piece,), (out, (start[1] + end[1]) / 2)
