"""Names with what picks one of several: `button[3]`, `key[row, 2]`, `rim(0.5)`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from affordance_templates import expressions
from affordance_templates.expressions import ExpressionError
from affordance_templates.numbers import indexed

_SHAPE = re.compile(r"\s*([^\W\d]\w*)\s*(?:(\[)(.*)\]|(\()(.*)\))?\s*", re.DOTALL)


@dataclass(frozen=True)
class Reference:
    """A name, and what stood in its brackets (whole numbers) or parentheses."""

    name: str
    brackets: Literal["", "[", "("]
    values: tuple[float, ...]

    @property
    def text(self) -> str:
        """As things are named: `button[3]`; without what is in parentheses."""
        return indexed(self.name, tuple(map(int, self.values))) if self.brackets == "[" else self.name


def refer(text: str, names: Mapping[str, float]) -> Reference:
    """Read a reference. Raises ExpressionError."""
    found = _SHAPE.fullmatch(text)
    if found is None:
        raise ExpressionError(f"got {text!r}; expected a name such as rim, button[3] or rim(0.5)")
    name, square, inside, round_, within = found.groups()
    if not square and not round_:
        return Reference(name, "", ())
    parts = _parts(inside if square else within)
    values = tuple(expressions.evaluate(part, names) for part in parts)
    if square:
        for part, value in zip(parts, values, strict=True):
            if value != round(value) or not 0 <= value < 1e6:
                raise ExpressionError(f"{part.strip()!r} in {text!r} is {value:g}; expected a whole number from 0")
        return Reference(name, "[", values)
    return Reference(name, "(", values)


def _parts(inside: str) -> list[str]:
    """What is between commas, those within parentheses left alone."""
    if not inside.strip():
        return []
    parts, depth = [""], 0
    for letter in inside:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts
