"""A trajectory of an instance bound to a robot's hand: where the arm's tip is to be at every waypoint, and what the fingers do.

Which robot's arm is which of the template's hands is said by whoever binds, `{"twisting": "right", "holding": "left"}`. A robot's
file says where the hand is in the arm's tip frame (`palm`), which side of the body it is on, and its poses by name
(`handrail.robot.description`). A trajectory that is written for one side is mirrored for a hand of the other one: every waypoint
in the x-z plane of the frame that it is said in, the hand in its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from affordance_templates.instance import Instance
from affordance_templates.placement import Array, inverse, of_message, placed, rotation_of, to_message
from affordance_templates.template import ResolvedTrajectory, ResolvedWaypoint, Sync, Tolerance
from handrail.messages import FrameGoal
from handrail.robot.description import Arm, RobotDescription

_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class BoundWaypoint:
    """A waypoint for one robot's arm."""

    waypoint: ResolvedWaypoint
    arm: Arm
    tip_in_world: Array
    """(4, 4) of the arm's tip frame"""
    tolerance: Tolerance
    """along and about the tip frame's own axes"""
    fingers: Mapping[str, float]
    """joint that a gripper drives → rad or m; empty: as they are"""
    force_in_world: Array | None
    """(3,) N, what the hand does to the object"""

    def goal(self) -> FrameGoal:
        """What a planner is asked for."""
        free = [k for k in range(3) if self.tolerance.rotation[k] >= np.pi - 1e-9]
        held = [float(self.tolerance.rotation[k]) for k in range(3) if k not in free]
        x, y, z = self.tolerance.position.tolist()
        about = "xyz"[free[0]] if len(free) == 1 else ""
        angle = min(held) if len(free) < 2 else np.pi if len(free) == 3 else 0.0
        return FrameGoal(
            frame=self.arm.tip,
            pose=to_message(self.tip_in_world),
            below=(x, y, z),
            above=(x, y, z),
            angle=float(angle),
            about=about,  # type: ignore[arg-type]
        )


@dataclass(frozen=True)
class BoundTrajectory:
    """A trajectory for one robot's arm."""

    trajectory: ResolvedTrajectory
    arm: Arm
    mirrored: bool
    waypoints: tuple[BoundWaypoint, ...]


def bind(
    instance: Instance, trajectory: str, robot: RobotDescription, hands: Mapping[str, str], *, mirrored: bool | None = None
) -> BoundTrajectory:  # fmt: skip
    """A trajectory for the arm that `hands` (the template's hand → the robot's arm) names; a robot with one arm needs none.

    :param mirrored: None: where the trajectory is written for the other side than the arm's
    :raises ValueError: an unknown trajectory, hand or arm; a hand pose that the arm has not, naming those that there are
    """
    known = instance.resolve().trajectories
    if trajectory not in known:
        raise ValueError(f"trajectory: got {trajectory!r}; expected one of {', '.join(known) or 'none'}")
    found = known[trajectory]
    arm = _arm(found.hand, robot, hands)
    if mirrored is None:
        mirrored = bool(found.side and arm.side and found.side != arm.side)
    waypoints = tuple(_bound(instance, waypoint, arm, mirrored) for waypoint in found.waypoints)
    return BoundTrajectory(found, arm, mirrored, waypoints)


def bind_together(
    instance: Instance, sync: str, robot: RobotDescription, hands: Mapping[str, str]
) -> dict[str, BoundTrajectory]:
    """All trajectories of a `sync`, each for its own arm. Raises ValueError, also where two hands would be one arm."""
    known = instance.resolve().syncs
    if sync not in known:
        raise ValueError(f"sync: got {sync!r}; expected one of {', '.join(known) or 'none'}")
    bound = {name: bind(instance, name, robot, hands) for name in known[sync].trajectories}
    arms: dict[str, str] = {}
    for each in bound.values():
        if each.arm.name in arms:
            raise ValueError(
                f"hands: {arms[each.arm.name]} and {each.trajectory.hand} are both {each.arm.name}; expected an arm each"
            )
        arms[each.arm.name] = each.trajectory.hand
    return bound


