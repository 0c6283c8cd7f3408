"""Reading and writing drives' parameters over a bus, one at a time, beside whoever else is on it."""

from __future__ import annotations

import itertools
import random
import time
from collections.abc import Callable, Iterable

from hal.can import frames
from hal.can.port import Port
from hal.drives.parameters import DICTIONARY, Parameter, ParameterResult
from hal.drives.protocol import LimbProtocol, ParameterReply
from hal.joint import JointState

_TRIES, _PATIENCE_S = 3, 0.4

_WORDS = {
    ParameterResult.UNKNOWN: "the drive has no such parameter",
    ParameterResult.READ_ONLY: "it can only be read",
    ParameterResult.OUT_OF_RANGE: "out of range",
    ParameterResult.WRONG_STATE: "not while the drive is in this state: disable the robot first",
}


class ParameterError(ValueError):
    """A drive refused, or did not answer; `str()` says joint, parameter and why."""


def converse(
    where: str,
    parameter: Parameter,
    value: float | None,
    send: Callable[[int], None],
    replies: Callable[[float], Iterable[ParameterReply]],
) -> ParameterReply:
    """Ask one drive for a parameter (`value` None) or to take a value, some times if need be; its answer, which is a good one.

    where: drive and parameter, for errors; `send`: the request under a sequence number, which tells its answer from those to
    others; `replies`: the drive's answers that arrive, after at most so many s. Raises ParameterError.
    """
    for _ in range(_TRIES):
        sequence = next(_sequences) & 0xFF
        send(sequence)
        asked = (parameter, sequence, value is not None)
        until, reply = time.monotonic() + _PATIENCE_S, None
        while reply is None and (left := until - time.monotonic()) > 0.0:
            reply = next((r for r in replies(left) if (r.index, r.sequence, r.write) == asked), None)
        if reply is None:
            continue
        if reply.result != ParameterResult.OK:
            known = reply.result in set(ParameterResult)
            words = _WORDS[ParameterResult(reply.result)] if known else f"refused with code {reply.result}"
            raise ParameterError(f"{where}{'' if value is None else f' {value:g}'}: {words}")
        return reply
    raise ParameterError(f"{where}: the drive does not answer; is it powered and on the bus (`handrail can stats`)?")


_sequences = itertools.count(random.randrange(256))


class ParameterClient:
    """Asks a robot's drives, by the joint's number."""

    def __init__(self, port: Port, protocol: LimbProtocol):
        self._port, self._protocol = port, protocol
        self._out, self._state = frames.empty(1), JointState(len(protocol.joints))

    def read(self, joint: int, parameter: Parameter) -> float:
        """A parameter's value. Raises ParameterError, hal.can.port.BusLost."""
        if not DICTIONARY[parameter].readable:
            raise ParameterError(f"{self._what(joint, parameter)}: can only be written")
        return self._ask(joint, parameter, None).value

    def write(self, joint: int, parameter: Parameter, value: float) -> float:
        """Write a value; what the drive reads it as afterwards. Raises ParameterError, hal.can.port.BusLost."""
        return self._ask(joint, parameter, value).value

    def _what(self, joint: int, parameter: Parameter) -> str:
        return f"{self._protocol.joints[joint]}: {parameter.name.lower()}"

    def _ask(self, joint: int, parameter: Parameter, value: float | None) -> ParameterReply:
        def send(sequence: int) -> None:
            if not self._protocol.encode_request(joint, parameter, value, sequence, self._out):
                family = self._protocol.program.joint_family[joint]
                raise ParameterError(f"{self._what(joint, parameter)}: drives of family {family} have no parameters")
            self._port.send(self._out)

        def replies(wait_s: float) -> Iterable[ParameterReply]:
            records = self._port.receive(wait_s)
            self._protocol.decode_status(records, len(records), self._state)
            return [reply for reply in self._protocol.replies() if reply.joint == joint]

        return converse(self._what(joint, parameter), parameter, value, send, replies)
