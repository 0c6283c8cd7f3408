"""Rules about joints: pure functions of what was commanded, what was measured and what the drives say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.exchange import Rule
from daemon.safety.bounds import DIVERGED, STALE
from daemon.safety.stop_socket import StopRequest
from hal.drives.rows import joint_state
from hal.joint import JointState
from handrail.compiled import compiled

Array = NDArray[np.float64]


class Followed(NamedTuple):
    """How well some joints follow their commands, as far as is known."""

    farthest: int
    """row of the joint that is farthest from its command"""
    off: float
    """rad"""
    oldest: int
    """row of the joint that has not been measured for longest"""
    age: int
    """cycles"""


class Trip(NamedTuple):
    """A rule that says no."""

    rule: Rule
    joint: int
    value: float
    limit: float


def followed(joints: NDArray[np.int64], commanded: Array, state: JointState) -> Followed:
    """Of `joints` (rows, one or more): who is farthest from its command, who was measured longest ago. `commanded`: (n,) rad."""
    return Followed(*_followed(joints, commanded, state.memory))


def unsafe(seen: Followed) -> Trip | None:
    """The rule by which an action on these joints must end in this cycle; None: it may go on."""
    if seen.age > STALE:
        return Trip(Rule.STALE, seen.oldest, float(seen.age), float(STALE))
    if not seen.off <= DIVERGED:
        return Trip(Rule.DIVERGED, seen.farthest, seen.off, DIVERGED)
    return None


def latched(held: str | None, asked: StopRequest) -> str | None:
    """Why the operator stop holds the robot after one more request, None: it does not. The first reason stays until a clear."""
    if not asked.stop:
        return None
    return asked.reason if held is None else held


def overrun(in_a_row: int, most: int, enabled: bool) -> StopRequest | None:
    """The operator stop that the loop itself asks for: it missed so many periods in a row; `most`: allowed, 0: any number."""
    if not enabled or not 0 < most <= in_a_row:
        return None
    return StopRequest(True, f"the loop missed {in_a_row} periods in a row; control.stop_after_misses is {most}")


def stranger(spoken: Array, expected: NDArray[np.int64], isolated: NDArray[np.bool_]) -> Trip | None:
    """The rule by which all drives stop when one of them says another protocol version than is expected.

    `spoken` (n,), NaN: it has not said; `expected` (n,), 0: its family has none; `isolated` (n,): these are stopped already.
    """
    strange = (expected > 0) & ~isolated & ~np.isnan(spoken) & (spoken != expected)
    if not strange.any():
        return None
    joint = int(np.argmax(strange))
    return Trip(Rule.PROTOCOL, joint, float(spoken[joint]), float(expected[joint]))


def expired(expires_ns: int, time_ns: int) -> Trip | None:
    """The rule by which a command that says until when it may come (robot's clock; 0: for ever) comes too late."""
    if not expires_ns or time_ns <= expires_ns:
        return None
    return Trip(Rule.EXPIRED, -1, (time_ns - expires_ns) * 1e-9, 0.0)


def isolated_with(lost: NDArray[np.bool_], limb: NDArray[np.int64], isolated: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) joints of all limbs that must be out of the robot: those in which a drive is `lost`, and those that are out already.

    `limb`: (n,) each joint's.
    """
    return np.isin(limb, limb[lost]) | isolated


@compiled
def _followed(joints, commanded, memory):  # type: ignore[no-untyped-def]
    table, times, _, _ = joint_state(memory, commanded.shape[0])
    farthest, most, oldest, age = joints[0], -1.0, joints[0], np.int64(-1)
    for j in joints:
        off = abs(table[0, j] - commanded[j])
        if not (np.isnan(most) or off <= most):  # NaN, too, which stays
            farthest, most = j, off
        if times[0, j] > age:
            oldest, age = j, times[0, j]
    return farthest, most, oldest, age
