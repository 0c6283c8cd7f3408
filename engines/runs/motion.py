"""A run's motion: actions on the daemon, paused and resumed as a whole, each cancelled by itself.

Those that move different joints run side by side, as states do; one waits for another that moves a joint of its own. Pause and
cancel come from the engine's main thread while activities' threads wait in `run`; the gate makes sure that no action starts in
between. While it is paused, joints are lent to whoever moves them by hand: what held them is let go, and goes on from where it was
once they are back there.
"""

from __future__ import annotations

import contextlib
import threading
import time
import uuid
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, get_args

import msgspec
import numpy as np

from engines.daemon_client import DaemonClient
from engines.runs import let_go
from engines.runs.parts import Parts, meet, moved
from engines.runs.preconditions import Precondition, at_posture
from handrail.behaviour_file import Robot
from handrail.messages import (
    FIRST_KNOT,
    NOT_READY,
    NOT_STANDING,
    ActionEvent,
    CancelAction,
    EndCondition,
    JointTarget,
    JointTrajectory,
    PauseAction,
    ResumeAction,
    StartAction,
    StartBehaviour,
    StreamJoints,
)
from handrail.messages import Motion as MotionMessage
from handrail.topics import RefusedError, Unreachable, refuse

GUARDS = frozenset(str(kind.__struct_config__.tag) for kind in get_args(EndCondition))
"""outcomes that an end condition made: results, not failures"""

_REASONS = {
    "stopped": "the operator stop was pressed",
    "owner_lost": "the engine did not check in with the daemon in time",
    "refused_by_limits": "the daemon's limits refused the motion",
    "drive_fault": "a drive failed",
    "diverged": "the robot left its command",
    "stale_state": "a joint was not measured for too long",
    "too_close": "the guard stopped it before bodies met, or a region (handrail safety explain)",
    "balance_lost": "the robot fell (handrail safety explain)",
    "cancelled": "it was cancelled",
}
_LISTEN_S, _STREAM_S = 0.5, 0.05
_ANSWER_S, _AGAIN_S, _MAKING_S = 10.0, 0.05, 300.0
"""of wall time: for the answer to a start, which the daemon's server may load libraries for; between asking for a motion whose
controller is still being made, and as long as that takes where nothing was compiled yet"""
_UNKNOWN_LIMIT = 4
_LET_GO_S = 3.0
"""of wall time, within which a motion that stands ends once it is let go"""


def _always() -> str:
    return ""


def _never(step: str, outcome: str) -> bool:
    return False


def _nobody(ended: ActionEvent) -> None:
    pass


class MotionFailed(Exception):
    """A motion that did not end as planned or could not start. `reason` is one word, `str()` a sentence.

    `started` is False where it is certain that the robot has not begun it.
    """

    def __init__(self, reason: str, message: str, *, started: bool = True):
        self.reason, self.started = reason, started
        super().__init__(message)


@dataclass(eq=False)
class _Running:
    """An action, from when it is wanted until its end."""

    message: StartAction | StartBehaviour
    cancelled: threading.Event
    still: Callable[[], str]
    what: str
    outdated: str = ""
    """why it was cancelled, or not started, instead of resumed"""
    let_go: bool = False
    """in a pause, for its joints to be moved by hand"""
    stood: np.ndarray | None = None
    """(n,) rad, the robot's command when it was"""


class Behaviour(Protocol):
    """A chain of motions, as `handrail.behaviour_file.BehaviourFile` reads it."""

    @property
    def hoped(self) -> str:
        """the outcome that who rehearses it takes for granted"""

    def call(self, action: str, owner: str, robot: Robot) -> StartBehaviour: ...
    def expected(self, step: str, outcome: str) -> bool: ...


