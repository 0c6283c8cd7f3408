"""What the expressions of a program see, while it runs: its variables, parameters, resources and constants by their names.

A program that a state of another one runs has a scope of its own: no name means anything in both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any

import msgspec

from engines.activities.base import SHAPES, ActivityFailed, Argument, Kind, goals_in
from engines.programs import nested
from engines.programs.expressions import ProgramEvaluator, attribute_of
from engines.programs.program import AUTONOMY, CONSTANTS, RETRIES, TEMPLATE, Program, State
from engines.programs.text import fill
from handrail.messages import Along, FrameGoal, GazeGoal

NO_VALUE = (NameError, TypeError, ValueError, ArithmeticError, AttributeError, LookupError)
"""what an expression raises that has no value"""


class _Told:
    """A name that is only assigned to: who listens (the attribute of that name with a _ before it) is told of each value."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._listener = f"_{name}"

    def __get__(self, data: ProgramData | None, owner: type) -> str:
        return ""

    def __set__(self, data: ProgramData, value: str) -> None:
        getattr(data, self._listener)(value)


class ProgramData:
    """SCXML's data model: the program's variables, parameters, resources and constants as attributes."""

    asked = _Told()
    """assigned to by transitions that ask instead of leading on: state and index of the way that is asked about"""
    logged = _Told()
    """by actions that log"""
    sent = _Told()
    """by actions that send: the event, and after how many s"""

    def __init__(self, names: Mapping[str, Any]):
        self.state: Any = None  # python-statemachine keeps the configuration here
        self.failure = ""
        self.autonomy_level = max(AUTONOMY.values())
        self._asked: Callable[[str], None] = lambda way: None
        self._logged: Callable[[str], None] = lambda text: None
        self._sent: Callable[[str], None] = lambda event: None
        for name, value in names.items():
            setattr(self, name, value)

    def when_told(self, logged: Callable[[str], None], sent: Callable[[str], None]) -> None:
        """Have them told of what actions log and send."""
        self._logged, self._sent = logged, sent

    def when_asked(self, call: Callable[[str], None]) -> None:
        """Have `call` told of such a way."""
        self._asked = call


class Scope:
    """The values of one program's names, and what its expressions come to."""

    def __init__(self, program: Program, evaluator: ProgramEvaluator, caller: State | None, above: Scope | None):
        """`caller`: the state that runs it, `above`: that one's program's; None of what is deployed."""
        self.program, self.caller, self.above = program, caller, above
        retries = {f"{RETRIES}{state.name}": 0 for state in program.own_states() if state.file.retry}
        # Until it is bound, a resource counts as of the template that stands first.
        templates = {
            f"{TEMPLATE}{name}": next(iter(program.resources[name].templates), "") for name in program.instances
        }
        self.data = ProgramData({**CONSTANTS, **retries, **templates, **program.variables})
        self.reason = ""
        """of the last failure of one of its activities"""
        self.entered = False
        """whether it has ever begun"""
        self.problem = ""
        """why it can't begin, though its state is active"""
        self._evaluator = evaluator
        # What expressions are evaluated over; the machine itself does not exist yet when its first activities begin.
        self._names = SimpleNamespace(model=self.data)
        if caller is not None and above is not None:
            setattr(above.data, attribute_of(caller.name), self.data)

    def begin(self, restored: Mapping[str, Any]) -> None:
        """Its state is entered: variables as the file says, parameters and resources as the state gives them.

        :param restored: values of variables and parameters that count instead
        :raises ValueError: what the state gives has no value, or one that the program can't have
        """
        assert self.caller is not None and self.above is not None
        self.entered, self.problem, self.reason, self.data.failure = True, "", "", ""
        given = self.caller.file.with_
        self.set({name: parameter.default for name, parameter in self.program.parameters.items()})
        self.set(self.program.variables)
        for name, bound in (given.get("bind") or {}).items():
            self.set({name: getattr(self.above.data, bound)})
            if name in self.program.instances:
                self.set({f"{TEMPLATE}{name}": getattr(self.above.data, f"{TEMPLATE}{bound}")})
        for name, expression in (given.get("parameters") or {}).items():
            try:
                value = self.above.value(expression)
            except NO_VALUE as missing:
                raise ValueError(f"{name}: {expression!r} has no value: {missing}") from missing
            problem, expected = self.program.problem(name, value)
            if problem:
                raise ValueError(f"{name}: got {value!r}, {problem}; expected {expected}")
            setattr(self.data, name, value)
        self.set(restored)

    def set(self, values: Mapping[str, Any]) -> None:
        """New values, for whatever is evaluated from now on."""
        for name, value in values.items():
            setattr(self.data, name, value)

    def remembered(self) -> dict[str, Any]:
        """Its variables as they stand; of a program that a state runs, its parameters too, and each after the state."""
        if self.caller is None:
            return {name: getattr(self.data, name) for name in self.program.variables}
        names = (*self.program.variables, *self.program.parameters)
        return {f"{self.caller.id}/{name}": getattr(self.data, name) for name in names}

    def outputs(self) -> dict[str, Any]:
        """What it gives to the program whose state runs it. Raises ValueError where that is not what its file says."""
        found = {}
        for name, output in self.program.outputs.items():
            try:
                value = self.value(output.value or name)
            except NO_VALUE as missing:
                raise ValueError(f"output {name} has no value: {missing}") from missing
            if problem := of_type(value, output.type):
                raise ValueError(f"output {name}: got {value!r}; {problem}")
            found[name] = value
        return found

    def value(self, expression: Any) -> Any:
        """What an expression comes to; what is no text is its own value. Raises `NO_VALUE`."""
        if not isinstance(expression, str):
            return expression
        return self._evaluator.compile_value(expression)(machine=self._names)

    def words(self, text: str) -> str:
        """A text with its expressions filled in."""
        return fill(text, self.value)

    def arguments(self, state: State, arguments: Mapping[str, Argument]) -> dict[str, Any]:
        """The values of what a state's activity is given. Raises ActivityFailed where one has none."""
        values = {}
        for name, argument in arguments.items():
            given = state.file.with_.get(name)
            try:
                values[name] = argument.default if given is None else self._argument(argument, given)
            except NO_VALUE as problem:
                raise ActivityFailed(
                    "bad_argument", f"{state.id}: {name}: {given!r} has no value: {problem}"
                ) from problem
        return values

    def _argument(self, argument: Argument, given: Any) -> Any:
        match argument.kind:
            case Kind.ARM | Kind.INSTANCE:
                return getattr(self.data, given)
            case Kind.TEXTS:
                return [self.words(each) for each in given]
            case Kind.TEXT:
                return self.words(given)
            case Kind.COMPOUND:
                return nested.filled(given, self.words, self.words, self.words)
            case Kind.PORTS:
                return {port: self._deep(value) for port, value in given.items()}
            case Kind.LIST:
                return nested.filled(given, self.value, self.words, lambda name: getattr(self.data, name))
            case Kind.NUMBER:
                value = self.value(given)
                if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
                    raise TypeError(f"got {value!r}; expected a number")
                return argument.default if value is None else float(value)
            case Kind.VALUE:
                return self.value(given)
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
        return [self._deep(value) for value in given] if isinstance(given, list) else self.value(given)


