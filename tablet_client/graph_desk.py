"""The canvas page's side of the desk for a node that is made of nodes: its parts with their ports, and the wires."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, Slot

from handrail.messages import NodePort, NodeState
from tablet_client.code_desk import CodeDesk
from tablet_client.drawing_desk import DrawingDesk
from tablet_client.models.canvas.graph import IN, OUT
from tablet_client.models.canvas.picture import Curve
from tablet_client.models.canvas.wiring import NEW, NOTHING
from tablet_client.models.given import ROLES
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_BOX = ("name", "boxX", "boxY", "boxWidth", "boxHeight", "title", "node", "kind", "problem", "active", "selected")
_SOCKET = ("key", "box", "port", "out", "atX", "atY", "known", "selected", "value")
_INPUT = ("name", "about", "source", "selected", "sources")
_ROOM = 10  # characters
_OUTPUT = ("name", "about", "own", "goes", "selected")


class GraphDesk(DrawingDesk):
    """What QML reads of a composite node's picture, and calls."""

    def __init__(self, situation: Situation, code: CodeDesk, soon: Callable[[], None]):
        """`soon` has the models looked at anew."""
        super().__init__(situation.wiring, code, soon)
        self._situation, self._wiring = situation, situation.wiring
        self._lists = {
            "boxes": Rows(_BOX, "name"),
            "sockets": Rows(_SOCKET, "key"),
            "nodes": Rows(("name", "title"), "name"),
            "settings": Rows((*ROLES, "doc", "own"), "name"),
            "inputs": Rows(_INPUT, "name"),
            "outputs": Rows(_OUTPUT, "name"),
        }
        self._drawn: object = None
        self.build()

    def _list(name: str) -> Callable[[GraphDesk], Rows]:  # type: ignore[misc]
        return lambda self: self._lists[name]

    boxes = Property(QObject, _list("boxes"), constant=True)
    sockets = Property(QObject, _list("sockets"), constant=True)
    nodes = Property(QObject, _list("nodes"), constant=True)
    """what can be a part"""
    settings = Property(QObject, _list("settings"), constant=True)
    """the selected part's parameters"""
    inputs = Property(QObject, _list("inputs"), constant=True)
    """the selected part's, or those that come from outside"""
    outputs = Property(QObject, _list("outputs"), constant=True)

    def curves(self) -> list[tuple[Curve, bool]]:
        """Each wire, and whether it leads to or from the port that is selected."""
        picture, box, port = self._wiring.picture, self._wiring.selected, self._wiring.port
        if picture is None:
            return []
        chosen = (box, port[0]) if port is not None else None
        return [
            (curve, chosen is not None and chosen == (wire.source if port and port[1] else wire.target))
            for curve, wire in zip(picture.curves, picture.wires, strict=True)
        ]

    # --------------------------------------------------------------------------------------------------------- buttons

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self._wiring.watched = self._situation.code.nodes_watched = on
        self._now()

    @Slot(float, float)
    def touchAt(self, x: float, y: float) -> None:
        """A place was touched, in the picture's pixels."""
        self._wiring.touch((x, y))
        self._now()

    @Slot(str)
    def touch(self, box: str) -> None:
        """A box was pressed otherwise than by a finger."""
        self._wiring.select(box)
        self._now()

    @Slot(str, str, bool, float, float)
    def join(self, box: str, port: str, out: bool, x: float, y: float) -> None:
        """A wire was drawn from a port to a place in the picture."""
        self._wiring.join(box, port, out, (x, y))
        self._now()

    @Slot(bool)
    def joining(self, on: bool) -> None:
        """The next port or box that is touched is where a new wire leads."""
        self._wiring.joining = on and self._wiring.port is not None
        self._now()

    @Slot(str, bool)
    def selectPort(self, port: str, out: bool) -> None:
        """One of the selected box's; once more: none."""
        chosen = (port, out)
        self._wiring.select(self._wiring.selected, None if self._wiring.port == chosen else chosen)
        self._now()

    @Slot(str)
    def add(self, node: str) -> None:
        self._wiring.add(node)
        self._now()

    @Slot(str, str)
    def feed(self, port: str, source: str) -> None:
        """The selected part's input gets a source."""
        self._wiring.feed(f"{self._wiring.selected}.{port}", source)
        self._now()

    @Slot(str, bool)
    def tell(self, port: str, on: bool) -> None:
        """Whether the selected part's output is one of its own."""
        self._wiring.tell(f"{self._wiring.selected}.{port}", on)
        self._now()

    @Slot(str, float)
    def turn(self, parameter: str, value: float) -> None:
        """A number of the selected part."""
        kind = next((each["type"] for each in self._lists["settings"].lines if each["name"] == parameter), "")
        self._wiring.give(parameter, round(value) if kind == "integer" else value)
        self._now()

    @Slot(str, str)
    def write(self, parameter: str, text: str) -> None:
        """A text of it."""
        self._wiring.give(parameter, text)
        self._now()

    @Slot(str, bool)
    def switch(self, parameter: str, on: bool) -> None:
        """A flag of it."""
        self._wiring.give(parameter, on)
        self._now()

    @Slot(str, bool)
    def outside(self, parameter: str, on: bool) -> None:
        """Whether a parameter of the selected part is one of its own."""
        self._wiring.outside(parameter, on)
        self._now()

    # --------------------------------------------------------------------------------------------------------- looking

    def build(self) -> None:
        """Look at the model anew."""
        if not self._wiring.watched and self._view:
            return
        wiring, picture = self._wiring, self._wiring.picture
        running = self._running()
        self._lists["boxes"].show(self._boxes(running is not None))
        self._lists["sockets"].show(self._sockets(running))
        drawn = (picture, wiring.selected, wiring.port)
        if drawn != self._drawn:
            self._drawn = drawn
            self.drawn.emit()
        self._lists["nodes"].show([{"name": name, "title": title} for name, title in wiring.nodes()])
        self._lists["settings"].show(
            [{**each.given.shown(), "doc": each.doc, "own": each.own} for each in wiring.settings()]
        )
        self._lists["inputs"].show(self._inputs())
        self._lists["outputs"].show(self._outputs())
        self._show(self._build_view(running is not None))

    def _build_view(self, running: bool) -> dict[str, Any]:
        wiring, picture, graph, part = self._wiring, self._wiring.picture, self._wiring.graph, self._wiring.part
        code = self._situation.code
        node, known = part.node if part is not None else "", wiring.known
        files = {each.name: each.file for each in code.nodes}
        return {
            **self._common(),
            "parts": len(graph.parts) if graph is not None else 0,
            "start": {"x": 0.0, "y": picture.height / 2 if picture else 0.0},
            "running": running,
            "selected": wiring.selected,
            "kind": "part" if part is not None else {IN: "in", OUT: "out"}.get(wiring.selected, ""),
            "port": wiring.port[0] if wiring.port is not None else "",
            "name": part.name if part is not None else wiring.port[0] if wiring.port is not None else "",
            "node": node,
            "wired": files.get(node, "").endswith(".yaml"),
            "known": node in files,
            "about": known.title(node),
            "nodeProblem": known.why_not(node),
            "title": graph.title if graph is not None else "",
            "every": "" if graph is None or graph.every is None else f"{graph.every:g}",
            "graphs": [each.name for each in code.nodes if each.file.endswith(".yaml")]
            + [each.name for each in code.documents.values() if each.file.endswith(".yaml") and _fresh(each, code)],
        }

    def _running(self) -> NodeState | None:
        """The first one of this very node that runs."""
        document, code = self._wiring.document, self._situation.code
        if document is None or code.engine:
            return None
        return next((each for each in code.running if each.node == document.name and each.state == "up"), None)

    def _boxes(self, active: bool) -> list[dict[str, Any]]:
        wiring, picture, graph = self._wiring, self._wiring.picture, self._wiring.graph
        if picture is None or graph is None:
            return []
        rows = []
        for name, box in picture.boxes.items():
            part = graph.parts.get(name)
            rows.append(
                {
                    "name": name,
                    "boxX": box.x,
                    "boxY": box.y,
                    "boxWidth": box.width,
                    "boxHeight": box.height,
                    "title": name if part is not None else "",
                    "node": part.node if part is not None else "",
                    "kind": "part" if part is not None else "in" if name == IN else "out",
                    "problem": wiring.known.why_not(part.node) if part is not None else "",
                    "active": active,
                    "selected": name == wiring.selected,
                }
            )
        return rows

    def _sockets(self, running: NodeState | None) -> list[dict[str, Any]]:
        picture, wiring = self._wiring.picture, self._wiring
        values = {port.name: _value(port) for port in running.ports} if running is not None else {}
        return [
            {
                "key": f"{each.box}.{each.port}.{each.out}",
                "box": each.box,
                "port": each.port,
                "out": each.out,
                "atX": each.at[0],
                "atY": each.at[1],
                "known": each.known,
                "selected": each.box == wiring.selected and wiring.port == (each.port, each.out),
                "value": values.get(each.port, "") if each.box in (IN, OUT) else "",
            }
            for each in (picture.sockets if picture is not None else ())
        ]

    def _inputs(self) -> list[dict[str, Any]]:
        """Of the selected part, with what each can get."""
        wiring, part, graph = self._wiring, self._wiring.part, self._wiring.graph
        if part is None or graph is None or wiring.picture is None:
            return []
        about = {port.name: _about(port) for port in wiring.ports(part.name, "input")}
        rows = []
        for each in wiring.picture.sockets:
            if each.box == part.name and not each.out:
                selected = wiring.port == (each.port, False)
                place = f"{part.name}.{each.port}"
                sources = wiring.sources(place) if selected else []
                rows.append(
                    {
                        "name": each.port,
                        "about": about.get(each.port, ""),
                        "source": graph.source_of(place),
                        "selected": selected,
                        "sources": [
                            {
                                "id": one.id,
                                "kind": _kind(one.id),
                                "text": one.id.removeprefix(f"{IN}."),
                                "chosen": one.chosen,
                            }
                            for one in sources
                        ],
                    }
                )
        return rows

    def _outputs(self) -> list[dict[str, Any]]:
        """Of the selected part; or the own ports of IN, OUT, and where they go."""
        wiring, part, graph = self._wiring, self._wiring.part, self._wiring.graph
        if graph is None or wiring.picture is None:
            return []
        if wiring.selected == IN:
            goes = {own: ", ".join(places) for own, places in graph.inputs.items()}
        elif wiring.selected == OUT:
            goes = dict(graph.outputs)
        elif part is not None:
            told = {source: own for own, source in graph.outputs.items()}
            about = {port.name: _about(port) for port in wiring.ports(part.name, "output")}
            return [
                {
                    "name": each.port,
                    "about": about.get(each.port, ""),
                    "own": told.get(f"{part.name}.{each.port}", ""),
                    "goes": "",
                    "selected": wiring.port == (each.port, True),
                }
                for each in wiring.picture.sockets
                if each.box == part.name and each.out
            ]
        else:
            return []
        chosen = wiring.port[0] if wiring.port is not None else ""
        return [
            {"name": own, "about": "", "own": own, "goes": where, "selected": own == chosen}
            for own, where in goes.items()
        ]


def _kind(source: str) -> str:
    return "nothing" if source == NOTHING else "new" if source == NEW else "in" if source.startswith(IN) else "part"


def _about(port: NodePort) -> str:
    """What it is, of what kind, in which unit."""
    kind = f"{port.kind}, {port.unit}" if port.unit else port.kind
    return f"{kind}: {port.doc}" if port.doc else kind


def _fresh(document: Any, code: Any) -> bool:
    """Whether only this window knows a node yet."""
    known = {each.name for each in code.nodes}
    return document.kind == "node" and document.engine == code.engine and document.name not in known


def _value(port: NodePort) -> str:
    """Its newest value, as far as there is room for it."""
    value = port.value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:.4g} {port.unit}".rstrip()
    if isinstance(value, str):
        return value if len(value) <= _ROOM else value[: _ROOM - 1] + "…"
    return "" if value is None and not port.summary else "…"  # arrays, poses: `handrail node watch` has them
