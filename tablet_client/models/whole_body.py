"""What moves along with a hand or the centre of mass that is dragged, and what holds meanwhile: for the ghost, and for the plan.

A plan is asked for what the ghost shows: the same joints move, and the same things are kept. On its feet a robot whose legs move
keeps all soles where they are, its pelvis upright and its centre of mass over them: the planner does so by itself
(docs/planning.md, On its feet), and the ghost does here.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from affordance_templates.placement import to_message
from handrail.messages import CentreOfMassGoal, FrameGoal, GazeGoal, PlanMotion
from handrail.messages.goals import Goal
from tablet_client.models.limbs import Solution
from tablet_client.models.posture import AtPose, Bounds, Chain, LooksAt, MassAt, Wish, missed, seen, solve
from tablet_client.models.view import Array

KEPT = ("torso", "legs", "hands", "gaze", "steady")
"""choices: the torso helps, the legs help; the other hands stay, a camera looks at the target, the tool stays turned as it is"""
_FREE = (None, None, None)
_HAND, _GAZE, _STEADY = 0.02, 0.05, 0.1  # rad
_OVER_FEET = 0.02  # m across: the planner itself keeps it where the soles' middle is


@dataclass(frozen=True)
class Camera:
    """Its link, and what it looks along in that link's frame."""

    name: str
    link: str
    axis: tuple[float, float, float]


@dataclass(frozen=True)
class Target:
    """What is dragged, and where to."""

    pose: Array
    """(4, 4), world; of the centre of mass only the place counts"""
    arm: str
    """whose tool tip it is; empty: the centre of mass"""
    turn: str = "all"
    """of a tool `AtPose.turn`; of the centre of mass `all`, or `none`: not how high"""


@dataclass(frozen=True)
class _Held:
    """Something that is to hold beside the target."""

    name: str
    wish: Wish
    room: tuple[float, float]
    """m, rad that it may be off"""
    goal: Goal | None = None
    """what a plan is asked for; None: the planner keeps it by itself"""
    at_end: bool = True
    on_the_way: bool = False


