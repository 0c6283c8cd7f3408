"""A parameter that an operator sets, of a program or of a node: its value, and whether it may have it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from handrail.messages import NodePort, ProgramParameter

_UNITS = {"deg": "°", "Nm": "N·m"}
_TYPES: dict[str, Literal["number", "integer", "text", "bool"]] = {
    "number": "number", "integer": "integer", "flag": "bool", "text": "text",
}  # fmt: skip


@dataclass(frozen=True)
class Given:
    """A parameter and its value."""

    parameter: ProgramParameter
    value: Any
    fits: bool
    choices: tuple[str, ...] = ()
    """texts of which it has to be one; empty: any"""

    @property
    def unit(self) -> str:
        """As people write it."""
        return _UNITS.get(self.parameter.unit, self.parameter.unit)

    @property
    def expected(self) -> str:
        """What its value has to be, in the parameter's own unit."""
        low = "" if self.parameter.min is None else f"{self.parameter.min:g}"
        high = "" if self.parameter.max is None else f"{self.parameter.max:g}"
        space = "" if self.unit == "°" else " "
        return ", ".join(self.choices) or f"{low} … {high}{space}{self.unit}".strip()

    def with_value(self, value: Any) -> Given:
        """The same with another value."""
        fits = _fits(self.parameter, value) and (not self.choices or value in self.choices)
        return Given(self.parameter, value, fits, self.choices)

    def shown(self) -> dict[str, Any]:
        """As `LaunchParameter` draws it: with a slider where it has bounds."""
        parameter, low, high = self.parameter, self.parameter.min, self.parameter.max
        bounded = parameter.type in ("number", "integer") and low is not None and high is not None and low < high
        return {
            "name": parameter.name,
            "title": parameter.title,
            "type": parameter.type,
            "unit": self.unit,
            "value": self.value,
            "low": low if bounded else 0.0,
            "high": high if bounded else 0.0,
            "bounded": bounded,
            "step": 1.0 if parameter.type == "integer" else 0.0,
            "fits": self.fits,
            "expected": self.expected,
            "choices": list(self.choices),
        }


ROLES = (
    "name", "title", "type", "unit", "value", "low", "high", "bounded", "step", "fits", "expected", "choices",
)  # fmt: skip
"""of `Given.shown`"""


def of_program(parameter: ProgramParameter, value: Any) -> Given:
    """A program's."""
    return Given(parameter, value, value == parameter.default or _fits(parameter, value))


def of_port(port: NodePort, value: Any) -> Given:
    """A node's."""
    parameter = ProgramParameter(
        name=port.name, type=_TYPES[port.kind], default=None, unit=port.unit, min=port.low, max=port.high
    )
    return Given(parameter, None, False, tuple(port.choices)).with_value(value)


def _fits(parameter: ProgramParameter, value: Any) -> bool:
    """As the engine checks it."""
    if parameter.type == "text":
        return isinstance(value, str)
    if parameter.type == "bool":
        return isinstance(value, bool)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return False
    if parameter.type == "integer" and value != round(value):
        return False
    low = -math.inf if parameter.min is None else parameter.min
    high = math.inf if parameter.max is None else parameter.max
    return low <= value <= high
