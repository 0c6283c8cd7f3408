"""What came out: a configuration with all that it misses or gives, in units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.planning.plan import Infeasible

if TYPE_CHECKING:
    from engines.planning.ik.constraints import Constraint

Array = NDArray[np.float64]


ANGLE_WEIGHT = 0.3
"""m/rad: what a radian counts against a metre while not everything can be kept"""


class Measure(NamedTuple):
    """One figure that a constraint is about."""

    constraint: str
    """its label"""
    what: str
    """x, y, z, angle, or the two bodies"""
    value: float
    lower: float
    upper: float
    unit: str
    """m or rad"""

    @property
    def by(self) -> float:
        """How far it is out of its bounds; 0 within."""
        return max(self.lower - self.value, self.value - self.upper, 0.0)

    @property
    def size(self) -> float:
        """m, the same; an angle counts ANGLE_WEIGHT."""
        return self.by * (ANGLE_WEIGHT if self.unit == "rad" else 1.0)

    @property
    def bound(self) -> str:
        """What it may be, in words: the side that it is out of, else both."""
        if self.value < self.lower:
            return f"at least {self.lower:.4g}"
        if self.value > self.upper:
            return f"at most {self.upper:.4g}"
        return f"{self.lower:.4g} to {self.upper:.4g}"

    def __str__(self) -> str:
        missed = f", missed by {self.by:.3g} {self.unit}" if self.by else ""
        return f"{self.constraint}: {self.what} is {self.value:.4g} {self.unit}, {self.bound} allowed{missed}"


@dataclass(frozen=True)
class Answer:
    """A configuration, checked: feasible when nothing is violated."""

    q: Array
    """(nq,) pinocchio's configuration: a free base's x y z and quaternion first"""
    cost: float
    """½ Σ weight · (distance to nominal)²"""
    violations: tuple[Measure, ...]
    """worst first, an angle counting 0.3 m/rad"""
    given: tuple[Measure, ...]
    """what was relaxed, each against what it asked for"""
    iterations: int
    """of all starts"""
    starts: int
    """that were tried"""
    granted: tuple[Constraint, ...] = ()
    """where something was relaxed, all constraints in their order, those that gave with bounds as wide as they had to be"""

    @property
    def feasible(self) -> bool:
        """Everything is kept that was not relaxed."""
        return not self.violations

    def require(self, where: str = "") -> Answer:
        """Itself. Raises Infeasible with the worst violation, the others in its words, when it is not feasible."""
        if self.violations:
            worst, *others = self.violations
            words = f"({worst.what}) is {worst.value:.3g} {worst.unit}"
            if others:
                words += f"; also {'; '.join(f'{o.constraint} ({o.what}) by {o.by:.3g} {o.unit}' for o in others)}"
            raise Infeasible(worst.constraint, worst.by, worst.unit, where, words)
        return self
