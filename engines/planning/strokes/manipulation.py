"""Plans a visit of one arm to a template's instance: which arc and posture, which way, at what speed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines import identifiers
from engines.planning.collision.bodies import CollisionScene
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import Obstacle, obstacles_of
from engines.planning.ik.constraints import Constraint, Direction, Position
from engines.planning.ik.mechanism import Mechanism
from engines.planning.measures import CLEARANCE, LIMIT_MARGIN, RESIDUAL, TILT, Measure, times_of
from engines.planning.plan import Plan, Segment
from engines.planning.strokes.assessment import Assessor
from engines.planning.strokes.behaviour import BehaviourSearch, Choice, ranked
from engines.planning.strokes.giving import Leeway, check_relax, gave, relaxed
from engines.planning.strokes.path import Leg
from engines.planning.strokes.stroke import ARCS, STARTS, Stroke
from engines.planning.strokes.tip_solver import POINTING, TipSolver, starts
from engines.planning.strokes.visit import Visit
from engines.planning.timing.timing import Limits, parametrise
from engines.planning.verifier import Verifier
from engines.planning.waiting import never, quiet
from handrail.messages import EndCondition, PathForce, PoseErrorEnd
from handrail.robot.description import Arm, RobotDescription
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

VELOCITY_SHARE = 0.7
"""of the velocity limits that a plan uses"""
RATE_SHARE = 0.5
"""of the limits of acceleration and jerk: the rest is for changes of speed in mid-motion"""
_BETWEEN = 1e-3
"""m of clearance that a path's rows keep more than what is between them"""


