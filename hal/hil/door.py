"""What a test may ask of the plant that no robot could: the truth at every step, drives that fail, joints put elsewhere.

One request, one answer, MessagePack over ZeroMQ at `plant.door` of the runtime folder. The plant serves it between two steps.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import zmq
from msgspec import Meta

from handrail.messages import GroundTruth
from handrail.runtime import Runtime

Positive = Annotated[float, Meta(gt=0)]


class DoorShut(Exception):
    """The plant refused what it was asked, or does not answer."""


class Fail(msgspec.Struct, tag=True, kw_only=True):
    """Let drives fault: error by its name (hal.drives.lifecycle.DriveError), `after` s of the plant's time from now."""

    joints: list[str]
    error: str
    after: float = 0.0


class Push(msgspec.Struct, tag=True, kw_only=True):
    """Push a link at its middle with a force N (world frame) for so many s of the plant's time."""

    link: str
    force: tuple[float, float, float]
    duration: Positive


class Place(msgspec.Struct, tag=True, kw_only=True):
    """Put joints at positions in rad, at rest, all brakes closed and drives switched off."""

    positions: dict[str, float]


class Look(msgspec.Struct, tag=True, kw_only=True):
    """What has been the case since the window began; `anew`: the next window begins now."""

    anew: bool = False


class Await(msgspec.Struct, tag=True, kw_only=True):
    """As Look, answered once the plant's clock is at `until_ns`, or the drives of `joints` are all in `state` (CiA 402, lower
    case); after `patience_s` of wall time in any case: nobody else is let in meanwhile."""

    until_ns: int | None = None
    joints: list[str] = []
    state: str = ""
    patience_s: float = 1.0


class Recall(msgspec.Struct, tag=True, kw_only=True):
    """Where the joints were at a moment of the last minute (ns of the plant's clock), to 10 ms."""

    time_ns: int


class Transition(msgspec.Struct, kw_only=True, frozen=True):
    """A drive came into another state."""

    time_ns: int
    joint: str
    state: str
    """CiA 402, lower case"""
    error: str
    """DriveError, lower case"""


class Seen(msgspec.Struct, tag=True, kw_only=True):
    """Answer to Look: every millisecond of a window of the plant's time. Arrays have one row a joint of `joints`."""

    joints: list[str]
    since_ns: int
    truth: GroundTruth
    """now"""
    velocity: list[float]
    """rad/s, now"""
    lowest: list[float]
    highest: list[float]
    """rad, of the window"""
    fastest: list[float]
    """rad/s, size, of the window"""
    speeding_ns: list[int]
    """how long each joint was faster than its velocity limit, at the longest stretch"""
    peak_contact_force: dict[str, float]
    """object → N, of the window"""
    states: list[str]
    """each drive's state now"""
    errors: list[str]
    braked: list[bool]
    transitions: list[Transition]
    """of the window, in order of time"""


class Was(msgspec.Struct, tag=True, kw_only=True):
    """Answer to Recall."""

    time_ns: int
    """at most 10 ms before the moment"""
    joints: dict[str, float]
    """rad"""


class Done(msgspec.Struct, tag=True):
    """Answer to the others."""

    time_ns: int


class No(msgspec.Struct, tag=True):
    """Answer to what can't be done."""

    why: str


Request = Fail | Push | Place | Look | Await | Recall
encode = msgspec.msgpack.encode
decode_request = msgspec.msgpack.Decoder(Request).decode
_decode_answer = msgspec.msgpack.Decoder(Seen | Was | Done | No).decode
_NAME = "plant.door"


def endpoint(runtime: Runtime) -> str:
    """Where the door is."""
    return runtime.endpoint(_NAME)


class Door:
    """The asker's side. One thread at a time."""

    def __init__(self, runtime: Runtime, timeout_s: float = 20.0):
        self._endpoint, self._timeout_s = endpoint(runtime), timeout_s
        self._socket: zmq.Socket = zmq.Context.instance().socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.connect(self._endpoint)

    def ask(self, request: Request) -> Seen | Was | Done:
        """Raises DoorShut when it is refused, or the plant does not answer."""
        self._socket.send(encode(request))
        if not self._socket.poll(round(self._timeout_s * 1000)):
            raise DoorShut(f"the plant does not answer at {self._endpoint}")
        answer = _decode_answer(self._socket.recv())
        if isinstance(answer, No):
            raise DoorShut(answer.why)
        return answer

    def close(self) -> None:
        self._socket.close()
