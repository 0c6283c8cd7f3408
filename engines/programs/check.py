"""Checks a program whole, before anything of it runs: names, targets, ways in and out, activities and their arguments, expressions.

Each check raises config.ConfigError at the first thing that is wrong.
"""

from __future__ import annotations

import ast
import keyword
import math
from collections.abc import Iterable, Iterator, Mapping, Set
from typing import Any

import msgspec
from statemachine.event import _event_data_kwargs
from statemachine.exceptions import InvalidDefinition
from statemachine.statemachine import StateChart

from engines.activities.base import SHAPES, Argument, Kind, goals_in
from engines.nodes import library as node_library
from engines.programs import actions, nested
from engines.programs.actions import Action
from engines.programs.call import SIGNATURES, check_call
from engines.programs.expressions import ProgramEvaluator
from engines.programs.program import CONSTANTS, RETRIES, TEMPLATE, Program, State, Transition
from engines.programs.scxml import SUFFIX
from engines.programs.text import fields
from handrail import compound_tasks
from handrail.behaviour_file import SOME_ARM, BehaviourFile, find, with_frames
from handrail.config import ConfigError

ERROR_OUTPUTS = frozenset({"message", "reason"})
"""what `_event.data` has after `error.execution`"""
RESERVED = frozenset({*_event_data_kwargs, *CONSTANTS, "failure", "autonomy_level", "asked", "logged", "sent"})
BEGIN = "handrail_begin"
"""state that leads to those that a run begins in, where they are further down than the top"""
STOPPED = "stopped"
"""id of the final state that every chart gets, for StopRun"""

_GRAMMAR = "names, numbers, texts in quotes, + - * /, comparisons, and, or, not"
_evaluator = ProgramEvaluator()


def check(program: Program) -> None:
    """Raise config.ConfigError unless the program can be deployed."""
    _check_names(program)
    states = _states_by_id(program)
    for state in program.states():
        _check_shape(program, state)
        _check_activity(program, state)
    try:
        check_together({state.id: state for state in program.states()}, program.start)
    except ValueError as problem:
        raise program.document.error("start", str(problem).removeprefix("start_at: ")) from problem
    for state in program.states():
        if state.start is not None:
            _check_transition(program, state, state.start, states)
        for transition in (*state.transitions, *(t for each in state.history.values() for t in each)):
            _check_transition(program, state, transition, states)
        _check_ways_out(program, state)
    _check_outputs(program)
    if not any(state.file.final for state in program.roots):
        raise program.document.error("states", "no final state; expected at least one, with `outcome: succeeded`")
    if not _is_scxml(program):
        _check_reachable(program, states)


def _is_scxml(program: Program) -> bool:
    """SCXML has nothing against states that are never entered and transitions that do nothing: slips, in a program's file."""
    return program.document.file.suffix == SUFFIX


def _check_names(program: Program) -> None:
    seen: dict[str, str] = {}
    for where in ("resources", "parameters", "variables"):
        for name in getattr(program, where):
            field = f"{where}.{name}"
            if not name.isidentifier() or name.startswith("_") or keyword.iskeyword(name) or name in RESERVED:
                raise program.document.error(field, f"{name!r} can't be used in expressions; expected another name")
            if name.startswith(RETRIES):
                raise program.document.error(field, f"{name!r} is for the retries of a state; expected another name")
            if name.startswith(TEMPLATE):
                raise program.document.error(field, f"{name!r} is for an instance's template; expected another name")
            if name in seen:
                raise program.document.error(field, f"{name!r} is in {seen[name]} too; expected one of each name")
            seen[name] = where
    for name, parameter in program.parameters.items():
        problem, expected = program.problem(name, parameter.default)
        if problem:
            raise program.document.error(
                f"parameters.{name}.default", f"{parameter.default!r} is {problem}; expected {expected}"
            )


def _check_outputs(program: Program) -> None:
    for name, output in program.outputs.items():
        field, problem = f"outputs.{name}", ""
        if not name.isidentifier() or name.startswith("_") or keyword.iskeyword(name) or name in _event_data_kwargs:
            problem = f"{name!r} can't be used in expressions; expected another name"
        elif name == "outcome":
            problem = "`outcome` is the name of the final state that the program came to; expected another name"
        elif not output.value and name not in program.names:
            problem = f"nothing is called {name!r} here; expected `value`, or one of {_listed(program.names)}"
        if problem:
            raise program.document.error(field, problem)
        _check_expression(program, f"{field}.value" if output.value else field, output.value or name, frozenset())


