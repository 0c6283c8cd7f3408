"""What an engine is busy with, one at a time: a program's run, or a motion that an operator asked for by itself."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
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


class MotionJob(ABC):
    """A motion without a program, in a thread of its own."""

    def __init__(self, services: Services, name: str):
        """`name`: of the thread, which `_drive` runs in once it is started."""
        self._services = services
        self._motion = Motion(services.daemon, Parts(services.daemon, services.description.groups))
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self._drive, name=name, daemon=True)

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

    @abstractmethod
    def _drive(self) -> None:
        """Until nothing moves any more."""


def reach(command: Callable[[], None]) -> None:
    """Do it. Raises RefusedError where the daemon does not answer."""
    try:
        command()
    except Unreachable as silent:
        raise refuse(f"the daemon does not answer: {silent}") from silent
