"""A program as a running statechart: python-statemachine gives SCXML's semantics, `do:` becomes an `invoke` of a type of our own.

The machine is driven by one thread. Activities run in threads of theirs and only post events, so that a macrostep is never entered
from two sides, and none is lost between the end of one macrostep and the next.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import msgspec
from statemachine.invoke import InvokeContext
from statemachine.io.interpreter import Interpreter
from statemachine.io.model import InvokeDefinition
from statemachine.io.native import native_dict_to_definition
from statemachine.io.yaml.reader import YAMLReader

from engines.activities.base import SHAPES, Activity, ActivityFailed, Argument, Kind, goals_in
from engines.programs import nested
from engines.programs.check import STOPPED
from engines.programs.expressions import ProgramEvaluator
from engines.programs.program import AUTONOMY, CONSTANTS, RETRIES, Program, State, Transition
from engines.programs.text import fill
from engines.runs.autonomy import Question
from engines.runs.clock import RunClock
from engines.runs.gate import RunGate
from engines.runs.history import RunHistory
from handrail.messages import Along, FrameGoal, GazeGoal
from handrail.topics import Unreachable

_INVOKE_TYPE = "handrail"
_STOP = "handrail.stop"
_TAKE = "handrail.take"
_AFTER = "handrail.after"
_RETRY = "handrail.retry"
_ALLOW = "handrail.allow"
_FOR_GOOD = frozenset({"bad_argument", "cancelled", "crashed", "refused", "stopped", "taken_over"})
"""reasons of failures that another attempt would not change, or that somebody wants"""
_log = logging.getLogger(__name__)

Make = Callable[[State, Mapping[str, Any]], Activity]
"""state, its activity's argument values → the activity"""


@dataclass(frozen=True)
class Event:
    """Something that happened, for the machine."""

    name: str
    data: Mapping[str, Any] = field(default_factory=dict)
    left: threading.Event | None = None
    """set once the visit of a state that it is about has ended: then nothing follows, even where the state is active anew"""


