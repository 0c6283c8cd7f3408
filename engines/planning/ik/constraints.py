"""What a configuration must keep: typed constraints on frames, bodies, the centre of mass and the posture.

Lengths are m, angles rad. A frame is a link or any other frame of the model; "" is the world (on a fixed base: the base's frame).
`in_frame` may itself be carried by the robot. Equal bounds make an equality; infinite ones leave a direction free. Every constraint
refuses what can't be meant (not finite, bounds the wrong way round, a direction without length) with a ValueError that names it.
The six families are those of Fallon et al. 2015 (An Architecture for Online Affordance-based Perception and Whole-body Planning),
§4.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from engines.planning.collision.world import World
from engines.planning.ik.hull import hull
from handrail.messages import Pose as PoseMessage

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

WORLD = ""
_ORIGIN: Vector = (0.0, 0.0, 0.0)
_ALWAYS = (-math.inf, math.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class Constraint:
    """What all kinds have."""

    name: str = ""
    """what reports call it; left out: made of kind and frames"""
    priority: int = 0
    """0: never given up; where relaxing is asked for, the largest number gives way first"""
    window: tuple[float, float] = _ALWAYS
    """s, of a trajectory: from when to when it holds; a single configuration has no time"""

    def __post_init__(self) -> None:
        first, last = self.window
        if not first <= last:
            self._refuse("window", self.window, "two times, the first not after the second")
        if self.priority < 0:
            self._refuse("priority", self.priority, "0 or more")

    @property
    def label(self) -> str:
        """The name, or what it is."""
        return self.name or self._words()

    def _words(self) -> str:
        return type(self).__name__.lower()

    def _refuse(self, field_name: str, value: object, expected: str) -> None:
        raise ValueError(f"{self.name or type(self).__name__}: {field_name}: got {value}; expected {expected}")

    def _check_finite(self, **fields: Sequence[float]) -> None:
        for name, values in fields.items():
            if not all(map(math.isfinite, values)):
                self._refuse(name, tuple(values), "finite numbers")

    def _check_bounds(self, lower: Sequence[float], upper: Sequence[float], names: str = "lower, upper") -> None:
        if len(lower) != len(upper) or not all(a <= b for a, b in zip(lower, upper, strict=True)):
            self._refuse(names, (tuple(lower), tuple(upper)), "numbers, none above its upper bound")
        if any(a == math.inf or b == -math.inf for a, b in zip(lower, upper, strict=True)):
            self._refuse(names, (tuple(lower), tuple(upper)), "bounds that some number keeps")

    def _check_direction(self, **fields: Vector) -> None:
        for name, values in fields.items():
            self._check_finite(**{name: values})
            if math.hypot(*values) < 1e-9:
                self._refuse(name, values, "a direction, longer than 0")

    def _check_quaternion(self, **fields: Quaternion) -> None:
        for name, values in fields.items():
            self._check_finite(**{name: values})
            if abs(math.hypot(*values) - 1.0) > 1e-3:
                self._refuse(name, values, "a unit quaternion (x, y, z, w)")

    def _check_angle(self, **fields: float) -> None:
        for name, value in fields.items():
            if not 0.0 <= value <= math.pi:
                self._refuse(name, value, "an angle from 0 to π rad")


@dataclass(frozen=True, kw_only=True, eq=False)
class JointLimits(Constraint):
    """Stay `margin` rad (m) within the limits of the joints named; the limits themselves always hold."""

    margin: float = 0.0
    joints: tuple[str, ...] = ()
    """none: all"""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(margin=(self.margin,))
        if self.margin < 0.0:
            self._refuse("margin", self.margin, "0 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class _OfFrame(Constraint):
    """What is said of one frame, seen from another."""

    frame: str
    in_frame: str = WORLD

    def _words(self) -> str:
        return f"{type(self).__name__.lower()} of {self.frame}" + (f" in {self.in_frame}" if self.in_frame else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class Position(_OfFrame):
    """A point on a frame lies in a box: its coordinates in `box` are within the bounds."""

    lower: Vector
    upper: Vector
    point: Vector = _ORIGIN
    """in `frame`"""
    box: PoseMessage = field(default_factory=PoseMessage)
    """the box's own frame, in `in_frame`"""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(point=self.point, box=self.box.position)
        self._check_quaternion(box=self.box.orientation)
        self._check_bounds(self.lower, self.upper)

    @classmethod
    def at(cls, frame: str, target: Sequence[float], *, tolerance: float = 0.0, **more: object) -> Position:
        """A point within `tolerance` of `target` (3,) along each axis."""
        low, high = ([float(x) + sign * tolerance for x in target] for sign in (-1, 1))
        return cls(frame=frame, lower=tuple(low), upper=tuple(high), **more)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True, eq=False)
