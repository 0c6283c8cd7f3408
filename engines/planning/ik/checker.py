"""Whether a configuration keeps its constraints: measured anew, sharing nothing with the solver but the model.

Each constraint is measured from link placements as its definition reads (angles by trace and cross product, distances by coal over
all pairs that may be the nearest, support by the polygon itself), without linearisation, kernels or tables: a mistake there shows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.obstacles import placement_of
from engines.planning.collision.world import World
from engines.planning.ik import constraints as kinds
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.hull import hull
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.report import Measure
from handrail.messages import Pose as PoseMessage
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]

LENGTH, ANGLE = 1e-4, 1e-3
"""m, rad: what a constraint may be missed by and still counts as kept"""
_AXES = "xyz"


class Checker:
    """Measures configurations of one mechanism. Not for several threads at once."""

    def __init__(self, mechanism: Mechanism):
        self._mechanism = mechanism
        self._data = mechanism.model.createData()
        self._scratch: WeakKeyDictionary[World, pin.GeometryData] = WeakKeyDictionary()
        self._low, self._high = mechanism.lower[mechanism.v_rows], mechanism.upper[mechanism.v_rows]
        self._said: WeakKeyDictionary[Constraint, pin.SE3] = WeakKeyDictionary()

    def violations(self, constraints: Sequence[Constraint], q: Array) -> tuple[Measure, ...]:
        """What is missed by more than is tolerated, worst first; joint limits are always checked."""
        return missed(self.measures(constraints, q))

    def measures(self, constraints: Sequence[Constraint], q: Array) -> list[Measure]:
        """All figures of all constraints, and of the joints' limits where those are missed."""
        pin.forwardKinematics(self._mechanism.model, self._data, q)
        found = list(self._limits(q))
        for constraint in constraints:
            found.extend(self._measure(constraint, q))
        return found

    def _frame(self, name: str) -> pin.SE3:
        if not name:
            return pin.SE3.Identity()
        return pin.updateFramePlacement(self._mechanism.model, self._data, self._mechanism.frame_id(name))

    def _limits(self, q: Array) -> Iterator[Measure]:
        mechanism, low, high = self._mechanism, self._low, self._high
        x = q[mechanism.q_rows]
        for k in ((x < low) | (x > high)).nonzero()[0]:
            unit = mechanism.unit_of(int(mechanism.v_rows[k]))
            yield Measure("joint limits", mechanism.joints[k], float(x[k]), float(low[k]), float(high[k]), unit)

    def _measure(self, constraint: Constraint, q: Array) -> Iterator[Measure]:
        match constraint:
            case kinds.Position():
                seen = self._seen(constraint, constraint.box)
                yield from self._position(constraint, seen.act(np.array(constraint.point)).tolist())
            case kinds.Orientation():
                seen = self._seen(constraint, PoseMessage(orientation=constraint.target))
                yield self._orientation(constraint, seen.rotation.tolist())
            case kinds.Pose():
                *turn_and_place, _ = self._seen(constraint, constraint.target).homogeneous.tolist()
                yield from self._position(constraint, [row[3] for row in turn_and_place])
                yield self._orientation(constraint, turn_and_place)
            case kinds.Direction():
                axis = self._frame(constraint.frame).rotation @ constraint.axis
                direction = self._frame(constraint.in_frame).rotation @ constraint.direction
                yield Measure(constraint.label, "angle", _angle(axis, direction), 0.0, constraint.cone, "rad")
            case kinds.Gaze():
                frame = self._frame(constraint.frame)
                sight = self._frame(constraint.in_frame) * np.array(constraint.target) - frame * np.array(
                    constraint.origin
                )
                angle = _angle(frame.rotation @ constraint.axis, sight)
                yield Measure(constraint.label, "angle", angle, 0.0, constraint.cone, "rad")
            case kinds.PointDistance():
                one = self._frame(constraint.frame) * np.array(constraint.point)
                other = self._frame(constraint.other) * np.array(constraint.other_point)
                apart = float(np.linalg.norm(one - other))
                yield Measure(constraint.label, "distance", apart, constraint.lower, constraint.upper, "m")
            case kinds.CentreOfMass():
                com = self._frame(constraint.in_frame).actInv(
                    pin.centerOfMass(self._mechanism.model, self._data, pin.POSITION, False)
                )
                com = constraint.share * com + np.array(constraint.held)
                for axis, lower, upper, value in zip(_AXES, constraint.lower, constraint.upper, com, strict=True):
                    yield Measure(constraint.label, axis, float(value), lower, upper, "m")
            case kinds.Balance():
                yield self._balance(constraint)
            case kinds.Posture():
                rows = [self._mechanism.row(joint) for joint in constraint.coefficients]
                factors = np.array(list(constraint.coefficients.values()))
                value = float(factors @ q[self._mechanism.coordinate[rows]])
                unit = self._mechanism.unit_of(rows[0])
                yield Measure(constraint.label, "relation", value, constraint.lower, constraint.upper, unit)
            case kinds.JointLimits():
                for joint in constraint.joints or self._mechanism.joints:
                    row = self._mechanism.row(joint)
                    low, high = (
                        self._mechanism.lower[row] + constraint.margin,
                        self._mechanism.upper[row] - constraint.margin,
                    )
                    x = float(q[self._mechanism.coordinate[row]])
                    yield Measure(constraint.label, joint, x, float(low), float(high), self._mechanism.unit_of(row))
            case kinds.Clearance():
                yield self._clearance(constraint)
            case kinds.BodyDistance():
                yield self._body_distance(constraint)
            case _:
                raise TypeError(f"got {type(constraint).__name__}; expected one of engines.planning.ik.constraints")

    def _seen(self, c: kinds.Position | kinds.Orientation | kinds.Pose, pose: PoseMessage) -> pin.SE3:
        """A constraint's frame, seen from the pose that it says, which is worked out once: a way has many configurations."""
        if (said := self._said.get(c)) is None:
            said = self._said[c] = placement_of(pose)
        wanted = self._frame(c.in_frame) * said if c.in_frame else said
        return wanted.actInv(self._frame(c.frame))

    def _position(self, c: kinds.Position | kinds.Pose, found: list[float]) -> Iterator[Measure]:
        label = c.label
        for axis, lower, upper, value in zip(_AXES, c.lower, c.upper, found, strict=True):
            if lower > -math.inf or upper < math.inf:
                yield Measure(label, axis, value, lower, upper, "m")

    def _orientation(self, c: kinds.Orientation | kinds.Pose, turn: list[list[float]]) -> Measure:
        (xx, xy, xz, *_), (yx, yy, yz, *_), (zx, zy, zz, *_) = turn
        sine = math.sqrt((zy - yz) ** 2 + (xz - zx) ** 2 + (yx - xy) ** 2)
        return Measure(c.label, "angle", math.atan2(sine, xx + yy + zz - 1.0), 0.0, c.angle, "rad")

    def _balance(self, c: kinds.Balance) -> Measure:
        corners = c.still
        if corners is None:
            points = [self._frame(name).act(np.array(one)) for name, many in c.contacts.items() for one in many]
            corners = hull(np.array(points)[:, :2])[0]
        x, y, _ = pin.centerOfMass(self._mechanism.model, self._data, pin.POSITION, False).tolist()
        starts = corners.tolist()
        margins = [
            ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / math.hypot(bx - ax, by - ay)
            for (ax, ay), (bx, by) in zip(starts, starts[1:] + starts[:1], strict=True)
        ]
        return Measure(c.label, "margin of the centre of mass", min(margins), c.margin, np.inf, "m")

    def _clearance(self, c: kinds.Clearance) -> Measure:
        scene = c.scene
        if not len(scene.pairs):
            return Measure(c.label, "no bodies", np.inf, c.at_least, np.inf, "m")
        if scene not in self._scratch:
            self._scratch[scene] = scene.geometry.createData()
        scratch = self._scratch[scene]
        scene.forget(scratch)
        pin.updateGeometryPlacements(self._mechanism.model, self._data, scene.geometry, scratch)
        places = placements(scratch.oMg)
        centres = np.einsum("kji,kj->ki", places[:, :9].reshape(-1, 3, 3), scene.centres) + places[:, 9:]
        one, other = scene.pairs.T
        least = np.linalg.norm(centres[one] - centres[other], axis=1) - scene.radii[one] - scene.radii[other]
        floors = c.floors
        least -= floors
        spare, worst = np.inf, 0
        for pair in np.argsort(least).tolist():  # no two bodies are nearer than the balls about them
            if least[pair] >= spare:
                break
            over = float(pin.computeDistance(scene.geometry, scratch, pair).min_distance - floors[pair])
            if over < spare:
                spare, worst = over, pair
        first, second = scene.pairs[worst]
        floor = float(floors[worst])
        return Measure(c.label, f"{scene.names[first]} and {scene.names[second]}", spare + floor, floor, np.inf, "m")

    def _body_distance(self, c: kinds.BodyDistance) -> Measure:
        scene = c.scene
        geometry = pin.GeometryModel(scene.geometry)
        geometry.removeAllCollisionPairs()
        for i in scene.bodies_of(c.link):
            for j in scene.bodies_of(c.other):
                geometry.addCollisionPair(pin.CollisionPair(i, j))
        scratch = geometry.createData()
        pin.updateGeometryPlacements(self._mechanism.model, self._data, geometry, scratch)
        nearest = pin.computeDistances(geometry, scratch)
        apart = float(scratch.distanceResults[nearest].min_distance)
        return Measure(c.label, f"{c.link} and {c.other}", apart, c.lower, c.upper, "m")


def missed(measures: Sequence[Measure]) -> tuple[Measure, ...]:
    """Those that are missed by more than is tolerated, worst first."""
    found = [m for m in measures if not m.by <= (ANGLE if m.unit == "rad" else LENGTH)]  # not finite: missed
    return tuple(sorted(found, key=lambda m: -m.size)) if found else ()


def _angle(a: Array, b: Array) -> float:
    """Between two directions, rad; exact for small ones and near π (Kahan)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))