def _states_by_id(program: Program) -> dict[str, State]:
    states: dict[str, State] = {}
    for state in program.states():
        for id, path in ((state.id, state.path), *((name, f"{state.path}.history.{name}") for name in state.history)):
            if not id.isidentifier() or hasattr(StateChart, id) or id in (STOPPED, BEGIN, "model", "id"):
                raise program.document.error(path, f"{id!r} can't be a state's name; expected another one")
            if id in states:
                raise program.document.error(path, f"a state {id!r} is there already; expected names that are unique")
            states[id] = state
    return states


def _check_shape(program: Program, state: State) -> None:
    file, error = state.file, program.document.error
    marked = [child for child in state.children if child.file.initial]
    if len(marked) > 1:
        raise error(f"{marked[1].path}.initial", f"{marked[0].id!r} is initial already; expected one among siblings")
    roots = [root for root in program.roots if root.file.initial]
    if len(roots) > 1:
        raise error(f"{roots[1].path}.initial", f"{roots[0].id!r} is initial already; expected one among siblings")
    if state.start is not None:
        way, inside = (
            state.start.file,
            {each for child in state.children for one in child.all() for each in (one.id, *one.history)},
        )
        if file.parallel or not state.children or marked:
            raise error(
                f"{state.path}.start",
                "expected it in a state with others in it, none of them `initial`, that is not parallel",
            )
        if not way.target or not set(way.target.split()) <= {*inside, *state.history}:
            raise error(f"{state.path}.start.target", f"got {way.target!r}; expected states within {state.id}")
        if way.event or way.cond or way.after is not None or way.internal or way.autonomy:
            raise error(f"{state.path}.start", "is always taken; expected `target`, `set` and `actions` alone")
        if (way.set or way.actions) and way.target not in {*(child.id for child in state.children), *state.history}:
            # python-statemachine does nothing on an initial transition that leads further down.
            raise error(
                f"{state.path}.start.target",
                f"got {way.target!r}, with something done on the way; expected one of its own states",
            )
    if file.retry and not file.do:
        raise error(f"{state.path}.retry", f"got {file.retry}; expected it where there is something to `do`")
    if file.parallel and not state.children:
        raise error(f"{state.path}.parallel", "a parallel state without states in it; expected at least one")
    if file.final:
        for part, there in (("do", file.do), ("transitions", state.transitions), ("states", state.children)):
            if there:
                raise error(f"{state.path}.{part}", "a final state ends there; expected none")
        if state.parent is None and not file.outcome:
            raise error(f"{state.path}.outcome", "missing; expected succeeded or failed: this state ends the run")
    if (file.outcome or file.detail) and not (file.final and state.parent is None):
        part = "outcome" if file.outcome else "detail"
        raise error(f"{state.path}.{part}", "only a top-level final state has one")
    if file.data and (not file.final or state.parent is None or state.parent.file.parallel):
        raise error(f"{state.path}.data", "only a final state in another one has data, for `done.state.`")
    actions.check_data(
        program.document,
        f"{state.path}.data",
        file.data,
        lambda path, value: _check_expression(program, path, value, frozenset()),
    )
    _check_text(program, f"{state.path}.detail", file.detail, frozenset())
    _check_actions(program, (*state.enter, *state.exit), frozenset())


