"""One visit to an instance: a trajectory's waypoints as tool-tip goals in the world, turned about the template's joint.

A trajectory with an entry lives on an arc about its joint: the planner chooses the arc's centre once, and each stroke enters at the
earliest angle of the arc that is clear of what stands in the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from affordance_templates.template import ResolvedJoint, ResolvedTrajectory, ResolvedWaypoint
from engines.planning.collision.obstacles import placement_of
from engines.planning.plan import Infeasible

Array = NDArray[np.float64]

_ENTRY_RESOLUTION = np.deg2rad(1.0)


@dataclass(frozen=True)
class TipPath:
    """Goals of the tool's tip, close together."""

    positions: Array
    """(k, 3) m, world"""
    axes: Array
    """(k, 3) unit pointing directions, world"""

    def __len__(self) -> int:
        return len(self.positions)


class Visit:
    """Geometry of one trajectory of an instance in the world."""

    def __init__(self, instance: Instance, trajectory: str):
        """Raises ValueError when the template has no such trajectory, or one that can't be followed."""
        resolved = instance.resolve()
        if trajectory not in resolved.trajectories:
            known = ", ".join(resolved.trajectories) or "none"
            raise ValueError(f"instance {instance.name}: no trajectory {trajectory!r}; expected one of {known}")
        self.trajectory: ResolvedTrajectory = resolved.trajectories[trajectory]
        self._joints = resolved.joints
        self._in_world: pin.SE3 = placement_of(instance.pose_in_world)
        self.entry = self.trajectory.entry
        for waypoint in self.trajectory.waypoints:
            if waypoint.approach == "along" and waypoint.joint not in self._joints:
                raise ValueError(f"trajectory {trajectory}, waypoint {waypoint.name}: no joint {waypoint.joint!r}")
            if waypoint.approach == "guarded":
                raise ValueError(
                    f"trajectory {trajectory}, waypoint {waypoint.name}: is guarded until a force; strokes know free, straight and "
                    "along alone"
                )
            if waypoint.approach == "along" and (self.entry is None or self.entry.joint != waypoint.joint):
                raise ValueError(
                    f"trajectory {trajectory}, waypoint {waypoint.name}: goes along {waypoint.joint} without an entry on it; "
                    "expected one, or a motion `along` the joint"
                )

    @property
    def joint(self) -> ResolvedJoint | None:
        """The joint of the entry's arc."""
        return self._joints[self.entry.joint] if self.entry else None

    @property
    def span(self) -> float:
        """rad of the arc, 0 without an entry"""
        return self.entry.span if self.entry else 0.0

    @property
    def contact(self) -> ResolvedWaypoint:
        """Where the tool works: the waypoint before the first one along a joint; without one the last straight one."""
        waypoints = self.trajectory.waypoints
        for before, waypoint in pairwise(waypoints):
            if waypoint.approach == "along":
                return before
        return next((w for w in reversed(waypoints) if w.approach == "straight"), waypoints[-1])

    @property
    def standoff(self) -> ResolvedWaypoint:
        """Where a stroke begins and ends: the first straight waypoint, else the contact."""
        return next((w for w in self.trajectory.waypoints if w.approach == "straight"), self.contact)

    @property
    def stations(self) -> list[ResolvedWaypoint]:
        """Waypoints at different depths, the contact first: what the arm must reach at every angle of the arc."""
        stations = [self.contact]
        for waypoint in self.trajectory.waypoints:
            if waypoint.approach == "straight" and all(
                np.linalg.norm(waypoint.position - other.position) > 1e-6 for other in stations
            ):
                stations.append(waypoint)
        return stations

    def index(self, waypoint: ResolvedWaypoint) -> int:
        """The waypoint's place in the trajectory."""
        return next(i for i, one in enumerate(self.trajectory.waypoints) if one is waypoint)

    def may_touch(self, waypoint: ResolvedWaypoint) -> bool:
        """True from the first waypoint that makes contact (guarded or along a joint) to the end of the trajectory."""
        for one in self.trajectory.waypoints:
            if one.guard is not None or one.approach == "along":
                return True
            if one is waypoint:
                return False
        return False

    def tip(self, waypoint: ResolvedWaypoint, angle: float) -> tuple[Array, Array]:
        """Tip position (3,) m and pointing direction (3,) in the world, the waypoint turned by `angle` about the entry's joint."""
        position, axis = waypoint.position, waypoint.axis
        if self.joint is not None:
            position, axis = moved(position, axis, self.joint, angle)
        return self._in_world.act(position), self._in_world.rotation @ axis

    def force(self, waypoint: ResolvedWaypoint, angle: float, size: float) -> Array:
        """What the object does to the tip when the tool pushes it along the joint with `size` N: (3,) N in the world."""
        if self.joint is None:
            return np.zeros(3)
        ahead = self.tip(waypoint, angle + 1e-3)[0] - self.tip(waypoint, angle - 1e-3)[0]
        length = float(np.linalg.norm(ahead))
        return -size * ahead / length if length > 1e-9 else np.zeros(3)

    def local(self, position: Array, axis: Array) -> tuple[float, float, float, float]:
        """A tip in the world as (angle rad, radius m, depth m beyond the contact, tilt rad) about the entry's joint.

        Raises ValueError without an entry.
        """
        joint = self.joint
        if joint is None:
            raise ValueError(f"trajectory {self.trajectory.name} has no entry")
        here, there = self._in_world.actInv(position) - joint.origin, self.contact.position - joint.origin
        depth = float((here - there) @ joint.axis)
        across, zero = here - joint.axis * (here @ joint.axis), there - joint.axis * (there @ joint.axis)
        angle = float(np.arctan2(joint.axis @ np.cross(zero, across), zero @ across))
        wanted = moved(self.contact.position, self.contact.axis, joint, angle)[1]
        cosine = float(np.clip(axis @ (self._in_world.rotation @ wanted), -1.0, 1.0))
        return angle, float(np.linalg.norm(across)), depth, float(np.arccos(cosine))

    def arc_centres(self, count: int) -> Array:
        """rad, where the arc's centre may be: all around a continuous joint, else at the joint's present position."""
        if self.joint is None:
            return np.zeros(1)
        if self.joint.kind != "continuous":
            return np.array([self.joint.position])
        return np.arange(count) * 2 * np.pi / count

    def entry_angle(self, arc: float, shift: float = 0.0) -> float:
        """The earliest angle of the arc with the clearance that is wanted from every obstacle; at least `shift` rad after that
        on a retry, since something stood at the earliest.

        Where no angle has all of it the one with most, at least half. From the entry the tool must still touch an obstacle before
        the arc's end. Raises Infeasible.
        """
        if self.entry is None or self.joint is None:
            return 0.0
        first, last = arc - self.span / 2, arc + self.span / 2
        if shift > 0.0:
            first = self.entry_angle(arc) + shift
        angles = np.arange(first, last, _ENTRY_RESOLUTION)
        if not self.entry.avoid and len(angles):
            return first
        obstacles = np.array(self.entry.avoid) + self.joint.position
        ahead = ((obstacles - angles[:, None]) % (2 * np.pi)).min(axis=1, initial=2 * np.pi)
        angles = angles[angles + ahead - self.entry.contact_offset < last]
        if not len(angles):
            raise Infeasible("room for a stroke on the arc", max(first - last, 0.0) + _ENTRY_RESOLUTION, "rad", "entry")
        gaps = np.abs((obstacles - angles[:, None] + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
        clearance = gaps - self.entry.contact_offset
        wide = np.flatnonzero(clearance >= self.entry.clearance)
        best = int(wide[0] if len(wide) else clearance.argmax())
        if clearance[best] < self.entry.clearance / 2:
            raise Infeasible(
                "angle between the tool and the nearest obstacle",
                self.entry.clearance / 2 - clearance[best],
                "rad",
                "entry",
            )
        return float(angles[best])

    def angles(self, arc: float) -> list[float]:
        """rad about the entry's joint, of each waypoint of a stroke whose arc has its centre there. Raises Infeasible."""
        angle, found = self.entry_angle(arc), list[float]()
        for waypoint in self.trajectory.waypoints:
            if waypoint.approach == "along":
                angle = arc + self.span / 2 if waypoint.to == "arc_end" else angle + float(waypoint.to)
            found.append(angle)
        return found

    def carried(self, pose: Array, angle: float) -> Array:
        """(4, 4): a pose of the world, turned by `angle` about the entry's joint."""
        if self.joint is None:
            return pose
        world = self._in_world.homogeneous
        return np.asarray(world @ self.joint.displacement(angle) @ np.linalg.inv(world) @ pose)

    def straight(self, start: tuple[Array, Array], goal: tuple[Array, Array], spacing: float) -> TipPath:
        """The tip on a line, the axis by the shortest turn; poses at most `spacing` m apart, both ends included."""
        count = max(2, int(np.ceil(np.linalg.norm(goal[0] - start[0]) / spacing)) + 1)
        share = np.linspace(0.0, 1.0, count)[:, None]
        turn = pin.log3(pin.Quaternion.FromTwoVectors(start[1], goal[1]).toRotationMatrix())
        axes = np.array([pin.exp3(turn * part[0]) @ start[1] for part in share])
        return TipPath((1 - share) * start[0] + share * goal[0], axes)

    def turned(self, waypoint: ResolvedWaypoint, start: float, end: float, spacing: float) -> TipPath:
        """A waypoint's tip from one angle about the entry's joint to another; poses at most `spacing` rad apart."""
        count = max(2, int(np.ceil(abs(end - start) / spacing)) + 1)
        return self.tips(waypoint, np.linspace(start, end, count))

    def tips(self, waypoint: ResolvedWaypoint, angles: Array) -> TipPath:
        """A waypoint's tip at angles (k,) rad about the entry's joint."""
        tips = [self.tip(waypoint, float(angle)) for angle in angles]
        return TipPath(np.array([tip[0] for tip in tips]), np.array([tip[1] for tip in tips]))


def moved(position: Array, axis: Array, joint: ResolvedJoint, amount: float) -> tuple[Array, Array]:
    """A point and a direction (template's frame) carried along by a joint that moves by `amount` rad (prismatic: m)."""
    motion = joint.displacement(amount)
    return motion[:3, :3] @ position + motion[:3, 3], motion[:3, :3] @ axis