class WholeBody:
    """One robot, where it stands."""

    def __init__(
        self, chain: Chain, tips: Mapping[str, str], arms: Mapping[str, Sequence[str]], lower: Array, upper: Array, *,
        feet: Sequence[str] = (), cameras: Sequence[Camera] = (),
    ):  # fmt: skip
        """`tips` arm → link, `arms` arm → joints, `lower`, `upper` (n,) in the chain's order, `feet` links of the soles."""
        self._chain, self._tips, self._lower, self._upper = chain, dict(tips), lower, upper
        self._arms = {arm: tuple(joints) for arm, joints in arms.items() if arm in tips}
        self._feet = tuple(foot for foot in feet if foot in chain.frames)
        self._legs = frozenset(joint for foot in self._feet for joint in chain.leading(foot))
        of_arms = frozenset(joint for joints in arms.values() for joint in joints)
        self._camera: Camera | None = None
        self._neck: frozenset[str] = frozenset()
        for camera in cameras:
            neck = frozenset(chain.leading(camera.link)) - of_arms if camera.link in chain.frames else frozenset()
            if neck and self._camera is None:
                self._camera, self._neck = camera, neck
        self._command, self._base, self._on_feet = np.zeros(0), np.eye(4), False

    def stands(self, command: Array, base: Array, on_feet: bool) -> None:
        """Where it is commanded to be (n,), where its base is in the world (4, 4), and whether it stands on its feet."""
        self._command, self._base, self._on_feet = command, base, on_feet and bool(self._feet)

    @property
    def on_feet(self) -> bool:
        return self._on_feet

    @property
    def centre_of_mass(self) -> Array:
        """(4, 4), world: a frame there, turned as the world is."""
        pose = np.eye(4)
        middle = self._chain.centre_of_mass(self._chain.poses(self._command))
        pose[:3, 3] = self._base[:3, :3] @ middle + self._base[:3, 3]
        return pose

    # ------------------------------------------------------------------------------------------------------- choices

    def offered(self, arm: str, on: Collection[str]) -> list[str]:
        """Which of KEPT can be chosen for an arm (empty: the centre of mass), while those in `on` are."""
        found = []
        if arm and set(self._arms[arm]) - self._own(arm):
            found.append("torso")
        if arm and self._on_feet:
            found.append("legs")
        others = any(other != arm for other in self._tips)
        if others and (not arm or any(name in on for name in found)):
            found.append("hands")
        if arm and self._camera is not None:
            found.append("gaze")
        return [*found, "steady"] if arm else found

    def moving(self, arm: str, on: Collection[str]) -> tuple[str, ...]:
        """The joints that may move, in the chain's order."""
        on = set(on) & set(self.offered(arm, on))
        found = set(self._own(arm)) if arm else {joint for joints in self._arms.values() for joint in joints}
        if "torso" in on:
            found |= set(self._arms[arm])
        if "legs" in on or (not arm and self._on_feet):
            found |= self._legs
        if "hands" in on:
            found |= {joint for other in self._arms for joint in self._own(other)}
        if "gaze" in on:
            found |= self._neck
        return tuple(joint for joint in self._chain.joints if joint in found)

    def _own(self, arm: str) -> frozenset[str]:
        """The joints of an arm that carry no other one."""
        others = {joint for other, joints in self._arms.items() if other != arm for joint in joints}
        return frozenset(self._arms[arm]) - others

    # ------------------------------------------------------------------------------------------------ ghost and plan

    def show(self, target: Target, on: Collection[str], near: Array) -> Solution:
        """The posture near `near` (n,) that brings it there, while what was chosen holds."""
        joints = self.moving(target.arm, on)
        rows = np.array([self._chain.joints.index(joint) for joint in joints], int)
        bounds, root = Bounds(rows, self._lower[rows], self._upper[rows]), self._root(joints)
        wish, held = self._wish(target, root), self._held(target, on, joints)
        found = solve(self._chain, bounds, [wish, *(each.wish for each in held)], near, root=root)
        lost = ""
        for each in held:
            off, turned = missed(self._chain, each.wish, found, root=root)
            if off > each.room[0] or turned > each.room[1]:
                lost = lost or each.name
        return Solution(found, *missed(self._chain, wish, found, root=root), lost)

    def plan(self, target: Target, on: Collection[str], *, seen: bool, relax: bool) -> PlanMotion:
        """What to ask for it."""
        joints = self.moving(target.arm, on)
        held = [each for each in self._held(target, on, joints) if each.goal is not None]
        goal: Goal
        if target.arm:
            goal = FrameGoal(
                pose=to_message(target.pose),
                angle=math.pi if target.turn == "none" else 0.0,
                about="" if target.turn in ("all", "none") else "z",
            )
            gives = ["goals[0].angle", "goals[0].position"]
        else:
            x, y, z = (float(value) for value in target.pose[:3, 3])
            across = _OVER_FEET if self._on_feet else 0.0
            goal = CentreOfMassGoal(
                position=(x, y, z), across=across, height=None if target.turn == "none" and not self._on_feet else 0.0
            )
            gives = ["goals[0]"]
        return PlanMotion(
            goals=[goal, *(each.goal for each in held if each.at_end and each.goal is not None)],
            keep=[each.goal for each in held if each.on_the_way and each.goal is not None],
            arm=target.arm,
            joints=list(joints),
            seen=seen,
            relax=gives if relax else [],
            label="By hand",
        )

    def _root(self, joints: Collection[str]) -> str:
        """The link that stands still where these joints move; empty: the base."""
        return self._feet[0] if self._on_feet and not self._legs.isdisjoint(joints) else ""

    def _seen_from(self, root: str) -> Array:
        """(4, 4): the base as it is now, seen from what stands still."""
        return np.asarray(seen(self._chain, self._command[None], root)[0, 0])

    def _wish(self, target: Target, root: str) -> Wish:
        there = self._seen_from(root) @ np.linalg.inv(self._base) @ target.pose
        if target.arm:
            return AtPose(self._tips[target.arm], there, target.turn)
        return MassAt(there[:3, 3], (0, 1) if target.turn == "none" and not self._on_feet else (0, 1, 2))

    def _held(self, target: Target, on: Collection[str], joints: Collection[str]) -> list[_Held]:
        on, root, found = set(on) & set(self.offered(target.arm, on)), self._root(joints), list[_Held]()
        poses = seen(self._chain, self._command[None], root)[0]

        def now(link: str) -> Array:
            frame = self._chain.frames[link]
            return np.asarray(poses[frame.body] @ frame.pose_in_body)

        to_world = self._base @ np.linalg.inv(self._seen_from(root))
        if root:
            for foot in self._feet[1:]:
                found.append(_Held("feet", AtPose(foot, now(foot)), (1e-3, 5e-3)))
            found.append(_Held("feet", AtPose(self._chain.bodies[0], poses[0], place=False), (0.0, 5e-3)))
            if target.arm:
                found.append(_Held("feet", MassAt(self._chain.centre_of_mass(poses), (0, 1)), (3e-3, 0.0)))
        if "hands" in on:
            for arm, link in self._tips.items():
                if arm != target.arm:
                    goal = FrameGoal(frame=link, pose=to_message(to_world @ now(link)), angle=_HAND)
                    found.append(_Held("hands", AtPose(link, now(link)), (5e-4, _HAND), goal, on_the_way=True))
        if "gaze" in on and self._camera is not None:
            camera, (x, y, z) = self._camera, (float(value) for value in target.pose[:3, 3])
            there = np.linalg.inv(to_world) @ target.pose
            look = LooksAt(camera.link, np.array(camera.axis), there[:3, 3])
            found.append(_Held("gaze", look, (0.0, _GAZE), GazeGoal(frame=camera.name, target=(x, y, z), cone=_GAZE)))
        if "steady" in on:
            link = self._tips[target.arm]
            goal = FrameGoal(frame=link, pose=to_message(to_world @ now(link)), below=_FREE, above=_FREE, angle=_STEADY)
            wish = AtPose(link, now(link), place=False)
            found.append(_Held("steady", wish, (0.0, _STEADY), goal, at_end=False, on_the_way=True))
        return found
