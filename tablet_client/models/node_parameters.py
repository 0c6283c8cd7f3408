"""Parameters of nodes that run, as an operator sets them: the latest value of each, one call at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from handrail.messages import Message, NodePort, NodeState, PutNode
from tablet_client.models.code import Code
from tablet_client.models.given import Given, of_port


@dataclass(frozen=True)
class Tuned:
    """A parameter of a node that runs."""

    node: str
    """as it is called where it runs"""
    given: Given
    doc: str


class NodeParameters:
    """Of the nodes that run of the document that is open."""

    def __init__(self, code: Code):
        self._code = code
        self._wanted: dict[tuple[str, str], Any] = {}
        """node and parameter → the value that is still to be sent"""
        self._out: PutNode | None = None
        self.problem = ""
        """why the last value was declined"""

    def all(self) -> list[Tuned]:
        """As they will stand once what is on its way has arrived."""
        document = self._code.document
        if document is None or document.kind != "node" or document.engine:
            return []
        return [
            Tuned(state.name, of_port(port, self._value(state.name, port)), port.doc)
            for state in self._code.running
            if state.node == document.name and state.state == "up"
            for port in state.ports
            if port.way == "parameter"
        ]

    def _value(self, node: str, port: NodePort) -> Any:
        if (node, port.name) in self._wanted:
            return self._wanted[node, port.name]
        if self._out is not None and self._out.name == node and port.name in self._out.params:
            return self._out.params[port.name]
        return port.value

    def put(self, node: str, parameter: str, value: Any) -> None:
        """A value was set; what its node would decline is not sent, and `problem` says why."""
        tuned = next((each for each in self.all() if (each.node, each.given.parameter.name) == (node, parameter)), None)
        if tuned is None:
            return
        if tuned.given.parameter.type == "integer" and isinstance(value, float) and value == round(value):
            value = round(value)
        if not (given := tuned.given.with_value(value)).fits:
            self.problem = f"{parameter}: got {value!r}; expected {given.expected or given.parameter.type}"
            return
        self.problem = ""
        self._wanted[node, parameter] = value

    def want(self) -> Iterator[Message]:
        """The call that is due: all that was set of one node."""
        if self._out is None and self._wanted:
            name = next(iter(self._wanted))[0]
            mine = {key: value for key, value in self._wanted.items() if key[0] == name}
            for key in mine:
                del self._wanted[key]
            self._out = PutNode(name=name, params={key[1]: value for key, value in mine.items()})
            yield self._out

    def take(self, call: Message, answer: Any) -> None:
        """An answer to one of these calls; others count for nothing."""
        if call is self._out:
            self._out = None
            if isinstance(answer, NodeState):
                self._code.running = [answer if each.name == answer.name else each for each in self._code.running]

    def failed(self, call: Message, why: str) -> bool:
        """It was declined, or not answered; False: it was none of these."""
        if call is not self._out:
            return False
        self._out, self.problem = None, why
        return True

    def anew(self) -> None:
        """The engine is gone: nothing is on its way."""
        self._wanted, self._out = {}, None
