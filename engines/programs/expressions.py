"""How a program's guards and values are evaluated: python-statemachine's restricted expressions, over the program's own names.

The library's evaluator lets an event's data hide variables of the same name. Here a name always means the program's variable,
parameter, resource or constant, and event data is what `_event.data` says. An expression of a program that a state of another one
runs says so itself (`within`): then its names are that program's.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from typing import Any

from statemachine.exceptions import InvalidDefinition
from statemachine.io.evaluators import RestrictedEvaluator
from statemachine.spec_parser import parse_expr

FAILED_IN = "_failed_in"
"""name of the scope whose activity has failed; None after any other event"""
_MARK = "\x1f"


def within(scope: str, expression: str) -> str:
    """An expression that is evaluated in a scope (id of the state that runs the program; empty: the program's own)."""
    return f"{scope}{_MARK}{expression}" if scope else expression


def attribute_of(state: str) -> str:
    """Under which name a program's data model has the one of a program that this state runs: no expression can say it."""
    return f"in·{state}"


def location(scope: str, variable: str) -> str:
    """Where an assignment finds a variable of a scope."""
    return ".".join([*(attribute_of(state) for state in scope.split("/") if state), variable])


class ProgramEvaluator(RestrictedEvaluator):
    """Expressions by an AST allow-list: no calls, no private attributes, no scripts, no files."""

    def __init__(self) -> None:
        super().__init__()
        self._compiled: dict[str, Callable[..., Any]] = {}

    def compile_value(self, expr: str) -> Callable[..., Any]:
        """Raises InvalidDefinition where the expression is not allowed."""
        if expr not in self._compiled:
            self._compiled[expr] = self._read(expr)
        return self._compiled[expr]

    def _read(self, expr: str) -> Callable[..., Any]:
        scope, _, expression = expr.rpartition(_MARK)
        try:
            return parse_expr(_states_within(scope, expression) if scope else expression, _Names(scope))
        except (ValueError, SyntaxError) as problem:
            raise InvalidDefinition(str(problem)) from problem

    def compile_bool(self, expr: str) -> Callable[..., bool]:
        """Raises InvalidDefinition where the expression is not allowed."""
        value = self.compile_value(expr)

        def guard(*args: Any, **kwargs: Any) -> bool:
            return bool(value(*args, **kwargs))

        return guard


class _Names:
    """What a name of a scope's expressions comes to."""

    def __init__(self, scope: str):
        self._path = [attribute_of(state) for state in scope.split("/") if state]

    def __call__(self, name: str) -> Callable[..., Any]:
        def resolve(*_: Any, machine: Any, _event: Any = None, **__: Any) -> Any:
            if name == "_event":
                return _event
            if name == FAILED_IN:
                source = getattr(getattr(_event, "data", None), "_source", None)
                return None if source is None else str(source).rpartition("/")[0]
            data = machine.model
            for part in self._path:
                data = getattr(data, part)
            if not name.startswith("_") and hasattr(data, name):
                return getattr(data, name)
            raise NameError(f"name {name!r} is not known")

        resolve.__name__ = name
        return resolve


def _states_within(scope: str, expression: str) -> str:
    """With the states that ``In()`` names, as the whole chart calls them."""
    if not re.search(r"\b[Ii]n\s*\(", expression):
        return expression
    tree = ast.parse(expression, mode="eval")
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            for argument in node.args:
                if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
                    argument.value = f"{scope}/{argument.value}"
    return ast.unparse(tree)
