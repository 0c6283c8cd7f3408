"""Constraints as the kernels read them: one table of items, each with its rows, bounds and weights, and what each row is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning.ik import constraints as kinds
from engines.planning.ik import kernels
from engines.planning.ik.constraints import Constraint, Quaternion, Vector
from engines.planning.ik.hull import hull
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.report import ANGLE_WEIGHT

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Place = tuple[int, Array]
"""a frame on a joint, 0 the world: (12,) rotation by columns, translation"""

_AXES = np.eye(3)
_WORLD = (0, np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]))


@dataclass
class Table:
    """Items and rows of all constraints but those between bodies, whose rows come and go (see `nearness`)."""

    integers: Integers
    """(items, INTEGERS)"""
    numbers: Array
    """(items, NUMBERS)"""
    relations: Array
    """(items, nv) factors of joint positions"""
    lower: Array
    """(rows,)"""
    upper: Array
    weight: Array
    owners: list[int]
    """(rows,) the number of the constraint that each is about"""
    low: Array
    """(nv,) limits of the joints, with margins"""
    high: Array
    bodies: list[tuple[int, kinds.Clearance | kinds.BodyDistance]]
    """(number, constraint) of those between bodies"""

    @property
    def rows(self) -> int:
        """Rows of all items."""
        return len(self.owners)


def table_of(mechanism: Mechanism, constraints: Sequence[Constraint], q: Array) -> Table:
    """The table; `q` (nq,) is the configuration at which the corners of a support that moves are put in order.

    Raises ValueError naming constraint, field, value and what was expected.
    """
    builder = _Builder(mechanism, q)
    for number, constraint in enumerate(constraints):
        try:
            builder.add(number, constraint)
        except ValueError as problem:
            text = str(problem)
            raise ValueError(text if text.startswith(constraint.label) else f"{constraint.label}: {text}") from None
    return builder.table()


class _Builder:
    def __init__(self, mechanism: Mechanism, q: Array):
        self._mechanism, self._q = mechanism, q
        self._integers: list[tuple[int, int, int, int]] = []
        self._numbers: list[Array] = []
        self._relations: dict[int, dict[int, float]] = {}
        self._lower: list[float] = []
        self._upper: list[float] = []
        self._weight: list[float] = []
        self._owners: list[int] = []
        self._low, self._high = mechanism.lower.copy(), mechanism.upper.copy()
        self._bodies: list[tuple[int, kinds.Clearance | kinds.BodyDistance]] = []
        self._number = 0

    def table(self) -> Table:
        relations = np.zeros((len(self._integers), self._mechanism.nv))
        for item, factors in self._relations.items():
            for row, factor in factors.items():
                relations[item, row] = factor
        integers = np.array(self._integers, np.int64).reshape(-1, kernels.INTEGERS)
        numbers = np.concatenate(self._numbers) if self._numbers else np.zeros((0, kernels.NUMBERS))
        bounds = (np.array(self._lower), np.array(self._upper), np.array(self._weight))
        return Table(integers, numbers, relations, *bounds, self._owners, self._low, self._high, self._bodies)

    def add(self, number: int, constraint: Constraint) -> None:
        self._number = number
        match constraint:
            case kinds.Position():
                b = self._on(constraint.in_frame, _matrix(constraint.box.orientation), constraint.box.position)
                self._position(constraint, self._on(constraint.frame, None, constraint.point), b)
            case kinds.Orientation():
                b = self._on(constraint.in_frame, _matrix(constraint.target))
                self._orientation(constraint, self._on(constraint.frame), b)
            case kinds.Pose():
                a, target = self._on(constraint.frame), constraint.target
                b = self._on(constraint.in_frame, _matrix(target.orientation), target.position)
                self._position(constraint, a, b)
                self._orientation(constraint, a, b)
            case kinds.Direction():
                self._direction(constraint)
            case kinds.Gaze():
                self._gaze(constraint)
            case kinds.PointDistance():
                self._distance(constraint)
            case kinds.CentreOfMass():
                self._centre_of_mass(constraint)
            case kinds.Balance():
                self._balance(constraint)
            case kinds.Posture():
                self._posture(constraint)
            case kinds.JointLimits():
                self._joint_limits(constraint)
            case kinds.Clearance() | kinds.BodyDistance():
                if constraint.scene.mechanism is not self._mechanism:
                    raise ValueError("scene: got one of another mechanism; expected one of the solver's")
                if isinstance(constraint, kinds.BodyDistance):
                    constraint.scene.bodies_of(constraint.link)
                    constraint.scene.bodies_of(constraint.other)
                self._bodies.append((number, constraint))
            case _:
                raise ValueError(f"got {type(constraint).__name__}; expected one of engines.planning.ik.constraints")

    def _item(
        self, kind: int, a: Place, b: Place, lower: list[float], upper: list[float], unit: str,
        vector: Sequence[float] = (), other: Sequence[float] = (),
    ) -> None:  # fmt: skip
        """One item, of as many rows as there are bounds."""
        self._integers.append((kind, a[0], b[0], len(self._owners)))
        numbers = np.zeros((1, kernels.NUMBERS))
        numbers[0, kernels.VECTOR : kernels.VECTOR + len(vector)] = vector
        numbers[0, kernels.OTHER : kernels.OTHER + len(other)] = other
        self._add(numbers, a, b, lower, upper, unit)

    def _items(
        self, kind: int, a: Place, b: Place, lower: list[float], upper: list[float], vectors: Array
    ) -> None:  # fmt: skip
        """An item of one row, about lengths, for each vector (k, 3)."""
        first = len(self._owners)
        self._integers += [(kind, a[0], b[0], first + k) for k in range(len(vectors))]
        numbers = np.zeros((len(vectors), kernels.NUMBERS))
        numbers[:, kernels.VECTOR : kernels.VECTOR + 3] = vectors
        self._add(numbers, a, b, lower, upper, "m")

    def _add(self, numbers: Array, a: Place, b: Place, lower: list[float], upper: list[float], unit: str) -> None:
        numbers[:, kernels.PLACE_A : kernels.PLACE_A + 12] = a[1]
        numbers[:, kernels.PLACE_B : kernels.PLACE_B + 12] = b[1]
        self._numbers.append(numbers)
        self._lower += lower
        self._upper += upper
        self._weight += [ANGLE_WEIGHT if unit == "rad" else 1.0] * len(lower)
        self._owners += [self._number] * len(lower)

    def _on(self, frame: str, rotation: Array | None = None, point: Vector = (0.0, 0.0, 0.0)) -> Place:
        """A frame within a frame, on the joint that carries it."""
        joint, place = self._mechanism.place(frame)
        if rotation is None and not any(point):
            return joint, place
        if not frame:
            return 0, np.concatenate((_AXES.reshape(-1) if rotation is None else rotation.T.reshape(-1), point))
        turn, local = place[:9].reshape(3, 3).T, place.copy()
        local[9:] += turn @ point
        if rotation is not None:
            local[:9] = (turn @ rotation).T.reshape(-1)
        return joint, local

    def _position(self, c: kinds.Position | kinds.Pose, a: Place, b: Place) -> None:
        axes = [k for k in range(3) if c.lower[k] > -np.inf or c.upper[k] < np.inf]
        lower, upper = [c.lower[k] for k in axes], [c.upper[k] for k in axes]
        self._items(kernels.POINT, a, b, lower, upper, _AXES[axes])

    def _orientation(self, c: kinds.Orientation | kinds.Pose, a: Place, b: Place) -> None:
        if c.angle == 0.0:
            self._item(kernels.TURN, a, b, [0.0] * 3, [0.0] * 3, "rad")
        elif c.angle < np.pi:
            self._item(kernels.ANGLE, a, b, [-np.inf] * kernels.SIDES, [c.angle] * kernels.SIDES, "rad")

    def _direction(self, c: kinds.Direction) -> None:
        a, b = self._on(c.frame), self._on(c.in_frame)
        axis, direction = _unit(c.axis), _unit(c.direction)
        if c.cone == 0.0:
            self._item(kernels.ALIGN, a, b, [0.0] * 2, [0.0] * 2, "rad", axis, direction)
        elif c.cone < np.pi:
            self._item(kernels.CONE, a, b, [-np.inf] * kernels.SIDES, [c.cone] * kernels.SIDES, "rad", axis, direction)

    def _gaze(self, c: kinds.Gaze) -> None:
        a, b = self._on(c.frame, None, c.origin), self._on(c.in_frame, None, c.target)
        if c.cone < np.pi:
            self._item(kernels.GAZE, a, b, [-np.inf] * kernels.SIDES, [c.cone] * kernels.SIDES, "rad", _unit(c.axis))

    def _distance(self, c: kinds.PointDistance) -> None:
        a, b = self._on(c.frame, None, c.point), self._on(c.other, None, c.other_point)
        self._item(kernels.DISTANCE, a, b, [c.lower], [c.upper], "m")

    def _centre_of_mass(self, c: kinds.CentreOfMass) -> None:
        b = self._on(c.in_frame)
        axes = [k for k in range(3) if c.lower[k] > -np.inf or c.upper[k] < np.inf]
        lower, upper = ([(bound[k] - c.held[k]) / c.share for k in axes] for bound in (c.lower, c.upper))
        self._items(kernels.COM, _WORLD, b, lower, upper, _AXES[axes])

    def _balance(self, c: kinds.Balance) -> None:
        places = [self._on(frame, None, point) for frame, points in c.contacts.items() for point in points]
        corners, order = hull(self._mechanism.points(self._q, places)[:, :2])
        if len(order) < 3:
            raise ValueError(f"contacts: got {dict(c.contacts)}; expected points that span an area, seen from above")
        if all(joint == 0 for joint, _ in places):  # a polygon that stands still: half-planes
            ahead = np.roll(corners, -1, axis=0) - corners
            inward = np.zeros((len(order), 3))
            inward[:, :2] = np.column_stack([-ahead[:, 1], ahead[:, 0]]) / np.hypot(ahead[:, :1], ahead[:, 1:])
            bounds = (inward[:, :2] * corners).sum(axis=1) + c.margin
            self._items(kernels.COM, _WORLD, _WORLD, bounds.tolist(), [np.inf] * len(order), inward)
        else:
            for k in range(len(order)):
                a, b = places[order[k]], places[order[(k + 1) % len(order)]]
                self._item(kernels.EDGE, a, b, [c.margin], [np.inf], "m")

    def _posture(self, c: kinds.Posture) -> None:
        self._relations[len(self._integers)] = {self._mechanism.row(j): f for j, f in c.coefficients.items()}
        self._item(kernels.POSTURE, _WORLD, _WORLD, [c.lower], [c.upper], "rad")

    def _joint_limits(self, c: kinds.JointLimits) -> None:
        rows = [self._mechanism.row(joint) for joint in c.joints or self._mechanism.joints]
        self._low[rows] = np.maximum(self._low[rows], self._mechanism.lower[rows] + c.margin)
        self._high[rows] = np.minimum(self._high[rows], self._mechanism.upper[rows] - c.margin)
        for row in rows:
            if self._low[row] > self._high[row]:
                joint = self._mechanism.joint_of(row)
                span = self._mechanism.upper[row] - self._mechanism.lower[row]
                raise ValueError(f"margin: got {c.margin}; expected at most {span / 2:.3g}, half of what {joint} has")


def _unit(direction: Vector) -> list[float]:
    length = float(np.linalg.norm(direction))
    return [float(x) / length for x in direction]


def _matrix(quaternion: Quaternion) -> Array | None:
    """Rotation (3, 3) of a quaternion (x, y, z, w), normalised; None: no turn."""
    x, y, z, w = quaternion
    if x == y == z == 0.0:
        return None
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
