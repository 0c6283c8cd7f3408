"""A loop that was recorded, as it is found again: what it started from, and what it took in and commanded, cycle by cycle."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt

from daemon.exchange import COMMAND, ControllerState
from daemon.replay.tape import Entry, Kind, Words
from daemon.safety.stop_socket import StopRequest
from hal.can.frames import RECORD
from handrail.robot.description import RobotDescription
from handrail.robot.keepsake import keepsake

_HEADER = COMMAND.itemsize // 8


class LoopStart(msgspec.Struct, kw_only=True):
    """All that a loop is made of, but for its code."""

    robot: str
    """name"""
    clock: str
    """wall or lockstep"""
    joints: list[str]
    """the rows of everything that has one a joint"""
    files: dict[str, str]
    """the robot's folder in one piece (handrail.robot.keepsake)"""
    made_with: dict[str, str] = {}
    """what may round a float64 otherwise: processor, libraries and their versions"""

    @classmethod
    def of(cls, description: RobotDescription, clock: str) -> LoopStart:
        """What a loop that starts now starts from."""
        return cls(
            robot=description.name,
            clock=clock,
            joints=list(description.joints),
            files=keepsake(description),
            made_with=made_with(),
        )


def made_with() -> dict[str, str]:
    """What computes here: libraries choose their kernels by the processor, and each may sum in an order of its own."""
    found = {name: metadata.version(name) for name in ("numpy", "numba", "pin")}
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        found["processor"] = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return found


@dataclass
class Cycle:
    """One cycle as it was recorded; queues hold what it took in, in order."""

    number: int
    time_ns: int
    """of the robot's clock; in lock-step the cycle before's, since this one's comes from the bus"""
    received: deque[tuple[int, npt.NDArray[np.void]]] = field(default_factory=deque)
    """plant's ticks so far, frames"""
    stops: deque[tuple[int, StopRequest]] = field(default_factory=deque)
    """how often the bus had been looked at before, request"""
    orders: deque[tuple[np.ndarray, np.ndarray]] = field(default_factory=deque)
    """header COMMAND (1,), payload"""
    waits: deque[bool] = field(default_factory=deque)
    controllers: deque[tuple[int, ControllerState]] = field(default_factory=deque)
    motions: deque[bool] = field(default_factory=deque)
    sent: list[npt.NDArray[np.void]] = field(default_factory=list)
    command: Words | None = None
    """memory of the JointCommand that it decided on; None: the recording breaks off in this cycle"""
    then: list[Then] = field(default_factory=list)
    """what happened before the next cycle"""
    last_sent: list[npt.NDArray[np.void]] | None = None
    """what the loop sent at its end; None: it went on"""


@dataclass(frozen=True)
class Then:
    """Something between two cycles: an order (was its prepared motion there? Cycle.motions), a stop request, or periods skipped."""

    order: tuple[np.ndarray, np.ndarray] | None = None
    stop: StopRequest | None = None
    skipped: int = 0


def cycles(entries: Iterable[Entry]) -> Iterator[Cycle]:
    """The cycles that the entries of one loop tell, START left out. Raises ValueError where one is missing."""
    cycle: Cycle | None = None
    for entry in entries:
        if cycle is None or entry.cycle != cycle.number:
            expected = 1 if cycle is None else cycle.number + 1
            if entry.cycle != expected:
                raise ValueError(f"cycle {entry.cycle} follows where {expected} should: something is missing")
            if cycle is not None:
                yield cycle
            cycle = Cycle(entry.cycle, entry.time_ns)
        _add(cycle, entry)
    if cycle is not None:
        yield cycle


def _add(cycle: Cycle, entry: Entry) -> None:
    body, over = entry.body, cycle.command is not None
    match entry.kind:
        case Kind.RECEIVED:
            cycle.received.append((int(body[0]), body[1:].view(RECORD)))
        case Kind.SENT:
            (cycle.sent if cycle.last_sent is None else cycle.last_sent).append(body.view(RECORD))
        case Kind.COMMAND:
            cycle.command = body[2:]
        case Kind.ORDER:
            order = body[:_HEADER].view(COMMAND), body[_HEADER:].view(np.float64)
            if over:
                cycle.then.append(Then(order=order))
            else:
                cycle.orders.append(order)
        case Kind.STOP:
            request = StopRequest(bool(body[0]), body[2:].tobytes()[: int(body[1])].decode())
            if over:
                cycle.then.append(Then(stop=request))
            else:
                cycle.stops.append((len(cycle.received), request))
        case Kind.WAIT:
            cycle.waits.append(bool(body[0]))
        case Kind.CONTROLLER:
            cycle.controllers.append((int(body[0]), ControllerState(int(body[1]))))
        case Kind.MOTION:
            cycle.motions.append(bool(body[1]))
        case Kind.SKIP:
            cycle.then.append(Then(skipped=int(body[0])))
        case Kind.END:
            cycle.last_sent = []
        case _:
            raise ValueError(f"cycle {entry.cycle}: a {entry.kind.name} does not belong there")
