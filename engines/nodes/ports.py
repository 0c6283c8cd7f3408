"""Typed ports of nodes: what may flow through them, and what is said when something else comes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from handrail.messages import Pose


@dataclass(frozen=True)
class Kind:
    """What a port carries."""

    name: str
    expected: str
    """in words"""
    take: Callable[[Any], Any]
    """a value as the node sees it; raises ValueError or TypeError for what is none"""
    pack: Callable[[Any], Any] = lambda value: value
    """that value as the wire carries it, which `take` reads again"""


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ValueError
    return float(value)


def _integer(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ValueError
    return int(value)


def _one_of(*kinds: type) -> Callable[[Any], Any]:
    def take(value: Any) -> Any:
        if not isinstance(value, kinds):
            raise ValueError
        return value

    return take


def _joints(value: Any) -> dict[str, float]:
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise ValueError
    return {name: _number(position) for name, position in value.items()}


def _pose(value: Any) -> Pose:
    pose = msgspec.convert(value, Pose) if isinstance(value, Mapping) else value
    if not isinstance(pose, Pose) or not all(map(math.isfinite, (*pose.position, *pose.orientation))):
        raise ValueError
    if abs(math.hypot(*pose.orientation) - 1.0) > 1e-3:
        raise ValueError
    return pose


def _array(shape: tuple[int | None, ...] | None = None) -> Callable[[Any], np.ndarray]:
    def take(value: Any) -> np.ndarray:
        if isinstance(value, Mapping):  # as `engines.nodes.shared.inline` has it
            array = np.frombuffer(value["data"], np.dtype(value["dtype"])).reshape(value["shape"])
        else:
            array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise ValueError
        if shape is not None:
            fits = len(shape) == array.ndim and all(b in (None, a) for a, b in zip(array.shape, shape, strict=False))
            if not fits or not np.isfinite(array).all():
                raise ValueError
            array = array.astype(float, copy=False)
        return array

    return take


KINDS = {
    kind.name: kind
    for kind in (
        Kind("number", "a finite number", _number),
        Kind("integer", "a whole number", _integer),
        Kind("flag", "true or false", _one_of(bool)),
        Kind("text", "a text", _one_of(str)),
        Kind("joints", "joint names with finite positions, rad", _joints),
        Kind("pose", "a Pose: position m, unit quaternion (x, y, z, w)", _pose, msgspec.to_builtins),
        Kind("wrench", "6 finite numbers: force N, torque N·m", _array((6,)), np.ndarray.tolist),
        Kind("numbers", "a list of finite numbers", _array((None,)), np.ndarray.tolist),
        Kind("cloud", "points (n, 3) m, finite", _array((None, 3))),
        Kind("array", "an array of numbers", _array()),
    )
}


def plain(value: Any) -> Any:
    """A port's value as numbers, texts, lists and mappings."""
    return value.tolist() if isinstance(value, np.ndarray) else msgspec.to_builtins(value)


class PortError(ValueError):
    """A value that a port does not take, or one that is not there. Names node's port, value and expectation."""


class MissingError(PortError):
    """A port is read that nothing has come to yet."""


class _Port:
    """A class attribute of a node that holds one value for each instance."""

    word = "port"

    def __init__(self, kind: str, doc: str = "", *, unit: str = ""):
        if kind not in KINDS:
            raise PortError(f"{self.word}: got kind {kind!r}; expected one of {', '.join(KINDS)}")
        self.kind, self.doc, self.unit, self.name = KINDS[kind], doc, unit, ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, node: Any, owner: type | None = None) -> Any:
        if node is None:
            return self
        if self.name not in node.values:
            raise MissingError(f"{self.word} {self.name}: nothing has come yet; expected {self.kind.expected}")
        return node.values[self.name]

    def __set__(self, node: Any, value: Any) -> None:
        node.values[self.name] = self.taken(value)

    def taken(self, value: Any) -> Any:
        """The value as the node sees it. Raises PortError."""
        try:
            return self.kind.take(value)
        except (ValueError, TypeError, KeyError, msgspec.ValidationError):
            got = str(value)
            raise PortError(
                f"{self.word} {self.name}: got {got if len(got) <= 80 else got[:79] + '…'}; expected {self.kind.expected}"
            ) from None


class Input(_Port):
    """What a node reads: the newest value that has come."""

    word = "input"


class Output(_Port):
    """What a node writes: told after each step in which it was written."""

    word = "output"

    def __init__(self, kind: str, doc: str = "", *, unit: str = "", rate: float = 200.0):
        """:param rate: Hz at which a node that steps by itself may tell it; of more, the newest is told when its turn comes"""
        super().__init__(kind, doc, unit=unit)
        if not rate > 0.0:
            raise PortError(f"output: got rate {rate!r}; expected more than 0 Hz")
        self.rate = rate

    def __set__(self, node: Any, value: Any) -> None:
        super().__set__(node, value)
        node.written.add(self.name)


class Param(_Port):
    """A number, flag or text that is set from outside, and counts from the next step."""

    word = "parameter"

    def __init__(
        self, default: float | bool | str, doc: str = "", *, unit: str = "", low: float = -math.inf, high: float = math.inf,
        choices: tuple[str, ...] = (),
    ):  # fmt: skip
        kinds = {bool: "flag", int: "integer", float: "number", str: "text"}
        if type(default) not in kinds:
            raise PortError(f"parameter: got default {default!r}; expected a number, true, false, or a text")
        super().__init__(kinds[type(default)], doc, unit=unit)
        self.default, self.low, self.high, self.choices = default, low, high, choices

    def __get__(self, node: Any, owner: type | None = None) -> Any:
        return self if node is None else node.values.get(self.name, self.default)

    def taken(self, value: Any) -> Any:
        value = super().taken(value)
        if isinstance(value, int | float) and not self.low <= value <= self.high:
            raise PortError(
                f"parameter {self.name}: got {value:g}; expected {self.low:g} to {self.high:g} {self.unit}".rstrip()
            )
        if self.choices and value not in self.choices:
            raise PortError(f"parameter {self.name}: got {value!r}; expected one of {', '.join(self.choices)}")
        return value
