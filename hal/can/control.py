"""Talking to the hub about the bus itself: who is on it, how loaded it is, and which faults it shall have.

The same socket as the frames' (hal.can.wire), joined with `Hello(role="control")`: then every datagram is one request in JSON,
answered by one datagram: `{"type":"get_bus"}`, `{"type":"get_node","name":"daemon"}`, `{"type":"clear_fault"}`,
`{"type":"add_fault","fault":{"kind":"drop"}}`. The hub answers between two turns of the bus; nothing here touches the way of the
frames.
"""

from __future__ import annotations

import os
import select

import msgspec

from hal.can import wire
from hal.can.faults import Fault
from hal.can.wire import BusLost, Sorry

_ANSWER_S = 5.0
_ROOM = 1 << 20


class IdentifierLoad(msgspec.Struct, kw_only=True):
    """What frames of one identifier have cost so far."""

    can_id: int
    extended: bool
    frames: int
    busy_ns: int


class NodeState(msgspec.Struct, kw_only=True):
    """One node on one channel, after ISO 11898-1's fault confinement."""

    name: str
    channel: str
    state: str
    """error_active, error_passive, bus_off or cut"""
    transmit_errors: int | None
    receive_errors: int | None
    """TEC and REC; None: a real controller's that does not tell them"""
    waiting: int
    """frames in its transmit FIFO"""
    overflows: int
    """frames refused since the FIFO was full, or thrown away at bus-off"""
    unread: int = 0
    """frames of all its channels that the hub keeps for it since its process has not read the earlier ones"""


class ChannelState(msgspec.Struct, kw_only=True):
    """One channel."""

    name: str
    bitrate: int
    data_bitrate: int
    frames: int
    busy_ns: int
    error_frames: int
    load: float
    """share of the time in use over about the last second of the bus's clock"""
    identifiers: list[IdentifierLoad]


class BusReport(msgspec.Struct, tag="bus", kw_only=True):
    """Answer to `GetBus`: everything about the bus at one moment."""

    time_ns: int
    """of the bus's clock"""
    timing: bool
    """frames take the time that they would on a real bus"""
    channels: list[ChannelState]
    nodes: list[NodeState]
    faults: dict[int, Fault]
    """number → fault that is on the bus, waiting or acting"""
    hits: dict[int, int]
    """number → frames hit so far"""


class GetBus(msgspec.Struct, tag="get_bus"):
    """Asks for a `BusReport`."""


class GetNode(msgspec.Struct, tag="get_node", kw_only=True, forbid_unknown_fields=True):
    """Asks how one node fares; answered by `NodeStates`, which costs the hub next to nothing."""

    name: str


class NodeStates(msgspec.Struct, tag="node", kw_only=True):
    """The node on each of its channels; none where nobody is called so."""

    nodes: list[NodeState]


class AddFault(msgspec.Struct, tag="add_fault", kw_only=True, forbid_unknown_fields=True):
    """Lays a fault on the bus; answered by `FaultAdded`."""

    fault: Fault


class FaultAdded(msgspec.Struct, tag="fault_added", kw_only=True):
    """The fault's number, by which it is cleared and reported."""

    number: int


class ClearFault(msgspec.Struct, tag="clear_fault", kw_only=True, forbid_unknown_fields=True):
    """Takes a fault back; None: all of them. Answered by `FaultsCleared`."""

    number: int | None = None


class FaultsCleared(msgspec.Struct, tag="faults_cleared", kw_only=True):
    """How many faults were taken back."""

    count: int


Answer = BusReport | NodeStates | FaultAdded | FaultsCleared | Sorry
decode_request = msgspec.json.Decoder(GetBus | GetNode | AddFault | ClearFault).decode
_decode_answer = msgspec.json.Decoder(Answer).decode


class HubControl:
    """A connection to the hub at `path` (Runtime.bus) that is about the bus, not on it."""

    def __init__(self, path: str | os.PathLike[str], *, timeout_s: float = 5.0):
        """Raises BusLost when no hub answers within `timeout_s`, ValueError when it refuses."""
        self._path = path
        self._socket, self.channels = wire.join(path, timeout_s=timeout_s, role="control")
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def report(self) -> BusReport:
        """The bus at this moment. Raises BusLost."""
        answer = self._ask(GetBus())
        assert isinstance(answer, BusReport)
        return answer

    def node(self, name: str) -> list[NodeState]:
        """The node of this name on each of its channels; none where nobody is called so. Raises BusLost."""
        answer = self._ask(GetNode(name=name))
        assert isinstance(answer, NodeStates)
        return answer.nodes

    def add(self, fault: Fault) -> int:
        """Lay a fault on the bus; returns its number. Raises ValueError with the hub's words when it refuses, BusLost."""
        answer = self._ask(AddFault(fault=fault))
        assert isinstance(answer, FaultAdded)
        return answer.number

    def clear(self, number: int | None = None) -> int:
        """Take back one fault, or all; returns how many. Raises ValueError when there is no such fault, BusLost."""
        answer = self._ask(ClearFault(number=number))
        assert isinstance(answer, FaultsCleared)
        return answer.count

    def close(self) -> None:
        """Leave. Faults that were laid on the bus stay."""
        self._socket.close()

    def _ask(self, request: GetBus | GetNode | AddFault | ClearFault) -> Answer:
        try:
            self._socket.send(wire.encode(request))
            if not self._poll.poll(_ANSWER_S * 1000):
                raise BusLost(f"CAN bus at {self._path}: its hub does not answer within {_ANSWER_S:g} s")
            datagram = self._socket.recv(_ROOM)
        except OSError as error:
            raise error if isinstance(error, BusLost) else BusLost(f"CAN bus at {self._path}: {error}") from error
        if not datagram:
            raise BusLost(f"CAN bus at {self._path}: the hub has ended")
        answer = _decode_answer(datagram)
        if isinstance(answer, Sorry):
            raise ValueError(answer.reason)
        return answer
