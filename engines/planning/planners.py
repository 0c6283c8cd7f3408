"""The planners of one robot, as the engine asks them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines.planning.collision.obstacles import Obstacle
from engines.planning.plan import Plan
from engines.planning.strokes.behaviour import Choice
from engines.planning.strokes.manipulation import ManipulationPlanner
from handrail.messages import Base, PlanMotion, PointCloud
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics

if TYPE_CHECKING:
    import pinocchio as pin

    from engines.planning.collision.seen import Seen
    from engines.planning.motion_planner import MotionPlanner

Array = NDArray[np.float64]


class Planners:
    """Strokes at templates' instances, and motions to goals."""

    def __init__(self, description: RobotDescription):
        self._description = description
        self._kinematics = Kinematics(description)
        self._strokes = ManipulationPlanner(description, self._kinematics)
        self._motions: dict[bool, MotionPlanner] = {}
        self._making = threading.Lock()

    def plan(
        self, instance: Instance, trajectory: str, arm: str, position: Array, *, arc: float | None = None,
        entry_shift: float = 0.0, others: Sequence[Instance] = (), seen: Sequence[Obstacle] = (),
        relax: Sequence[str] = (), base: Base | None = None,
        cancelled: Callable[[], bool] | None = None, progress: Callable[[str], None] | None = None,
    ) -> Plan:  # fmt: skip
        """A stroke; see ManipulationPlanner. `base` of a robot where it is not fixed: it stays there, and where it stands on its
        feet its centre of mass stays over them, else Infeasible says by how much not.
        """
        from engines.planning.footing import base_of, seen_from

        there, standing = base_of(base)
        plan = self._strokes.plan(
            seen_from(there, instance), trajectory, arm, position, arc=arc, entry_shift=entry_shift, seen=seen, relax=relax,
            others=[seen_from(there, other) for other in others], cancelled=cancelled, progress=progress,
        )  # fmt: skip
        if standing:
            self._planner(standing=True).check_stand(plan, position)
        return plan

    def rank(
        self, instance: Instance, position: Array, *, trajectories: Sequence[str] = (), arms: Sequence[str] = (),
        others: Sequence[Instance] = (), base: Base | None = None, cancelled: Callable[[], bool] | None = None,
    ) -> list[Choice]:  # fmt: skip
        """Choices for strokes; see ManipulationPlanner. `base` as for `plan`, but balance is for the plan to tell."""
        from engines.planning.footing import base_of, seen_from

        there, _ = base_of(base)
        return self._strokes.rank(
            seen_from(there, instance), position, trajectories=trajectories, arms=arms,
            others=[seen_from(there, other) for other in others], cancelled=cancelled,
        )  # fmt: skip

    @property
    def motions(self) -> MotionPlanner:
        """Of a robot whose base is held."""
        return self._planner(standing=False)

    def of(self, base: Base | None) -> tuple[MotionPlanner, pin.SE3]:
        """Who plans for a robot whose base is there (None: fixed), and where that is. Raises ValueError as `base_of`."""
        from engines.planning.footing import base_of

        there, standing = base_of(base)
        return self._planner(standing=standing), there

    def _planner(self, *, standing: bool) -> MotionPlanner:
        """Made when it is asked for first: many programs never do, and it has a model and geometry of its own."""
        from engines.planning.motion_planner import MotionPlanner

        with self._making:
            if standing not in self._motions:
                self._motions[standing] = MotionPlanner(
                    self._description, self._kinematics, self._strokes.limits, standing=standing
                )
            return self._motions[standing]

    def motion(
        self, call: PlanMotion, instances: Sequence[Instance], position: Array, *, seeds: Sequence[Array] = (),
        seen: Seen | None = None, base: Base | None = None, cancelled: Callable[[], bool] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Plan:  # fmt: skip
        """What a call asks for, from where all joints are, `position` (n,) rad. See MotionPlanner.

        `base`: of a robot where it is not fixed.
        """
        planner, there = self.of(base)
        question = replace(
            planner.read(call, instances, position, there), seeds=seeds, seen=seen.obstacles if seen else ()
        )
        return planner.plan(question, position, cancelled=cancelled, progress=progress)

    def see(self, clouds: Sequence[PointCloud], time_ns: int, position: Array, instances: Sequence[Instance]) -> Seen:
        """See MotionPlanner."""
        if self._description.base == "free":
            raise ValueError(
                "seen: got true; expected false, since where the base was when a cloud was taken is not known"
            )
        return self.motions.see(clouds, time_ns, position, instances)
