"""A robot that stands on its feet: they are held where they are, and its centre of mass stays over them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines.planning.collision.obstacles import placement_of
from engines.planning.goals import message_of
from engines.planning.ik.constraints import WORLD, Balance, CentreOfMass, Constraint, Orientation, Pose
from engines.planning.ik.mechanism import Mechanism
from handrail.messages import Base
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

COMPOUND = "follow"
"""compound task (docs/wbc.md) that runs plans which move legs"""
MARGIN = 0.02
"""m that the centre of mass stays within the soles' hull: whole-body control keeps the pressure's centre 1 cm within, and sways"""
_MIDDLE = 0.003
"""m about the soles' middle where the centre of mass stays while legs move: there the compound task keeps it"""


def base_of(base: Base | None) -> tuple[pin.SE3, bool]:
    """Where a robot's base is in the world, upright, as whole-body control takes it; and whether it stands on its feet.

    Raises ValueError where nobody can say how it is carried.
    """
    if base is None:  # fixed, or of a robot on paper
        return pin.SE3.Identity(), False
    if base.source not in ("feet", "still"):
        why = base.problem or "no foot holds, and it does not hang still"
        raise ValueError(f"base: got {base.source} ({why}); expected a robot that stands on its feet, or hangs still")
    lifted = [foot.name for foot in base.feet if not foot.holds]
    if base.source == "feet" and (lifted or not base.feet):
        raise ValueError(f"base: got no hold of foot {', '.join(lifted)}; expected a robot that stands on all its feet")
    x, y, z, w = base.pose_in_world.orientation
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return pin.SE3(pin.utils.rotate("z", heading), np.array(base.pose_in_world.position)), base.source == "feet"


def seen_from(root: pin.SE3, instance: Instance) -> Instance:
    """An instance of the world, in a frame of the world."""
    if root.isIdentity(0.0):
        return instance
    return replace(instance, pose_in_world=message_of(root.inverse() * placement_of(instance.pose_in_world)))


class Footing:
    """The feet of one robot, whose mechanism is seen from the first of their soles."""

    def __init__(self, mechanism: Mechanism, kinematics: Kinematics, base_frame: str):
        model, self._feet = kinematics.model, kinematics.description.feet
        carrying = {
            j for foot in self._feet for j in model.supports[model.frames[kinematics.frame_id(foot.link)].parentJoint]
        }
        self.legs = frozenset(model.names[j] for j in carrying if j)
        """joints between base and soles: where one of them moves the base moves"""
        self._base_frame = base_frame
        self._mechanism, self._data = mechanism, mechanism.model.createData()
        held = mechanism.model.inertias[0]
        self._rest = held.mass * held.lever
        self._whole, self._moving = (
            held.mass + pin.computeTotalMass(mechanism.model),
            pin.computeTotalMass(mechanism.model),
        )

    def constraints(self, start: Array, moving: Sequence[str]) -> list[Constraint]:
        """What holds from `start` (nq,) on while these joints move."""
        mechanism = self._mechanism
        pin.framesForwardKinematics(mechanism.model, self._data, start)
        soles = [pin.SE3(self._data.oMf[mechanism.frame_id(foot.link)]) for foot in self._feet]
        corners = []
        for foot, sole in zip(self._feet, soles, strict=True):
            length, width = foot.size
            corners += [sole.act(np.array([x * length / 2, y * width / 2, 0.0])) for x in (-1, 1) for y in (-1, 1)]
        points = tuple(tuple(self._without_held(corner).tolist()) for corner in corners)
        kept: list[Constraint] = [Balance(contacts={WORLD: points}, margin=MARGIN, name="balance on the feet")]  # type: ignore[dict-item]
        if not self.legs.isdisjoint(moving):
            kept += [
                Pose(frame=foot.link, target=message_of(sole), name=f"{foot.name} foot is held")
                for foot, sole in zip(self._feet[1:], soles[1:], strict=True)
            ]
            middle = self._without_held(np.mean([sole.translation for sole in soles], axis=0))[:2]
            off = pin.centerOfMass(mechanism.model, self._data, start)[:2] - middle
            lower, upper = middle + np.minimum(off, -_MIDDLE), middle + np.maximum(off, _MIDDLE)
            box = ((*lower.tolist(), -math.inf), (*upper.tolist(), math.inf))
            pelvis = message_of(self._data.oMf[mechanism.frame_id(self._base_frame)]).orientation
            kept.append(Orientation(frame=self._base_frame, target=pelvis, name="pelvis is upright"))
            kept.append(CentreOfMass(lower=box[0], upper=box[1], name="centre of mass over the feet"))
        return kept

    def _without_held(self, point: Array) -> Array:
        """Where the centre of all that moves is when the robot's is at `point` (3,): what is held has its share, and pinocchio
        leaves it out."""
        return np.asarray((self._whole * point - self._rest) / self._moving)
