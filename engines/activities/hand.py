"""`do: hand`: open, close, or shape the hand of an arm, and say whether something is in it."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import Any

from engines.activities.base import Activity, ActivityFailed, Argument, Context, Kind, Services
from engines.activities.carrying import let_go
from engines.runs.motion import MotionFailed
from engines.runs.preconditions import Precondition
from handrail.messages import (
    CompliantMotion,
    EndCondition,
    GripperAtEnd,
    GripperHoldsEnd,
    GripperOrder,
    StartBehaviour,
    Step,
)
from handrail.robot.description import Arm

_PATIENCE_S = 5.0
"""of the robot's clock, within which fingers are where they are sent, or hold something"""
_NEAR = 0.03
"""share of the fingers' way at which they are there"""
_HOLDS = "gripper_holds"
OPEN = "open"
"""the hand pose that holds nothing"""


class HandOrder:
    """A behaviour of one step: a gripper goes to a position, while its arm stays where it is and gives way a little."""

    hoped = _HOLDS
    """what a rehearsal takes for the end"""

    def __init__(self, arm: Arm, gripper: str, position: float, near: float, effort: float, velocity: float):
        """`position`, `near`: rad or m of the gripper's joint, where to, and from how far it is there."""
        self._arm, self._gripper, self._position, self._near = arm, gripper, position, near
        self._effort, self._velocity = effort, velocity

    def call(self, action: str, owner: str, robot: object) -> StartBehaviour:
        """As `engines.runs.motion.Motion` asks for it."""
        arm, gripper = self._arm, self._gripper
        still = CompliantMotion(frame=arm.tip, joints=list(arm.joints), duration=_PATIENCE_S)
        order = GripperOrder(gripper=gripper, position=self._position, effort=self._effort, velocity=self._velocity)
        there = GripperAtEnd(gripper=gripper, position=self._position, tolerance=self._near)
        ends: list[EndCondition] = [there, GripperHoldsEnd(gripper=gripper)]
        then: dict[str, str] = {"gripper_at": "end", _HOLDS: "end"}
        step = Step(name="hand", motion=still, gripper=order, ends=ends, then=then)
        return StartBehaviour(id=action, owner=owner, steps=[step])

    def expected(self, step: str, outcome: str) -> bool:
        """Ends that are none of a failure."""
        return outcome in ("gripper_at", _HOLDS, "done")


def shape_hand(
    context: Context, arm: Arm, pose: Mapping[str, float], cancelled: threading.Event, *,
    effort: float = 0.0, velocity: float = 0.0,
) -> bool:  # fmt: skip
    """Bring an arm's hand into a pose; True: something keeps it from getting there.

    :param pose: joint that a gripper drives → rad or m; grippers go one after the other
    :raises ActivityFailed: `refused` for joints that are no gripper's, `slow` where it neither gets there nor holds
    """
    description = context.services.description
    grippers = {device.joint: device.name for device in description.devices if device.family == "gripper"}
    holds = False
    for joint, position in pose.items():
        if joint not in grippers:
            raise ActivityFailed(
                "refused", f"no gripper moves {joint}; expected one of {', '.join(grippers) or 'none'}"
            )
        low, high, *_ = description.device_limits[joint]
        if not low <= position <= high:
            raise ActivityFailed("refused", f"{grippers[joint]}: got {position:g}; expected {low:g} to {high:g}")
        order = HandOrder(arm, grippers[joint], position, _NEAR * (high - low), effort, velocity)
        what = f"{grippers[joint]} to {position:g}"
        try:
            ended = context.motion.run_behaviour(order, description, cancelled, what=what)
        except MotionFailed as failed:
            raise ActivityFailed(failed.reason, str(failed)) from failed
        if ended.outcome == "done":
            raise ActivityFailed("slow", f"{what}: neither there nor holding anything after {_PATIENCE_S:g} s")
        holds |= ended.outcome == _HOLDS
    return holds


def poses_of(services: Services, arm: str) -> Mapping[str, Mapping[str, float]]:
    """An arm's hand poses by name. Raises ActivityFailed where it has no hand."""
    description = services.description
    if not description.arms[arm].hand_poses:
        raise ActivityFailed(
            "no_hand", f"the {arm} arm of {description.name} has no hand (robot.yaml: arms.{arm}.hand_poses)"
        )
    return description.arms[arm].hand_poses


class HandActivity(Activity):
    """Brings the hand of an arm into one of its poses. Done with `holds`: something keeps it from getting there.

    What the hand carried stands from then on where it is, if it opens or nothing is in it.
    """

    arguments = {
        "arm": Argument(Kind.ARM),
        "pose": Argument(Kind.TEXT),
        "effort": Argument(Kind.NUMBER, required=False, default=0.0, unit="N·m or N"),
        "speed": Argument(Kind.NUMBER, required=False, default=0.0, unit="rad/s or m/s"),
    }
    outputs = frozenset({"holds"})

    def run(self) -> dict[str, Any]:
        values = self.values
        known = poses_of(self.services, values["arm"])
        if values["pose"] not in known:
            raise ActivityFailed("refused", f"pose: got {values['pose']!r}; expected one of {', '.join(known)}")
        holds = shape_hand(
            self.context, self.services.description.arms[values["arm"]], known[values["pose"]], self.cancelled,
            effort=values["effort"], velocity=values["speed"],
        )  # fmt: skip
        if not holds or values["pose"] == OPEN:
            let_go(self.services, self.services.description.arms[values["arm"]])
        return {"holds": holds}

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        known, pose = self.services.description.arms[self.values["arm"]].hand_poses, self.values["pose"]
        expected = f"one of {', '.join(known) or 'none'}"
        yield Precondition("the hand has the pose", pose in known, f"{pose!r}", expected)
        yield from super().preconditions()

    def cancel(self) -> None:
        super().cancel()
        self.context.motion.interrupt()
