"""A program as a running statechart: python-statemachine gives SCXML's semantics, what states `do:` is `engines.programs.doing`'s.

The machine is driven by one thread. Activities run in threads of theirs and only post events, so that a macrostep is never entered
from two sides, and none is lost between the end of one macrostep and the next.
"""

from __future__ import annotations

import functools
import queue
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from statemachine.io.interpreter import Interpreter
from statemachine.io.native import native_dict_to_definition
from statemachine.io.yaml.reader import YAMLReader

from engines.activities.base import Activity, ActivityFailed
from engines.programs import actions, failing, native
from engines.programs.check import STOPPED, check_together, takes
from engines.programs.doing import Doing, Event
from engines.programs.expressions import ProgramEvaluator
from engines.programs.native import AFTER, ALLOW, RETRY, STOP, TAKE
from engines.programs.program import AUTONOMY, RETRIES, Program, State
from engines.programs.scope import NO_VALUE, Scope, Scopes
from engines.runs.autonomy import Question
from engines.runs.clock import RunClock
from engines.runs.gate import RunGate
from engines.runs.history import RunHistory

_FOR_GOOD = frozenset({"bad_argument", "cancelled", "crashed", "refused", "stopped", "taken_over"})
"""reasons of failures that another attempt would not change, or that somebody wants"""
_WANTED = frozenset({"cancelled", "stopped", "taken_over"})
"""reasons of failures that somebody wants"""

EDITED = "handrail.edited"
"""that another version of the program waits: whoever drives the chart looks; the program itself never hears of it"""

Make = Callable[[State, Mapping[str, Any]], Activity]
"""state, its activity's argument values → the activity"""


