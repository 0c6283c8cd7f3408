"""What goes into the nodes of an engine's library and comes out of them, asked of the engine one by one: it loads them for that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from handrail.messages import GetNodePorts, Message, NodePort, NodePorts


class KnownPorts:
    """Of one engine's nodes. When its code becomes another they are asked anew, and what was known stays until then."""

    def __init__(self) -> None:
        self._told: dict[str, NodePorts] = {}
        self._why: dict[str, str] = {}
        """node → why its ports are not known"""
        self._fresh: set[str] = set()
        """nodes that were asked since the code was another one"""
        self._asked: GetNodePorts | None = None
        self._engine = ""
        self.news = 0
        """rises with all that is learnt"""

    @property
    def all(self) -> Mapping[str, Sequence[NodePort]]:
        """node → its ports, of those that are known"""
        return {node: each.ports for node, each in self._told.items()}

    def of(self, node: str, way: str) -> list[NodePort]:
        """Its inputs, outputs or parameters (`way`); none where they are not known."""
        told = self._told.get(node)
        return [port for port in told.ports if port.way == way] if told is not None else []

    def title(self, node: str) -> str:
        """What it does; empty: not known (yet)."""
        told = self._told.get(node)
        return told.title if told is not None else ""

    def why_not(self, node: str) -> str:
        """Why its ports are not known; empty: they are, or are still to be asked."""
        return self._why.get(node, "")

    def at(self, engine: str) -> None:
        """From here on another engine's nodes."""
        if engine != self._engine:
            self._engine, self._told = engine, {}
            self.anew()

    def want(self, nodes: Iterable[str]) -> Iterator[Message]:
        """The call that is due, one at a time, for the first of the nodes that is to be asked."""
        for node in nodes if self._asked is None else ():
            if node and node not in self._fresh and node not in self._why:
                self._asked = GetNodePorts(node=node, engine=self._engine)
                yield self._asked
                return

    def take(self, call: Message, answer: object) -> None:
        """An answer to one of these calls; others count for nothing."""
        if call is self._asked and isinstance(answer, NodePorts):
            self._asked = None
            self._told[answer.node] = answer
            self._fresh.add(answer.node)
            self.news += 1

    def failed(self, call: Message, why: str) -> bool:
        """One of them was refused, or not answered; False: it was none of these."""
        if call is not self._asked or not isinstance(call, GetNodePorts):
            return False
        self._asked = None
        self._why[call.node] = why
        self._told.pop(call.node, None)
        self.news += 1
        return True

    def anew(self) -> None:
        """The engine has come back, or has other code."""
        self._why, self._asked = {}, None
        self._fresh.clear()
        self.news += 1
