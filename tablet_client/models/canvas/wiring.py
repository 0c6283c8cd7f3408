"""The composite node that is open, as a picture that is edited: parts, the wires between them, what goes in and out.

As with a program's picture, every edit changes the text that the code page has open, too. What goes into a node and comes out of it
is asked of the engine, for the parts of the node that is open first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from handrail.graph_edit import GraphText
from handrail.messages import Message, NodePort
from handrail.port_kinds import misfit
from tablet_client.models.canvas import graph_picture
from tablet_client.models.canvas.editing import Editing
from tablet_client.models.canvas.graph import IN, OUT, Graph, Part, read
from tablet_client.models.canvas.graph_picture import GraphPicture, Socket
from tablet_client.models.canvas.node_ports import KnownPorts
from tablet_client.models.canvas.picture import Point
from tablet_client.models.code import Code, Document
from tablet_client.models.given import Given, of_port

NOTHING, NEW = "", ":new"
"""sources of an input that are no port: none, an own input that is made for it"""


@dataclass(frozen=True)
class Source:
    """What an input can get."""

    id: str
    """PART.output, `:in.NAME`, NOTHING or NEW"""
    chosen: bool


@dataclass(frozen=True)
class Setting:
    """A parameter of a part."""

    given: Given
    doc: str
    set: bool
    """the file gives it; else it is the node's own default"""
    own: str
    """the own parameter that it gets its value from; empty: none"""