def _check_transition(program: Program, state: State, transition: Transition, states: dict[str, State]) -> None:
    file, path = transition.file, transition.path
    for target in (file.target or "").split():
        if target not in states:
            raise program.document.error(f"{path}.target", f"no state {target!r}; expected one of {', '.join(states)}")
    if (
        file.internal
        and not _is_scxml(program)
        and not set((file.target or "").split()) <= {each.id for child in state.children for each in child.all()}
    ):
        raise program.document.error(f"{path}.internal", f"got {file.target!r}; expected a target within {state.id}")
    if file.target is None and not file.set and not file.actions and not _is_scxml(program):
        raise program.document.error(path, "leads nowhere and does nothing; expected `target`, `set` or `actions`")
    if file.after is not None:
        if file.event is not None:
            raise program.document.error(f"{path}.after", "a time-out with an event; expected one of the two")
        if not isinstance(file.after, str) and not 0 < file.after < math.inf:
            raise program.document.error(f"{path}.after", f"got {file.after:g}; expected a time in s, above 0")
        _check_expression(program, f"{path}.after", file.after, frozenset())
        if isinstance(program.variables.get(str(file.after)), str):
            raise program.document.error(f"{path}.after", f"{file.after} is a text; expected a time in s")
        if transition not in state.transitions:
            raise program.document.error(
                f"{path}.after", "nobody stays in a history; expected it at a state's transition"
            )
    if file.autonomy and (file.target is None or (file.event is None and file.after is None)):
        raise program.document.error(
            f"{path}.autonomy", "nothing to ask about; expected it with `target` and `event` or `after`"
        )
    if file.event is None and file.after is None and file.target is None:
        raise program.document.error(path, "would be taken without end; expected `event` or `target`")
    if (
        file.event is None
        and file.after is None
        and file.cond is None
        and file.target in {each.id for each in state.lineage()}
    ):
        raise program.document.error(path, "is always taken and leads back here; expected `event` or `cond`")
    outputs: Set[str] | None = None
    for event in (file.event or "").split():
        data = _data_of(program, path, event, states)
        outputs = data if outputs is None else outputs & data
    if file.cond is not None:
        _check_expression(program, f"{path}.cond", file.cond, outputs or frozenset(), guard=True)
    for name, expression in file.set.items():
        if name not in program.variables:
            known = ", ".join(program.variables) or "none"
            raise program.document.error(f"{path}.set.{name}", f"no such variable; expected one of {known}")
        _check_expression(program, f"{path}.set.{name}", expression, outputs or frozenset())
    _check_actions(program, transition.actions, outputs or frozenset())


def _check_actions(program: Program, given: tuple[Action, ...], outputs: Set[str]) -> None:
    actions.check(
        program.document,
        given,
        list(program.variables),
        lambda path, value: _check_expression(program, path, value, outputs),
        lambda path, text: _check_text(program, path, text, outputs),
    )


def _data_of(program: Program, path: str, event: str, states: dict[str, State]) -> frozenset[str]:
    """What `_event.data` has after an event."""
    for prefix, wanted in (("done.invoke.", "that does something"), ("done.state.", "with states in it")):
        if not event.startswith(prefix):
            continue
        named = states.get(event.removeprefix(prefix))
        if named is None or not (named.file.do if prefix == "done.invoke." else named.children):
            raise program.document.error(
                f"{path}.event", f"got {event!r}; expected the name of a state {wanted} after {prefix}"
            )
        if named.called is not None and prefix == "done.invoke.":
            return frozenset({"outcome", *named.called.outputs})
        if prefix == "done.state.":
            ends = [frozenset(child.file.data) for child in named.children if child.file.final]
            return frozenset.intersection(*ends) if ends else frozenset()
        return SIGNATURES[named.file.do].outputs_of(named.file.with_) if named.file.do in SIGNATURES else frozenset()
    if event in ("error.execution", "error"):
        return ERROR_OUTPUTS
    return actions.data_of((each for state in program.states() for each in _actions_of(state)), event)


def _actions_of(state: State) -> Iterator[Action]:
    yield from (*state.enter, *state.exit)
    start = () if state.start is None else (state.start,)
    for way in (*state.transitions, *start, *(each for ways in state.history.values() for each in ways)):
        yield from way.actions


def _check_activity(program: Program, state: State) -> None:
    given, error = state.file.with_, program.document.error
    if not state.file.do:
        if given:
            raise error(f"{state.path}.with", "arguments without `do`; expected an activity")
        return
    if state.file.do not in SIGNATURES:
        raise error(f"{state.path}.do", f"no activity {state.file.do!r}; expected one of {', '.join(SIGNATURES)}")
    if state.children:
        raise error(
            f"{state.path}.do", "a state with states in it can't do an activity itself; expected it in one of them"
        )
    arguments = SIGNATURES[state.file.do].arguments
    for name in given:
        if name not in arguments:
            raise error(
                f"{state.path}.with.{name}",
                f"not an argument of {state.file.do}; expected one of {', '.join(arguments)}",
            )
    for name, argument in arguments.items():
        if name in given:
            _check_argument(program, f"{state.path}.with.{name}", argument, given[name])
        elif argument.required:
            raise error(f"{state.path}.with.{name}", f"missing; {state.file.do} needs it ({argument.kind.value})")
    for output in sorted(SIGNATURES[state.file.do].outputs_of(given) & _event_data_kwargs):
        raise error(f"{state.path}.with.outputs", f"no expression can name {output!r}; expected another output")
    name, problem = SIGNATURES[state.file.do].problem(given)
    if problem:
        raise error(f"{state.path}.with.{name}", problem)
    if state.called is not None:
        check_call(program, state, state.called)


