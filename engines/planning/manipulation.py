"""Plans a visit of one arm to a template's instance: which arc and posture, which way, at what speed."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines.planning.assessment import Assessor
from engines.planning.branch import Branch, BranchSearch
from engines.planning.collision import CollisionScene, RobotBodies
from engines.planning.ik import TipSolver, starts
from engines.planning.obstacles import obstacles_of
from engines.planning.path import Leg, PathBuilder
from engines.planning.plan import Infeasible, Plan, Segment
from engines.planning.timing import Limits, parametrise
from engines.planning.visit import Visit
from handrail.messages import EndCondition, PathForce, PoseErrorEnd
from handrail.robot.description import Arm, RobotDescription
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

VELOCITY_SHARE = 0.7
"""of the velocity limits that a plan uses"""
_TORQUE_SHARE = 0.15
"""of the torque limits that acceleration may take, joint by joint at the home posture"""
_ARCS, _STARTS, _TRIES = 8, 10, 4


class ManipulationPlanner:
    """Plans for one robot. One plan at a time: pinocchio's scratch data is shared."""

    def __init__(self, description: RobotDescription, kinematics: Kinematics):
        self._description = description
        # A model of its own: plans are made in a thread beside others that use theirs.
        self._kinematics = Kinematics(kinematics.description)
        self._bodies = RobotBodies(self._kinematics)
        self._solvers = {name: TipSolver(self._kinematics, arm) for name, arm in description.arms.items()}
        home = description.home_position(next(iter(description.home)))
        inertia = np.diag(self._kinematics.mass_matrix(home))
        velocity = VELOCITY_SHARE * description.velocity_limit
        self.limits = Limits(velocity, np.minimum(2.0 * velocity, _TORQUE_SHARE * description.torque_limit / inertia))
        """of all joints, (n,)"""
        self._home = home
        self._lock = threading.Lock()

    def plan(
        self,
        instance: Instance,
        trajectory: str,
        arm: str,
        position: Array,
        *,
        arc: float | None = None,
        entry_shift: float = 0.0,
        cancelled: Callable[[], bool] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Plan:
        """One stroke from where all joints are commanded now.

        :param position: (n,) rad, all joints
        :param arc: None: choose the arc's centre and the posture branch; rad: keep this centre, and the branch near `position`
        :param entry_shift: rad, how much later on the arc to enter than would be the earliest
        :param cancelled: asked often; Cancelled is raised soon after it says True
        :param progress: told in a few words what is being done
        :raises Infeasible: there is no plan; names the constraint and by how much it is missed
        :raises Cancelled: as asked
        :raises ValueError: no such arm or trajectory, or a position of wrong shape
        """
        side = self._arm(arm)
        position = self._position(position)
        with self._lock:
            return self._plan(
                instance, trajectory, side, position, arc, entry_shift, cancelled or (lambda: False),
                progress or (lambda _: None),
            )  # fmt: skip

    def _arm(self, name: str) -> Arm:
        if name not in self._description.arms:
            raise ValueError(f"arm: got {name!r}; expected one of {', '.join(self._description.arms)}")
        return self._description.arms[name]

    def _position(self, position: Array) -> Array:
        position = np.asarray(position, dtype=float)
        n = len(self._description.joints)
        if position.shape != (n,) or not np.isfinite(position).all():
            raise ValueError(f"position: got shape {position.shape}, expected ({n},) of finite numbers")
        return position

    def _plan(
        self, instance: Instance, trajectory: str, arm: Arm, position: Array, arc: float | None, entry_shift: float,
        cancelled: Callable[[], bool], progress: Callable[[str], None],
    ) -> Plan:  # fmt: skip
        visit = Visit(instance, trajectory)
        scene = CollisionScene(self._bodies, arm, obstacles_of(instance))
        assessor = Assessor(self._kinematics, arm, scene, position)
        solver = self._solvers[arm.name]
        failure: Infeasible | None = None

        def built(posture: Array, begin: Callable[[PathBuilder], int], centre: float, entry: float) -> Plan:
            builder = PathBuilder(visit, solver, assessor, posture, cancelled)
            for waypoint in visit.trajectory.waypoints[begin(builder) :]:
                progress(f"way to {waypoint.name}")
                builder.go(waypoint, centre + visit.span / 2)
            progress("timing")
            outputs = {"entry_angle": entry, "end_angle": centre + visit.span / 2, "arc_centre": centre}
            return self._timed(builder.legs, instance, visit, arm, assessor, outputs if visit.entry else {})

        if arc is not None:
            angle = _beside(visit, solver, assessor.start, arc)
            if angle is not None:
                entry = visit.entry_angle(arc, entry_shift)

                def at_object(builder: PathBuilder) -> int:
                    builder.begin_return(angle, entry)
                    return visit.trajectory.waypoints.index(visit.standoff) + 1

                progress("return to the entry")
                try:
                    return built(assessor.start, at_object, arc, entry)
                except Infeasible as problem:
                    failure = problem  # the branch does not carry on: try to come in anew
        progress("arc and posture")
        arcs = visit.arc_centres(_ARCS) if arc is None else np.array([arc])
        home = self._home[assessor.rows]
        near = [home, assessor.start] if arc is None else [assessor.start, home]
        tries = BranchSearch(visit, solver, assessor, cancelled).ranked(
            arcs, starts(near, solver.lower, solver.upper, _STARTS)
        )
        for branch in tries[:_TRIES]:
            if branch.failure is not None:
                failure = failure or branch.failure
                continue
            try:
                entry = visit.entry_angle(branch.arc, entry_shift)

                def from_afar(builder: PathBuilder, branch: Branch = branch, entry: float = entry) -> int:
                    if visit.trajectory.waypoints[0].approach != "free":
                        return 0
                    builder.begin_free(branch, entry)
                    return 1

                return built(branch.posture, from_afar, branch.arc, entry)
            except Infeasible as problem:
                failure = failure or problem
        assert failure is not None  # every way out above either returned or failed
        raise failure

    def _timed(
        self, legs: list[Leg], instance: Instance, visit: Visit, arm: Arm, assessor: Assessor,
        outputs: Mapping[str, float],
    ) -> Plan:  # fmt: skip
        limits = Limits(self.limits.velocity[assessor.rows], self.limits.acceleration[assessor.rows])
        segments = []
        for leg in legs:
            knots = parametrise(leg.path, limits, leg.duration, where=leg.name)
            ends, path_force = self._conditions(leg, visit, arm)
            segments.append(Segment(leg.name, knots.times, knots.positions, knots.velocities, ends, path_force))
        return Plan(
            id=f"plan-{uuid.uuid4().hex[:12]}",
            label=f"{instance.name}: {visit.trajectory.name}",
            arm=arm.name,
            joints=arm.joints,
            segments=tuple(segments),
            made_from={instance.name: instance.version},
            start=assessor.start,
            clearance=min(leg.clearance for leg in legs),
            limit_margin=min(leg.limit_margin for leg in legs),
            outputs=outputs,
        )

    def _conditions(self, leg: Leg, visit: Visit, arm: Arm) -> tuple[tuple[EndCondition, ...], PathForce | None]:
        waypoint = leg.waypoint
        if waypoint is None:
            return (), None
        ends: tuple[EndCondition, ...] = ()
        if waypoint.guard is not None:
            axis = self._solvers[arm.name].tip(leg.path[-1])[1]
            ends = (
                PoseErrorEnd(
                    frame=arm.tip, position=waypoint.guard, axis=(float(axis[0]), float(axis[1]), float(axis[2]))
                ),
            )
        if waypoint.path_force is None:
            return ends, None
        gain, limit = waypoint.path_force
        return ends, PathForce(frame=arm.tip, gain=gain, limit=limit)


_BESIDE = 0.02
"""m: so close to the circle on which the trajectory runs the tool counts as being at the object"""


def _beside(visit: Visit, solver: TipSolver, start: Array, arc: float) -> float | None:
    """The tool's angle about the joint when it is at the standoff or deeper, on the arc's side; None when it is elsewhere."""
    if visit.joint is None:
        return None
    angle, radius, depth, tilt = visit.local(*solver.tip(start))
    _, wanted, standoff, _ = visit.local(*visit.tip(visit.standoff, arc))
    angle = arc + (angle - arc + np.pi) % (2 * np.pi) - np.pi
    on_circle = abs(radius - wanted) < _BESIDE and standoff - _BESIDE < depth < _BESIDE and tilt < 0.2
    return angle if on_circle and abs(angle - arc) < visit.span / 2 + 0.3 else None
