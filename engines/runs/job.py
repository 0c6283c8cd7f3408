"""What an engine is busy with, one at a time: a program's run, or a motion that an operator asked for by itself. In a pause of a
run there may be both.
"""

from __future__ import annotations

import functools
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol

from engines.activities.base import Services
from engines.runs.motion import Motion
from engines.runs.parts import Parts
from handrail.topics import Unreachable, refuse


class Job(Protocol):
    """Can be paused, resumed and stopped, and that acts on the motion."""

    @property
    def active(self) -> bool: ...
    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def stop(self) -> None: ...
    def join(self, timeout_s: float) -> None: ...


class Lender(Protocol):
    """A paused run, beside which the operator moves the robot by hand."""

    @property
    def active(self) -> bool: ...
    @property
    def parts(self) -> Parts: ...
    def lend(self, joints: Sequence[str]) -> None: ...


class MotionJob(ABC):
    """A motion without a program, in a thread of its own."""

    def __init__(self, services: Services, name: str, joints: Sequence[str], lender: Lender | None = None):
        """`name`: of the thread, which `_drive` runs in once it is started; `joints`: that it moves, lent by `lender`."""
        self._services, self._joints, self._lender = services, joints, lender
        parts = Parts(services.daemon, services.description.groups) if lender is None else lender.parts
        self._motion = Motion(services.daemon, parts, robot=services.description)
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self._drive, name=name, daemon=True)

    @property
    def paused(self) -> bool:
        """Whether it stands, as asked."""
        return self._motion.paused

    def pause(self) -> None:
        """Stop along its path."""
        reach(self._motion.pause)

    def resume(self) -> None:
        """Go on."""
        reach(self._motion.resume)

    def stop(self) -> None:
        """Cancel the motion; the robot holds."""
        self._cancelled.set()
        reach(self._motion.interrupt)

    def join(self, timeout_s: float) -> None:
        """Wait until it has ended."""
        self._thread.join(timeout_s)

    def _borrow(self) -> None:
        """Have a paused run let go of the joints. Raises RefusedError."""
        if self._lender is not None:
            reach(functools.partial(self._lender.lend, self._joints))

    def _give_back(self) -> None:
        """Nothing moves any more; what a paused run has taken is the run's still."""
        if self._lender is None or not self._lender.active:
            self._motion.end()

    @abstractmethod
    def _drive(self) -> None:
        """Until nothing moves any more."""


def reach(command: Callable[[], None]) -> None:
    """Do it. Raises RefusedError where the daemon does not answer."""
    try:
        command()
    except Unreachable as silent:
        raise refuse(f"the daemon does not answer: {silent}") from silent
