"""Who may say what over the link: the gate writes on a call whose key it came with, and what that key may do.

What comes from the robot's own machine says nothing of a key, and may speak for anybody.
"""

from __future__ import annotations

from handrail import messages as m
from handrail.topics import refuse

_STEERING = ("operator", "developer")
"""roles of people"""


def speaks_for(by: str, owner: str) -> bool:
    """Whether whoever has the key of `by` may call himself `owner`: by its name, or that and more behind a slash."""
    return not by or owner == by or owner.startswith(f"{by}/")


def owner_of(owner: str, by: str) -> str:
    """Who commands, of a call that came with the key of `by`. Raises RefusedError where he calls himself somebody else."""
    if speaks_for(by, owner or by):
        return owner or by
    raise refuse(f"the link knows you as {by}", "owner", owner, f"{by}, or {by}/ and more")


def check_steering(by: str, action: str, owner: str) -> None:
    """Raise RefusedError where who ends, pauses or steers an action of `owner` has the key of somebody else."""
    if not speaks_for(by, owner):
        raise refuse(f"the action is {owner}'s, and the link knows you as {by}", "id", action, f"an action of {by}")


def check_speed(call: m.SetSpeed, present: float, owner: str) -> None:
    """Raise RefusedError unless the speed may be set: by people, by whose action it is, and slower by everybody.

    `present`: share that it is now; `owner`: of the action, "" where all are meant.
    """
    if not call.by or call.role in _STEERING or call.share <= present or (owner and speaks_for(call.by, owner)):
        return
    raise refuse(
        f"going faster is for operators, and for whose action it is: {call.by} has the role {call.role or 'none'}",
        "share",
        call.share,
        f"at most {present:g}",
    )
