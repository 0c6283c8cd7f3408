"""How a program's guards and values are evaluated: python-statemachine's restricted expressions, over the program's own names.

The library's evaluator lets an event's data hide variables of the same name. Here a name always means the program's variable,
parameter, resource or constant, and event data is what `_event.data` says.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from statemachine.exceptions import InvalidDefinition
from statemachine.io.evaluators import RestrictedEvaluator
from statemachine.spec_parser import parse_expr


class ProgramEvaluator(RestrictedEvaluator):
    """Expressions by an AST allow-list: no calls, no private attributes, no scripts, no files."""

    def compile_value(self, expr: str) -> Callable[..., Any]:
        """Raises InvalidDefinition where the expression is not allowed."""
        try:
            return parse_expr(expr, _named)
        except (ValueError, SyntaxError) as problem:
            raise InvalidDefinition(str(problem)) from problem

    def compile_bool(self, expr: str) -> Callable[..., bool]:
        """Raises InvalidDefinition where the expression is not allowed."""
        value = self.compile_value(expr)

        def guard(*args: Any, **kwargs: Any) -> bool:
            return bool(value(*args, **kwargs))

        return guard


def _named(name: str) -> Callable[..., Any]:
    def resolve(*_: Any, machine: Any, _event: Any = None, **__: Any) -> Any:
        if name == "_event":
            return _event
        if not name.startswith("_") and hasattr(machine.model, name):
            return getattr(machine.model, name)
        raise NameError(f"name {name!r} is not known")

    resolve.__name__ = name
    return resolve
