"""Plans motions to goals: a posture, a reach, a look, any set of constraints; through key frames, with constraints kept on the way.

The posture planner and the reach of the manipulation planner of Fallon et al. 2015 (An Architecture for Online Affordance-based
Perception and Whole-body Planning, §4.2), and its key frames (§5.2.2). Where a motion has only an end, the IK engine finds postures
for it, the nearest first, and the way there is the straight one in joint space if it is clear, else one that sampling finds. Where
something holds on the way, the whole way is one optimisation over a spline's knots. What comes out is timed, and verified before
it is returned.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines.planning.along import Follow, touching
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.collision.seen import Eyes, Seen
from engines.planning.collision.world import World
from engines.planning.footing import Footing, seen_from
from engines.planning.goals import GoalReader, described
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.solver import Solver
from engines.planning.ik.trajectory import TrajectorySolver
from engines.planning.motion import Motion
from engines.planning.motion_search import MotionSearch
from engines.planning.plan import Infeasible, Plan
from engines.planning.relaxing import prioritised, told
from engines.planning.scene import Scene
from engines.planning.timing.path_torque import TORQUE_SHARE, Dynamics, PathTorque
from engines.planning.timing.standing_torque import StandingDynamics
from engines.planning.timing.timing import Limits
from engines.planning.verifier import Verifier
from engines.planning.waiting import never, quiet
from handrail.messages import PlanMotion, PointCloud
from handrail.robot.description import Foot, RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.robot.rooting import rebuilt

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_SCENES = 4
"""that are kept with what measures in them: two arms' and both's, and another clearance"""


class MotionPlanner:
    """Plans for one robot, with its base where it is. One plan at a time."""

    def __init__(
        self, description: RobotDescription, kinematics: Kinematics, limits: Limits, *, standing: bool = False
    ):
        """`limits` (n,) of all joints that a plan keeps; `standing`: on its feet, which are held; else its base is."""
        self._description, self._limits = description, limits
        self._kinematics = Kinematics(kinematics.description)
        self.mechanism = Mechanism.of(self._kinematics)
        self.base_frame = next(frame.name for frame in self.mechanism.model.frames if frame.type == pin.BODY)
        self._footing: Footing | None = None
        if standing:
            seen_from = description.feet[0].link
            self.mechanism = Mechanism(*rebuilt(self.mechanism.model, self.mechanism.geometry, seen_from))
            self._footing = Footing(self.mechanism, self._kinematics, self.base_frame)
        rows = dict(zip(self.mechanism.joints, self.mechanism.q_rows.tolist(), strict=True))
        self._rows: Integers = np.array([rows[joint] for joint in description.joints], np.int64)
        self.dynamics: Dynamics = self._kinematics
        if standing:
            self.dynamics = StandingDynamics(description, self.mechanism.model, self._rows)
        self.solver = Solver(self.mechanism)
        self.trajectories = TrajectorySolver(self.solver)
        self._scenes: dict[tuple[object, ...], Scene] = {}
        self._lock = threading.Lock()

    # ----------------------------------------------------------------------------------------------------------- questions

    def read(
        self, call: PlanMotion, instances: Sequence[Instance], position: Array | None = None, base: pin.SE3 | None = None
    ) -> Motion:  # fmt: skip
        """What a call asks for, in a world of instances. Raises ValueError naming field, value and what was expected.

        `position` (n,) rad, of a robot that stands on its feet; `base`: in the world, None: at its origin.
        """
        description, root = self._description, self._root_in_world(position, base)
        instances = [seen_from(root, each) for each in instances]
        if call.arm and call.arm not in description.arms:
            raise ValueError(f"arm: got {call.arm!r}; expected one of {', '.join(description.arms)}")
        only = next(iter(description.arms)) if len(description.arms) == 1 else ""
        arm = call.arm or only
        if not arm and not call.joints:
            raise ValueError(
                f"arm: got none, and no joints; expected one of {', '.join(description.arms)}, or `joints`"
            )
        for name in call.ignore:
            if name not in {each.name for each in instances}:
                known = ", ".join(each.name for each in instances) or "none: there is nothing to ignore"
                raise ValueError(f"ignore: got {name!r}; expected one of {known}")
        for field_name, value in {"clearance": call.clearance, "duration": call.duration}.items():
            if not np.isfinite(value):
                raise ValueError(f"{field_name}: got {value}; expected a finite number")
        if bool(call.goals) == (call.along is not None) or (call.along is not None and call.through):
            raise ValueError("goals: expected at least one, or `along` without goals and key frames")
        moving = self._moving(call.joints) if call.joints else description.arms[arm].joints
        tip = description.arms[arm].tip if arm else ""
        placed = {each.name: each for each in instances}
        reader = GoalReader(description, self.mechanism, placed, tip, moving, root.inverse())
        used = {goal.instance for goal in (*call.goals, *call.keep) if hasattr(goal, "instance")}
        used |= {goal.instance for frame in call.through for goal in frame.goals if hasattr(goal, "instance")}
        obstacles = [each for each in instances if each.name not in call.ignore]
        follow, touched = None, list[tuple[str, str]]()
        label = ", ".join(described(goal, tip) for goal in call.goals)
        if call.along is not None:
            follow = Follow.of(call.along, reader.instances, tip, self.mechanism)
            used.add(call.along.instance)
            label = f"{follow.frame} along {call.along.instance} {call.along.joint}"
            if call.along.touch and arm:
                touched = touching(self.mechanism, description.arms[arm].tool, call.along.instance)
        stands: list[Constraint] = []
        if self._footing is not None and position is not None:
            stands = self._footing.constraints(self.configuration("position", position), moving)
        return Motion(
            stands=stands,
            closed=self._footing is not None and not self._footing.legs.isdisjoint(moving),
            root_in_world=root,
            goals=prioritised(reader.constraints(call.goals, "goals"), call.relax),
            moving=moving,
            through=[reader.constraints(each.goals, f"through[{n}].goals") for n, each in enumerate(call.through)],
            keep=reader.constraints(call.keep, "keep"),
            obstacles=obstacles,
            clearance=call.clearance,
            duration=call.duration,
            along=follow,
            touching=touched,
            label=call.label or label[:120],
            arm=arm,
            made_from={each.name: each.version for each in instances if each in obstacles or each.name in used},
        )

    def _root_in_world(self, position: Array | None, base: pin.SE3 | None) -> pin.SE3:
        """What stands still: the base, or the sole that the mechanism is seen from."""
        base = pin.SE3.Identity() if base is None else base
        if self._footing is None:
            return base
        if position is None:
            raise ValueError("position: got none; expected where the joints are of a robot that stands on its feet")
        return base * self._kinematics.frame(position, self._description.feet[0].link)

    def _moving(self, names: Sequence[str]) -> tuple[str, ...]:
        wanted: set[str] = set()
        for name in names:
            group = self._description.groups.get(name, (name,))
            if unknown := [joint for joint in group if joint not in self._description.joints]:
                known = ", ".join((*self._description.groups, *self._description.joints))
                raise ValueError(f"joints: got {unknown[0]!r}; expected joints or groups: {known}")
            wanted.update(group)
        return tuple(joint for joint in self._description.joints if joint in wanted)

    # -------------------------------------------------------------------------------------------------------------- answers

    def plan(
        self, motion: Motion, position: Array, *, cancelled: Callable[[], bool] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Plan:  # fmt: skip
        """A verified plan from where all joints are commanded, `position` (n,) rad.

        :param cancelled: asked often; Cancelled is raised soon after it says True
        :param progress: told in a few words what is being done
        :raises Infeasible: there is no plan, or none was found; names the constraint, by how much it is missed, and where
        :raises Cancelled: as asked
        :raises ValueError: a question that can't be meant
        """
        start = self.configuration("position", position)
        with self._lock:
            search = MotionSearch(self, motion, start, cancelled or never, progress or quiet)
            try:
                return search.plan()
            except Infeasible:
                relaxed = search.relaxed()
                if relaxed is None:
                    raise
                looser, gave = relaxed
                plan = MotionSearch(self, looser, start, cancelled or never, progress or quiet).plan()
                return replace(plan, gave=tuple(told(gave)))

    def check_stand(self, plan: Plan, position: Array) -> None:
        """Raises Infeasible where a plan of arms alone, from all joints at `position` (n,) rad, does not keep the stand:
        balance, what the ground can bear, and every joint's torque, those of the legs among them.
        """
        if self._footing is None:
            raise ValueError("base: got one that is held; expected one that stands on its feet")
        start = self.configuration("position", position)
        stands, rows = self._footing.constraints(start, plan.joints), self._rows[self._description.index(plan.joints)]
        with self._lock:
            for segment in plan.segments:
                for q in segment.positions:
                    start[rows] = q
                    for worst in self.solver.checker.violations(stands, start)[:1]:
                        words = f"({worst.what}) is {worst.value:.3g} {worst.unit}"
                        raise Infeasible(worst.constraint, worst.by, worst.unit, segment.name, words)
            at = self.configuration("position", position)
            found = self._bearing.loads(self._of_all(plan, position), at, self._description.torque_limit, self.feet)
        if found:
            raise found[0].error()

    @cached_property
    def _bearing(self) -> Verifier:
        """Of what joints and ground bear: nothing moves in its world, so that nothing meets."""
        return Verifier(World(self.mechanism, [], self._description.allowed_collision_pairs, moving=()))

    def _of_all(self, plan: Plan, position: Array) -> Plan:
        """The same plan of all joints, those that it does not move at `position` (n,) rad."""
        columns, joints = self._description.index(plan.joints), tuple(self._description.joints)
        segments = []
        for segment in plan.segments:
            positions = np.tile(position, (len(segment.times), 1))
            velocities = np.zeros_like(positions)
            positions[:, columns], velocities[:, columns] = segment.positions, segment.velocities
            segments.append(replace(segment, positions=positions, velocities=velocities))
        start = np.array(position, dtype=float)
        start[columns] = plan.start
        return replace(plan, joints=joints, segments=tuple(segments), start=start)

    @cached_property
    def _eyes(self) -> Eyes:
        return Eyes(self.mechanism)

    def see(self, clouds: Sequence[PointCloud], time_ns: int, position: Array, instances: Sequence[Instance]) -> Seen:
        """What cameras see beside the robot, which is at `position` (n,) rad, and the instances, at that time of its clock."""
        placed = [solid for instance in instances for solid in obstacles_of(instance)]
        with self._lock:
            return self._eyes.solids(clouds, time_ns, self.configuration("position", position), placed)

    def configuration(self, name: str, position: Array) -> Array:
        """(nq,) for positions (n,) of the description's joints. Raises ValueError."""
        position = np.asarray(position, dtype=float)
        if position.shape != (len(self._rows),):
            raise ValueError(f"{name}: got shape {position.shape}; expected ({len(self._rows)},)")
        if not np.isfinite(position).all():
            row = int(np.flatnonzero(~np.isfinite(position))[0])
            joint = self._description.joints[row]
            raise ValueError(f"{name}.{joint}: got {position[row]}; expected a finite number")
        q = self.mechanism.configuration(np.zeros(len(self.mechanism.joints)))
        q[self._rows] = position
        return q

    def positions(self, q: Array) -> Array:
        """(n,) of the description's joints at q (nq,)."""
        return np.asarray(q[self._rows])

    def tip_of(self, arm: str) -> str:
        """The frame of an arm's tool tip."""
        return self._description.arms[arm].tip

    def limits_of(self, joints: tuple[str, ...], q: Array) -> Limits:
        """Those of a motion of these joints, the others where they are at q (nq,)."""
        rows, all_joints = self._description.index(joints), self._limits
        torque = PathTorque(self.dynamics, rows, q[self._rows], TORQUE_SHARE)
        jerk = None if all_joints.jerk is None else all_joints.jerk[rows]
        return Limits(all_joints.velocity[rows], all_joints.acceleration[rows], jerk, torque)

    def scene(self, motion: Motion) -> Scene:
        """The one in which a motion is planned: the same one as long as the same things stand around."""
        solids = [*(solid for instance in motion.obstacles for solid in obstacles_of(instance)), *motion.seen]
        allowed = (*self._description.allowed_collision_pairs, *motion.touching)
        key = (motion.moving, motion.clearance, allowed, tuple(map(id, solids)))  # alive: the scene's world holds them
        found = self._scenes.pop(key, None)
        if found is None:
            guard = self._description.guard
            itself = max(motion.clearance, guard.planned) if guard.self_collision else motion.clearance
            margins = Margins(itself=itself, objects=motion.clearance)
            found = Scene(World(self.mechanism, solids, allowed, moving=motion.moving), margins)
        else:
            found.forget()
            self.solver.forget(found.world)
        self._scenes[key] = found
        if len(self._scenes) > _SCENES:
            del self._scenes[next(iter(self._scenes))]
        return found

    def torque_limit(self, joints: tuple[str, ...]) -> Array:
        """(m,) N·m"""
        return np.asarray(self._description.torque_limit[self._description.index(joints)])

    @property
    def feet(self) -> tuple[Foot, ...]:
        """that it stands on, the mechanism's origin first; none: its base is held"""
        return tuple(self._description.feet) if self._footing is not None else ()
