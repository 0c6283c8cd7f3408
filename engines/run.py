"""A program that runs, or a plan executed by itself: both can be paused, resumed and stopped, and that acts on the motion."""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import msgspec

from engines.activities import ACTIVITIES
from engines.activities.base import Activity, ActivityFailed, Context, Services
from engines.activities.execute import check, execute
from engines.deployment import Deployed
from engines.motion import Motion
from engines.parts import Parts
from engines.plans import PlanRecord
from engines.program import State
from engines.statechart import Chart
from handrail.messages import RunState
from handrail.topics import Unreachable, refuse

_SETTLE_S = 3.0
"""wall time that a run waits for its cancelled motion to stand, before it says that it has ended"""
HOLD_S = 30.0
"""wall time for which simulated time waits at most, while a program computes (lock-step)"""
_log = logging.getLogger(__name__)


class Job(Protocol):
    """What the engine is busy with."""

    @property
    def active(self) -> bool: ...
    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def stop(self) -> None: ...
    def join(self, timeout_s: float) -> None: ...


class ProgramRun:
    """One run of a deployed program, in a thread of its own."""

    def __init__(self, deployed: Deployed, services: Services, publish: Callable[[RunState], None]):
        self._services, self._publish = services, publish
        parts = Parts(services.daemon, services.description.groups)
        self._motion = Motion(services.daemon, parts, hold_after_s=HOLD_S)
        program = deployed.program
        self._parameters = deployed.parameters
        self._context = Context(services, f"run-{uuid.uuid4().hex[:8]}", self._motion, HOLD_S)
        self._chart = Chart(program, deployed.names(), self._activity)
        self._lock = threading.RLock()
        self._state = RunState(
            run=self._context.run,
            deployment=deployed.id,
            program=program.name,
            hash=program.hash,
            status="ready",
            active=[],
            data=self._data(),
        )
        self._stopping = False
        self._thread = threading.Thread(target=self._drive, name=self._context.run, daemon=True)

    @property
    def state(self) -> RunState:
        """As last published."""
        with self._lock:
            return self._state

    @property
    def active(self) -> bool:
        return self.state.status in ("ready", "running", "paused")

    def start(self) -> RunState:
        """Begin."""
        self._tell(status="running")
        self._thread.start()
        return self.state

    def pause(self) -> None:
        """Stop the motion along its path and start nothing new. Refused when there is nothing that runs."""
        with self._lock:
            self._not_stopping()
            if self._state.status != "running":
                raise refuse("the program does not run", "status", self._state.status, "running")
            _reach(self._motion.pause)
            self._tell(status="paused")

    def resume(self) -> None:
        """Go on. Refused when it is not paused."""
        with self._lock:
            self._not_stopping()
            if self._state.status != "paused":
                raise refuse("the program is not paused", "status", self._state.status, "paused")
            _reach(self._motion.resume)
            self._tell(status="running")

    def stop(self) -> None:
        """Cancel the motion and end; the robot holds. Refused when it has ended already."""
        if not self.active:
            raise refuse("the program has ended", "status", self.state.status, "running or paused")
        self._stopping = True
        self._chart.stop()

    def _not_stopping(self) -> None:
        # The motion slows down to its end: nothing may set it going again.
        if self._stopping and self.active:
            raise refuse("the program is being stopped")

    def join(self, timeout_s: float) -> None:
        """Wait until it has ended."""
        self._thread.join(timeout_s)

    def _activity(self, state: State, values: Mapping[str, Any]) -> Activity:
        return ACTIVITIES[state.file.do](self._context, values)

    def _drive(self) -> None:
        self._services.daemon.hold_time(HOLD_S)
        try:
            self._chart.begin()
            while (end := self._chart.ended) is False:
                self._tell(active=self._chart.active(), data=self._data())
                self._chart.step()
            if isinstance(end, State):
                status, detail = str(end.file.outcome), self._chart.words(end.file.detail)
            else:
                status, detail = "stopped", "stopped by the operator"
        except Exception as crash:  # noqa: BLE001
            # Whatever went wrong in here, clients must not be left with a run that seems to go on.
            _log.exception("%s crashed", self._context.run)
            status, detail = "failed", f"the engine's own error: {type(crash).__name__}: {crash}"
        finally:
            self._services.daemon.release_time()
        if not self._motion.settled(_SETTLE_S):
            self._services.log("warning", "the program has ended, but the daemon has not told that its motion has")
        self._motion.end()
        self._tell(status=status, detail=detail, active=self._chart.active(), data=self._data())

    def _data(self) -> dict[str, Any]:
        return {**self._chart.variables(), **self._parameters}

    def _tell(self, **changes: Any) -> None:
        with self._lock:
            state = msgspec.structs.replace(self._state, **changes, time_ns=self._services.daemon.time_ns)
            if msgspec.structs.replace(state, time_ns=self._state.time_ns) == self._state:
                return
            self._state = state
            self._publish(state)


class PlanExecution:
    """A plan's segments, executed because an operator asked for it, without a program."""

    def __init__(self, services: Services, record: PlanRecord, segments: Sequence[str]):
        """Raises ActivityFailed when the plan is stale, or has no such segments."""
        check(services, record, segments)
        self._services, self._record, self._segments = services, record, segments
        parts = Parts(services.daemon, services.description.groups)
        self._motion, self._cancelled = Motion(services.daemon, parts), threading.Event()
        self._thread = threading.Thread(target=self._drive, name=f"execute {record.plan.id}", daemon=True)
        self._thread.start()

    @property
    def active(self) -> bool:
        return self._thread.is_alive()

    def pause(self) -> None:
        """Stop the motion along its path."""
        _reach(self._motion.pause)

    def resume(self) -> None:
        """Go on."""
        _reach(self._motion.resume)

    def stop(self) -> None:
        """Cancel the motion; the robot holds."""
        self._cancelled.set()
        _reach(self._motion.interrupt)

    def join(self, timeout_s: float) -> None:
        """Wait until it has ended."""
        self._thread.join(timeout_s)

    def _drive(self) -> None:
        label = self._record.plan.label
        try:
            ended = execute(self._services, self._motion, self._record, self._segments, self._cancelled)
        except ActivityFailed as failed:
            self._services.log("info" if failed.reason == "cancelled" else "error", f"{label}: {failed}")
        except Exception as crash:  # noqa: BLE001
            _log.exception("%s crashed", label)
            self._services.log("error", f"{label}: the engine's own error: {type(crash).__name__}: {crash}")
        else:
            level = "info" if ended["outcome"] == "done" else "warning"
            self._services.log(level, f"{label}: {ended['outcome']} after {ended['segment']}")
        finally:
            self._motion.end()


def _reach(command: Callable[[], None]) -> None:
    try:
        command()
    except Unreachable as silent:
        raise refuse(f"the daemon does not answer: {silent}") from silent
