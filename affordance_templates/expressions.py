"""Arithmetic in files: ``2/3 * radius``, ``asin((tool_radius + spoke_radius) / engage_radius)``, ``120 * deg``, or the same
as ``${2/3 * radius}``.

Only numbers, names, ``+ - * / **``, signs and a few functions: the text is parsed, checked against this list and walked. It is
never run as Python, so a file from elsewhere can compute numbers and nothing else.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180}
"""names that every expression knows; ``deg`` is one degree in radians"""

FUNCTIONS: Mapping[str, tuple[Callable[..., float], int, int]] = {
    "sin": (math.sin, 1, 1),
    "cos": (math.cos, 1, 1),
    "tan": (math.tan, 1, 1),
    "asin": (math.asin, 1, 1),
    "acos": (math.acos, 1, 1),
    "atan2": (math.atan2, 2, 2),
    "sqrt": (math.sqrt, 1, 1),
    "abs": (abs, 1, 1),
    "floor": (math.floor, 1, 1),
    "min": (min, 2, 16),
    "max": (max, 2, 16),
}
"""name → function, fewest and most arguments"""

_BINARY: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[float], float]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_LONGEST = 500
_LARGEST = 10**15


class ExpressionError(ValueError):
    """An expression that is not arithmetic as above, or has no finite value. `str()` says what is wrong and what would be right."""


@dataclass(frozen=True)
class Expression:
    """A checked expression."""

    text: str
    names: frozenset[str]
    """names that need a value, the constants not among them"""
    _body: ast.expr

    def value(self, names: Mapping[str, float]) -> float:
        """Its value with these names' values. Raises ExpressionError on an unknown name or a value that is not finite."""
        try:
            value = _value(self._body, names)
        except (ValueError, ZeroDivisionError, OverflowError) as problem:
            if isinstance(problem, ExpressionError):
                raise
            raise ExpressionError(f"{self.text!r} has no value here ({problem})") from problem
        if not math.isfinite(value):
            raise ExpressionError(f"{self.text!r} is {value}; expected a finite number")
        return value


def parse(text: str | float) -> Expression:
    """Check an expression (or take a plain number). Raises ExpressionError."""
    text = str(text)
    if len(text) > _LONGEST:
        raise ExpressionError(f"an expression of {len(text)} characters; expected at most {_LONGEST}")
    return _parsed(text)


@lru_cache(maxsize=4096)
def _parsed(text: str) -> Expression:
    """Kept: a template is resolved again and again while a parameter is dragged."""
    inside = text.strip()
    if inside.startswith("${") and inside.endswith("}"):
        inside = inside[2:-1].strip()
    try:
        body = ast.parse(inside, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        raise ExpressionError(f"{text!r} is not an expression; expected arithmetic such as 2 * radius") from problem
    names: set[str] = set()
    try:
        _check(body, text, names)
    except RecursionError as problem:
        raise ExpressionError(f"{text[:40]!r}… is nested too deeply") from problem
    return Expression(text, frozenset(names - set(CONSTANTS)), body)


def evaluate(text: str | float, names: Mapping[str, float]) -> float:
    """Parse and evaluate at once. Raises ExpressionError."""
    if isinstance(text, int) and abs(text) > _LARGEST:
        raise ExpressionError(f"a whole number of {text.bit_length()} bits; expected at most {_LARGEST:g}")
    if isinstance(text, int | float) and not isinstance(text, bool) and math.isfinite(text):
        return float(text)
    return parse(text).value(names)


def _check(node: ast.expr, text: str, names: set[str]) -> None:
    """Refuse everything that is not on the list, and collect the names."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise ExpressionError(f"{node.value!r} in {text!r}; expected a number")
    elif isinstance(node, ast.Name):
        if node.id in FUNCTIONS:
            raise ExpressionError(f"{node.id} in {text!r} is a function; expected {node.id}(…)")
        names.add(node.id)
    elif isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        _check(node.left, text, names)
        _check(node.right, text, names)
    elif isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        _check(node.operand, text, names)
    elif isinstance(node, ast.Call):
        _check_call(node, text, names)
    else:
        raise ExpressionError(
            f"{ast.unparse(node)!r} in {text!r} is not allowed; expected numbers, parameters, + - * / **, {_listed(FUNCTIONS)}"
        )


def _check_call(node: ast.Call, text: str, names: set[str]) -> None:
    if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS:
        raise ExpressionError(
            f"{ast.unparse(node.func)!r} in {text!r} can't be called; expected one of {_listed(FUNCTIONS)}"
        )
    _, fewest, most = FUNCTIONS[node.func.id]
    if node.keywords or not fewest <= len(node.args) <= most:
        wanted = str(fewest) if fewest == most else f"{fewest} to {most}"
        raise ExpressionError(f"{ast.unparse(node)!r} in {text!r}: expected {wanted} arguments for {node.func.id}")
    for argument in node.args:
        _check(argument, text, names)


def _value(node: ast.expr, names: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name):
            if name in names:
                return float(names[name])
            if name in CONSTANTS:
                return CONSTANTS[name]
            raise ExpressionError(f"unknown name {name!r}; expected one of {_listed([*names, *CONSTANTS])}")
        case ast.BinOp(left=left, op=sign, right=right):
            return _BINARY[type(sign)](_value(left, names), _value(right, names))
        case ast.UnaryOp(op=sign, operand=operand):
            return _UNARY[type(sign)](_value(operand, names))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name][0](*(_value(argument, names) for argument in arguments))
    raise ExpressionError(f"{ast.unparse(node)!r} is not allowed")  # `parse` has refused it already


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names))
