"""Reading and writing drives' parameters over a bus, one at a time, beside whoever else is on it."""

from __future__ import annotations

import random
import time

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


class ParameterClient:
    """Asks a robot's drives. Its own sequence numbers tell its answers from those to others."""

    def __init__(self, port: Port, protocol: LimbProtocol):
        self._port, self._protocol = port, protocol
        self._out, self._state = frames.empty(1), JointState(len(protocol.joints))
        self._sequence = random.randrange(256)

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
        for _ in range(_TRIES):
            self._sequence = (self._sequence + 1) & 0xFF
            if not self._protocol.encode_request(joint, parameter, value, self._sequence, self._out):
                family = self._protocol.program.joint_family[joint]
                raise ParameterError(f"{self._what(joint, parameter)}: drives of family {family} have no parameters")
            self._port.send(self._out)
            reply = self._wait(joint, parameter, value is not None)
            if reply is None:
                continue
            if reply.result != ParameterResult.OK:
                known = reply.result in set(ParameterResult)
                words = _WORDS[ParameterResult(reply.result)] if known else f"refused with code {reply.result}"
                asked = "" if value is None else f" {value:g}"
                raise ParameterError(f"{self._what(joint, parameter)}{asked}: {words}")
            return reply
        raise ParameterError(
            f"{self._what(joint, parameter)}: the drive does not answer; is it powered and on the bus (`handrail can stats`)?"
        )

    def _wait(self, joint: int, parameter: Parameter, write: bool) -> ParameterReply | None:
        until = time.monotonic() + _PATIENCE_S
        while (left := until - time.monotonic()) > 0.0:
            records = self._port.receive(left)
            self._protocol.decode_status(records, len(records), self._state)
            for reply in self._protocol.replies():
                if (reply.joint, reply.index, reply.sequence, reply.write) == (joint, parameter, self._sequence, write):
                    return reply
        return None
