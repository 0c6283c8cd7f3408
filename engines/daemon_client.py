"""The engine's side of the daemon: what the robot does now, calls from any thread, the sign of life.

One thread listens to the daemon's events, one checks in; each call has a connection to itself, and leaves it to the next one.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import msgspec
import numpy as np

from engines.plans.freshness import World
from handrail.messages import (
    ActionEvent,
    Base,
    CheckIn,
    DaemonStatus,
    HoldTime,
    ReleaseTime,
    RobotState,
)
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber, Unreachable

OWNER = "engine"
_CHECK_IN_S = 0.3
_SILENT_S = 3.0
_ANOTHER_CLOCK_NS = 1_000_000_000
_BASE_MOVED_M = 0.005


class ActionWatch:
    """Waits for one action's events. Made before the action is started, so that none is missed."""

    def __init__(self, client: DaemonClient, id: str):
        self.id = id
        self._client = client
        self._events: queue.SimpleQueue[ActionEvent] = queue.SimpleQueue()

    def tell(self, event: ActionEvent) -> None:
        """Called by the listening thread."""
        self._events.put(event)

    def next(self, timeout_s: float) -> ActionEvent | None:
        """The next event, or None when there was none in time."""
        try:
            return self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def __enter__(self) -> ActionWatch:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.forget(self)


