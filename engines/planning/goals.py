"""A motion's goals, as messages say them, as constraints of the IK engine: names looked up, instances put into the world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from affordance_templates.instance import Instance
from engines.planning.collision.obstacles import placement_of
from engines.planning.ik.constraints import CentreOfMass, Constraint, Direction, Gaze, Position, Posture
from engines.planning.ik.constraints import Pose as PoseConstraint
from engines.planning.ik.mechanism import Mechanism
from handrail.messages import (
    CentreOfMassGoal,
    FrameGoal,
    GazeGoal,
    Goal,
    JointsGoal,
    Pose,
    PostureGoal,
    RelationGoal,
)
from handrail.robot.description import RobotDescription

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""of a frame, by the names that goals have for them"""


@dataclass(frozen=True)
class GoalReader:
    """Reads goals for one motion. `where` in its methods is the goal's place in the call, which errors and reports name."""

    description: RobotDescription
    mechanism: Mechanism
    instances: Mapping[str, Instance]
    tip: str
    """the frame that is meant where none is named; empty: none"""
    moving: Sequence[str]
    """joints that may move"""
    world: pin.SE3 = field(default_factory=pin.SE3.Identity)
    """in the frame that constraints are said in, in which the instances are"""

    def constraints(self, goals: Sequence[Goal], where: str) -> list[Constraint]:
        """Raises ValueError naming the goal's place, field, value and what was expected."""
        found: list[Constraint] = []
        for number, goal in enumerate(goals):
            found += self._read(goal, f"{where}[{number}]")
        return found

    def _read(self, goal: Goal, where: str) -> list[Constraint]:
        match goal:
            case JointsGoal():
                _finite(where, tolerance=(goal.tolerance,))
                if not goal.positions:
                    raise ValueError(f"{where}.positions: got none; expected at least one joint")
                return [self._at(where, joint, x, goal.tolerance) for joint, x in goal.positions.items()]
            case PostureGoal():
                named = self.description.home
                if goal.name not in named:
                    raise ValueError(f"{where}.name: got {goal.name!r}; expected one of {', '.join(named)}")
                posture = dict(
                    zip(self.description.joints, self.description.home_position(goal.name).tolist(), strict=True)
                )
                return [self._at(f"{where} ({goal.name})", joint, posture[joint], 0.0) for joint in self.moving]
            case RelationGoal():
                for joint in goal.coefficients:
                    _named(f"{where}.coefficients", joint, self.mechanism.joints)
                words = f"{where} (relation of {', '.join(goal.coefficients)})"
                return [Posture(coefficients=goal.coefficients, lower=goal.lower, upper=goal.upper, name=words)]
            case FrameGoal():
                return self._frame(goal, where)
            case GazeGoal():
                frame, axis = self._sight(goal)
                self._robot_frame(f"{where}.frame", frame)
                _finite(where, target=goal.target)
                base = self._base(goal, where)
                x, y, z = (base.act(np.array(goal.target))).tolist()
                words = f"{where} (gaze of {goal.frame})"
                sight = Gaze(
                    frame=frame,
                    target=(x, y, z),
                    axis=axis,
                    cone=goal.cone,
                    in_frame=goal.in_frame,
                    name=words,
                )
                return [sight]
            case CentreOfMassGoal():
                return [self._mass(goal, where)]

    def _sight(self, goal: GazeGoal) -> tuple[str, tuple[float, float, float]]:
        """Frame and axis that look: of a camera, where the frame is one's name."""
        for camera in self.description.cameras:
            if camera.name == goal.frame:
                return camera.link, AXES["z" if camera.optical else "x"]
        return goal.frame, goal.axis

    def _at(self, where: str, joint: str, position: float, tolerance: float) -> Posture:
        _named(f"{where}.positions", joint, self.mechanism.joints)
        _finite(where, **{f"positions[{joint}]": (position,)})
        row = self.mechanism.row(joint)
        low, high = float(self.mechanism.lower[row]), float(self.mechanism.upper[row])
        if not low <= position <= high:
            raise ValueError(
                f"{where}.positions[{joint}]: got {position:g}; expected {low:.4g} to {high:.4g}, the joint's limits"
            )
        return Posture(
            coefficients={joint: 1.0}, lower=position - tolerance, upper=position + tolerance, name=f"{where} ({joint})"
        )

    def _frame(self, goal: FrameGoal, where: str) -> list[Constraint]:
        frame = goal.frame or self.tip
        if not frame:
            raise ValueError(
                f"{where}.frame: got none; expected a frame's name, since no arm is named whose tip it could be"
            )
        self._robot_frame(f"{where}.frame", frame)
        _finite(where, **{"pose.position": goal.pose.position, "pose.orientation": goal.pose.orientation})
        for name, room in {"below": goal.below, "above": goal.above}.items():
            _finite(where, **{name: [x for x in room if x is not None]})
        length = math.hypot(*goal.pose.orientation)
        if abs(length - 1.0) > 1e-3:
            raise ValueError(
                f"{where}.pose.orientation: got {tuple(goal.pose.orientation)} of length {length:.3g}; "
                "expected a unit quaternion (x, y, z, w)"
            )
        if not goal.angle <= math.pi:
            raise ValueError(f"{where}.angle: got {goal.angle}; expected 0 to π rad")
        target = message_of(self._base(goal, where) * placement_of(goal.pose))
        below, above = ([math.inf if x is None else x for x in room] for room in (goal.below, goal.above))
        lower, upper = tuple(-x for x in below), tuple(above)
        bounded = not all(map(math.isinf, (*lower, *upper)))
        if not bounded and goal.angle == math.pi:
            raise ValueError(f"{where}: got no bound on position or angle; expected a goal that says something")
        name = f"{where} ({frame}{f' at {goal.instance}' if goal.instance else ''})"
        shared = {"frame": frame, "in_frame": goal.in_frame, "name": name}
        position = Position(lower=lower, upper=upper, box=target, **shared)  # type: ignore[arg-type]
        if goal.about:
            axis = AXES[goal.about]
            x, y, z = (placement_of(target).rotation @ np.array(axis)).tolist()
            turn = Direction(axis=axis, direction=(x, y, z), cone=goal.angle, **shared)  # type: ignore[arg-type]
            return [position, turn] if bounded else [turn]
        if goal.angle == math.pi:
            return [position]
        return [PoseConstraint(target=target, lower=lower, upper=upper, angle=goal.angle, **shared)]  # type: ignore[arg-type]

    def _mass(self, goal: CentreOfMassGoal, where: str) -> CentreOfMass:
        _finite(where, position=goal.position, across=(goal.across or 0.0,), height=(goal.height or 0.0,))
        if goal.across is None and goal.height is None:
            raise ValueError(f"{where}: got no bound across or in height; expected a goal that says something")
        middle = self.world.act(np.array(goal.position))
        room = np.array([math.inf if x is None else x for x in (goal.across, goal.across, goal.height)])
        share, (a, b, c) = self.mechanism.whole_mass
        return CentreOfMass(
            lower=tuple((middle - room).tolist()),
            upper=tuple((middle + room).tolist()),
            share=share,
            held=(float(a), float(b), float(c)),
            name=f"{where} (centre of mass)",
        )

    def _base(self, goal: FrameGoal | GazeGoal, where: str) -> pin.SE3:
        """Where the frame is that a goal is said in: in the world, or in `in_frame`."""
        if not goal.instance:
            if goal.feature:
                raise ValueError(
                    f"{where}.instance: got none; expected the instance that has the feature {goal.feature!r}"
                )
            self._robot_frame(f"{where}.in_frame", goal.in_frame)
            return pin.SE3.Identity() if goal.in_frame else self.world
        if goal.in_frame:
            raise ValueError(
                f"{where}.in_frame: got {goal.in_frame!r} beside instance {goal.instance!r}; expected one of both"
            )
        if goal.instance not in self.instances:
            known = ", ".join(self.instances) or "none: place one first"
            raise ValueError(f"{where}.instance: got {goal.instance!r}; expected one of {known}")
        instance = self.instances[goal.instance]
        return placement_of(instance.pose_in_world) * feature_of(instance, goal.feature, f"{where}.feature")

    def _robot_frame(self, field: str, name: str) -> None:
        try:
            self.mechanism.frame_id(name)
        except ValueError as problem:
            raise ValueError(f"{field}: {str(problem).removeprefix('frame: ')}") from None


