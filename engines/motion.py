"""A run's motion: one action after another on the daemon, paused, resumed and cancelled as a whole.

Pause and cancel come from the engine's main thread while an activity's thread waits in `run`; the gate makes sure that no action
starts in between.
"""

from __future__ import annotations

import threading
import uuid
from collections.abc import Sequence

from engines.daemon_client import OWNER, DaemonClient
from handrail.messages import (
    ActionEvent,
    CancelAction,
    EndCondition,
    PauseAction,
    ResumeAction,
    StartAction,
)
from handrail.messages import Motion as MotionMessage
from handrail.topics import RefusedError, Unreachable

GUARDS = frozenset({"time", "pose_error", "force", "contact", "joint_limit", "divergence"})
"""outcomes that an end condition made: results, not failures"""

_REASONS = {
    "stopped": "the operator stop was pressed",
    "owner_lost": "the engine did not check in with the daemon in time",
    "refused_by_limits": "the daemon's limits refused the motion",
    "drive_fault": "a drive failed",
    "diverged": "the robot left its command",
    "cancelled": "it was cancelled",
}
_LISTEN_S = 0.5
_UNKNOWN_LIMIT = 4


class MotionFailed(Exception):
    """A motion that did not end as planned or could not start. `reason` is one word, `str()` a sentence."""

    def __init__(self, reason: str, message: str):
        self.reason = reason
        super().__init__(message)


class Motion:
    """Runs actions for one run; every method may be called from any thread, `run` from one at a time."""

    def __init__(self, daemon: DaemonClient, *, hold_after_s: float = 0.0):
        """`hold_after_s`: in lock-step, simulated time waits this long (wall time) for the engine after each action."""
        self._daemon, self._hold_after_s = daemon, hold_after_s
        self._gate = threading.Condition()
        self._paused = False
        self._action = ""
        self._name = uuid.uuid4().hex[:8]
        self._count = 0

    @property
    def paused(self) -> bool:
        return self._paused

    def run(
        self, motion: MotionMessage, ends: Sequence[EndCondition], cancelled: threading.Event, *, what: str = "motion"
    ) -> ActionEvent:
        """Run one action and wait for its end.

        :param cancelled: set it and call `interrupt` to end the action early
        :return: its last event; the outcome is `done` or the name of the end condition that tripped
        :raises MotionFailed: where it could not start, or ended otherwise
        """
        self._count += 1
        action = f"{OWNER}-{self._name}-{self._count}"
        with self._daemon.watch(action) as watch:
            unknown = 0
            hold = self._hold_after_s
            message = StartAction(id=action, owner=OWNER, motion=motion, ends=list(ends), hold_after_s=hold)
            self._start(message, cancelled, what)
            try:
                while True:
                    event = watch.next(_LISTEN_S)
                    if event is not None and event.state == "ended":
                        break
                    # A daemon that was started anew knows nothing of the action, and will never tell that it ended.
                    unknown = unknown + 1 if event is None and self._daemon.running_action() != action else 0
                    if not self._daemon.alive() or unknown >= _UNKNOWN_LIMIT:
                        raise MotionFailed("daemon_lost", f"{what}: the daemon has gone silent or was started anew")
            finally:
                with self._gate:
                    self._action = ""
        if event.outcome == "done" or event.outcome in GUARDS:
            return event
        detail = f" ({event.detail})" if event.detail else ""
        raise MotionFailed(event.outcome, f"{what}: {_REASONS.get(event.outcome, event.outcome)}{detail}")

    def _start(self, message: StartAction, cancelled: threading.Event, what: str) -> None:
        with self._gate:
            self._gate.wait_for(lambda: not self._paused or cancelled.is_set())
            if cancelled.is_set():
                raise MotionFailed("cancelled", f"{what}: it was cancelled")
            try:
                self._daemon.call(message)
            except RefusedError as refused:
                raise MotionFailed("refused", f"{what}: the daemon refused it: {refused}") from refused
            except Unreachable as silent:
                raise MotionFailed("daemon_lost", f"{what}: {silent}") from silent
            self._action = message.id

    def pause(self) -> None:
        """Stop moving along the path, and start nothing new. Raises Unreachable when the daemon does not answer."""
        with self._gate:
            self._paused = True
            self._tell(PauseAction)

    def resume(self) -> None:
        """Go on. Raises Unreachable when the daemon does not answer."""
        with self._gate:
            self._tell(ResumeAction)
            self._paused = False
            self._gate.notify_all()

    def interrupt(self) -> None:
        """End the running action, after its `cancelled` was set. Raises Unreachable when the daemon does not answer."""
        with self._gate:
            self._gate.notify_all()
            self._tell(CancelAction)

    def _tell(self, kind: type[PauseAction | ResumeAction | CancelAction]) -> None:
        if not self._action:
            return
        try:
            self._daemon.call(kind(id=self._action))
        except RefusedError:
            # It has just ended by itself: there is nothing left to pause or cancel.
            return