class ProgramData:
    """SCXML's data model: the program's variables, parameters, resources and constants as attributes."""

    def __init__(self, names: Mapping[str, Any]):
        self.state: Any = None  # python-statemachine keeps the configuration here
        self.failure = ""
        self.autonomy_level = max(AUTONOMY.values())
        self._asked: Callable[[str], None] = lambda way: None
        for name, value in names.items():
            setattr(self, name, value)

    @property
    def asked(self) -> str:
        """Assigned to by transitions that ask instead of leading on: state and index of the way that is asked about."""
        return ""

    @asked.setter
    def asked(self, way: str) -> None:
        self._asked(way)

    def when_asked(self, call: Callable[[str], None]) -> None:
        """Have `call` told of such a way."""
        self._asked = call


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
    ):
        """`make` makes a state's activity when it is entered.

        :param names: the values of variables, parameters and resources
        :param gate: passed by every activity before it is made
        :param clock: by which time-outs count
        :param history: told of each state that is entered and left
        :param ask: told of ways out that the operator is to be asked about first; None: he is not
        :param withdraw: told of each state that was left, so that nothing is asked about it any more
        :param start_at: begin in these states instead of the initial ones; one, or one of each parallel region
        :raises ValueError: no such state, or states that can't be active together
        """
        super().__init__(reader=YAMLReader(), evaluator=ProgramEvaluator())
        self.program, self._make, self._history = program, make, history
        self.gate, self._clock = gate or RunGate(lambda why: None), clock or RunClock()
        self._ask, self._withdraw, self._event = ask, withdraw, Event("")
        self._timeouts: dict[str, list[Callable[[], None]]] = {}
        self._visits: dict[str, threading.Event] = {}
        """active state → set when it is left"""
        self._invokers: list[_ActivityInvoker] = []
        self.abandoned = False
        retries = {f"{RETRIES}{state.id}": 0 for state in program.states() if state.file.retry}
        self.data = ProgramData({**CONSTANTS, **retries, **names})
        self.data.when_asked(self._asks)
        # What expressions are evaluated over; the machine itself does not exist yet when its first activities begin.
        self._names = SimpleNamespace(model=self.data)
        self._by_id = {state.id: state for state in program.states()}
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        definition = _native(program, _initial(program, self._by_id, start_at))
        self.process_definition(native_dict_to_definition(definition), location=program.name)
        self._machine: Any = None

    # ------------------------------------------------------------------------------------------- called by the driving thread

    def begin(self) -> None:
        """Enter the initial states."""
        self._machine = self.scs[self.program.name](model=self.data, listeners=[self])

    def step(self, timeout_s: float | None = None) -> bool:
        """Wait for the next event and carry out all that follows from it. False when none came in time (None: for ever)."""
        try:
            event = self._event = self._events.get(timeout=timeout_s)
        except queue.Empty:
            return False
        if event.left is None or not event.left.is_set():
            self._machine.send(event.name, **event.data)
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
        active = {state.id for state in self._machine.configuration}
        states = [state for state in self._by_id.values() if state.id in active]
        return [state.id for state in sorted(states, key=lambda state: len(list(state.lineage())))]

    def variables(self) -> dict[str, Any]:
        """The program's variables as they stand."""
        return {name: getattr(self.data, name) for name in self.program.variables}

    def words(self, text: str) -> str:
        """A text of the program with its expressions filled in."""
        return fill(text, self._value)

    # --------------------------------------------------------------------------------------------------- called by any thread

    def post(self, event: Event) -> None:
        """Hand an event to the driving thread."""
        self._events.put(event)

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """New values, for whatever is evaluated from now on."""
        for name, value in values.items():
            setattr(self.data, name, value)

    def allow(self, question: Question) -> None:
        """Take the way that was asked about, with the data of the event that would have taken it; nothing if the state was left."""
        self.post(Event(f"{_ALLOW}.{question.state}.{question.way}", question.data, question.left))

    def set_autonomy(self, level: str) -> None:
        """Which ways are asked about from now on; one of `AUTONOMY`."""
        self.data.autonomy_level = AUTONOMY[level]

    def take(self, state: str, way: int) -> None:
        """Leave a state by one of its transitions that lead somewhere, whatever the guard says. What it sets from the event's data
        stays as it was.
        """
        self.post(Event(f"{_TAKE}.{state}.{way}", left=self._visits.get(state)))

    def stop(self) -> None:
        """End the run from whatever state it is in; its activities are cancelled."""
        self.post(Event(_STOP))

    def abandon(self) -> None:
        """The machine itself can't go on: cancel what its states do."""
        self.abandoned = True
        for invoker in self._invokers:
            invoker.abandon()

    # ---------------------------------------------------------------------------------------- called by python-statemachine

    def make_invoker(self, invoke_def: InvokeDefinition) -> Any:
        """An activity for our own type of invoke; nothing else is invoked."""
        self._invokers.append(_ActivityInvoker(self, self._by_id[invoke_def.id or ""]))
        return self._invokers[-1]

    def before_transition(self, event_data: Any) -> None:
        """Keeps the last failure's words where expressions find them, as `failure`: an activity's, or an expression's own."""
        if str(event_data.event).startswith(("error.execution", _RETRY)):
            told = event_data.trigger_data.kwargs
            self.data.failure = str(told.get("message") or told.get("error", ""))

    def _asks(self, way: str) -> None:
        state, _, index = way.rpartition(".")
        transition, left = self._by_id[state].transitions[int(index)].file, self._visits[state]
        if self._ask is None:
            self.post(Event(f"{_ALLOW}.{way}", self._event.data, left))
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
        """A state becomes active: its time-outs begin."""
        found = self._by_id.get(state.id)
        if found is None:
            return
        self._visits[state.id] = threading.Event()
        if self._history is not None:
            self._history.entered(state.id)
        for k, way in enumerate(found.transitions):
            if way.file.after is not None:
                self._begin_timeout(found.id, f"{_AFTER}.{found.id}.{k}", way.file.after)

    def _begin_timeout(self, state: str, event: str, after: Any) -> None:
        left = self._visits[state]
        try:
            seconds = float(self._value(after))
            if not 0 < seconds < float("inf"):
                raise ValueError(f"got {seconds:g}; expected a time in s, above 0")
        except (NameError, TypeError, ValueError, ArithmeticError, AttributeError, LookupError) as problem:
            text = f"{state}: after: {after!r} is no time: {problem}"
            self.post(Event("error.execution", {"message": text, "reason": "bad_argument", "source": state}, left))
            return
        take_back = self._clock.after(seconds, lambda: self.post(Event(event, left=left)))
        self._timeouts.setdefault(state, []).append(take_back)

    def on_exit_state(self, state: Any, event: Any) -> None:
        """A state is left: its time-outs end, and its retries, unless it is entered for another one."""
        for take_back in self._timeouts.pop(state.id, []):
            take_back()
        if (left := self._visits.pop(state.id, None)) is not None:
            left.set()
        self._withdraw(state.id)
        found, name = self._by_id.get(state.id), str(event or "")
        if found is not None and found.file.retry:
            retries = f"{RETRIES}{state.id}"
            again = name == f"{_RETRY}.{state.id}"
            setattr(self.data, retries, getattr(self.data, retries) + 1 if again else 0)
        if self._history is not None:
            self._history.left(state.id, _told(name))

    def fails_for_good(self, state: State, reason: str) -> bool:
        """Whether a failure of a state's activity is the program's to know: no retry is left, or none would help."""
        return reason in _FOR_GOOD or self.retries(state) >= state.file.retry

    def retries(self, state: State) -> int:
        """How often the state's activity was begun anew since it was entered."""
        return getattr(self.data, f"{RETRIES}{state.id}", 0)

    # --------------------------------------------------------------------------------------------------------------- values

    def make_activity(self, state: State) -> Activity:
        """The activity of a state that was just entered, with its arguments' values. Raises ActivityFailed where one has none."""
        values = {}
        from engines.activities import ACTIVITIES

        for name, argument in ACTIVITIES[state.file.do].arguments.items():
            given = state.file.with_.get(name)
            try:
                values[name] = argument.default if given is None else self._argument(argument, given)
            except (NameError, TypeError, ValueError, ArithmeticError, AttributeError, LookupError) as problem:
                raise ActivityFailed(
                    "bad_argument", f"{state.id}: {name}: {given!r} has no value: {problem}"
                ) from problem
        return self._make(state, values)

    def _argument(self, argument: Argument, given: Any) -> Any:
        match argument.kind:
            case Kind.ARM | Kind.INSTANCE:
                return getattr(self.data, given)
            case Kind.TEXT:
                return self.words(given)
            case Kind.COMPOUND:
                return self._worded(given)
            case Kind.PORTS:
                return {port: self._deep(value) for port, value in given.items()}
            case Kind.LIST:
                return nested.filled(given, self._value, self.words, lambda name: getattr(self.data, name))
            case Kind.NUMBER:
                value = self._value(given)
                if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
                    raise TypeError(f"got {value!r}; expected a number")
                return argument.default if value is None else float(value)
            case Kind.VALUE:
                return self._value(given)
            case Kind.GOALS | Kind.KEY_FRAMES | Kind.ALONG:
                read = msgspec.convert(given, SHAPES[argument.kind])
                for goal in goals_in(read):
                    if isinstance(goal, FrameGoal | GazeGoal | Along) and goal.instance:
                        goal.instance = getattr(self.data, goal.instance)
                return read
        return given

    def _deep(self, given: Any) -> Any:
        """A value in which every text is an expression."""
        if isinstance(given, dict):
            return {name: self._deep(value) for name, value in given.items()}
        return [self._deep(value) for value in given] if isinstance(given, list) else self._value(given)

    def _worded(self, given: Any) -> Any:
        return nested.filled(given, self.words, self.words, self.words)

    def _value(self, expression: Any) -> Any:
        if not isinstance(expression, str):
            return expression
        return self._evaluator.compile_value(expression)(machine=self._names)