def described(goal: Goal, tip: str) -> str:
    """A goal in a few words for people."""
    match goal:
        case JointsGoal():
            return ", ".join(goal.positions)
        case PostureGoal():
            return goal.name
        case RelationGoal():
            return f"relation of {', '.join(goal.coefficients)}"
        case FrameGoal():
            return f"{goal.frame or tip} to {' '.join(filter(None, (goal.instance, goal.feature))) or goal.in_frame or 'a pose'}"
        case GazeGoal():
            return f"{goal.frame} looks at {goal.instance or goal.in_frame or 'a point'}"
        case CentreOfMassGoal():
            return "centre of mass"


def feature_of(instance: Instance, feature: str, field: str = "feature") -> pin.SE3:
    """A feature's frame in the template's: `rim(0.5)`, `button[3]`; an object's; a joint's (x along its axis, turned or moved as
    far as the joint is); or that of a waypoint, TRAJECTORY.WAYPOINT (z against the tool's pointing direction). Raises ValueError
    naming `field`.
    """
    try:
        frame = instance.resolve().frame(feature)
    except ValueError as problem:
        raise ValueError(f"{field}: {problem}") from None
    return pin.SE3(frame)


def message_of(placement: pin.SE3) -> Pose:
    """A placement as messages say it."""
    x, y, z = placement.translation.tolist()
    a, b, c, d = pin.Quaternion(placement.rotation).coeffs().tolist()
    return Pose(position=(x, y, z), orientation=(a, b, c, d))


def _finite(where: str, **fields: Sequence[float]) -> None:
    for name, values in fields.items():
        if not all(map(math.isfinite, values)):
            shown = values[0] if len(values) == 1 else tuple(values)
            raise ValueError(f"{where}.{name}: got {shown}; expected finite numbers")


def _named(field: str, joint: str, known: Sequence[str]) -> None:
    if joint not in known:
        raise ValueError(f"{field}: got {joint!r}; expected joints of the robot: {', '.join(known)}")