class Wiring(Editing[GraphText, Graph, GraphPicture]):
    """What is drawn, and what one does with it. Selected is a part, IN or OUT."""

    def __init__(self, code: Code):
        super().__init__(code)
        self.port: tuple[str, bool] | None = None
        """a port of what is selected, and whether something comes out of it there"""
        self.known = KnownPorts()

    # ---------------------------------------------------------------------------------------------------------- shown

    def _shows(self, document: Document) -> bool:
        return document.kind == "node" and document.file.endswith(".yaml")

    def _open(self, text: str) -> GraphText:
        return GraphText(text)

    def _read(self, text: str) -> Graph:
        return read(text)

    def _lay_out(self, read: Graph) -> GraphPicture:
        return graph_picture.of(read, self.known.all)

    def _news(self) -> int:
        return self.known.news

    def _took(self, read: Graph) -> None:
        if self.selected not in (IN, OUT, *read.parts):
            self.select("")

    @property
    def graph(self) -> Graph | None:
        """The node as it stands; of a text that can't be read the last one that could be."""
        return self.read

    @property
    def part(self) -> Part | None:
        graph = self.graph
        return graph.parts.get(self.selected) if graph is not None else None

    def ports(self, part: str, way: str) -> list[NodePort]:
        """A part's; none where they are not known."""
        graph = self.graph
        return self.known.of(graph.parts[part].node, way) if graph is not None and part in graph.parts else []

    def nodes(self) -> list[tuple[str, str]]:
        """Nodes of the library that can be a part, with what they do; a file of the library that is none is left out."""
        own = self.document.name if self.document is not None else ""
        names = [each.name for each in self._code.nodes if each.name != own and not self.known.why_not(each.name)]
        return [(name, self.known.title(name)) for name in names]

    def settings(self) -> list[Setting]:
        """The selected part's parameters."""
        part, graph = self.part, self.graph
        if part is None or graph is None:
            return []
        outside = {place: own for own, places in graph.params.items() for place in places}
        return [
            Setting(
                of_port(port, part.params.get(port.name, port.value)),
                port.doc,
                port.name in part.params,
                outside.get(f"{part.name}.{port.name}", ""),
            )
            for port in self.ports(part.name, "parameter")
        ]

    def sources(self, to: str) -> list[Source]:
        """What an input (PART.port) of a part can get; what it gets now is among it, whatever it is."""
        graph = self.graph
        if graph is None:
            return []
        now, part = graph.source_of(to), to.partition(".")[0]
        target = self._port(to, "input")
        found = [NOTHING]
        for other in graph.parts:
            if other != part:
                found += [f"{other}.{port.name}" for port in self.ports(other, "output") if not _why_not(port, target)]
        found += [f"{IN}.{own}" for own in graph.inputs if not _why_not(self._value(f"{IN}.{own}"), target)]
        found.append(NEW)
        if now not in found:
            found.insert(1, now)
        return [Source(each, each == now) for each in found]

    def _port(self, place: str, way: str) -> NodePort | None:
        part, _, name = place.partition(".")
        return next((port for port in self.ports(part, way) if port.name == name), None)

    # ------------------------------------------------------------------------------------------------------- selected

    def select(self, box: str, port: tuple[str, bool] | None = None) -> None:
        self.selected, self.port, self.joining, self.said = box, port, False, ""

    def touch(self, point: Point) -> None:
        """A place of the picture was touched: a port, a wire (then where it leads), a box, or the ground."""
        picture = self.picture
        if picture is None:
            return
        socket, box = picture.socket_at(point), picture.box_at(point)
        if self.joining and self.port is not None and (socket is not None or box):
            self._join((self.selected, *self.port), socket, box)
        elif socket is not None:
            self.select(socket.box, (socket.port, socket.out))
        elif not box and (wire := picture.wire_at(point)) is not None:
            self.select(wire.target[0], (wire.target[1], False))
        else:
            self.select(box)

    def join(self, box: str, port: str, out: bool, point: Point) -> None:
        """A wire was drawn from a port to a place in the picture."""
        picture = self.picture
        if picture is not None:
            socket, there = picture.socket_at(point), picture.box_at(point)
            if socket is not None or there:
                self._join((box, port, out), socket, there)

    def beside(self, step: int) -> None:
        """Select the next box, or the one before, in the order in which they are drawn."""
        picture = self.picture
        if picture is not None and picture.boxes:
            names = list(picture.boxes)
            at = names.index(self.selected) + step if self.selected in names else 0
            self.select(names[at % len(names)])

    # --------------------------------------------------------------------------------------------------------- edited

    def why_not_edit(self) -> str:
        """Code of the reason why nothing can be changed here."""
        return "builtin" if self.document is not None and self.document.builtin else super().why_not_edit()

    def add(self, node: str) -> None:
        """A node of the library as one more part."""
        graph = self.graph
        if graph is None:
            return
        name = _free(node, graph.parts)
        if self._edit(lambda text: text.add_part(name, node)):
            self.select(name)

    def rename(self, to: str) -> None:
        """The selected own port, else the selected part."""
        graph, name = self.graph, self.selected
        if graph is None or not to:
            return
        if name in (IN, OUT) and self.port is not None:
            own, field = self.port[0], "inputs" if name == IN else "outputs"
            if own != to and self._edit(lambda text: text.rename_own(field, own, to)):
                self.select(name, (to, name == IN))
        elif name in graph.parts and name != to and self._edit(lambda text: text.rename_part(name, to)):
            self.select(to)

    def remove(self) -> None:
        """What the selected input gets, or the selected own port; else the selected part, with all its wires."""
        graph, name, port = self.graph, self.selected, self.port
        if graph is None:
            return
        if name in (IN, OUT):
            if port is not None and self._edit(
                lambda text: text.remove(["inputs" if name == IN else "outputs", port[0]])
            ):
                self.select("")
        elif port is not None and not port[1] and graph.source_of(f"{name}.{port[0]}"):
            self.feed(f"{name}.{port[0]}", NOTHING)
        elif name in graph.parts and self._edit(lambda text: text.remove_part(name)):
            self.select("")

    def feed(self, to: str, source: str) -> None:
        """A part's input gets one of `sources`, and nothing else any more."""
        graph = self.graph
        if graph is None or graph.source_of(to) == source:
            return
        if source == NOTHING:
            done = self._edit(lambda text: text.unwire(to))
        elif source == NEW:
            own = self._own_name(to.partition(".")[2])
            done = self._edit(lambda text: text.give("inputs", own, to))
        elif source.startswith(f"{IN}."):
            done = self._edit(lambda text: text.give("inputs", source.removeprefix(f"{IN}."), to))
        else:
            done = self._edit(lambda text: text.wire(to, source))
        if done:
            part, _, port = to.partition(".")
            self.select(part, (port, False))

    def tell(self, source: str, on: bool) -> None:
        """Whether a part's output (PART.port) is one of its own."""
        graph = self.graph
        if graph is None:
            return
        own = next((own for own, each in graph.outputs.items() if each == source), "")
        if on and not own:
            fresh = self._own_name(source.partition(".")[2])
            self._edit(lambda text: text.tell(fresh, source))
        elif own and not on:
            self._edit(lambda text: text.remove(["outputs", own]))

    def give(self, name: str, value: Any) -> None:
        """A value for a parameter of the selected part; its default needs none."""
        part = self.part
        setting = next((each for each in self.settings() if each.given.parameter.name == name), None)
        if part is None or setting is None:
            return
        port = self._port(f"{part.name}.{name}", "parameter")
        if port is not None and not (fitting := of_port(port, value)).fits:
            self.said = f"{name}: got {value!r}; expected {fitting.expected or fitting.parameter.type}"
            return
        path = ["nodes", part.name, "params", name]
        if port is not None and value == port.value:
            if setting.set:
                self._edit(lambda text: text.remove(path), ".".join(path))
        elif value != part.params.get(name):
            self._edit(lambda text: text.set(path, value), ".".join(path))

    def outside(self, name: str, on: bool) -> None:
        """Whether a parameter of the selected part is one of its own."""
        part = self.part
        own = next((each.own for each in self.settings() if each.given.parameter.name == name), "")
        if part is None:
            return
        place = f"{part.name}.{name}"
        if on and not own:
            fresh = self._own_name(name)
            self._edit(lambda text: text.give("params", fresh, place))
        elif own and not on:
            self._edit(lambda text: text.take("params", own, place))

    def put(self, field: str, typed: str) -> None:
        """Its title, or how often it steps, as it was typed; empty: it has none."""
        typed = typed.strip()
        if field == "every" and typed:
            try:
                value = float(typed)
            except ValueError:
                value = math.nan
            if not 0.0 <= value < math.inf:
                self.said = f"every: got {typed!r}; expected a time in s, 0 for on and on, or nothing: when it is asked"
                return
            self._edit(lambda text: text.set(["every"], value))
        elif typed:
            self._edit(lambda text: text.set([field], typed))
        elif self.graph is not None and getattr(self.graph, field) not in ("", None):
            self._edit(lambda text: text.remove([field]))

    def _join(self, start: tuple[str, str, bool], socket: Socket | None, box: str) -> None:
        """From a port to another one, or to a box: to the first port of it that fits."""
        self.joining, self.said = False, ""
        name, port, out = start
        box = socket.box if socket is not None else box
        other = socket.port if socket is not None and socket.out != out else ""
        (source, output), (target, input_) = ((name, port), (box, other)) if out else ((box, other), (name, port))
        if source in (target, OUT) or target == IN or (source, target) == (IN, OUT):
            self.said = "expected a wire from a part's output, or from an input of all, to another part, or out of all"
        elif target == OUT:
            output = output or next((each.name for each in self.ports(source, "output")), "")
            self.tell(f"{source}.{output}", True)
        elif source == IN and not output:
            self.feed(f"{target}.{input_}", NEW)
        else:
            self._wire(source, output, target, input_)

    def _wire(self, source: str, output: str, target: str, input_: str) -> None:
        """From a box to a box, from the first of its ports (or the one that is named) to the first that it fits."""
        graph = self.graph
        assert graph is not None
        outputs = [output] if output else [each.name for each in self.ports(source, "output")]
        inputs = [input_] if input_ else [each.name for each in self.ports(target, "input")]
        why = f"{target} has no input, as far as it is known" if not inputs else f"{source} has no output"
        for to in sorted(inputs, key=lambda each: bool(graph.source_of(f"{target}.{each}"))):  # what has none yet first
            for each in outputs:
                found = _why_not(self._value(f"{source}.{each}"), self._port(f"{target}.{to}", "input"))
                if not found:
                    self.feed(f"{target}.{to}", f"{source}.{each}")
                    return
                why = f"{source}.{each} → {target}.{to}: {found}"
        self.said = why

    def _value(self, source: str) -> NodePort | None:
        """What comes out of a part, or in from outside: as the first port that it goes to takes it."""
        if not source.startswith(f"{IN}."):
            return self._port(source, "output")
        places = self.graph.inputs.get(source.removeprefix(f"{IN}."), ()) if self.graph is not None else ()
        return self._port(places[0], "input") if places else None

    def _own_name(self, like: str) -> str:
        graph = self.graph
        taken = {*graph.inputs, *graph.params, *graph.outputs} if graph is not None else set()
        return _free(like, taken)

    # ------------------------------------------------------------------------------------------------------- its calls

    def want(self) -> Iterator[Message]:
        """The call that is due: the ports of its parts first, then of all nodes that could be one."""
        self.known.at(self._code.engine)
        graph = self.graph
        if self.watched and graph is not None:
            yield from self.known.want(
                (*(each.node for each in graph.parts.values()), *(name for name, _ in self.nodes()))
            )


def _why_not(source: NodePort | None, target: NodePort | None) -> str:
    """Why what comes out of one port is nothing for another; empty: it is, or nobody knows yet."""
    if source is None or target is None:
        return ""
    what, got, taken = misfit(source.kind, source.unit, target.kind, target.unit)
    return f"{what} {got}, expected {taken}" if what else ""


def _free(like: str, taken: Mapping[str, Any] | set[str]) -> str:
    number, name = 1, like
    while name in taken:
        number += 1
        name = f"{like}_{number}"
    return name