class _ActivityInvoker:
    """What python-statemachine runs (in a thread of its own) when a state with `do:` is entered, and cancels when it is left.

    There is one for all visits of a state: an activity that ends slowly may still run when the state is entered anew.
    """

    def __init__(self, chart: Chart, state: State):
        self._chart, self._state = chart, state
        self.invoke_id, self.idlocation, self.autoforward = state.id, None, False
        self._lock = threading.Lock()
        self._running: dict[threading.Event, Activity | None] = {}
        """each visit's cancellation → its activity, once that was made"""

    def run(self, ctx: InvokeContext) -> None:
        """Do the activity and post how it ended; returns when the state is left, so that the machine hears of it only once."""
        with self._lock:
            self._running[ctx.cancelled] = None
        if self._chart.abandoned:
            ctx.cancelled.set()
        event = self._outcome(ctx)
        self._chart.post(replace(event, left=ctx.cancelled))
        ctx.cancelled.wait()

    def _outcome(self, ctx: InvokeContext) -> Event:
        source = self._state.id
        try:
            if not self._chart.gate.admit(source, ctx.cancelled):
                raise ActivityFailed("cancelled", f"{source} was left before it began")
            activity = self._chart.make_activity(self._state)
            with self._lock:
                self._running[ctx.cancelled] = activity
            if ctx.cancelled.is_set():
                activity.cancel()
            return Event(f"done.invoke.{source}", activity.run())
        except ActivityFailed as failed:
            name = "error.execution" if self._chart.fails_for_good(self._state, failed.reason) else f"{_RETRY}.{source}"
            return Event(name, {"message": str(failed), "reason": failed.reason, "source": source})
        except Exception as crash:  # noqa: BLE001
            # A defect in an activity must end the program by its own failure path, not leave it waiting for ever.
            _log.exception("activity %s of state %s crashed", self._state.file.do, source)
            text = f"{self._state.file.do} crashed: {type(crash).__name__}: {crash}"
            return Event("error.execution", {"message": text, "reason": "crashed", "source": source})
        finally:
            with self._lock:
                del self._running[ctx.cancelled]

    def on_cancel(self) -> None:
        """Called by the driving thread after the state was left."""
        self._chart.gate.wake()
        with self._lock:
            over = [activity for cancelled, activity in self._running.items() if cancelled.is_set() and activity]
        for activity in over:
            if activity.cancelled.is_set():
                continue
            try:
                activity.cancel()
            except Unreachable as silent:
                _log.warning("state %s: %s", self._state.id, silent)

    def abandon(self) -> None:
        """Cancel what runs, though the machine does not leave the state."""
        with self._lock:
            for cancelled in self._running:
                cancelled.set()
        self.on_cancel()


