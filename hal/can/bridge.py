"""A bridge between two buses: what one carries, the other does too, both ways, and nothing comes back as an echo.

Most interfaces never give a process its own frames back. For those that do (udp_multicast), the bridge knows what it has sent
and drops the first of it that returns. One thread carries both ways where both interfaces can be waited on; else each has its own.
"""

from __future__ import annotations

import hashlib
import os
import select
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import can

from handrail.sole_holder import HeldElsewhere, sole_holder

ECHOING = frozenset({"udp_multicast"})
"""interfaces that give a process its own frames back, whatever it asks for"""

_PATIENCE_S = 0.2
"""the longest wait for a frame, so that the end is noticed"""
_TURN = 64
_PRIORITY = 75  # of SCHED_FIFO: between the plant's and the daemon's
_ECHO_S = 2.0
"""what has not come back by then was lost on the way: the next of the kind is no echo"""


class EchoFilter:
    """Frames that were sent and shall not be taken for somebody else's when they return. For two threads."""

    def __init__(self, forget_s: float = _ECHO_S, clock: Callable[[], float] = time.monotonic):
        self._sent: OrderedDict[tuple[object, ...], list[float]] = OrderedDict()
        self._forget_s, self._clock, self._lock = forget_s, clock, threading.Lock()

    @staticmethod
    def _key(message: can.Message) -> tuple[object, ...]:
        return (
            message.arbitration_id, message.is_extended_id, message.is_remote_frame, message.is_fd, message.dlc,
            bytes(message.data),
        )  # fmt: skip

    def sent(self, message: can.Message) -> None:
        """It is about to go out."""
        with self._lock:
            now = self._clock()
            key = self._key(message)
            self._sent.setdefault(key, []).append(now)
            self._sent.move_to_end(key)
            while self._sent:  # oldest kinds first
                oldest = next(iter(self._sent))
                if now - self._sent[oldest][-1] <= self._forget_s:
                    break
                del self._sent[oldest]

    def is_echo(self, message: can.Message) -> bool:
        """Whether this is one that was sent; each is dropped once."""
        with self._lock:
            key, now = self._key(message), self._clock()
            times = self._sent.get(key)
            while times and now - times[0] > self._forget_s:
                times.pop(0)
            if not times:
                self._sent.pop(key, None)
                return False
            times.pop(0)
            if not times:
                del self._sent[key]
            return True


def _together(one: can.BusABC, other: can.BusABC) -> select.poll | None:
    """What waits for frames on either, None where an interface can't be waited on."""
    waiting = select.poll()
    try:
        for bus in (one, other):
            waiting.register(bus.fileno(), select.POLLIN)
    except (NotImplementedError, OSError, ValueError):
        return None
    return waiting


def _hurry() -> None:
    """Run this thread before those of ordinary programs where that is permitted: a drive's answer waits for it."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))


@dataclass
class Side:
    """One end of a bridge, and what came through it."""

    name: str
    """for people: interface and channel"""
    bus: can.BusABC
    echoes: bool = False
    """the interface gives back what it is sent"""
    taken: int = 0
    """frames that came from it and went out on the other"""
    refused: int = 0
    """frames from it that the other did not take: its transmit queue was full, or it carries no such frames"""
    errors: int = 0
    """error frames; they stay on their own bus"""
    why_refused: str = ""
    echo: EchoFilter = field(default_factory=EchoFilter)


class Bridge:
    """Carries frames between two buses, from `start` until `end` or until one of them ends. The buses are closed by `end`."""

    def __init__(self, one: Side, other: Side):
        self.sides = (one, other)
        self.problem = ""
        """why it ended by itself"""
        self.ended = threading.Event()
        self._poll = _together(one.bus, other.bus)
        ways = [(self._carry_both, ())] if self._poll else [(self._carry, (one, other)), (self._carry, (other, one))]
        self._threads = [threading.Thread(target=way, args=pair, daemon=True) for way, pair in ways]

    def start(self) -> None:
        """Begin."""
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Stop and leave both buses."""
        self.ended.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()
        for side in self.sides:
            side.bus.shutdown()

    def _carry_both(self) -> None:
        """Both directions, where both interfaces can be waited on at once."""
        assert self._poll is not None
        _hurry()
        one, other = self.sides
        while not self.ended.is_set():
            if self._poll.poll(_PATIENCE_S * 1000):
                for source, target in ((one, other), (other, one)):
                    for _ in range(_TURN):  # a flood from one side can't starve the other
                        if not self._carry_one(source, target, 0.0):
                            break

    def _carry(self, source: Side, target: Side) -> None:
        """One direction, in a thread of its own."""
        _hurry()
        while not self.ended.is_set():
            self._carry_one(source, target, _PATIENCE_S)

    def _carry_one(self, source: Side, target: Side, wait_s: float) -> bool:
        """Take at most one frame across; False when none came."""
        try:
            message = source.bus.recv(wait_s)
        except (can.CanError, OSError, ValueError) as error:
            self._fail(f"{source.name}: {error}")
            return False
        if message is None:
            return False
        if message.is_error_frame:
            source.errors += 1
            return True
        if source.echoes and source.echo.is_echo(message):
            return True
        # A message's channel is that of where it came from.
        message.channel, message.is_rx = None, False
        if target.echoes:
            target.echo.sent(message)
        try:
            target.bus.send(message, timeout=0.0)
        except (can.CanOperationError, ValueError) as error:
            if target.echoes:
                target.echo.is_echo(message)  # it never left
            source.refused += 1
            source.why_refused = str(error)
        except (can.CanError, OSError) as error:
            self._fail(f"{target.name}: {error}")
            return False
        else:
            source.taken += 1
        return True

    def _fail(self, problem: str) -> None:
        if not self.ended.is_set():
            self.problem = problem
            self.ended.set()


@contextmanager
def only_bridge(folder: Path, *ends: str) -> Iterator[None]:
    """Hold the one place that there is for a bridge between these ends: a second one would send every frame round for ever.

    Raises ValueError when another process has it.
    """
    name = hashlib.sha256("\n".join(sorted(ends)).encode()).hexdigest()[:16]
    with ExitStack() as held:
        try:
            held.enter_context(sole_holder(folder / f"bridge-{name}.lock"))
        except HeldElsewhere as error:
            raise ValueError(
                f"{' and '.join(ends)} are bridged already (process {error.process}): "
                "two bridges would send every frame round for ever"
            ) from error
        yield
