"""A layered drawing of a directed graph, top to bottom: Sugiyama, Tagawa, Toda (1981), with labels as nodes of their own.

Cycles are opened where a depth-first search from the first node closes them; layers are by longest path; what spans several layers
gets a place in each; their order in a layer is by the neighbours' mean, where that crosses least; their x is the least-squares one
that keeps order and gaps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

_SWEEPS = 8


@dataclass(frozen=True)
class Size:
    width: float
    height: float


@dataclass(frozen=True)
class Edge:
    """`label`: how much room its words take, half-way on its first piece."""

    source: str
    target: str
    label: Size


@dataclass(frozen=True)
class Drawing:
    width: float
    height: float
    places: Mapping[str, tuple[float, float]]
    """node → left, top"""
    bends: Sequence[list[tuple[float, float]]]
    """by edge, from its source to its target: the points between the two nodes"""
    labels: Sequence[tuple[float, float]]
    """by edge, the middle of its label"""


@dataclass
class _Item:
    """A node, or a place that an edge takes in a layer."""

    layer: int
    width: float
    height: float
    node: str = ""
    x: float = 0.0
    """of the middle"""
    y: float = 0.0
    before: list[_Item] = field(default_factory=list)
    after: list[_Item] = field(default_factory=list)


def draw(nodes: Mapping[str, Size], edges: Sequence[Edge], *, gap: float, rise: float) -> Drawing:
    """Nodes in the order in which they should be read; `gap` between what stands side by side, `rise` between layers.

    No edge may lead from a node to itself.
    """
    back = _back(list(nodes), edges)
    pairs = [(e.target, e.source) if n in back else (e.source, e.target) for n, e in enumerate(edges)]
    layers = _layers(list(nodes), pairs)
    items = {name: _Item(2 * layers[name], size.width, size.height, name) for name, size in nodes.items()}
    chains: list[list[_Item]] = []
    for number, ((top, bottom), edge) in enumerate(zip(pairs, edges, strict=True)):
        first, last = 2 * layers[top] + 1, 2 * layers[bottom]
        chain = [_Item(layer, gap / 2, 0.0) for layer in range(first, last)]
        words = chain[-1] if number in back else chain[0]
        words.width, words.height = edge.label.width, edge.label.height
        for above, below in zip([items[top], *chain], [*chain, items[bottom]], strict=True):
            above.after.append(below)
            below.before.append(above)
        chains.append(chain)
    rows: list[list[_Item]] = [[] for _ in range(max((item.layer for item in items.values()), default=0) + 1)]
    for item in (*items.values(), *(each for chain in chains for each in chain)):
        rows[item.layer].append(item)
    rows = _ordered(rows)
    _set_x(rows, gap)
    height = _set_y(rows, rise)
    left = min((item.x - item.width / 2 for row in rows for item in row), default=0.0)
    for row in rows:
        for item in row:
            item.x -= left
    width = max((item.x + item.width / 2 for row in rows for item in row), default=0.0)
    bends, labels = [], []
    for number, chain in enumerate(chains):
        words = chain[-1] if number in back else chain[0]
        points = [(item.x, item.y) for item in chain]
        bends.append(points[::-1] if number in back else points)
        labels.append((words.x, words.y))
    places = {name: (item.x - item.width / 2, item.y - item.height / 2) for name, item in items.items()}
    return Drawing(width, height, places, bends, labels)


def _back(nodes: list[str], edges: Sequence[Edge]) -> set[int]:
    """Edges that close a cycle, by number."""
    ways: dict[str, list[tuple[int, str]]] = {name: [] for name in nodes}
    for number, edge in enumerate(edges):
        ways[edge.source].append((number, edge.target))
    back, done = set[int](), set[str]()
    for root in nodes:
        if root in done:
            continue
        open_, stack = {root}, [(root, iter(ways[root]))]
        while stack:
            name, rest = stack[-1]
            found = next(rest, None)
            if found is None:
                stack.pop()
                open_.discard(name)
                done.add(name)
            elif found[1] in open_:
                back.add(found[0])
            elif found[1] not in done:
                open_.add(found[1])
                stack.append((found[1], iter(ways[found[1]])))
    return back


def _layers(nodes: list[str], pairs: Sequence[tuple[str, str]]) -> dict[str, int]:
    """Longest path from above, without cycles."""
    into = {name: 0 for name in nodes}
    ways: dict[str, list[str]] = {name: [] for name in nodes}
    for top, bottom in pairs:
        ways[top].append(bottom)
        into[bottom] += 1
    layer, free = dict.fromkeys(nodes, 0), [name for name in nodes if not into[name]]
    while free:
        name = free.pop()
        for below in ways[name]:
            layer[below] = max(layer[below], layer[name] + 1)
            into[below] -= 1
            if not into[below]:
                free.append(below)
    return layer


def _ordered(rows: list[list[_Item]]) -> list[list[_Item]]:
    best, least = rows, _crossings(rows)
    rows = [list(row) for row in rows]
    for sweep in range(_SWEEPS):
        down = sweep % 2 == 0
        for number in range(1, len(rows)) if down else range(len(rows) - 2, -1, -1):
            beside = rows[number - 1 if down else number + 1]
            place = {id(item): at for at, item in enumerate(beside)}
            keys = {}
            for at, item in enumerate(rows[number]):
                near = [place[id(other)] for other in (item.before if down else item.after)]
                keys[id(item)] = sum(near) / len(near) if near else float(at)
            rows[number].sort(key=lambda item, keys=keys: keys[id(item)])  # type: ignore[misc]
        if (crossed := _crossings(rows)) < least:
            best, least = [list(row) for row in rows], crossed
    return best


def _crossings(rows: list[list[_Item]]) -> int:
    found = 0
    for row, below in pairwise(rows):
        place = {id(item): at for at, item in enumerate(below)}
        ends = [place[id(other)] for item in row for other in sorted(item.after, key=lambda other: place[id(other)])]
        found += sum(a > b for at, a in enumerate(ends) for b in ends[at + 1 :])
    return found


def _set_x(rows: list[list[_Item]], gap: float) -> None:
    for row in rows:
        at = 0.0
        for item in row:
            item.x = at + item.width / 2
            at += item.width + gap
    for sweep in range(_SWEEPS):
        down = sweep % 2 == 0
        for row in rows if down else reversed(rows):
            wanted = []
            for item in row:
                near = (item.before or item.after) if down else (item.after or item.before)
                wanted.append(sum(other.x for other in near) / len(near) if near else item.x)
            for item, x in zip(row, _apart(wanted, [item.width for item in row], gap), strict=True):
                item.x = x


def _apart(wanted: list[float], widths: list[float], gap: float) -> list[float]:
    """The places nearest to the wanted ones, squared, at which nothing overlaps: pools of adjacent violators."""
    offsets = [0.0]
    for left, right in pairwise(widths):
        offsets.append(offsets[-1] + (left + right) / 2 + gap)
    pools: list[tuple[float, int]] = []  # sum, count
    for value in (x - offset for x, offset in zip(wanted, offsets, strict=False)):
        pools.append((value, 1))
        while len(pools) > 1 and pools[-2][0] / pools[-2][1] > pools[-1][0] / pools[-1][1]:
            (a, n), (b, k) = pools[-2:]
            pools[-2:] = [(a + b, n + k)]
    placed = [total / count for total, count in pools for _ in range(count)]
    return [x + offset for x, offset in zip(placed, offsets, strict=False)]


def _set_y(rows: list[list[_Item]], rise: float) -> float:
    at = 0.0
    for row in rows:
        tallest = max((item.height for item in row), default=0.0)
        for item in row:
            item.y = at + tallest / 2
        at += tallest + rise
    return max(0.0, at - rise)