class Chart(Interpreter):
    """One run of a program's statechart."""

    def __init__(
        self,
        program: Program,
        names: Mapping[str, Any],
        make: Make,
        *,
        gate: RunGate | None = None,
        clock: RunClock | None = None,
        history: RunHistory | None = None,
        ask: Callable[[Question], None] | None = None,
        withdraw: Callable[[str], None] = lambda state: None,
        start_at: Iterable[str] = (),
        outlasts: frozenset[str] = frozenset(),
        pause_on_failure: bool = False,
        log: Callable[[str, str], None] = lambda level, text: None,
    ):
        """`make` makes a state's activity when it is entered.

        :param names: the values of variables, parameters and resources
        :param gate: passed by every activity before it is made
        :param clock: by which time-outs count
        :param history: told of each state that is entered and left
        :param ask: told of ways out that the operator is to be asked about first; None: he is not
        :param withdraw: told of each state that was left, so that nothing is asked about it any more
        :param start_at: begin in these states instead of the initial ones; one, or one of each parallel region
        :param outlasts: reasons of failures that the program does not hear of: the gate closes, and the activity begins anew
        :param pause_on_failure: so does any other failure that the program has no way on from, or that nobody could foresee
        :param log: told of what the program logs
        :raises ValueError: no such state, or states that can't be active together
        """
        evaluator = ProgramEvaluator()
        super().__init__(reader=YAMLReader(), evaluator=evaluator)
        self.program, self._make, self._history = program, make, history
        self.gate, self._clock = gate or RunGate(lambda why: None), clock or RunClock()
        self._outlasts, self._pause_on_failure = outlasts, pause_on_failure
        self._failing: dict[str, Event] = {}
        """active state → its failure, which the program has not heard of yet"""
        self._ask, self._withdraw, self._event = ask, withdraw, Event("")
        self._timeouts: dict[str, list[Callable[[], None]]] = {}
        self._since: dict[str, float] = {}
        """active state → s of the run's time when it was entered"""
        self._visits: dict[str, threading.Event] = {}
        """active state → set when it is left"""
        self._doing = Doing(self)
        start_at = tuple(start_at)
        self._scopes = Scopes(program, evaluator, names)
        self._scopes.own.data.when_asked(self._asks)
        for scope in self._scopes:
            scope.data.when_told(functools.partial(self._logs, log, scope), functools.partial(self._sends, scope))
        self._by_id = {state.id: state for state in program.states()}
        self._fresh: set[str] = set()
        """active states that run a program in which nothing has been done yet"""
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        check_together(self._by_id, start_at)
        definition = native.chart(program, start_at)
        above = (each.id for id in start_at for each in self._by_id[id].lineage() if each.id != id)
        self._scopes.keep_restored(frozenset(above))
        self.process_definition(native_dict_to_definition(definition), location=program.name)
        self._machine: Any = None

    # ------------------------------------------------------------------------------------------- called by the driving thread

    def begin(self) -> None:
        """Enter the initial states."""
        self._machine = self.scs[self.program.name](model=self._scopes.own.data, listeners=[self])
        self._doing.begin()
        self._scopes.keep_restored(frozenset())

    def takes_over(self, old: Chart) -> list[str]:
        """Begin where a chart of an older version of the program is (see `missing_in`), which is of no use then.

        What its states do goes on, but for what the new version does otherwise in them, which begins anew. What has happened and
        was not carried out yet is carried out by the new version.

        :return: the states whose activity begins anew
        """
        self._events, self._doing, self._fresh = old._events, old._doing, old._fresh & self._by_id.keys()
        self._visits, self._since, self._failing = old._visits, old._since, old._failing
        self._scopes.take_over(old._scopes, frozenset(self._visits))
        for id in self._visits:
            for take_back in old._timeouts.pop(id, []):
                take_back()
            self._begin_timeouts(self._by_id[id])
        anew = [id for id in self._visits if _does_otherwise(old._by_id[id], self._by_id[id])]
        for id in anew:
            self._failing.pop(id, None)
            self._visits[id].set()
            self._doing.left(self._visits[id])
        self._doing.belongs_to(self)
        for id in anew:
            self._visits[id] = threading.Event()
            if self._by_id[id].file.do and self._by_id[id].called is None:
                self._doing.entered(self._by_id[id], self._visits[id])
        before = old._machine
        self._scopes.own.data.state = type(before.configuration_values)(before.configuration_values)
        self._machine = self.scs[self.program.name](model=self._scopes.own.data, listeners=[self])
        there = {state.id: state for state in self._machine.states_map.values()}
        for name, states in before.history_values.items():
            if all(state.id in there for state in states):
                self._machine.history_values[name] = [there[state.id] for state in states]
        self._doing.begin()
        return anew

    def missing_in(self, program: Program) -> str:
        """An active state that another version of the program has not, or not in the same place; empty: it can take over."""
        states, active = {state.id: state for state in program.states()}, self.active()
        for id in reversed(active):
            if id not in states:
                return id
        for id in active:
            state, before = states[id], self._by_id[id]
            if [each.id for each in state.lineage()] != [each.id for each in before.lineage()]:
                return id
            inside = {child.id for child in state.children}.intersection(active)
            if (state.called is None) != (before.called is None) or state.file.final != before.file.final:
                return id
            if len(inside) != (len(state.children) if state.file.parallel else min(1, len(state.children))):
                return id
        return ""

    def step(self, timeout_s: float | None = None) -> bool:
        """Wait for the next event and carry out all that follows from it. False when none came in time (None: for ever)."""
        try:
            event = self._event = self._events.get(timeout=timeout_s)
        except queue.Empty:
            return False
        if event.name != EDITED and (event.left is None or not event.left.is_set()):
            self._machine.send(event.name, **event.data)
            self._doing.begin()
        return True

    @property
    def ended(self) -> State | bool | None:
        """False while it runs; then the final state that it reached, None when it was stopped."""
        if not self._machine.is_terminated:
            return False
        final = next(state.id for state in self._machine.configuration if state.final and state.parent is None)
        return None if final == STOPPED else self._by_id[final]

    def active(self) -> list[str]:
        """Ids of the active states, outermost first; none before it has begun."""
        if self._machine is None:
            return []
        # Other threads look while this one enters states, and may find inner ones without those around them. They take the
        # machine's values and not its states: it keeps the states that were read last, by whomever, and goes on with them.
        return self.with_parents(id for id in self._machine.configuration_values if id in self._by_id)

    def with_parents(self, ids: Iterable[str]) -> list[str]:
        """States and those around them, outermost first."""
        active = {each.id for id in ids for each in self._by_id[id].lineage()}
        states = [state for state in self._by_id.values() if state.id in active]
        return [state.id for state in sorted(states, key=lambda state: len(list(state.lineage())))]

    def variables(self) -> dict[str, Any]:
        """The program's variables as they stand; then variables and parameters of the programs that active states run, by the
        state's id and theirs: ``grasping/force``.
        """
        return self._scopes.remembered(frozenset(self.active()))

    def remembered(self) -> dict[str, Any]:
        """The same, of every program that a state has run."""
        return self._scopes.remembered()

    def words(self, text: str, scope: str = "") -> str:
        """A text of a program (of the one that the state `scope` runs) with its expressions filled in."""
        return self._scopes[scope].words(text)

    # --------------------------------------------------------------------------------------------------- called by any thread

    def post(self, event: Event) -> None:
        """Hand an event to the driving thread."""
        self._events.put(event)

    def failing(self) -> dict[str, str]:
        """Active states whose activity has failed and waits for help, and why."""
        return {id: str(failure.data["message"]) for id, failure in dict(self._failing).items()}

    def tries_again(self) -> None:
        """What has failed is about to begin anew."""
        self._failing.clear()

    def let_fail(self, state: str) -> bool:
        """Let the program hear of a state's failure after all; False where none waits, or where it has no way out for one."""
        failure = self._failing.pop(state, None)
        own = (each for each in self._by_id[state].lineage() if each.scope == self._by_id[state].scope)
        if failure is None or not any(takes(way, failing.FAILED) for each in own for way in each.transitions):
            return False
        self.post(failure)
        return True

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """New values, for whatever is evaluated from now on."""
        self._scopes.own.set(values)

    def allow(self, question: Question) -> None:
        """Take the way that was asked about, with the data of the event that would have taken it; nothing if the state was left."""
        self.post(Event(f"{ALLOW}.{question.state}.{question.way}", question.data, question.left))

    def set_autonomy(self, level: str) -> None:
        """Which ways are asked about from now on; one of `AUTONOMY`."""
        for scope in self._scopes:
            scope.data.autonomy_level = AUTONOMY[level]

    def take(self, state: str, way: int) -> None:
        """Leave a state by one of its transitions that lead somewhere, whatever the guard says. What it sets from the event's data
        stays as it was.
        """
        self.post(Event(f"{TAKE}.{state}.{way}", left=self._visits.get(state)))

    def stop(self) -> None:
        """End the run from whatever state it is in; its activities are cancelled."""
        self.post(Event(STOP))

    def abandon(self) -> None:
        """The machine itself can't go on: cancel what its states do."""
        self._doing.abandon()

    # ---------------------------------------------------------------------------------------- called by python-statemachine

    def before_transition(self, event_data: Any) -> None:
        """Keeps the last failure's words where expressions find them, as `failure`: an activity's, or an expression's own."""
        if str(event_data.event).startswith(("error.execution", RETRY)):
            told = event_data.trigger_data.kwargs
            source = told.get("_source")
            # A guard's or an assignment's own error says not whose it is.
            for scope in self._scopes if source is None else [self._scopes[source.rpartition("/")[0]]]:
                scope.data.failure = str(told.get("message") or told.get("error", ""))
                scope.reason = str(told.get("reason", ""))

    def _logs(self, log: Callable[[str, str], None], scope: Scope, text: str) -> None:
        log("info", scope.words(text))

    def _sends(self, scope: Scope, event: str) -> None:
        name, after, given = actions.sent(event)
        seconds, data = float(scope.value(after)), {key: scope.value(value) for key, value in given.items()}
        if not 0 <= seconds < float("inf"):
            raise ValueError(f"after: got {seconds:g}; expected a time in s")
        if seconds:
            self._clock.after(seconds, lambda: self.post(Event(name, data)))
        else:
            self.post(Event(name, data))

    def _asks(self, way: str) -> None:
        state, _, index = way.rpartition(".")
        transition, left = self._by_id[state].transitions[int(index)].file, self._visits[state]
        if self._ask is None:
            self.post(Event(f"{ALLOW}.{way}", self._event.data, left))
            return
        done = {f"done.invoke.{state}": "is done", f"done.state.{state}": "is done", "error.execution": "has failed"}
        happened = f"{self._by_id[state].file.title or state} {done.get(self._event.name, _told(self._event.name))}"
        why = f": {told}" if (told := self._event.data.get("message")) else ""
        goal = " and ".join(
            self._by_id[each].file.title or each for each in str(transition.target).split() if each in self._by_id
        )
        text = f"{happened}{why}. Go on with: {transition.title or goal or transition.target}?"
        self._ask(Question(state, int(index), transition.autonomy, text, self._event.data, left))

    def on_enter_state(self, state: Any) -> None:
        """A state becomes active: its time-outs begin, and the program that it runs."""
        found = self._by_id.get(state.id)
        if found is None:
            return
        self._visits[state.id] = threading.Event()
        if self._history is not None:
            self._history.entered(state.id)
        if found.called is not None:
            self._begin_program(found)
        elif found.file.do:
            self._doing.entered(found, self._visits[state.id])
        elif found.file.final and found.parent is not None and found.parent.called is not None:
            self._end_program(found.parent, found)
        self._since[state.id] = self._clock.elapsed_s
        self._begin_timeouts(found)

    def _begin_timeouts(self, state: State) -> None:
        for k, way in enumerate(state.transitions):
            if way.file.after is not None:
                self._begin_timeout(state, f"{AFTER}.{state.id}.{k}", way.file.after)

    def _begin_program(self, state: State) -> None:
        scope = self._scopes[state.id]
        self._fresh.add(state.id)
        try:
            scope.begin(self._scopes.restored(state.id))
        except ValueError as problem:
            scope.problem = f"{state.id}: {problem}"
            self.post(self.failure(state, "bad_argument", scope.problem, self._visits[state.id]))

    def _end_program(self, state: State, final: State) -> None:
        """The program that a state runs has come to an end: that is the end of what the state does."""
        scope, left, ended = self._scopes[state.id], self._visits[state.id], f"done.invoke.{state.id}"
        if self._scopes.blocked(state.id):
            return
        try:
            if final.file.outcome == "succeeded":
                self.post(Event(ended, {"outcome": final.name, **scope.outputs()}, left))
                return
            detail, reason = scope.words(final.file.detail), final.name
        except NO_VALUE as problem:
            detail, reason = f"{final.id}: {problem}", "bad_result"
        if scope.reason in _FOR_GOOD and state.file.retry:
            reason = scope.reason  # nobody wants it tried again, or it would not help
        self.post(self.failure(state, reason, detail or f"{scope.program.name} has ended as {final.name}", left))

    def failure(self, state: State, reason: str, message: str, left: threading.Event | None = None) -> Event:
        """What follows when what a state does has failed."""
        name = "error.execution" if self.fails_for_good(state, reason) else f"{RETRY}.{state.id}"
        return Event(name, {"message": message, "reason": reason, "_source": state.id}, left)

    def _begin_timeout(self, state: State, event: str, after: Any) -> None:
        left = self._visits[state.id]
        try:
            seconds = float(self._scopes[state.scope].value(after))
            if not 0 < seconds < float("inf"):
                raise ValueError(f"got {seconds:g}; expected a time in s, above 0")
        except NO_VALUE as problem:
            text = f"{state.id}: after: {after!r} is no time: {problem}"
            self.post(Event("error.execution", {"message": text, "reason": "bad_argument", "_source": state.id}, left))
            return
        gone = self._clock.elapsed_s - self._since[state.id]
        take_back = self._clock.after(max(seconds - gone, 0.0), lambda: self.post(Event(event, left=left)))
        self._timeouts.setdefault(state.id, []).append(take_back)

    def on_exit_state(self, state: Any, event: Any) -> None:
        """A state is left: its time-outs end, and its retries, unless it is entered for another one."""
        for take_back in self._timeouts.pop(state.id, []):
            take_back()
        self._failing.pop(state.id, None)
        if (left := self._visits.pop(state.id, None)) is not None:
            left.set()
            self._doing.left(left)
        self._withdraw(state.id)
        found, name = self._by_id.get(state.id), str(event or "")
        if found is not None and found.file.retry:
            again = name == f"{RETRY}.{state.id}"
            self._scopes[found.scope].set({f"{RETRIES}{found.name}": self.retries(found) + 1 if again else 0})
        if self._history is not None:
            self._history.left(state.id, _told(name))

    def fails_for_good(self, state: State, reason: str) -> bool:
        """Whether a failure of a state's activity is the program's to know: no retry is left, or none would help."""
        return reason in _FOR_GOOD or self.retries(state) >= state.file.retry

    def waits_for_help(self, state: State, failed: ActivityFailed, left: threading.Event) -> bool:
        """Whether the run pauses because of a failure, so that the activity begins anew when it goes on."""
        if failed.reason in self._outlasts:
            self.gate.shut(f"{failed}; {state.id} begins anew when the run goes on")
            return True
        if not self._pause_on_failure or failed.reason in _WANTED or not self.fails_for_good(state, failed.reason):
            return False
        foreseen = failed.reason not in _FOR_GOOD
        if foreseen and not failing.ends(state, self._by_id, lambda each: self.retries(each) < each.file.retry):
            return False
        self._failing[state.id] = self.failure(state, failed.reason, str(failed), left)
        self.gate.shut(f"{state.file.title or state.id} has failed: {failed}")
        return True

    def retries(self, state: State) -> int:
        """How often the state's activity was begun anew since it was entered."""
        return getattr(self._scopes[state.scope].data, f"{RETRIES}{state.name}", 0)

    def make_activity(self, state: State) -> Activity:
        """The activity of a state that was just entered, with its arguments' values. Raises ActivityFailed where one has none."""
        state = self._by_id[state.id]  # of a newer version, where it has waited at the gate meanwhile
        return self._make(state, self.arguments(state))

    def arguments(self, state: State) -> Mapping[str, Any]:
        """The values of what a state's activity is given, as they stand. Raises ActivityFailed where one has none."""
        from engines.activities import ACTIVITIES

        return self._scopes[state.scope].arguments(state, ACTIVITIES[state.file.do].arguments)

    def doing(self) -> list[tuple[State, Activity | None]]:
        """Active states that do something, and their activities; None where one has not begun."""
        return self._doing.present()

    def admit(self, state: State, cancelled: threading.Event) -> bool:
        """Wait until a state may begin what it does; False when it was left instead. Called by the activity's own thread."""
        if self._scopes.blocked(state.scope):
            cancelled.wait()  # the program that it belongs to could not begin: what follows is not this state's to say
        around = [each.id for each in state.lineage() if each.id in self._fresh]
        self._fresh.difference_update(around)
        return self.gate.admit(state.id, cancelled, within=around)


def _does_otherwise(old: State, new: State) -> bool:
    return (old.file.do, old.file.with_) != (new.file.do, new.file.with_) and (old.called is None or new.called is None)


def _told(event: str) -> str:
    """An event's name, for people."""
    if event.startswith((TAKE, STOP)):
        return "operator"
    return {AFTER: "time-out", RETRY: "retry", ALLOW: "operator"}.get(".".join(event.split(".")[:2]), event)