class DaemonClient:
    """What the engine knows of the daemon and asks it to do."""

    def __init__(
        self, runtime: Runtime, joints: int, *, owner: str = OWNER, log: Callable[[str], None] = lambda text: None
    ):
        """`joints`: how many the robot has; states with another number are not taken. `owner`: who commands, as leases name him."""
        self._runtime, self._joints, self._log, self.owner = runtime, joints, log, owner
        self.rested: Callable[[], None] = lambda: None
        """called, from a thread of its own, when the robot has come to rest elsewhere than it last rested"""
        self._rested_at = (np.zeros(0), np.zeros(3))
        self._lock = threading.Lock()
        self._watches: dict[str, ActionWatch] = {}
        self._command: np.ndarray | None = None
        self._position: np.ndarray | None = None
        self._base: Base | None = None
        self._time_ns = 0
        self._clocks: list[Callable[[int], None]] = []
        self._last_heard = -float("inf")
        self._status: DaemonStatus | None = None
        self._idle: queue.SimpleQueue[Caller] = queue.SimpleQueue()
        """connections that nobody uses: an activity's thread lives shorter than it takes to make one worth while"""
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=self._listen, name="daemon events", daemon=True),
            threading.Thread(target=self._check_in, name="daemon check-in", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    # ---------------------------------------------------------------------------------------------------------------- calls

    def call(self, message: msgspec.Struct, timeout_s: float = 2.0) -> Any:
        """Call the daemon. Raises RefusedError, or Unreachable when it does not answer."""
        try:
            caller = self._idle.get_nowait()
        except queue.Empty:
            caller = Caller(self._runtime.endpoint("daemon.call"))
        try:
            return caller.call(message, timeout_s)
        finally:
            self._idle.put(caller)

    def hold_time(self, limit_s: float) -> None:
        """Lock-step: stop simulated time while the engine thinks, at most `limit_s` of wall time. A courtesy, never an error."""
        self._courtesy(HoldTime(owner=self.owner, limit_s=limit_s))

    def release_time(self) -> None:
        """Lock-step: let simulated time go on."""
        self._courtesy(ReleaseTime(owner=self.owner))

    def _courtesy(self, message: msgspec.Struct) -> None:
        try:
            self.call(message, timeout_s=1.0)
        except (RefusedError, Unreachable) as problem:
            self._log(f"simulated time: {problem}")

    # ---------------------------------------------------------------------------------------------------------------- state

    def alive(self) -> bool:
        """Whether anything was heard of the daemon within the last seconds of wall time."""
        return time.monotonic() - self._last_heard < _SILENT_S

    def runs(self, action: str) -> bool:
        """Whether the daemon says that it runs an action."""
        return self._status is not None and action in self._status.actions

    @property
    def time_ns(self) -> int:
        """The robot's clock, as last heard."""
        return self._time_ns

    def command(self) -> np.ndarray | None:
        """rad (n,), what the robot was last commanded; None before the first state came."""
        with self._lock:
            return None if self._command is None else self._command.copy()

    def world(self) -> World | None:
        """What plans are made from: joints, base and time, as last heard; None before the first state came."""
        with self._lock:
            return None if self._command is None else World(self._time_ns, self._command.copy(), self._base)

    def measured(self) -> tuple[np.ndarray, Base | None] | None:
        """(n,) rad, where the joints are, and the base (None: it is fixed), as last heard; None before the first state came."""
        with self._lock:
            return None if self._position is None else (self._position, self._base)

    def watch(self, action: str) -> ActionWatch:
        """Listen for an action's events; a context manager."""
        watch = ActionWatch(self, action)
        with self._lock:
            self._watches[action] = watch
        return watch

    def tell_time(self, clock: Callable[[int], None]) -> None:
        """Have `clock` told the robot's time, ns, at each state, from the listening thread; it must return at once."""
        self._clocks.append(clock)

    def tell_no_time(self, clock: Callable[[int], None]) -> None:
        """End that."""
        if clock in self._clocks:
            self._clocks.remove(clock)

    def forget(self, watch: ActionWatch) -> None:
        """End a watch."""
        with self._lock:
            self._watches.pop(watch.id, None)

    def close(self) -> None:
        """End the threads; waits for them."""
        self._closing.set()
        for thread in self._threads:
            thread.join(timeout=1.0)
        while not self._idle.empty():
            self._idle.get().close()

    # -------------------------------------------------------------------------------------------------------------- threads

    def _listen(self) -> None:
        subscriber = Subscriber(self._runtime.endpoint("daemon.events"), RobotState | DaemonStatus | ActionEvent)
        try:
            while not self._closing.is_set():
                # The timeout is only there to notice the closing. Of robot states the newest is enough: in lock-step several come
                # at once.
                for message in subscriber.newest(0.2):
                    self._take(message)
        finally:
            subscriber.close()

    def _take(self, message: RobotState | DaemonStatus | ActionEvent) -> None:
        self._last_heard = time.monotonic()
        if isinstance(message, DaemonStatus):
            self._status = message
            return
        with self._lock:
            # Compared by the robot's clock: a loop that is started anew counts its cycles from 0 again, the clock goes on. Where
            # the clock itself has gone back far, it is another robot's, or a plant that was started anew.
            newer = message.time_ns >= self._time_ns or message.time_ns < self._time_ns - _ANOTHER_CLOCK_NS
            elsewhere = False
            if newer and len(message.command) == self._joints:
                command, before = np.array(message.command), self._command
                self._time_ns, self._command = message.time_ns, command
                if isinstance(message, RobotState):
                    self._base, self._position = message.base, np.array(message.position)
                    elsewhere = before is not None and np.array_equal(command, before) and self._elsewhere(message)
            watch = self._watches.get(message.id) if isinstance(message, ActionEvent) else None
        if watch is not None and isinstance(message, ActionEvent):
            watch.tell(message)
        if elsewhere:
            self.rested()
        if newer and isinstance(message, RobotState):
            for clock in tuple(self._clocks):
                clock(message.time_ns)

    def _elsewhere(self, state: RobotState) -> bool:
        command, base = self._rested_at
        here = np.array(state.command), np.array(state.base_in_world.position)
        if np.array_equal(command, here[0]) and np.linalg.norm(here[1] - base) < _BASE_MOVED_M:
            return False
        self._rested_at = here
        return True

    def _check_in(self) -> None:
        caller = Caller(self._runtime.endpoint("daemon.call"))
        message = CheckIn(owner=self.owner)
        try:
            while not self._closing.wait(_CHECK_IN_S):
                try:
                    caller.call(message, timeout_s=_CHECK_IN_S)
                except (Unreachable, RefusedError):
                    # Nothing to be done here: without the daemon there is no action to keep alive.
                    continue
        finally:
            caller.close()