def _check_argument(program: Program, path: str, argument: Argument, value: Any) -> None:
    error = program.document.error
    match argument.kind:
        case Kind.ARM | Kind.INSTANCE:
            wanted = argument.kind.value
            fitting = [name for name, resource in program.resources.items() if resource.kind == wanted]
            if value not in fitting:
                there = f"one of: {', '.join(fitting)}" if fitting else "a declaration of it under `resources`"
                raise error(path, f"got {value!r}, no resource of kind {wanted}; expected {there}")
        case Kind.BEHAVIOUR:
            try:
                BehaviourFile(find(str(value)), SOME_ARM)
            except ConfigError as problem:
                raise error(path, f"got {value!r}: {problem}") from problem
        case Kind.NODE:
            try:
                node_library.find(str(value))
            except ValueError as problem:
                raise error(path, str(problem).removeprefix("node: ")) from problem
        case Kind.PORTS:
            if not isinstance(value, dict):
                raise error(path, f"got {value!r}; expected ports with their values")
            for where, _, text in nested.parts(value, path):
                _check_expression(program, where, text, frozenset())
        case Kind.COMPOUND:
            _check_compound(program, path, value)
        case Kind.LIST:
            _check_list(program, path, argument, value)
        case Kind.NAME if not isinstance(value, str) or not value:
            raise error(path, f"got {value!r}; expected a name")
        case Kind.NAMES if not isinstance(value, list) or not value or not all(isinstance(each, str) for each in value):
            raise error(path, f"got {value!r}; expected a list of names")
        case Kind.CHOICE if value not in argument.choices:
            raise error(path, f"got {value!r}; expected one of {', '.join(argument.choices)}")
        case Kind.GOALS | Kind.KEY_FRAMES | Kind.ALONG:
            try:
                read = msgspec.convert(value, SHAPES[argument.kind])
            except msgspec.ValidationError as problem:
                raise error(path, f"{problem}; expected {argument.kind.value}") from problem
            if not read:
                raise error(path, f"got none; expected {argument.kind.value}")
            instances = program.instances
            for goal in goals_in(read):
                if (instance := getattr(goal, "instance", "")) and instance not in instances:
                    there = f"one of: {', '.join(instances)}" if instances else "a declaration of it under `resources`"
                    raise error(path, f"got {instance!r}, no resource of kind instance; expected {there}")
        case Kind.TEXT | Kind.TEXTS:
            texts = [value] if argument.kind is Kind.TEXT else value
            if not isinstance(texts, list) or not all(isinstance(each, str) for each in texts):
                raise error(
                    path, f"got {value!r}; expected {'a text' if argument.kind is Kind.TEXT else 'a list of texts'}"
                )
            for each in texts:
                _check_text(program, path, each, frozenset())
        case Kind.NUMBER | Kind.VALUE:
            if isinstance(value, bool) or not isinstance(value, str | int | float):
                kind = f"a number in {argument.unit}" if argument.unit else f"a {argument.kind.value}"
                raise error(path, f"got {value!r}; expected {kind}, or an expression")
            if isinstance(value, str):
                _check_expression(program, path, value, frozenset())
                if argument.kind is Kind.NUMBER and isinstance(program.variables.get(value), str):
                    raise error(path, f"{value} is a text; expected a number in {argument.unit or 'no unit'}")


def _check_compound(program: Program, path: str, value: Any) -> None:
    """The daemon tries it on the robot; here it has to be there, and its texts to have values."""
    error, known = program.document.error, compound_tasks.everywhere()
    if isinstance(value, dict):
        if not isinstance(value.get("levels"), list):
            raise error(f"{path}.levels", "missing; expected a list of levels, each a list of tasks")
        for where, _, text in nested.parts(value, path):
            _check_text(program, where, text, frozenset())
    elif not isinstance(value, str) or ("{" not in value and value not in known):
        expected = f"a compound task's name, of {', '.join(sorted(known))}, or its constraints and levels"
        raise error(path, f"got {value!r}; expected {expected}")
    else:
        _check_text(program, path, value, frozenset())


def _check_list(program: Program, path: str, argument: Argument, value: Any) -> None:
    if not isinstance(value, list):
        raise program.document.error(path, f"got {value!r}; expected a list")
    for where, field, text in nested.parts(value, path):
        if field in nested.INSTANCES:
            _check_argument(program, where, Argument(Kind.INSTANCE), text)
        elif nested.is_text(field):
            _check_text(program, where, text, frozenset())
        else:
            _check_expression(program, where, text, frozenset())
    meant = with_frames(nested.filled(value, lambda _: 1.0, str, str), SOME_ARM.frame)
    program.document.converted(meant, argument.of, path)


