"""Where everything of a composite node's picture is: boxes with their ports, and curved wires. Units are pixels at zoom 1.

What flows goes from left to right: inputs stand on a box's left edge, outputs on its right one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from handrail.messages import NodePort
from tablet_client.models.canvas.graph import IN, OUT, Graph, Wire
from tablet_client.models.canvas.layers import Edge, Size, draw
from tablet_client.models.canvas.picture import PADDING, Box, Curve, Point

HEAD, ROW = 46.0, 32.0
"""room for a box's title, and for a port"""
_CHARACTER, _TITLE, _LEAST, _MOST = 6.7, 7.6, 120.0, 300.0
_GAP, _RISE = 26.0, 30.0
_APART = 9.0
"""between wires that run side by side"""
_NEAR = 14.0
"""that a finger may miss a wire by"""


@dataclass(frozen=True)
class Socket:
    """A port as it is drawn, on an edge of its box."""

    box: str
    port: str
    out: bool
    """something comes out of it there: a part's output, an own input"""
    text: str
    known: bool
    """the node has such a port, as far as it is known"""
    at: Point


@dataclass(frozen=True)
class GraphPicture:
    width: float
    height: float
    boxes: Mapping[str, Box]
    sockets: Sequence[Socket]
    curves: Sequence[Curve]
    wires: Sequence[Wire]
    """what each of the curves stands for"""

    def box_at(self, point: Point) -> str:
        """Empty: none."""
        return next((name for name, box in self.boxes.items() if box.has(point)), "")

    def socket_at(self, point: Point) -> Socket | None:
        """The port in whose row of a box a point lies, on its side of it, or a little beside it."""
        for socket in self.sockets:
            box = self.boxes[socket.box]
            reach = box.width / 2 if self._faces(socket) else box.width
            along = (socket.at[0] - point[0]) if socket.out else (point[0] - socket.at[0])
            if abs(point[1] - socket.at[1]) <= ROW / 2 and -ROW / 2 <= along <= reach:
                return socket
        return None

    def _faces(self, socket: Socket) -> bool:
        """Whether a port stands in the same row on the other side."""
        return any(
            each.box == socket.box and each.out != socket.out and each.at[1] == socket.at[1] for each in self.sockets
        )

    def wire_at(self, point: Point) -> Wire | None:
        """The nearest one there."""
        best, found = _NEAR, None
        for curve, wire in zip(self.curves, self.wires, strict=True):
            if (away := _away(curve, point)) < best:
                best, found = away, wire
        return found


def of(graph: Graph, ports: Mapping[str, Sequence[NodePort]]) -> GraphPicture:
    """The picture of a composite; `ports`: of the nodes of the library that are known by now."""
    wires = graph.all_wires()
    rows = {name: _rows(name, graph, ports, wires) for name in (IN, *graph.parts, OUT)}
    sizes = {name: _size(_head(name, graph), *rows[name]) for name in rows if name in graph.parts or any(rows[name])}
    pairs = list(dict.fromkeys((wire.source[0], wire.target[0]) for wire in wires))
    pairs = [pair for pair in pairs if pair[0] != pair[1]]
    # Drawn from top to bottom and then turned: across is down.
    turned = {name: Size(size.height, size.width) for name, size in sizes.items()}
    drawing = draw(turned, [Edge(*pair, Size(_GAP / 2, 0.0)) for pair in pairs], gap=_GAP, rise=_RISE)
    boxes = {}
    for name, (down, across) in drawing.places.items():
        boxes[name] = Box(across + PADDING, down + PADDING, sizes[name].width, sizes[name].height)
    bends = {
        pair: [(across + PADDING, down + PADDING) for down, across in points] if len(points) > 1 else []
        for pair, points in zip(pairs, drawing.bends, strict=True)
    }
    sockets = []
    for name, box in boxes.items():
        for out, side in zip((False, True), rows[name], strict=True):
            for row, (port, known) in enumerate(side):
                x = box.x + box.width if out else box.x
                sockets.append(Socket(name, port, out, port, known, (x, box.y + HEAD + ROW * (row + 0.5))))
    return GraphPicture(
        drawing.height + 2 * PADDING,
        drawing.width + 2 * PADDING,
        boxes,
        sockets,
        _curves(wires, sockets, bends),
        wires,
    )


def _rows(
    name: str, graph: Graph, ports: Mapping[str, Sequence[NodePort]], wires: Sequence[Wire]
) -> tuple[list[tuple[str, bool]], list[tuple[str, bool]]]:
    """A box's inputs and outputs, and whether the node is known to have each."""
    used = (
        [wire.target[1] for wire in wires if wire.target[0] == name],
        [wire.source[1] for wire in wires if wire.source[0] == name],
    )
    if name == IN:
        return [], [(own, True) for own in graph.inputs]
    if name == OUT:
        return [(own, True) for own in graph.outputs], []
    known = ports.get(graph.parts[name].node)
    sides = []
    for way, there in zip(("input", "output"), used, strict=True):
        has = [port.name for port in known or () if port.way == way]
        more = [port for port in dict.fromkeys(there) if port not in has]  # the file says so; nobody else does (yet)
        sides.append([(port, True) for port in has] + [(port, known is None) for port in more])
    return sides[0], sides[1]


def _head(name: str, graph: Graph) -> tuple[str, str]:
    part = graph.parts.get(name)
    return (part.name, part.node) if part is not None else ("outputs", "")  # the longer of the words that are drawn


def _size(head: tuple[str, str], ins: list[tuple[str, bool]], outs: list[tuple[str, bool]]) -> Size:
    both = max((len(port) for port, _ in ins), default=0) + max((len(port) for port, _ in outs), default=0)
    width = max(_TITLE * len(head[0]), _CHARACTER * len(head[1]), _CHARACTER * both + 30.0) + 24.0
    return Size(min(max(_LEAST, width), _MOST), HEAD + ROW * max(len(ins), len(outs), 0) + 8.0)


def _curves(
    wires: Sequence[Wire], sockets: Sequence[Socket], bends: Mapping[tuple[str, str], list[Point]]
) -> list[Curve]:
    places = {(socket.box, socket.port, socket.out): socket.at for socket in sockets}
    beside: dict[tuple[str, str], int] = {}
    found = []
    for number, wire in enumerate(wires):
        start, end = places[(*wire.source, True)], places[(*wire.target, False)]
        pair = (wire.source[0], wire.target[0])
        shift = _APART * beside.get(pair, 0)
        beside[pair] = beside.get(pair, 0) + 1
        points = [start, *((x, y + shift) for x, y in bends.get(pair, [])), end]
        pieces = tuple(_piece(a, b) for a, b in pairwise(points))
        found.append(Curve(pair[0], pair[1], (number,), start, pieces, "", ((start[0] + end[0]) / 2, start[1])))
    return found


def _piece(a: Point, b: Point) -> tuple[Point, Point, Point]:
    """Leaves and arrives level; far enough out where it has to go back."""
    out = max(abs(b[0] - a[0]) / 2, 30.0 if b[0] < a[0] else 0.0)
    return (a[0] + out, a[1]), (b[0] - out, b[1]), b


def _away(curve: Curve, point: Point) -> float:
    """px from a point to a curve."""
    least, start = math.inf, curve.start
    for first, second, end in curve.pieces:
        for step in range(17):
            t = step / 16
            weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3)
            x, y = (
                sum(w * each[axis] for w, each in zip(weights, (start, first, second, end), strict=True))
                for axis in (0, 1)
            )
            least = min(least, math.dist((x, y), point))
        start = end
    return least
