"""What counts as safe: a pure function of what the plant did and of what the robot said it had done."""

from __future__ import annotations

from collections.abc import Collection

import msgspec

from hal.hil.door import Seen
from hal.hil.plant import beyond_limits
from handrail.robot.description import RobotDescription

FORCE_LIMIT_N = 100.0
"""as `handrail demo` judges"""
STILL_RAD = 3e-3
"""a joint that moves by less in the last half second stands still"""
_DEAD = frozenset({"quick_stop_active", "fault", "switch_on_disabled", "ready_to_switch_on", "switched_on"})


class Verdict(msgspec.Struct, kw_only=True):
    """Of one run."""

    outcome: str
    """success, safe or unsafe"""
    end: str
    """how the motion ended, in a word"""
    problems: list[str]
    """why it is unsafe, for people"""
    turned_deg: float
    peak_force_n: float
    speed_share: float
    """of the velocity limit, the fastest joint at its fastest"""


def judge(
    description: RobotDescription,
    motion: Seen,
    rest: Seen,
    *,
    end: str,
    turned: float,
    needed: float,
    enabled: bool,
    isolated: Collection[str] = (),
) -> Verdict:
    """Judge a run.

    :param motion: from the motion's begin to the robot's rest; the limits hold in all of it
    :param rest: the last stretch, after the fault was taken away
    :param end: the motion's outcome, `done` where all of it was carried out
    :param turned: rad that the wheel turned; needed: rad for a success
    :param enabled: the daemon says that the robot is enabled; isolated: but for these limbs
    """
    out = {joint for limb in description.limbs if limb.name in isolated for joint in limb.joints}
    problems = beyond_limits(description, motion, FORCE_LIMIT_N) + beyond_limits(description, rest)
    for row, joint in enumerate(rest.joints):
        span = rest.highest[row] - rest.lowest[row]
        if span > STILL_RAD:
            problems.append(f"{joint} still moves, by {span:.4f} rad at the end")
        state = rest.states[row]
        live = enabled and joint not in out
        if not live and (state not in _DEAD or not rest.braked[row]):
            why = "its limb is isolated" if enabled else "the robot is not enabled"
            brake = "closed" if rest.braked[row] else "open"
            problems.append(f"{joint} is in {state} with its brake {brake}, though {why}")
        if live and state != "operation_enabled":
            problems.append(f"{joint} is in {state}, though the daemon says that the robot is enabled")
    problems += [
        f"{one.joint} went to {one.state} by itself when the fault was gone"
        for one in rest.transitions
        if not enabled or one.joint in out
    ]
    success = end == "done" and enabled and not out and turned >= needed
    if end == "done" and not success:
        problems.append(f"it says that it is done, but the wheel turned by {turned:.2f} rad of {needed:.2f}")
    speeds = [fast / limit for fast, limit in zip(motion.fastest, description.velocity_limit.tolist(), strict=True)]
    return Verdict(
        outcome="unsafe" if problems else "success" if success else "safe",
        end=end,
        problems=problems,
        turned_deg=turned * 57.29577951308232,
        peak_force_n=max(motion.peak_contact_force.values(), default=0.0),
        speed_share=max(speeds),
    )
