"""Template instances: placed, edited by several operators at once, held while one drags them, undone, told."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, Pose, Vector, travels

By = Annotated[str, Meta(max_length=128)]
"""whose key a call came with; the link writes it. Empty: it came from the robot itself, not through the link"""
Quaternion = tuple[float, float, float, float]


class Provenance(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """Where an instance comes from, and who had it last. Operators are named as their keys are; times are UTC, s since 1970."""

    placed_by: str = ""
    placed_at: float = 0.0
    """0: not known"""
    source: str = ""
    """what it was made from: empty, placed by hand; else as who placed it said, such as `copy of wheel_1`"""
    edited_by: str = ""
    """who changed pose, parameters or joints last; empty: nobody since it was placed"""
    edited_at: float = 0.0


class Attachment(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """What an instance goes along with: a link of the robot, or another instance."""

    link: str = ""
    """a frame of the robot's model; its pose is that of the measured joints"""
    instance: str = ""
    """one of both is empty"""
    pose: Pose
    """of the instance, in the frame of that link or instance"""


@travels(priority=2, reliable=False, superseded_by=("name",), remote=True)
class InstanceState(Message):
    """A template placed in the world, as it stands now. Told at most 30 times a second of one instance, the latest value."""

    name: str
    template: str
    """library name"""
    template_hash: str
    version: int
    """goes up with every edit of pose, parameters or, by an operator, joints; plans made from an older one are stale"""
    pose_in_world: Pose
    parameters: dict[str, float]
    joint_state: dict[str, float]
    """joint → rad (prismatic: m), as believed from the tool's motion, which is no edit, or as an operator set it"""
    removed: bool = False
    held_by: str = ""
    """the operator who is dragging it: nobody else may move or remove it. Empty: nobody"""
    provenance: Provenance = Provenance()
    attachment: Attachment | None = None
    """what it goes along with: None, it stands in the world. A robot that carries it makes no new version of it"""


@travels(priority=1, remote=True)
class PlaceInstance(Message):
    """Put a template into the world."""

    name: Name
    template: Name
    pose_in_world: Pose
    parameters: dict[str, float] = {}
    source: Annotated[str, Meta(max_length=128)] = ""
    """see Provenance"""
    by: By = ""


@travels(priority=1, remote=True)
class MoveInstance(Message):
    """Give an instance a new pose; plans made from it become stale. Refused while somebody else holds it."""

    name: Name
    pose_in_world: Pose
    by: By = ""


@travels(priority=1, remote=True)
class SetParameters(Message):
    """Change an instance's parameters; plans made from it become stale."""

    name: Name
    parameters: dict[str, float]
    by: By = ""


@travels(priority=1, remote=True)
class EditInstance(Message):
    """Change some fields of an instance and leave the others as they are, whatever somebody else makes of them meanwhile.

    Of a field that two operators change, the value that comes last holds, and both are told: one by the answer, the other by
    InstanceState. Plans made from the instance become stale. Refused while somebody else holds it and this would move it.
    """

    name: Name
    position: Vector | None = None
    """m, in the world"""
    orientation: Quaternion | None = None
    """unit quaternion (x, y, z, w), in the world"""
    parameters: dict[str, float] = {}
    joints: dict[str, float] = {}
    """joint → rad (prismatic: m), where the operator sees it"""
    base: int | None = None
    """the version that was edited: the answer names what others have changed since and this replaces"""
    by: By = ""


@travels(priority=1, remote=True)
class AttachInstance(Message):
    """Have an instance go along with a link of the robot, as once it is grasped, or with another instance; with neither, have it
    stand in the world. It stays where it is now. Refused while somebody else holds it, and where it would go along with itself.
    """

    name: Name
    link: Annotated[str, Meta(max_length=128)] = ""
    instance: Annotated[str, Meta(max_length=128)] = ""
    by: By = ""


@travels(priority=1, remote=True)
class UndoEdit(Message):
    """Take back the last thing that this operator did to any instance; all of a drag under a hold is one.

    A field that somebody else has changed since stays as it is; the answer says which. Refused when there is nothing.
    """

    by: By = ""


@travels(priority=1, remote=True)
class RedoEdit(Message):
    """Do again what this operator took back last, where nobody has changed it since. Refused when there is nothing."""

    by: By = ""


class InstanceEdit(Message):
    """Answer to EditInstance, AttachInstance, UndoEdit and RedoEdit.

    Fields: position, orientation, attachment, parameters.NAME, joints.NAME.
    """

    name: str
    instance: InstanceState | None
    """as it now stands, all operators' edits merged; None: it is not there"""
    fields: list[str] = []
    """that have another value now; `instance`: it was placed again, or taken away"""
    overwrote: dict[str, str] = {}
    """field → the operator whose newer value than that of `base` was replaced"""
    left: dict[str, str] = {}
    """field → why it was not taken back, in words"""


@travels(priority=1, remote=True)
class HoldInstance(Message):
    """Take hold of an instance, to drag it: until it is released, nobody else may move or remove it.

    The hold ends by itself 2 s after its holder's last call about the instance. Refused while somebody else holds it.
    """

    name: Name
    by: By = ""


@travels(priority=1, remote=True)
class ReleaseInstance(Message):
    """Let go of an instance. Nothing happens when this operator does not hold it (any more)."""

    name: Name
    by: By = ""


@travels(priority=1)
class SetJoint(Message):
    """Note where an instance's joint is now believed to be. From one engine to the one that owns the instances; no edit."""

    name: Name
    joint: Name
    position: float
    """rad; m for a prismatic joint"""


@travels(priority=1, remote=True)
class RemoveInstance(Message):
    """Take an instance away. Refused while somebody else holds it, or another instance is attached to it."""

    name: Name
    by: By = ""


@travels(priority=1, remote=True)
class GetInstances(Message):
    """All instances."""


@travels(priority=1, remote=True)
class SaveTemplate(Message):
    """Save an instance as a template in the engine's workspace: its parameters' values are the defaults.

    Refused where there is a template of that name, or the engine has no workspace.
    """

    instance: Name
    name: Name
    """what to call the template"""


class SavedTemplate(Message):
    """Answer to SaveTemplate."""

    name: str
    file: str
    """path on the engine's computer"""
    hash: str


@travels(priority=2, remote=True)
class GetTemplate(Message):
    """A template's file as the robot has it, with the meshes that it names: for who draws instances of it on another machine."""

    template: Name


class TemplateSource(Message):
    """Answer to GetTemplate."""

    template: str
    hash: str
    """of the file's content, and of its meshes'"""
    text: str
    meshes: dict[str, bytes] = {}
    """path beside the file → content"""


class Instances(Message):
    """Answer to GetInstances."""

    instances: list[InstanceState]