def _check_text(program: Program, path: str, text: str, outputs: Set[str]) -> None:
    try:
        parts = fields(text)
    except ValueError as problem:
        raise program.document.error(
            path, f"{problem}; expected {{expression}} or {{expression:format}} in a text"
        ) from problem
    for expression in parts:
        _check_expression(program, path, expression, outputs)


def _check_expression(program: Program, path: str, text: Any, outputs: Set[str], *, guard: bool = False) -> None:
    """Refuse what the restricted evaluator does not take, and names that nothing gives a value."""
    if not isinstance(text, str):
        return
    try:
        _evaluator.compile_bool(text) if guard else _evaluator.compile_value(text)
        tree = ast.parse(text, mode="eval")
    except (InvalidDefinition, SyntaxError) as problem:
        reason = str(problem)
        raise program.document.error(
            path,
            f"{text!r} is not an expression that is allowed here ({reason}); expected {_GRAMMAR}",
        ) from problem
    known = program.names
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Name)
            and node.id not in known
            and node.id not in ("_event", "In", "True", "False", "None")
        ):
            raise program.document.error(
                path, f"unknown name {node.id!r} in {text!r}; expected one of {_listed(known)}"
            )
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "_event.data" and node.attr not in outputs:
            there = f"one of {_listed(outputs)}" if outputs else "no data: this event carries none"
            raise program.document.error(path, f"_event.data has no {node.attr!r} here; expected {there}")


def _check_ways_out(program: Program, state: State) -> None:
    """A state that does something must say where to go when it is done and when it fails; any other must be left somehow."""
    if state.file.final or state.children:
        return
    ways = [way for each in state.lineage() for way in each.transitions]
    if not ways:
        if state.file.do or not any(each.file.parallel for each in state.lineage()):
            raise program.document.error(
                state.path, "nothing leads out of this state; expected `transitions`, or `final: true`"
            )
        return
    if not state.file.do:
        return
    done = f"done.invoke.{state.id}"
    if not any(takes(way, done) for way in ways):
        raise program.document.error(
            f"{state.path}.transitions", f"nothing follows when it is done; expected a transition on {done}"
        )
    if not any(takes(way, "error.execution") and way.file.cond is None for way in ways):
        raise program.document.error(
            f"{state.path}.transitions",
            "nothing follows when it fails; expected a transition on error.execution without `cond`",
        )


def check_together(states: Mapping[str, State], start_at: Iterable[str]) -> None:
    """Raise ValueError for states that are none, or can't be active together."""
    within: dict[str | None, str] = {}
    for id in start_at:
        if id not in states:
            raise ValueError(f"start_at: got {id!r}; expected one of {', '.join(states)}")
        for state in states[id].lineage():
            above = state.parent
            if above is not None and above.file.parallel:
                continue
            key = above.id if above is not None else None
            if within.setdefault(key, state.id) != state.id:
                raise ValueError(f"start_at: {id!r} can't be active together with {within[key]!r}")


def takes(way: Transition, event: str) -> bool:
    """SCXML §3.12.1: a descriptor matches an event whose first tokens are its tokens."""
    tokens = event.split(".")
    return any(
        descriptor == "*" or tokens[: len(parts)] == parts
        for descriptor in (way.file.event or "").split()
        for parts in [descriptor.removesuffix("*").rstrip(".").split(".")]
    )


def _check_reachable(program: Program, states: dict[str, State]) -> None:
    """Every state must be entered by some way: as a target, as an initial child, as a sibling in parallel, or as an ancestor."""
    first = next((root for root in program.roots if root.file.initial), program.roots[0])
    begins = [states[id] for id in program.start] or [first]
    waiting = [(state, True) for state in begins]  # and whether its initial children are entered with it
    seen: set[tuple[str, bool]] = set()
    while waiting:
        state, whole = waiting.pop()
        if (state.id, whole) in seen:
            continue
        seen.add((state.id, whole))
        waiting += [(child, True) for child in state.initial_children()] if whole else []
        start = () if state.start is None else (state.start,)
        for way in (*state.transitions, *start, *(way for each in state.history.values() for way in each)):
            for target in (way.file.target or "").split():
                waiting.append((states[target], target not in states[target].history))
        if state.parent is not None:
            waiting.append((state.parent, state.parent.file.parallel))
    for state in program.states():
        if not {(state.id, True), (state.id, False)} & seen:
            raise program.document.error(state.path, f"no way leads to {state.id!r}; expected a transition to it")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names))
