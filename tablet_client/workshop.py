"""The desks of what is made and looked into at the robot: its output, the code of its nodes and programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from PySide6.QtCore import Property, QObject

from handrail.messages import GetNodes, Message
from tablet_client.canvas_desk import CanvasDesk
from tablet_client.code_desk import CodeDesk
from tablet_client.graph_desk import GraphDesk
from tablet_client.models.situation import Situation
from tablet_client.node_desk import NodeDesk
from tablet_client.output_desk import OutputDesk
from tablet_client.session import Session

_NODES_S = 3.0
"""between two questions which nodes run, while somebody looks"""


class Workshop(QObject):
    """Made by the desk; QML has its parts as `desk.workshop.output` and so on."""

    def __init__(self, situation: Situation, send: Callable[[Message], None], soon: Callable[[], None]):
        """`send` sends what a button asked for, `soon` has the models looked at anew."""
        super().__init__()
        self._situation = situation
        self._output = OutputDesk(situation, soon)
        self._code = CodeDesk(situation, send, soon)
        self._canvas = CanvasDesk(situation, self._code, soon)
        self._graph = GraphDesk(situation, self._code, soon)
        self._nodes = NodeDesk(situation, soon)
        self._nodes_asked = float("-inf")

    def serve(self, session: Session) -> None:
        """Hear and ask through this session from now on."""
        self._output.serve(session.hear)

    @Property(QObject, constant=True)
    def output(self) -> OutputDesk:
        return self._output

    @Property(QObject, constant=True)
    def code(self) -> CodeDesk:
        return self._code

    @Property(QObject, constant=True)
    def canvas(self) -> CanvasDesk:
        return self._canvas

    @Property(QObject, constant=True)
    def graph(self) -> GraphDesk:
        return self._graph

    @Property(QObject, constant=True)
    def nodes(self) -> NodeDesk:
        return self._nodes

    def want(self, now: float) -> Iterator[Message]:
        """The calls that are due, at a time in s that only rises."""
        situation = self._situation
        watched = (
            self._output.watched or situation.code.watched or situation.wiring.watched or situation.signals.watched
        )
        if watched and now - self._nodes_asked >= _NODES_S:
            self._nodes_asked = now
            yield GetNodes()
        self._situation.code.at(self._situation.launch.engine)
        yield from self._situation.code.want()
        yield from self._situation.wiring.want()
        yield from self._situation.node_parameters.want()
        yield from self._situation.signals.want(now)

    def build(self) -> None:
        """Look at the models anew."""
        self._output.build()
        self._code.build()
        self._canvas.build()
        self._graph.build()
        self._nodes.build()
