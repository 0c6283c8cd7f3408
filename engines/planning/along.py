"""A frame that goes with a joint of an object as though it held it: a valve turned in the hand, a door opened, a drawer pulled.

"It was also possible to input a trajectory of end-effector goals [...] the operator could request a valve turning plan by simply
rotating a valve affordance with a grasped hand attached" (Fallon et al. 2015, §4.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines.planning.collision.obstacles import placement_of
from engines.planning.goals import AXES, feature_of, message_of
from engines.planning.ik.constraints import Constraint, Direction, Pose, Position
from engines.planning.ik.mechanism import Mechanism
from handrail.messages import Along

Array = NDArray[np.float64]

_ANGLE, _LENGTH = np.deg2rad(4.0), 0.01
"""rad, m of the joint between neighbouring goals"""


@dataclass(frozen=True)
class Follow:
    """What `Along` asks for, in a world of instances."""

    asked: Along
    instance: Instance
    frame: str

    @classmethod
    def of(cls, asked: Along, instances: Mapping[str, Instance], tip: str, mechanism: Mechanism) -> Follow:
        """Raises ValueError naming field, value and what was expected."""
        if asked.instance not in instances:
            known = ", ".join(instances) or "none: place one first"
            raise ValueError(f"along.instance: got {asked.instance!r}; expected one of {known}")
        instance, joints = instances[asked.instance], instances[asked.instance].resolve().joints
        if asked.joint not in joints:
            raise ValueError(
                f"along.joint: got {asked.joint!r}; expected one of {', '.join(joints) or 'none: it has no joint'}"
            )
        joint = joints[asked.joint]
        if not math.isfinite(asked.by) or asked.by == 0.0:
            raise ValueError(f"along.by: got {asked.by}; expected a finite number other than 0")
        if not joint.lower <= joint.position + asked.by <= joint.upper:
            low, high = joint.lower - joint.position, joint.upper - joint.position
            raise ValueError(
                f"along.by: got {asked.by:g}; expected {low:.4g} to {high:.4g}, which {asked.joint} can move by"
            )
        frame = asked.frame or tip
        if not frame:
            raise ValueError(
                "along.frame: got none; expected a frame's name, since no arm is named whose tip it could be"
            )
        try:
            mechanism.frame_id(frame)
        except ValueError as problem:
            raise ValueError(f"along.frame: {str(problem).removeprefix('frame: ')}") from None
        return cls(asked, instance, frame)

    def _joint(self, by: float) -> pin.SE3:
        """The joint's frame in the world when it has moved by so much."""
        joint = self.asked.joint
        position = self.instance.resolve().joints[joint].position + by
        moved = replace(self.instance, joint_state={**self.instance.joint_state, joint: position})
        return placement_of(moved.pose_in_world) * feature_of(moved, joint)

    def goals(self, start: pin.SE3) -> Iterator[tuple[float, list[Constraint]]]:
        """(share of the way, constraints) close together, of a frame that is at `start` in the world now."""
        slides = self.instance.resolve().joints[self.asked.joint].kind == "prismatic"
        count = max(2, math.ceil(abs(self.asked.by) / (_LENGTH if slides else _ANGLE)))
        held = self._joint(0.0).actInv(start)
        for share in (np.arange(count) + 1) / count:
            yield float(share), self._constraints(self._joint(float(share) * self.asked.by) * held)

    def _constraints(self, target: pin.SE3) -> list[Constraint]:
        name = f"along {self.asked.joint} ({self.frame})"
        if not self.asked.about:
            return [Pose(frame=self.frame, target=message_of(target), name=name)]
        axis = AXES[self.asked.about]
        x, y, z = (target.rotation @ np.array(axis)).tolist()
        return [
            Position.at(self.frame, target.translation.tolist(), name=name),
            Direction(frame=self.frame, axis=axis, direction=(x, y, z), name=name),
        ]

    def missed(self, start: pin.SE3, here: pin.SE3) -> float:
        """m that a frame's place is off the way that its joint leads it on, whatever the joint's position."""
        joint = self._joint(0.0)
        before, now = joint.actInv(start.translation), joint.actInv(here.translation)
        if self.instance.resolve().joints[self.asked.joint].kind == "prismatic":
            return float(np.linalg.norm((now - before)[1:]))
        return math.hypot(math.hypot(*before[1:]) - math.hypot(*now[1:]), before[0] - now[0])


def touching(mechanism: Mechanism, link: str, instance: str) -> list[tuple[str, str]]:
    """Pairs of names, as `World` allows them: a tool's link, and what it carries, and everything of an instance."""
    model, tool = mechanism.model, mechanism.frame_id(link)
    names = set()
    for body in mechanism.geometry.geometryObjects:
        frame = body.parentFrame
        while frame:
            if frame == tool:
                names.add(model.frames[body.parentFrame].name)
                break
            frame = model.frames[frame].parentFrame
    return [(name, f"* of {instance}") for name in sorted(names)]
