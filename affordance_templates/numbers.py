"""Numbers of a template's file, once its parameters have values; errors know their field and line."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from affordance_templates import expressions
from affordance_templates.expressions import ExpressionError
from affordance_templates.placement import Array, placed, pointing, rotation_of
from affordance_templates.template_schema import Number, Triple
from handrail.config import Document

Names = Mapping[str, float]
_MOST_REPEATS = 200
"""of one thing, all its indices together"""


@dataclass(frozen=True)
class Numbers:
    """Evaluates the fields of one document. Everything raises config.ConfigError."""

    document: Document

    def number(self, field: str, text: Number, names: Names) -> float:
        """A field's value."""
        try:
            return expressions.evaluate(text, names)
        except ExpressionError as problem:
            raise self.document.error(field, str(problem)) from problem

    def positive(self, field: str, text: Number, names: Names) -> float:
        """A value above 0."""
        value = self.number(field, text, names)
        if value <= 0:
            raise self.document.error(field, f"got {value:g}; expected above 0")
        return value

    def least(self, field: str, text: Number, names: Names) -> float:
        """A value of 0 or more."""
        value = self.number(field, text, names)
        if value < 0:
            raise self.document.error(field, f"got {value:g}; expected 0 or more")
        return value

    def vector(self, field: str, texts: Triple, names: Names) -> Array:
        """(3,)"""
        if type(texts[0]) is not str and type(texts[1]) is not str and type(texts[2]) is not str:
            constant = np.array(texts, float)
            if math.isfinite(float(constant.sum())):
                return constant
        return np.array([self.number(f"{field}[{k}]", text, names) for k, text in enumerate(texts)])

    def direction(self, field: str, texts: Triple, names: Names) -> Array:
        """(3,) unit vector"""
        vector = self.vector(field, texts, names)
        length = math.sqrt(float(vector @ vector))
        if length < 1e-9:
            raise self.document.error(field, f"got {vector.tolist()}; expected a vector with a direction")
        return vector / length

    def placement(self, field: str, position: Triple, rpy: Triple, names: Names) -> Array:
        """(4, 4)"""
        turned = np.eye(3) if tuple(rpy) == (0, 0, 0) else rotation_of(self.vector(f"{field}.rpy", rpy, names))
        return placed(self.vector(f"{field}.position", position, names), turned)

    def pointing(self, field: str, name: str, direction: Triple, across: Triple | None, names: Names) -> Array:
        """(3, 3) of a hand that points along the direction in the field `name`, closing along the one in `across`."""
        towards = self.direction(f"{field}.{name}", direction, names)
        if across is None:
            return pointing(towards)
        try:
            return pointing(towards, self.direction(f"{field}.across", across, names))
        except ValueError as problem:
            raise self.document.error(f"{field}.across", str(problem)) from problem

    def repeated(
        self, field: str, repeat: Mapping[str, Number], names: Names
    ) -> list[tuple[tuple[int, ...], dict[str, float]]]:
        """Indices and the names with them added, once per repetition; without any repetition once, without indices."""
        if not repeat:
            return [((), dict(names))]
        counts = []
        for index, text in repeat.items():
            where = f"{field}.repeat.{index}"
            if not usable(index):
                raise self.document.error(where, f"{index!r} can't be used in expressions; expected another name")
            count = self.number(where, text, names)
            if count != round(count) or not 1 <= count <= _MOST_REPEATS:
                raise self.document.error(where, f"got {count:g}; expected a whole number, 1 to {_MOST_REPEATS}")
            counts.append(int(count))
        if (total := int(np.prod(counts, dtype=float))) > _MOST_REPEATS:
            raise self.document.error(f"{field}.repeat", f"got {total} in all; expected at most {_MOST_REPEATS}")
        rows = itertools.product(*map(range, counts))
        return [(row, {**names, **dict(zip(repeat, map(float, row), strict=True))}) for row in rows]


def usable(name: str) -> bool:
    """A name that expressions can have."""
    return name.isidentifier() and name not in expressions.CONSTANTS and name not in expressions.FUNCTIONS


def indexed(name: str, indices: tuple[int, ...]) -> str:
    """`button`, (2,) → `button[2]`"""
    return f"{name}[{', '.join(map(str, indices))}]" if indices else name