class Orientation(_OfFrame):
    """A frame is turned at most `angle` rad from the target orientation; 0: exactly so."""

    target: Quaternion
    angle: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_quaternion(target=self.target)
        self._check_angle(angle=self.angle)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose(_OfFrame):
    """A frame is at a pose: its origin within bounds along the target's own axes, turned by at most `angle` from it."""

    target: PoseMessage
    lower: Vector = _ORIGIN
    upper: Vector = _ORIGIN
    angle: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(target=self.target.position)
        self._check_quaternion(target=self.target.orientation)
        self._check_bounds(self.lower, self.upper)
        self._check_angle(angle=self.angle)

    @cached_property
    def halves(self) -> tuple[Position, Orientation]:
        """The same as two constraints."""
        shared = {"name": self.label, "priority": self.priority, "window": self.window, "in_frame": self.in_frame}
        return (
            Position(frame=self.frame, lower=self.lower, upper=self.upper, box=self.target, **shared),  # type: ignore[arg-type]
            Orientation(frame=self.frame, target=self.target.orientation, angle=self.angle, **shared),  # type: ignore[arg-type]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction(_OfFrame):
    """An axis of a frame points along a direction, to within a cone of half-angle `cone`; 0: exactly. Turning about it is free."""

    axis: Vector
    direction: Vector
    """in `in_frame`"""
    cone: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_direction(axis=self.axis, direction=self.direction)
        self._check_angle(cone=self.cone)


@dataclass(frozen=True, kw_only=True, eq=False)
class Gaze(Constraint):
    """A target point is within the cone about a frame's axis: a camera sees it, a hand faces it."""

    frame: str
    target: Vector
    """in `in_frame`"""
    axis: Vector = (1.0, 0.0, 0.0)
    cone: float = 0.0
    """half-angle; must be more than 0"""
    origin: Vector = _ORIGIN
    """the cone's tip, in `frame`"""
    in_frame: str = WORLD

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(target=self.target, origin=self.origin)
        self._check_direction(axis=self.axis)
        if not 0.0 < self.cone <= math.pi:
            self._refuse("cone", self.cone, "a half-angle above 0, up to π rad")

    def _words(self) -> str:
        return f"gaze of {self.frame}"


@dataclass(frozen=True, kw_only=True, eq=False)
class PointDistance(Constraint):
    """The distance of two points, each on a frame, is within bounds."""

    frame: str
    other: str
    lower: float = 0.0
    upper: float = math.inf
    point: Vector = _ORIGIN
    other_point: Vector = _ORIGIN

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(point=self.point, other_point=self.other_point)
        self._check_bounds((self.lower,), (self.upper,))
        if self.upper < 0.0:
            self._refuse("upper", self.upper, "0 or more")

    def _words(self) -> str:
        return f"distance of {self.frame} and {self.other or 'the world'}"


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyDistance(Constraint):
    """The shapes of two links are at least (and at most) so far apart. Penetration counts as negative distance."""

    scene: World
    link: str
    other: str
    lower: float = 0.0
    upper: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_bounds((self.lower,), (self.upper,))

    def _words(self) -> str:
        return f"distance of {self.link} and {self.other}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Clearance(Constraint):
    """All bodies of a scene keep `at_least` m: the robot's links from each other and from what stands around."""

    scene: World
    at_least: float = 0.01
    itself: float | None = None
    """m, of the robot's links from each other where that is another one"""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(at_least=(self.at_least,), itself=() if self.itself is None else (self.itself,))

    @property
    def floors(self) -> NDArray[np.float64]:
        """(pairs of the scene,) m"""
        return np.where(self.scene.of_itself, self.at_least if self.itself is None else self.itself, self.at_least)

    def _words(self) -> str:
        return "clearance"


@dataclass(frozen=True, kw_only=True, eq=False)
class CentreOfMass(Constraint):
    """The centre of mass lies in a box in `in_frame`.

    Of what moves, as pinocchio counts it; of the robot with what stands still where `share` and `held` say how the one follows from
    the other: share · (of what moves) + held (`Mechanism.whole_mass`).
    """

    lower: Vector
    upper: Vector
    in_frame: str = WORLD
    share: float = 1.0
    """of the robot's mass, that moves"""
    held: Vector = _ORIGIN
    """m, world: what stands still adds to the centre"""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_bounds(self.lower, self.upper)
        self._check_finite(held=self.held)
        if not 0.0 < self.share <= 1.0:
            self._refuse("share", self.share, "above 0, up to 1")
        if self.in_frame and (self.share, self.held) != (1.0, _ORIGIN):
            self._refuse("in_frame", repr(self.in_frame), "the world, where what stands still counts")

    def _words(self) -> str:
        return "centre of mass"


@dataclass(frozen=True, kw_only=True, eq=False)
class Balance(Constraint):
    """Quasi-static balance: the centre of mass, seen along gravity (−z of the world), is `margin` m within the contacts' hull.

    Contacts are points on frames, which the polygon goes with; under "" they are points of the world.
    """

    contacts: Mapping[str, Sequence[Vector]]
    margin: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(margin=(self.margin,))
        for frame, points in self.contacts.items():
            for point in points:
                self._check_finite(**{f"contacts[{frame!r}]": point})
        if sum(len(points) for points in self.contacts.values()) < 3:
            self._refuse("contacts", dict(self.contacts), "3 points or more")

    def _words(self) -> str:
        return "balance"

    @cached_property
    def still(self) -> NDArray[np.float64] | None:
        """(k, 2) m, the corners where all contacts are points of the world; None where some go with a frame."""
        return None if set(self.contacts) - {WORLD} else hull(np.array(self.contacts[WORLD], dtype=float)[:, :2])[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Posture(Constraint):
    """A linear relation of joint positions: lower ≤ Σ coefficient · position ≤ upper. Symmetry: {left: 1, right: −1}, 0 to 0."""

    coefficients: Mapping[str, float]
    lower: float = 0.0
    upper: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_finite(coefficients=tuple(self.coefficients.values()))
        self._check_bounds((self.lower,), (self.upper,))
        if not any(self.coefficients.values()):
            self._refuse("coefficients", dict(self.coefficients), "a joint with a factor other than 0")

    def _words(self) -> str:
        return "posture of " + ", ".join(self.coefficients)