class ManipulationPlanner:
    """Plans for one robot. One plan at a time: pinocchio's scratch data is shared."""

    def __init__(self, description: RobotDescription, kinematics: Kinematics):
        self._description = description
        # A model of its own: plans are made in a thread beside others that use theirs.
        self._kinematics = Kinematics(kinematics.description)
        self._mechanism = Mechanism.of(self._kinematics)
        self._solvers = {name: TipSolver(self._mechanism, description, arm) for name, arm in description.arms.items()}
        home = description.home_position(next(iter(description.home)))
        velocity = VELOCITY_SHARE * description.velocity_limit
        acceleration = np.minimum(2.0 * velocity, RATE_SHARE * description.acceleration_limit)
        self.limits = Limits(velocity, acceleration, RATE_SHARE * description.jerk_limit)
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
        others: Sequence[Instance] = (),
        seen: Sequence[Obstacle] = (),
        relax: Sequence[str] = (),
        cancelled: Callable[[], bool] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Plan:
        """One stroke from where all joints are commanded now.

        :param position: (n,) rad, all joints
        :param arc: None: choose the arc's centre and the posture branch; rad: keep this centre, and the branch near `position`
        :param entry_shift: rad, how much later on the arc to enter than would be the earliest
        :param others: what else stands around; nothing may touch it
        :param seen: what cameras see; nothing may touch it, but the tool from where on it may touch the instance
        :param relax: what gives way where there is no plan, the first one first: tilt, reach; `Plan.gave` says by how much
        :param cancelled: asked often; Cancelled is raised soon after it says True
        :param progress: told in a few words what is being done
        :raises Infeasible: there is no plan; names the constraint and by how much it is missed
        :raises Cancelled: as asked
        :raises ValueError: no such arm or trajectory, or a position of wrong shape
        """
        side, position = self._arm(arm), self._position(position)
        check_relax(relax)
        with self._lock:
            visit = Visit(instance, trajectory)
            others = [other for other in others if other.name != instance.name]
            around = [solid for one in (instance, *others) for solid in obstacles_of(one)]
            scene = CollisionScene(self._mechanism, self._description, side, around, instance.name, seen)

            def within(leeway: Leeway) -> Plan:
                solver = self._solvers[arm]
                if leeway.pointing != 1.0:
                    solver = TipSolver(self._mechanism, self._description, side, pointing=leeway.pointing)
                assessor = Assessor(self._kinematics, side, scene, position, leeway)
                home = self._home[assessor.rows]
                stroke = Stroke(visit, solver, assessor, home, cancelled or never, progress or quiet)
                legs, outputs = stroke.legs(arc, entry_shift)
                plan = self._timed(legs, instance, visit, side, assessor, outputs)
                self._verify(plan, legs, scene, assessor, position, cancelled or never)
                return replace(plan, gave=gave([(leg.name, leg.reach) for leg in legs]))

            plan = relaxed(within, relax)
            return replace(plan, made_from={**plan.made_from, **{other.name: other.version for other in others}})

    def rank(
        self,
        instance: Instance,
        position: Array,
        *,
        trajectories: Sequence[str] = (),
        arms: Sequence[str] = (),
        others: Sequence[Instance] = (),
        cancelled: Callable[[], bool] | None = None,
    ) -> list[Choice]:
        """Choices for a behaviour at an instance, the best first: arms, trajectories (none: all), places around the joint.

        Cancelled and ValueError as for `plan`.
        """
        position, cancelled = self._position(position), cancelled or never
        found: list[Choice] = []
        with self._lock:
            others = [other for other in others if other.name != instance.name]
            around = [solid for one in (instance, *others) for solid in obstacles_of(one)]
            for arm in arms or self._description.arms:
                side, solver = self._arm(arm), self._solvers[arm]
                scene = CollisionScene(self._mechanism, self._description, side, around, instance.name)
                assessor = Assessor(self._kinematics, side, scene, position)
                near = [self._home[assessor.rows], assessor.start]
                postures = starts(near, solver.lower, solver.upper, STARTS)
                for trajectory in trajectories or instance.resolve().trajectories:
                    visit = Visit(instance, trajectory)
                    found += BehaviourSearch(visit, solver, assessor, cancelled).choices(
                        visit.arc_centres(ARCS), postures
                    )
        return ranked(found)

    def _verify(
        self, plan: Plan, legs: list[Leg], scene: CollisionScene, assessor: Assessor, position: Array,
        cancelled: Callable[[], bool],
    ) -> None:  # fmt: skip
        """Raises Infeasible where a look at the finished plan finds anything that it misses, Cancelled as asked."""
        limits = Limits(self.limits.velocity[assessor.rows], self.limits.acceleration[assessor.rows])
        kept = Margins(scene.margins.itself - _BETWEEN, scene.margins.objects - _BETWEEN)
        found = Verifier(scene.world, margins=kept).violations(
            plan, limits, scene.configurations(position[None])[0],
            touching={leg.name: scene.touching for leg in legs if leg.may_touch},
            torque=self._description.torque_limit[assessor.rows], cancelled=cancelled,
            constraints=list(_goals(plan, legs, assessor)),
        )  # fmt: skip
        if found:
            raise found[0].error()

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

    def _timed(
        self, legs: list[Leg], instance: Instance, visit: Visit, arm: Arm, assessor: Assessor,
        outputs: Mapping[str, float],
    ) -> Plan:  # fmt: skip
        rows, all_joints = assessor.rows, self.limits
        assert all_joints.jerk is not None
        limits = Limits(
            all_joints.velocity[rows], all_joints.acceleration[rows], all_joints.jerk[rows], assessor.torque
        )
        segments = []
        for leg in legs:
            knots = parametrise(leg.path, limits, leg.duration, where=leg.name)
            ends, path_force = self._conditions(leg, visit, arm)
            segment = Segment(leg.name, knots.times, knots.positions, knots.velocities, ends, path_force)
            segments.append(replace(segment, measures=_measures(leg, segment, assessor)))
        margins = [
            measure.values.min() for each in segments for measure in each.measures if measure.name == LIMIT_MARGIN
        ]
        return Plan(
            id=identifiers.new("plan", 12),
            label=f"{instance.name}: {visit.trajectory.name}",
            arm=arm.name,
            joints=arm.joints,
            segments=tuple(segments),
            made_from={instance.name: instance.version},
            start=assessor.start,
            clearance=min(leg.near.distance for leg in legs),
            limit_margin=float(min(margins)),
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


def _goals(plan: Plan, legs: list[Leg], assessor: Assessor) -> Iterator[Constraint]:
    """What the tool's tip keeps where each leg ends."""
    end, tip, leeway = 0.0, assessor.arm.tip, assessor.leeway
    for leg, segment in zip(legs, plan.segments, strict=True):
        end += segment.duration
        position, axis = (tuple(part.tolist()) for part in leg.goal)
        yield Position.at(tip, position, tolerance=leeway.reach.bound, name=f"tip after {leg.name}", window=(end, end))
        cone, label = leeway.tilt.bound, f"tool after {leg.name}"
        yield Direction(frame=tip, axis=POINTING, direction=axis, cone=cone, name=label, window=(end, end))


def _measures(leg: Leg, segment: Segment, assessor: Assessor) -> tuple[Measure, ...]:
    """What was checked at the path's rows, when the motion passes them, and what its knots need."""
    passed = times_of(leg.path, segment.times, segment.positions)
    met = passed[-len(leg.reach.residual) :]
    forces = np.column_stack([np.interp(segment.times, passed, column) for column in leg.forces.T])
    return (
        Measure(CLEARANCE, passed, leg.near.along, leg.near.pairs),
        Measure(RESIDUAL, met, leg.reach.residual),
        Measure(TILT, met, leg.reach.tilt),
        assessor.limit_margins(segment.times, segment.positions),
        assessor.torque_shares(segment.times, segment.positions, segment.velocities, forces),
    )
