"""A program that runs: it can be paused, resumed and stopped, and that acts on the motion."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import msgspec
import numpy as np

from engines import identifiers
from engines.activities import ACTIVITIES
from engines.activities.base import Activity, ActivityFailed, Context, Services
from engines.learning.facts import RunNotes
from engines.learning.learner import RunWatch
from engines.programs.deployment import Deployed, check_breakpoints, check_parameters
from engines.programs.program import Program, State
from engines.programs.statechart import EDITED, Chart, Event
from engines.runs.autonomy import Permissions, Question
from engines.runs.clock import RunClock
from engines.runs.edit import Edit, Waiting
from engines.runs.gate import RunGate
from engines.runs.history import RunHistory
from engines.runs.job import reach
from engines.runs.motion import Motion
from engines.runs.parts import Parts
from engines.runs.remedies import remedies
from handrail import workspace
from handrail.messages import RunState, StateVisit
from handrail.topics import Unreachable, refuse

_SETTLE_S = 3.0
"""wall time that a run waits for its cancelled motion to stand, before it says that it has ended"""
HOLD_S = 30.0
"""wall time for which simulated time waits at most, while a program computes (lock-step)"""
LINK_CUT = frozenset({"daemon_lost", "owner_lost"})
"""reasons of failures that an engine on another machine has when its link is cut"""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Start:
    """Where and with what a run begins, if not as the program says."""

    states: tuple[str, ...] = ()
    """one, or one of each parallel region"""
    variables: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    paused: str = ""
    """why it waits before its first activity; empty: it does not"""
    run: str = ""
    """id of the run that it goes on with"""
    edit: Waiting | None = None
    """another version that waits for its place"""


class ProgramRun:
    """One run of a deployed program, in a thread of its own."""

    def __init__(
        self,
        deployed: Deployed,
        services: Services,
        publish: Callable[[Deployed, RunState], None],
        keep: Callable[[Deployed, RunState, Waiting | None], None],
        *,
        breakpoints: Iterable[str] = (),
        autonomy: str = "full",
        on_failure: Literal["pause", "end"] = "end",
        start: Start | None = None,
        seeds: Mapping[str, Sequence[np.ndarray]] | None = None,
        watch: RunWatch | None = None,
    ):
        """`publish` is told of every change, and in which version; `keep` before, with the version that waits; `seeds`: state →
        where its plans ended in a rehearsal; `watch` compares it with past runs.

        Raises ValueError where `start` names states that can't be active together.
        """
        self._seeds = seeds or {}
        self._services, self._publish, self._keep = services, publish, keep
        self._deployed, self._start = deployed, start or Start()
        self.parts = parts = Parts(services.daemon, services.description.groups)
        """of the body that it holds"""
        self._watch, self._notes = watch, RunNotes(self._look_back)
        self._motion = Motion(
            services.daemon, parts, robot=services.description, hold_after_s=HOLD_S, heard=self._notes.moved
        )
        program = deployed.program
        self._parameters = {**deployed.parameters, **self._start.parameters}
        id = self._start.run or identifiers.new("run")
        self._context = Context(services, id, self._motion, HOLD_S, notes=self._notes)
        self._gate, self._clock = RunGate(self._waits), RunClock()
        self._gate.set_breakpoints(breakpoints)
        self._history = RunHistory(lambda: services.daemon.time_ns)
        names = {**deployed.names(), **self._start.variables, **self._parameters}
        self._permissions = Permissions(services.prompts, self._context.run, self._allow, services.log, autonomy)
        self._on_failure = on_failure
        self._chart = self._chart_of(program, names, self._start.states)
        self._chart.set_autonomy(autonomy)
        self._lock = threading.RLock()
        self._state = RunState(
            run=self._context.run,
            deployment=deployed.id,
            program=program.name,
            hash=program.hash,
            status="ready",
            active=[],
            data=self._data(),
            breakpoints=self._gate.breakpoints,
            autonomy=autonomy,
            on_failure=on_failure,
        )
        self._stopping = False
        self._doing = _doing(program)
        self._edit = Edit(services, self._context.run, self._kept, self._start.edit)
        self._unmet: list[str] = []
        """pre-conditions that were not met when it was last to go on, and told"""
        self._thread = threading.Thread(target=self._drive, name=self._context.run, daemon=True)

    def _chart_of(self, program: Program, names: Mapping[str, Any], start_at: Iterable[str] = ()) -> Chart:
        return Chart(
            program,
            names,
            self._activity,
            gate=self._gate,
            clock=self._clock,
            history=self._history,
            ask=self._permissions.ask,
            withdraw=self._permissions.withdraw,
            start_at=start_at,
            outlasts=self._services.outlasts,
            pause_on_failure=self._on_failure == "pause",
            log=self._services.log,
        )

    @property
    def state(self) -> RunState:
        """As last published."""
        with self._lock:
            return self._state

    @property
    def active(self) -> bool:
        return self.state.status in ("ready", "running", "paused")

    @property
    def deployed(self) -> Deployed:
        """What it runs."""
        return self._deployed

    @property
    def visits(self) -> list[StateVisit]:
        """What it went through."""
        return self._history.visits()

    def start(self) -> RunState:
        """Begin."""
        if self._start.paused:
            self._gate.close()
            self._clock.stand()
            self._tell(status="paused", active=self._chart.with_parents(self._start.states), detail=self._start.paused)
        else:
            self._tell(status="running")
        self._began_ns = self.state.time_ns
        self._look_back()
        self._services.daemon.tell_time(self._clock.tick)
        self._thread.start()
        return self.state

    def pause(self) -> None:
        """Stop the motion along its path and start nothing new. Refused when there is nothing that runs."""
        with self._lock:
            self._not_stopping()
            if self._state.status != "running":
                raise refuse("the program does not run", "status", self._state.status, "running")
            reach(self._motion.pause)
            self._clock.stand()
            self._gate.close()
            self._unmet = []
            self._tell(status="paused")

    def lend(self, joints: Sequence[str]) -> None:
        """Let go of joints, so that they are moved by hand. Refused when it is not paused, or can't let go of what holds them."""
        self._services.daemon.release_time()  # which a plan that is being made may hold
        self._motion.lend(joints)

    def resume(self) -> None:
        """Go on. Refused when it is not paused, and once where a pre-condition of what its states do is not met: it stays paused,
        and says which, and what can be done. Resumed once more, the program goes its own way for what can't go on.
        """
        self._go_on(one_step=False)

    def step(self) -> None:
        """Go on until the next activity is about to begin. Refused when it is not paused."""
        self._go_on(one_step=True)

    def _go_on(self, *, one_step: bool) -> None:
        with self._lock:
            self._not_stopping()
            if self._state.status != "paused":
                raise refuse("the program is not paused", "status", self._state.status, "paused")
            self._check_preconditions()
            reach(self._motion.resume)
            self._clock.go()
            self._chart.tries_again()
            self._gate.open(one_step=one_step)
            self._tell(status="running", detail="")

    def _check_preconditions(self) -> None:
        """The one place where they are asked. Refused where one is not met that was not told yet."""
        found = []
        with workspace.pinned(self._deployed.folder):
            for state, begun in self._chart.doing():
                try:
                    activity = begun or self._made(state, self._chart.arguments(state))
                except ActivityFailed:
                    continue  # it says so itself, once it is made
                found += [(state, str(each)) for each in activity.preconditions() if not each.met]
        unmet, self._unmet = self._unmet, [f"{state.id}: {words}" for state, words in found]
        if not self._unmet or self._unmet == unmet:
            self._unmet = []
            return
        why = f"it can't go on: {'; '.join(self._unmet)}. {remedies(self._deployed.program, {state.id for state, _ in found})}"
        self._services.log("warning", why)
        self._tell(detail=why)
        raise refuse(why, "status", "paused", "all that its states need")

    def set_breakpoints(self, states: Sequence[str]) -> None:
        """Pause before what these states do. Refused for a state that does nothing."""
        check_breakpoints(self._deployed, states)
        with self._lock:
            self._gate.set_breakpoints(states)
            self._tell()

    def take(self, id: str, way: int | None) -> RunState:
        """Leave an active state by its `way`-th transition, or (None) as though done. Refused where there is no such way."""
        with self._lock:
            self._not_stopping()
            if not self.active:
                raise refuse("the program has ended", "status", self._state.status, "running or paused")
            # Not what was told last: a prompt may be out before the driving thread has told of the state that asks it.
            if id not in (active := self._chart.active() or self._state.active):
                raise refuse("the state is not active", "state", id, f"one of: {', '.join(active)}")
            state = next(state for state in self._deployed.program.states() if state.id == id)
            leading = {k: each.file for k, each in enumerate(state.transitions) if each.file.target}
            ways = "; ".join(
                f"{k}: {each.event or each.cond or 'always'} → {each.target}" for k, each in leading.items()
            )
            if way is None:
                done = {f"done.invoke.{id}", f"done.state.{id}"}
                way = next((k for k, each in leading.items() if done & set((each.event or "").split())), None)
                if way is None:
                    raise refuse("the state has no way out for being done", "way", None, ways or "a state that has one")
            elif way not in leading:
                raise refuse("the state has no such way out", "way", way, ways or "a state that has one")
            unset = [name for name, value in leading[way].set.items() if "_event" in str(value)]
            left_out = f"; not set, for want of a result: {', '.join(unset)}" if unset else ""
            self._services.log("warning", f"{id} → {leading[way].target}, because an operator said so{left_out}")
            self._chart.take(id, way)
            return self.state

    def let_fail(self, id: str) -> RunState:
        """Let the program go on, as it says, from a failure that the run has paused for. Refused where none waits."""
        waiting = self._chart.failing()
        if id not in waiting:
            expected = f"one that has failed: {', '.join(waiting) or 'none has'}"
            raise refuse("what the state does has not failed", "state", id, expected)
        if not self._chart.let_fail(id):
            raise refuse(
                "the program says nowhere what follows when it fails", "state", id, "retry it, skip it or stop"
            )
        return self.state

    def set_parameters(self, parameters: Mapping[str, Any]) -> None:
        """Change parameters; each counts from when it is used next. Refused, naming the first that can't be so."""
        with self._lock:
            if not self.active:
                raise refuse("the program has ended", "status", self._state.status, "running or paused")
            check_parameters(self._deployed.program, parameters)
            self._parameters.update(parameters)
            self._chart.set_parameters(parameters)
            self._tell(data=self._data())

    def set_autonomy(self, level: str) -> None:
        """How much the run does without asking. Refused for a level that is none."""
        with self._lock:
            self._chart.set_autonomy(level)
            self._permissions.set_level(level)
            self._tell(autonomy=level)

    def _allow(self, question: Question) -> None:
        self._chart.allow(question)

    def again_from(self, state: str, *, paused: bool, within: Deployed) -> Start:
        """How a run begins that goes on in a state with what this one has remembered, as far as the program `within` has it."""
        with self._lock:
            why = f"before {state}, as asked" if paused else ""
            remembered, parameters = self._chart.remembered(), dict(self._parameters)
        if within is not self._deployed:
            known = within.program.remembers()
            remembered, parameters = {name: remembered[name] for name in remembered if name in known}, {}
            return Start((state,), remembered, parameters, paused=why)
        return Start((state,), remembered, parameters, paused=why, edit=self._edit.waiting)

    def edit(self, waiting: Waiting) -> None:
        """Go on in another version of the program, once the active states are there; until then, the operator is asked."""
        self._edit.wanted(waiting)
        self._chart.post(Event(EDITED))

    def _go_over(self) -> bool:
        """Where another version waits, and has a place for what is active: go on in that one. Between two macrosteps."""
        waiting = self._edit.waiting
        if waiting is None or self._permissions.asked:  # a way out that is asked about is this version's
            return False
        newer = waiting.newer
        program = newer.program
        if missing := self._chart.missing_in(program):
            self._edit.ask(missing, self.stop)
            return False
        with self._lock:
            kept = {name: value for name, value in self._parameters.items() if not program.problem(name, value)[0]}
            self._deployed, self._parameters = newer, {**newer.parameters, **kept, **waiting.parameters}
            chart = self._chart_of(program, {**newer.names(), **self._parameters})
            anew = chart.takes_over(self._chart)
            chart.set_autonomy(self._state.autonomy)
            self._chart, self._doing = chart, _doing(program)
            halting = {state.id for state in program.states() if state.file.do}
            self._gate.set_breakpoints(halting.intersection(self._gate.breakpoints))
            self._tell(deployment=newer.id, hash=program.hash, active=chart.active(), data=self._data())
        # After it was kept that it goes on in this version: killed between the two, it would be without.
        self._edit.done(waiting)
        begun = f"; {', '.join(anew)} begins anew, for it does something else now" if anew else ""
        self._services.log("info", f"{program.name} was edited: the run goes on in version {program.hash}{begun}")
        return True

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
        if again := self._chart.retries(state):
            why = self._chart.words("{failure}", state.scope)
            self._services.log("warning", f"{state.id}: once more ({again} of {state.file.retry}): {why}")
        workspace.pin(self._deployed.folder)  # for this thread, which is the activity's own
        return self._made(state, values)

    def _made(self, state: State, values: Mapping[str, Any]) -> Activity:
        return ACTIVITIES[state.file.do](replace(self._context, seeds=self._seeds.get(state.id, ())), values)

    def _waits(self, why: str) -> None:
        """An activity waits at the gate, which it has closed itself where there is a reason."""
        with self._lock:
            if not self.active:
                return  # its state was left as it came here, and the run has ended
            if why and self._gate.is_open:
                why = ""  # the operator has paused and gone on meanwhile
            # The driving thread tells the same soon: whoever reads that a state waits finds it among the active ones.
            now = {"active": self._chart.active() or self._state.active, "data": self._data()}
            if not why or self._stopping:
                self._tell(**now)
                return
            self._clock.stand()
            try:
                self._motion.pause()  # what a parallel state moves
            except Unreachable as silent:
                self._services.log("warning", f"{why}: {silent}")
            self._unmet = []
            self._tell(status="paused", detail=why, **now)
        self._services.daemon.release_time()

    def _drive(self) -> None:
        if not self._start.paused:
            self._services.daemon.hold_time(HOLD_S)
        try:
            self._chart.begin()
            while (end := self._chart.ended) is False:
                if self._go_over():
                    continue
                active = self._chart.active()
                with self._lock:  # else a parameter that is set meanwhile would be told as it was before
                    self._tell(active=active, data=self._data())
                if self._doing.isdisjoint(active):  # nothing computes: what it waits for may be time itself
                    self._services.daemon.release_time()
                self._chart.step()
            if isinstance(end, State):
                status, detail = str(end.file.outcome), self._chart.words(end.file.detail)
            else:
                status, detail = "stopped", "stopped by the operator"
        except Exception as crash:  # noqa: BLE001
            # Whatever went wrong in here, clients must not be left with a run that seems to go on.
            _log.exception("%s crashed", self._context.run)
            status, detail = "failed", f"the engine's own error: {type(crash).__name__}: {crash}"
            self._chart.abandon()
        finally:
            self._permissions.withdraw()
            self._edit.end()
            self._services.daemon.tell_no_time(self._clock.tick)
            self._services.daemon.release_time()
        if not self._motion.settled(_SETTLE_S):
            self._services.log("warning", "the program has ended, but the daemon has not told that its motion has")
        self._motion.end()
        self._services.daemon.release_time()  # its last motion may have asked for time to think at its end
        self._tell(status=status, detail=detail, active=self._chart.active(), data=self._data())
        if self._watch is not None:
            self._watch.ended(self.state, (self.state.time_ns - self._began_ns) / 1e9, self._notes.facts())

    def _look_back(self) -> None:
        """Say what of this run looks like runs that failed, once each."""
        if self._watch is None:
            return
        words = self._watch.warnings(self._notes.facts())
        with self._lock:
            new = [each for each in words if each not in self._state.warnings]
            self._tell(warnings=[*self._state.warnings, *new])
        for each in new:
            self._services.log("warning", f"this looks like failures of the past: {each}")

    def _data(self) -> dict[str, Any]:
        return {**self._chart.variables(), **self._parameters}

    def _tell(self, **changes: Any) -> None:
        with self._lock:
            now = {"waiting": self._gate.waiting(), "breakpoints": self._gate.breakpoints}
            changes = {**now, "failing": self._chart.failing(), **changes}
            state = msgspec.structs.replace(self._state, **changes, time_ns=self._services.daemon.time_ns)
            if msgspec.structs.replace(state, time_ns=self._state.time_ns) == self._state:
                return
            self._state = state
            self._kept()
            self._publish(self._deployed, state)

    def _kept(self) -> None:
        with self._lock:
            self._keep(self._deployed, self._state, self._edit.waiting)


def _doing(program: Program) -> frozenset[str]:
    """States that do something themselves."""
    return frozenset(state.id for state in program.states() if state.file.do not in ("", "program"))