def _told(event: str) -> str:
    """An event's name, for people."""
    if event.startswith((_TAKE, _STOP)):
        return "operator"
    return {_AFTER: "time-out", _RETRY: "retry", _ALLOW: "operator"}.get(".".join(event.split(".")[:2]), event)


def _initial(program: Program, states: Mapping[str, State], start_at: Iterable[str]) -> dict[str | None, str]:
    """Parent (None: of all) → the child that is entered first, where the program itself does not say so or is overruled."""
    initial: dict[str | None, str] = {}
    for id in start_at:
        if id not in states:
            raise ValueError(f"start_at: got {id!r}; expected one of {', '.join(states)}")
        for state in states[id].lineage():
            above = state.parent
            if above is not None and above.file.parallel:
                continue
            key = above.id if above is not None else None
            if initial.setdefault(key, state.id) != state.id:
                raise ValueError(f"start_at: {id!r} can't be active together with {initial[key]!r}")
    return initial


def _native(program: Program, initial: Mapping[str | None, str]) -> dict[str, Any]:
    """The program in python-statemachine's own words, with a final state that StopRun leads to from everywhere."""
    first = initial.get(None) or next((root.id for root in program.roots if root.file.initial), program.roots[0].id)
    states = {state.id: _native_state(state, initial, state.id == first) for state in program.roots}
    return {"name": program.name, "states": {**states, STOPPED: {"final": True}}}


