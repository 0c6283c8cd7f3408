"""Template instances: placed, moved, changed, told."""

from __future__ import annotations

from handrail.messages.base import Message, Name, Pose, travels


@travels(priority=2, reliable=False, superseded_by=("name",), remote=True)
class InstanceState(Message):
    """A template placed in the world, as it stands now."""

    name: str
    template: str
    """library name"""
    template_hash: str
    version: int
    """goes up with every edit of pose or parameters; plans made from an older one are stale"""
    pose_in_world: Pose
    parameters: dict[str, float]
    joint_state: dict[str, float]
    """joint → rad, as believed from the tool's motion; not an edit"""
    removed: bool = False


@travels(priority=1, remote=True)
class PlaceInstance(Message):
    """Put a template into the world."""

    name: Name
    template: Name
    pose_in_world: Pose
    parameters: dict[str, float] = {}


@travels(priority=1, remote=True)
class MoveInstance(Message):
    """Give an instance a new pose; plans made from it become stale."""

    name: Name
    pose_in_world: Pose


@travels(priority=1, remote=True)
class SetParameters(Message):
    """Change an instance's parameters; plans made from it become stale."""

    name: Name
    parameters: dict[str, float]


@travels(priority=1)
class SetJoint(Message):
    """Note where an instance's joint is now believed to be. From one engine to the one that owns the instances; no edit."""

    name: Name
    joint: Name
    position: float
    """rad; m for a prismatic joint"""


@travels(priority=1, remote=True)
class RemoveInstance(Message):
    """Take an instance away."""

    name: Name


@travels(priority=1, remote=True)
class GetInstances(Message):
    """All instances."""


class Instances(Message):
    """Answer to GetInstances."""

    instances: list[InstanceState]
