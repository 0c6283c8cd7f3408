"""Pushing something around its hinge with what does not hold it: a tool beside a lever, on a handle, against a door.

The frame that pushes is led ahead of what it pushes, under Cartesian impedance, chord by chord of the circle about the hinge. It is
led no further ahead than the force that is allowed, and each chord ends when the frame itself has gone as far: what is stiff gets
more, what is stuck never more than that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from affordance_templates.instance import Instance
from affordance_templates.placement import Array, of_message, shortest_turn, to_message, turn_about
from affordance_templates.template import ResolvedJoint
from handrail.messages import CompliantMotion, StartBehaviour, Step, TravelEnd
from handrail.robot.description import Arm

STIFFNESS = (600.0, 20.0)
"""N/m, N·m/rad of the motion"""
_STEP, _SHARE = math.radians(15.0), 0.25
"""rad that a chord is at most, and m of it over those that the frame may be ahead: so much of the force is missing at its end"""
_PATIENCE, _LEAST_S = 3.0, 0.6
"""times as long as a chord would take unhindered; s"""
MOST = 16
"""chords of one behaviour"""


def at_stop(joint: ResolvedJoint, by: float, gone: float, share: float = 0.8) -> bool:
    """Whether what goes no further is at the joint's own end: it was to go there, and has gone `share` of the way at least.

    :param by: rad or m that it was to go, `gone`: what it has
    """
    there = joint.upper if by > 0 else joint.lower
    return abs(joint.position + by - there) <= 0.02 * abs(by) and gone * by >= share * by * by


@dataclass(frozen=True)
class Circle:
    """About a joint's axis in the world, from where a frame is."""

    centre: Array
    """(3,) m, on the axis, nearest to the frame"""
    axis: Array
    """(3,), unit"""
    start: Array
    """(4, 4): the frame in the world"""
    free: bool
    """whether the frame may be turned about its own z as it likes"""
    lag: float = 0.0
    """rad by which the frame may be turned less than what it pushes"""

    @classmethod
    def of(cls, instance: Instance, joint: str, start: Array, *, free: bool, lag: float = 0.0) -> Circle:
        """About a revolute joint of an instance, where the joint's parents stand now."""
        frame = of_message(instance.pose_in_world) @ instance.resolve().frame(joint)
        axis = frame[:3, 0]
        centre = frame[:3, 3] + axis * float(axis @ (start[:3, 3] - frame[:3, 3]))
        return cls(centre, axis, start, free, lag)

    @property
    def radius(self) -> float:
        """m"""
        return float(np.linalg.norm(self.start[:3, 3] - self.centre))

    def at(self, angle: float) -> Array:
        """(4, 4): the frame in the world when it has gone round by so many rad; it is turned by `lag` less, or not yet."""
        turn, there = turn_about(self.axis, angle), self.start.copy()
        there[:3, 3] = self.centre + turn @ (self.start[:3, 3] - self.centre)
        turn = turn_about(self.axis, math.copysign(max(abs(angle) - self.lag, 0.0), angle))
        if self.free:
            pointing = self.start[:3, 2]
            turn = shortest_turn(pointing.tolist(), turn @ pointing)
        there[:3, :3] = turn @ self.start[:3, :3]
        return there

    def ahead(self, angle: float, sign: float) -> Array:
        """(3,), unit: which way it goes there, towards larger angles where `sign` is 1."""
        way = np.cross(self.axis, turn_about(self.axis, angle) @ (self.start[:3, 3] - self.centre)) * sign
        return way / np.linalg.norm(way)

    def chords(self, by: float, force: float, speed: float, arm: Arm) -> list[Chord]:
        """All the way by so many rad.

        :param force: N at most
        :param speed: m/s of the frame
        """
        most, arc = force / STIFFNESS[0], abs(by) * self.radius
        count = max(1, math.ceil(max(abs(by) / _STEP, arc / (_SHARE * most)) - 1e-6))
        length, sign, found = arc / count, math.copysign(1.0, by), []
        for number in range(count):
            angle = by * (number + 1) / count
            goal = self.at(angle)
            goal[:3, 3] += (most - length) * self.ahead(angle, sign)
            x, y, z = self.ahead(by * (number + 0.5) / count, sign).tolist()
            motion = CompliantMotion(
                frame=arm.tip, joints=list(arm.joints), duration=max(_PATIENCE * length / speed, _LEAST_S),
                goal_in_world=to_message(goal), stiffness=STIFFNESS,
            )  # fmt: skip
            found.append(
                Chord(f"chord_{number}", motion, TravelEnd(frame=arm.tip, distance=length, axis=(x, y, z)), angle)
            )
        return found


@dataclass(frozen=True)
class Chord:
    """One chord: a motion, and how far round it ends (rad from the start of all) when it has gone far enough."""

    name: str
    motion: CompliantMotion
    end: TravelEnd
    by: float


@dataclass(frozen=True)
class Push:
    """Chords as a behaviour: the last one's travel is its end, and so is any that runs out of time."""

    chords: Sequence[Chord]
    hoped: str = "travel"

    def call(self, action: str, owner: str, robot: object) -> StartBehaviour:
        """As `engines.runs.motion.Motion` asks for it."""
        following = [*(chord.name for chord in self.chords[1:]), "end"]
        steps = [
            Step(name=chord.name, motion=chord.motion, ends=[chord.end], then={"travel": then, "done": "end"})
            for chord, then in zip(self.chords, following, strict=True)
        ]
        return StartBehaviour(id=action, owner=owner, steps=steps)

    def expected(self, step: str, outcome: str) -> bool:
        """Ends that are none of a failure."""
        return outcome in ("travel", "done")