def _native_state(state: State, initial: Mapping[str | None, str], first: bool) -> dict[str, Any]:
    """`first`: it is entered with its parent."""
    if state.file.final:
        return {"final": True, "initial": first}
    native: dict[str, Any] = {"initial": first, "parallel": state.file.parallel}
    native["transitions"] = [
        each for k, way in enumerate(state.transitions) for each in _native_ways(way, f"{state.id}.{k}")
    ]
    if state.file.retry:
        native["transitions"].append({"event": f"{_RETRY}.{state.id}", "target": state.id})
    native["transitions"] += [
        _taken(way, f"{_TAKE}.{state.id}.{k}") for k, way in enumerate(state.transitions) if way.file.target
    ]
    if not state.children:
        # First in each innermost state: no other transition of the program can take the event away.
        native["transitions"].insert(0, {"event": _STOP, "target": STOPPED})
    else:
        entered = {initial[state.id]} if state.id in initial else {child.id for child in state.initial_children()}
        native["states"] = {
            child.id: _native_state(child, initial, not state.file.parallel and child.id in entered)
            for child in state.children
        }
    if state.history:
        native["history"] = {
            name: {"type": state.history_type[name], "transitions": [_native_transition(way) for way in ways]}
            for name, ways in state.history.items()
        }
    if state.file.do:
        native["invoke"] = [{"type": _INVOKE_TYPE, "id": state.id}]
    return native


def _native_ways(way: Transition, key: str) -> list[dict[str, Any]]:
    """A transition; where the operator may have to be asked, it is three: without asking, the question, and with his leave.

    `key`: state and index, dotted.
    """
    native = _native_transition(way, f"{_AFTER}.{key}")
    if not way.file.autonomy:
        return [native]
    free = f"autonomy_level > {AUTONOMY[way.file.autonomy]}"
    asks = {name: native[name] for name in ("event", "cond") if name in native}
    return [
        native | {"cond": f"({native['cond']}) and {free}" if "cond" in native else free},
        asks | {"on": [{"assign": {"location": "asked", "expr": repr(key)}}]},
        {**native, "event": f"{_ALLOW}.{key}", "cond": "True"},
    ]


def _native_transition(way: Transition, timeout: str = "") -> dict[str, Any]:
    """`timeout`: the event that comes when the time is over that the transition waits for, where it does."""
    native: dict[str, Any] = {
        key: value for key in ("event", "target", "cond") if (value := getattr(way.file, key)) is not None
    }
    if way.file.after is not None:
        native["event"] = timeout
    return native | _sets(way.file.set)


def _taken(way: Transition, event: str) -> dict[str, Any]:
    """The same way out for an operator who orders it: no guard, and nothing is set from the data of an event that did not come."""
    known = {name: value for name, value in way.file.set.items() if "_event" not in str(value)}
    return {"event": event, "target": way.file.target, **_sets(known)}


def _sets(values: Mapping[str, Any]) -> dict[str, Any]:
    if not values:
        return {}
    return {
        "on": [
            {"assign": {"location": name, "expr": expression if isinstance(expression, str) else repr(expression)}}
            for name, expression in values.items()
        ]
    }