def schedule(sync: Sync, durations: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
    """When each waypoint is reached, s from the start: as soon as it can be, those of a point of the sync at one time.

    :param durations: trajectory → s that the way to each of its waypoints takes at least
    :raises ValueError: durations that are missing or not finite and 0 or more, or points that no order meets
    """
    for name in sync.trajectories:
        given = durations.get(name)
        if given is None or not all(np.isfinite(given)) or min(given, default=0.0) < 0.0:
            raise ValueError(f"durations[{name!r}]: got {given}; expected seconds of 0 or more, one a waypoint")
    times: dict[str, list[float]] = {name: [] for name in sync.trajectories}
    for point in sync.points:
        for name, number in point.items():
            if number >= len(durations[name]) or number < len(times[name]):
                raise ValueError(f"points: {name} has no waypoint {number} left; expected points in order")
            _go_on(times[name], durations[name], number + 1)
        meeting = max(times[name][number] for name, number in point.items())
        for name, number in point.items():
            times[name][number] = meeting
    for name in sync.trajectories:
        _go_on(times[name], durations[name], len(durations[name]))
    return times


def _go_on(times: list[float], durations: Sequence[float], count: int) -> None:
    while len(times) < count:
        times.append((times[-1] if times else 0.0) + durations[len(times)])


def _arm(hand: str, robot: RobotDescription, hands: Mapping[str, str]) -> Arm:
    name = hands.get(hand, next(iter(robot.arms)) if len(robot.arms) == 1 else "")
    if name not in robot.arms:
        raise ValueError(f"hands[{hand!r}]: got {name or 'none'}; expected one of {', '.join(robot.arms)}")
    return robot.arms[name]


def _bound(instance: Instance, waypoint: ResolvedWaypoint, arm: Arm, mirrored: bool) -> BoundWaypoint:
    pose, tool, force = waypoint.pose_in_template, waypoint.tool, waypoint.force
    if mirrored:
        reference = waypoint.reference
        pose = reference @ _MIRROR @ inverse(reference) @ pose @ _MIRROR
        tool = _MIRROR[:3, :3] @ tool
        turned = reference[:3, :3]
        force = None if force is None else turned @ _MIRROR[:3, :3] @ turned.T @ force
    in_world = of_message(instance.pose_in_world)
    palm = placed(np.array(arm.palm.position), rotation_of(np.array(arm.palm.rpy)))
    tip = in_world @ pose @ placed(-tool, np.eye(3)) @ inverse(palm)
    return BoundWaypoint(
        waypoint=waypoint,
        arm=arm,
        tip_in_world=tip,
        tolerance=_seen_from(palm[:3, :3], waypoint.tolerance),
        fingers=_fingers(waypoint.hand_pose, arm),
        force_in_world=None if force is None else in_world[:3, :3] @ force,
    )


def _seen_from(palm: Array, tolerance: Tolerance) -> Tolerance:
    """About the tip frame's axes what was said about the hand's: exactly where they are parallel, else what is surely within."""
    position, rotation = np.empty(3), np.empty(3)
    for k in range(3):
        touched = np.abs(palm[k]) > 1e-6
        position[k], rotation[k] = tolerance.position[touched].min(), tolerance.rotation[touched].min()
    return Tolerance(position, rotation)


def _fingers(pose: str, arm: Arm) -> Mapping[str, float]:
    """What a hand's pose means; an arm that has none carries a rigid tool."""
    if not pose or not arm.hand_poses:
        return {}
    if pose not in arm.hand_poses:
        raise ValueError(f"hand_pose: {arm.name} has no {pose!r}; expected one of {', '.join(arm.hand_poses)}")
    return arm.hand_poses[pose]