class Motion:
    """Runs actions for one run; every method may be called from any thread."""

    def __init__(
        self,
        daemon: DaemonClient,
        parts: Parts,
        *,
        robot: let_go.Joints,
        hold_after_s: float = 0.0,
        heard: Callable[[ActionEvent], None] = _nobody,
    ):
        """`parts`: of the body, held from the first motion that needs them until `end`; `robot`: whose joints they are.

        `hold_after_s`: in lock-step, simulated time waits this long (wall time) for the engine after each action.

        `heard` is told how each ended.
        """
        self._daemon, self._parts, self._hold_after_s, self._heard = daemon, parts, hold_after_s, heard
        self._robot = robot
        self._gate = threading.Condition()
        self._paused = False
        self._running: list[_Running] = []
        self._waiting: list[_Running] = []
        """wanted, or let go, and not running"""
        self._stood: np.ndarray | None = None
        """(n,) rad, the robot's command when joints were first lent in this pause"""
        self.by_hand = False
        """whether joints have been lent"""
        self._name = uuid.uuid4().hex[:8]
        self._count = self._sample = 0
        self.ended: ActionEvent | None = None
        """how the last one ended; None: none has yet"""

    @property
    def paused(self) -> bool:
        return self._paused

    def run(
        self,
        motion: MotionMessage,
        ends: Sequence[EndCondition],
        cancelled: threading.Event,
        *,
        what: str = "motion",
        still: Callable[[], str] = _always,
        meanwhile: Callable[[str], None] | None = None,
        hoped: str = "done",
    ) -> ActionEvent:
        """Run one action and wait for its end.

        :param cancelled: set it and call `interrupt` to end the action early
        :param still: why the motion may not be run any more, in words, empty while it may: asked right before it starts, however
            long a pause kept it waiting, and again before a pause of it ends
        :param hoped: the outcome that a rehearsal takes for granted
        :param meanwhile: called with the action's id twenty times a second while it runs
        :return: its last event; the outcome is `done` or the name of the end condition that tripped
        :raises MotionFailed: where it could not start, or ended otherwise; `stale` where `still` said why
        """
        message = StartAction(
            id=self._next(), owner=self._daemon.owner, motion=motion, ends=list(ends), hold_after_s=self._hold_after_s
        )
        return self._run(message, cancelled, what, still, meanwhile=meanwhile)

    def run_behaviour(
        self, behaviour: Behaviour, robot: Robot, cancelled: threading.Event, *, what: str = "behaviour"
    ) -> ActionEvent:
        """Run a behaviour and wait for its end; what it leads to `end` by itself is an end as planned, too.

        :raises MotionFailed: as `run` does
        :raises ConfigError: for joints that the robot has not
        """
        call = behaviour.call(self._next(), self._daemon.owner, robot)
        message = msgspec.structs.replace(call, hold_after_s=self._hold_after_s)
        return self._run(message, cancelled, what, _always, behaviour.expected)

    def _next(self) -> str:
        self._count += 1
        return f"{self._daemon.owner}-{self._name}-{self._count}"

    def _run(
        self,
        message: StartAction | StartBehaviour,
        cancelled: threading.Event,
        what: str,
        still: Callable[[], str],
        expected: Callable[[str, str], bool] = _never,
        meanwhile: Callable[[str], None] | None = None,
    ) -> ActionEvent:
        running = _Running(message, cancelled, still, what)
        while True:
            event, others = self._once(running, meanwhile)
            if others:
                self._daemon.release_time()  # for which this one's end made time wait: what runs beside it goes on
            if running.stood is None:
                break
            if not self._come_back(running):
                event = msgspec.structs.replace(event, outcome="done")
                break
        self.ended = event
        self._heard(event)
        if event.outcome == "done" or event.outcome in GUARDS or expected(event.step, event.outcome):
            return event
        if running.outdated:
            raise MotionFailed("stale", f"{what} was not resumed: {running.outdated}")
        if event.outcome == "cancelled" and not cancelled.is_set() and (who := self._parts.taken_over()):
            raise MotionFailed("taken_over", f"{what} was cancelled: {who}")
        detail = f" ({event.detail})" if event.detail else ""
        raise MotionFailed(event.outcome, f"{what}: {_REASONS.get(event.outcome, event.outcome)}{detail}")

    def _once(self, running: _Running, meanwhile: Callable[[str], None] | None) -> tuple[ActionEvent, bool]:
        """Start it and wait for its end: that, and whether something else runs beside it. Raises MotionFailed."""
        action, what, quiet, patience = (
            running.message.id,
            running.what,
            0.0,
            _LISTEN_S if meanwhile is None else _STREAM_S,
        )
        with self._daemon.watch(action) as watch:
            unknown = 0
            self._start(running)
            try:
                while True:
                    event = watch.next(patience)
                    if event is not None and event.state == "ended":
                        if running.let_go and event.outcome == "cancelled" and not running.cancelled.is_set():
                            running.stood = np.array(event.command)
                        break
                    if meanwhile is not None:
                        meanwhile(action)
                    quiet = quiet + patience if event is None else 0.0
                    if 0.0 < quiet < _LISTEN_S:
                        continue
                    quiet = 0.0
                    # A daemon that was started anew knows nothing of the action, and will never tell that it ended.
                    if event is None and running.cancelled.is_set():
                        self._cancel_again(running)
                    unknown = unknown + 1 if event is None and not self._daemon.runs(action) else 0
                    if not self._daemon.alive() or unknown >= _UNKNOWN_LIMIT:
                        raise MotionFailed("daemon_lost", f"{what}: the daemon has gone silent or was started anew")
            finally:
                with self._gate:
                    self._running.remove(running)
                    if running.stood is not None:
                        self._waiting.append(running)
                    others = bool(self._running)
                    self._gate.notify_all()
        return event, others

    def _come_back(self, running: _Running) -> bool:
        """Wait for the end of the pause in which it was let go, and go on with what is left of it. False: nothing is.

        Raises MotionFailed where it can't be gone on with, or was cancelled.
        """
        message, what = running.message, running.what
        with self._gate:
            self._gate.wait_for(lambda: not self._paused or running.cancelled.is_set())
            self._waiting.remove(running)
            running.let_go = False
        if running.cancelled.is_set():
            raise MotionFailed("cancelled", f"{what}: it was cancelled")
        command = self._daemon.command()
        if running.outdated or isinstance(message, StartBehaviour) or command is None:
            raise MotionFailed("stale", f"{what} was not resumed: {running.outdated or 'it was let go'}")
        motion = let_go.rest(message.motion, command, self._robot)
        if motion is None:
            return False
        running.message, running.stood = msgspec.structs.replace(message, id=self._next(), motion=motion), None
        return True

    def _start(self, wanted: _Running) -> None:
        with self._gate:
            self._waiting.append(wanted)
            try:
                self._begin(wanted)
            finally:
                self._waiting.remove(wanted)
            self._running.append(wanted)

    def _begin(self, wanted: _Running) -> None:
        message, cancelled, what = wanted.message, wanted.cancelled, wanted.what
        with self._gate:
            if self._in_the_way(message):
                # A state was left in the middle of it: its joints are free once it stands, in simulated time, too.
                self._daemon.release_time()
            gives_up = time.monotonic() + _MAKING_S
            while True:
                self._gate.wait_for(lambda: not (self._paused or self._in_the_way(message)) or cancelled.is_set())
                if cancelled.is_set():
                    raise MotionFailed("cancelled", f"{what}: it was cancelled", started=False)
                if why := wanted.outdated or wanted.still():
                    raise MotionFailed("stale", f"{what} was not started: {why}", started=False)
                try:
                    self._daemon.call(self._parts.hold(message), timeout_s=_ANSWER_S)
                    break
                except RefusedError as refused:
                    if refused.refusal.value != NOT_READY or time.monotonic() > gives_up:
                        reason = "not_standing" if refused.refusal.value == NOT_STANDING else "refused"
                        if refused.refusal.field.startswith(FIRST_KNOT):
                            reason = "stale"  # the robot has gone on since `still` was asked: only the daemon knows by how much
                        said = f"{what}: the daemon refused it: {refused}"
                        raise MotionFailed(reason, said, started=False) from refused
                except Unreachable as silent:
                    with contextlib.suppress(
                        RefusedError, Unreachable
                    ):  # it may have begun, and only the answer was lost
                        self._daemon.call(CancelAction(id=message.id))
                    raise MotionFailed("daemon_lost", f"{what}: {silent}") from silent
                self._gate.wait(_AGAIN_S)  # others may pause, cancel, and start theirs meanwhile

    def _in_the_way(self, message: StartAction | StartBehaviour) -> bool:
        return any(meet(message, other.message) for other in self._running)

    def pause(self) -> None:
        """Stop moving along the paths, and start nothing new. Raises Unreachable when the daemon does not answer: then it is not
        paused (or the pause goes on, if it was).
        """
        with self._gate:
            for running in self._running:
                self._tell(PauseAction, running)
            self._paused = True

    def resume(self) -> None:
        """Go on; a motion that may not be run any more is cancelled instead. Raises Unreachable when the daemon does not answer."""
        with self._gate:
            for waiting in self._waiting:
                waiting.outdated = self._outdated(waiting)
            for running in self._running:
                running.outdated = self._outdated(running)
                self._tell(CancelAction if running.outdated else ResumeAction, running)
            self._paused, self._stood = False, None
            self._gate.notify_all()

    def _outdated(self, wanted: _Running) -> str:
        if not self._paused:
            return ""
        return wanted.still() or "; ".join(str(each) for each in self._preconditions(wanted) if not each.met)

    def lend(self, joints: Collection[str]) -> None:
        """While it is paused: let go of what holds any of these joints, so that they can be moved by hand.

        Raises RefusedError where it is not paused, or what holds them can't be let go; Unreachable.
        """
        with self._gate:
            if not self._paused:
                raise refuse("the program is not paused", "status", "running", "paused")
            held = [running for running in self._running if _moves(running.message, joints)]
            for running in held:
                if moved(running.message) is None:
                    raise refuse(
                        f"{running.what} moves the whole body, and may be what it stands by: stop the run first"
                    )
            for running in held:
                running.let_go = True
                self._tell(CancelAction, running)
            if self._stood is None:
                self._stood = self._daemon.command()
            self.by_hand = True
            if not self._gate.wait_for(lambda: not any(running in self._running for running in held), _LET_GO_S):
                raise refuse(f"{held[0].what} has not let go within {_LET_GO_S:g} s")
        if held:
            self._daemon.release_time()  # for which its end made time wait

    def preconditions(self, cancelled: threading.Event) -> Iterator[Precondition]:
        """Of what is under way, or wanted, whose cancellation this is: what the pause must have left as it was."""
        with self._gate:
            own = [each for each in (*self._running, *self._waiting) if each.cancelled is cancelled]
            found = [each for wanted in own for each in self._preconditions(wanted)]
        yield from found

    def _preconditions(self, wanted: _Running) -> Iterator[Precondition]:
        message, command = wanted.message, self._daemon.command()
        if wanted.let_go:
            kind = "a behaviour" if isinstance(message, StartBehaviour) else f"a {_kind(message)}"
            able = let_go.goes_on(message)
            value, expected = f"{kind} that was let go for a motion by hand", "one that a goal or a path says all of"
            yield Precondition(f"{wanted.what} can go on from its middle", able, value, expected)
        if command is None:
            return
        if wanted.stood is not None:
            joints = sorted(moved(message) or ())
            rows = [self._robot.joints.index(joint) for joint in joints if joint in self._robot.joints]
            names = [self._robot.joints[row] for row in rows]
            what = f"{wanted.what} goes on from where it was let go"
            yield at_posture(what, names, wanted.stood[rows], command[rows])
            return
        motion = message.motion if isinstance(message, StartAction) else None
        if isinstance(motion, JointTrajectory) and wanted not in self._running and not self._in_the_way(message):
            rows = [self._robot.joints.index(joint) for joint in motion.joints]
            what = f"{wanted.what} starts at the robot's present posture"
            yield at_posture(what, motion.joints, np.array(motion.positions[0]), command[rows])

    def strayed(self, besides: Collection[str]) -> str:
        """In a pause: which joint, besides these, was moved by hand from where it stood, in words; empty where none was."""
        command, stood = self._daemon.command(), self._stood
        if command is None or stood is None:
            return ""
        rows = [row for row, joint in enumerate(self._robot.joints) if joint not in besides]
        names = [self._robot.joints[row] for row in rows]
        there = at_posture("what it counts on to stay stands where it stood", names, stood[rows], command[rows])
        return "" if there.met else str(there)

    def interrupt(self) -> None:
        """End the running actions whose `cancelled` was set, and let none begin whose was. Raises Unreachable when the daemon does
        not answer.
        """
        with self._gate:
            self._gate.notify_all()
            for running in self._running:
                if running.cancelled.is_set():
                    self._tell(CancelAction, running)

    def redirect(self, positions: Sequence[float]) -> bool:
        """Give a JointTarget that is on its way another target (m,) rad. False: none is. Raises Unreachable."""
        with self._gate:
            on_the_way = [
                running.message.id
                for running in self._running
                if isinstance(running.message, StartAction) and isinstance(running.message.motion, JointTarget)
            ]
            if not on_the_way:
                return False
            self._sample += 1
            message = StreamJoints(id=on_the_way[0], sequence=self._sample, positions=list(positions))
            try:
                self._daemon.call(message)
            except RefusedError:  # it has just ended by itself
                return False
            return True

    def end(self) -> None:
        """The run has ended: others may command what it did."""
        self._parts.give_back()

    def settled(self, timeout_s: float) -> bool:
        """Wait until no action runs any more; False when one still does."""
        with self._gate:
            return self._gate.wait_for(lambda: not self._running, timeout_s)

    def _cancel_again(self, running: _Running) -> None:
        # The daemon may not have heard of it the first time; it does not mind hearing it twice.
        with self._gate, contextlib.suppress(Unreachable):
            self._tell(CancelAction, running)

    def _tell(self, kind: type[PauseAction | ResumeAction | CancelAction], running: _Running) -> None:
        # Refused, it has just ended by itself: there is nothing left to pause or cancel.
        with contextlib.suppress(RefusedError):
            self._daemon.call(kind(id=running.message.id))


def _moves(message: StartAction | StartBehaviour, joints: Collection[str]) -> bool:
    own = moved(message)
    return own is None or not own.isdisjoint(joints)


def _kind(message: StartAction) -> str:
    return str(type(message.motion).__struct_config__.tag).replace("_", " ")
