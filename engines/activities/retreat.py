"""`do: retreat`: after a plan was interrupted, take the tool out of what it was in, the way it came."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from affordance_templates.instance import Instance
from affordance_templates.joint_estimate import angle_about
from affordance_templates.template import Array, ResolvedTrajectory, ResolvedWaypoint
from engines.activities.base import Activity, ActivityFailed, Argument, Kind
from engines.activities.execute import waypoint_of
from engines.plans.store import PlanRecord
from engines.runs import retrace
from engines.runs.motion import MotionFailed
from engines.runs.preconditions import Precondition, at_posture
from handrail.messages import CartesianImpedance, Motion, Pose
from handrail.topics import RefusedError

_OUT_S = 1.5
_LOOKED_AT, _OFF = 200, 0.05
"""points of the way that it came that are looked at, and rad that a joint may be off the nearest: what a guard's stop left"""


class RetreatActivity(Activity):
    """Leaves the tool free, from wherever the plan's execution stopped.

    A straight way in is gone back; a straight way out is gone on to its end; from a turn about a joint the tool first backs off as
    the template's own release does, then goes straight out against its pointing direction. Where the tool was free, nothing moves.
    """

    arguments = {"plan": Argument(Kind.VALUE)}
    outputs = frozenset({"moved"})
    _moving = False

    def run(self) -> dict[str, Any]:
        try:
            record = self.services.plans.get(str(self.values["plan"]))
        except RefusedError as refused:
            raise ActivityFailed("refused", str(refused)) from refused
        waypoint = self._engaged(record)
        if waypoint is None or record.instance is None or record.trajectory is None:
            return {"moved": False}
        if self.context.motion.by_hand:
            for each in self._on_its_way(record):
                if not each.met:
                    raise ActivityFailed("stale", f"the tool may still be engaged: {each}")
        if waypoint.approach == "straight":
            return {"moved": self._along_segment(record, back=self._leads_in(record.trajectory, waypoint))}
        if waypoint.to == "arc_end":
            self._back_off(record, record.instance, record.trajectory, waypoint)
        self._straight_out(record, record.instance, record.trajectory, waypoint)
        return {"moved": True}

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        yield from super().preconditions()
        try:
            record = self.services.plans.get(str(self.values["plan"]))
        except RefusedError as refused:
            yield Precondition("there is the plan whose way it goes back", False, str(refused))
            return
        if self._engaged(record) is not None and not self._moving:
            yield from self._on_its_way(record)

    @staticmethod
    def _engaged(record: PlanRecord) -> ResolvedWaypoint | None:
        """The waypoint that the execution stopped before or at; None: the tool was free there."""
        if record.reached < 0:
            return None
        waypoint = waypoint_of(record, record.plan.segments[record.reached].name)
        return None if waypoint is None or waypoint.approach == "free" else waypoint

    def _on_its_way(self, record: PlanRecord) -> Iterator[Precondition]:
        """That the tool is where the plan's execution was interrupted, or further back: the rest of the way nobody has checked."""
        segment, rows = record.plan.segments[record.reached], self._rows(record)
        here = self._command()[rows]
        times = np.linspace(0.0, float(segment.times[-1]), _LOOKED_AT)
        path = retrace.hermite(segment.times, segment.positions, segment.velocities, times)
        if record.ended is not None:
            path = np.vstack([path, np.array(record.ended.command)[rows]])
        nearest = path[int(np.abs(path - here).max(axis=1).argmin())]
        what = f"the tool is on the way that it came, {segment.name} of {record.plan.id}"
        yield at_posture(what, record.plan.joints, nearest, here, _OFF)

    @staticmethod
    def _leads_in(trajectory: ResolvedTrajectory, waypoint: ResolvedWaypoint) -> bool:
        """Whether the tool moves along its pointing direction on the way to a waypoint."""
        waypoints = trajectory.waypoints
        index = waypoints.index(waypoint)
        return index == 0 or float((waypoint.position - waypoints[index - 1].position) @ waypoint.axis) > 0

    def _command(self) -> Array:
        """(n,) rad, where the robot is commanded to be."""
        command = self.services.daemon.command()
        if command is None:
            raise ActivityFailed("unknown_state", "the daemon has not told where the robot is: is it running?")
        return command

    def _rows(self, record: PlanRecord) -> np.ndarray:
        return self.services.description.index(record.plan.joints)

    def _along_segment(self, record: PlanRecord, *, back: bool) -> bool:
        segment, rows = record.plan.segments[record.reached], self._rows(record)
        path = retrace.way(segment.times, segment.positions, segment.velocities, self._command()[rows], back=back)
        return self._follow(record, path, f"retreat from {segment.name}")

    def _back_off(
        self, record: PlanRecord, instance: Instance, trajectory: ResolvedTrajectory, waypoint: ResolvedWaypoint
    ) -> None:
        """Go back along the turn by the angle of the release that follows it in the template."""
        following = trajectory.waypoints[trajectory.waypoints.index(waypoint) + 1 :]
        release = next((abs(w.to) for w in following if w.approach == "along" and not isinstance(w.to, str)), 0.0)
        segment, rows, command = record.plan.segments[record.reached], self._rows(record), self._command()
        path = retrace.way(segment.times, segment.positions, segment.velocities, command[rows], back=True)
        joint = instance.resolve().joints[waypoint.joint]
        angles: list[float] = []
        for row in path:
            position = command.copy()
            position[rows] = row
            tip = instance.point_in_template(self.services.tip(position, record.plan.arm))
            angles.append(angle_about(joint, waypoint.position, tip, near=angles[-1] if angles else 0.0))
        beyond = np.abs(np.array(angles) - angles[0]) >= release
        last = int(beyond.argmax()) if beyond.any() else len(path) - 1
        self._follow(record, path[: last + 1], f"back off from {segment.name}")

    def _straight_out(
        self, record: PlanRecord, instance: Instance, trajectory: ResolvedTrajectory, waypoint: ResolvedWaypoint
    ) -> None:
        """Draw the tool back in a straight line, as far as the template's waypoints lie apart along its direction."""
        depths = [float(w.position @ waypoint.axis) for w in trajectory.waypoints if w.approach != "free"]
        distance = float(waypoint.position @ waypoint.axis) - min(depths)
        arm = self.services.description.arms[record.plan.arm]
        position, orientation = self.services.tip_pose(self._command(), record.plan.arm)
        out = position - distance * (instance.rotation @ waypoint.axis)
        goal = Pose(position=tuple(out.tolist()), orientation=tuple(orientation.tolist()))
        self._run(
            CartesianImpedance(frame=arm.tip, joints=list(arm.joints), goal_in_world=goal, duration=_OUT_S),
            "draw the tool out",
        )

    def _follow(self, record: PlanRecord, path: Array, what: str) -> bool:
        limit = self.services.description.velocity_limit[self._rows(record)]
        trajectory = retrace.timed(record.plan.joints, path, limit)
        if trajectory is None:
            return False
        self._run(trajectory, what)
        return True

    def _run(self, motion: Motion, what: str) -> None:
        self._moving = True
        try:
            self.context.motion.run(motion, (), self.cancelled, what=what)
        except MotionFailed as failed:
            raise ActivityFailed(failed.reason, f"the tool may still be engaged: {failed}") from failed

    def cancel(self) -> None:
        super().cancel()
        self.context.motion.interrupt()