class Scopes:
    """Those of a program and of all that it runs, by the ids of the states that run them; "" is the program itself."""

    def __init__(self, program: Program, evaluator: ProgramEvaluator, names: Mapping[str, Any]):
        """`names`: values of variables, parameters and resources; of programs that states run as `Scope.remembered` has them."""
        self.own = Scope(program, evaluator, None, None)
        self.own.entered = True
        self._all = {"": self.own}
        for state in program.states():
            if state.called is not None:
                self._all[state.id] = Scope(state.called, evaluator, state, self._all[state.scope])
        self._restored: dict[str, dict[str, Any]] = {}
        for name, value in names.items():
            scope, _, own = name.rpartition("/")
            if scope:
                self._restored.setdefault(scope, {})[own] = value
            else:
                setattr(self.own.data, name, value)

    def __getitem__(self, id: str) -> Scope:
        return self._all[id]

    def __iter__(self) -> Iterator[Scope]:
        return iter(self._all.values())

    def restored(self, id: str) -> Mapping[str, Any]:
        """What counts instead of a program's first values."""
        return self._restored.get(id, {})

    def take_over(self, old: Scopes, active: frozenset[str]) -> None:
        """Go on from where the scopes of an older version are: those of the program, and of what active states run.

        What was only changed in the file (a new variable, a constant) is as the file says.
        """
        for id, scope in self._all.items():
            before = old._all.get(id)
            if before is None or (id and id not in active):
                continue
            scope.entered, scope.problem, scope.reason = before.entered, before.problem, before.reason
            names = {*scope.program.variables, "failure", "autonomy_level"}
            if id:
                names |= {*scope.program.parameters, *scope.program.resources}
                names |= {f"{TEMPLATE}{name}" for name in scope.program.instances}
            names |= {f"{RETRIES}{state.name}" for state in scope.program.own_states() if state.file.retry}
            scope.set({name: getattr(before.data, name) for name in names if hasattr(before.data, name)})

    def keep_restored(self, ids: frozenset[str]) -> None:
        """Of these programs only: any other begins as its file says."""
        self._restored = {id: values for id, values in self._restored.items() if id in ids}

    def blocked(self, id: str) -> bool:
        """A program that can't begin runs this one, or it can't begin itself."""
        scope: Scope | None = self._all[id]
        while scope is not None:
            if scope.problem:
                return True
            scope = scope.above
        return False

    def remembered(self, active: frozenset[str] | None = None) -> dict[str, Any]:
        """Everything that was ever begun, or (`active`) what these states run, and what the program itself remembers."""
        found: dict[str, Any] = {}
        for id, scope in self._all.items():
            if not id or (scope.entered if active is None else id in active):
                found |= scope.remembered()
        return found


def of_type(value: Any, type: str) -> str:
    """What is wrong with a value of a type as parameters and outputs have it; empty when nothing is."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    fits, expected = {
        "text": (isinstance(value, str), "a text"),
        "bool": (isinstance(value, bool), "true or false"),
        "integer": (number and value == round(value), "a whole number"),
        "number": (number, "a finite number"),
    }[type]
    return "" if fits else f"expected {expected}"
