"""What a client can do with templates in the world: place, edit with others, hold while dragging, undo (docs/templates.md)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from handrail.messages import (
    AttachInstance,
    EditInstance,
    GetInstances,
    HoldInstance,
    InstanceEdit,
    InstanceState,
    MoveInstance,
    PlaceInstance,
    Pose,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    SavedTemplate,
    SaveTemplate,
    SetParameters,
    UndoEdit,
)


class InstanceCalls:
    """Part of `handrail.client.Client`. Who edits is known by the key that the client shows."""

    if TYPE_CHECKING:  # the client has it

        def call(self, message: Any, timeout_s: float | None = None) -> Any: ...

    def place_instance(
        self, name: str, template: str, pose_in_world: Pose, parameters: Mapping[str, float] | None = None, *,
        source: str = "",
    ) -> InstanceState:  # fmt: skip
        """Put the library's `template` into the world under a name of its own. `source`: what it was made from, for people."""
        call = PlaceInstance(
            name=name, template=template, pose_in_world=pose_in_world, parameters=dict(parameters or {}), source=source
        )
        return self.call(call)

    def move_instance(self, name: str, pose_in_world: Pose) -> InstanceState:
        """Give an instance a new pose; plans made from it become stale. Refused while somebody else holds it."""
        return self.call(MoveInstance(name=name, pose_in_world=pose_in_world))

    def set_parameters(self, name: str, parameters: Mapping[str, float]) -> InstanceState:
        """Change an instance's parameters; plans made from it become stale."""
        return self.call(SetParameters(name=name, parameters=dict(parameters)))

    def edit_instance(
        self, name: str, *, position: tuple[float, float, float] | None = None,
        orientation: tuple[float, float, float, float] | None = None, parameters: Mapping[str, float] | None = None,
        joints: Mapping[str, float] | None = None, base: int | None = None,
    ) -> InstanceEdit:  # fmt: skip
        """Change only the fields given: position in m and orientation (x, y, z, w) in the world, parameters, joints in rad or m.

        What others change meanwhile stays. `base`: the version that was looked at; the answer's `overwrote` names whose newer
        values were replaced. Plans made from the instance become stale. Refused where it would move what somebody else holds.
        """
        call = EditInstance(
            name=name, position=position, orientation=orientation, parameters=dict(parameters or {}),
            joints=dict(joints or {}), base=base,
        )  # fmt: skip
        return self.call(call)

    def attach_instance(self, name: str, *, link: str = "", instance: str = "") -> InstanceEdit:
        """Have an instance go along with a link of the robot, or with another instance; with neither, have it stand in the world.

        It stays where it is now. What the robot carries goes along with its measured joints, is no obstacle to it, and gets no new
        version by it. Refused where somebody else holds it, and where it would go along with itself.
        """
        return self.call(AttachInstance(name=name, link=link, instance=instance))

    def save_template(self, instance: str, name: str) -> SavedTemplate:
        """Save an instance as a template in the engine's workspace: its parameters' values are the defaults.

        Refused where there is a template of that name, or the engine has no workspace.
        """
        return self.call(SaveTemplate(instance=instance, name=name))

    def undo_instances(self) -> InstanceEdit:
        """Take back the last thing that this operator did to any instance; all of a drag under a hold is one.

        The answer's `left` names the fields that somebody else has changed since: they stay. Refused when there is nothing.
        """
        return self.call(UndoEdit())

    def redo_instances(self) -> InstanceEdit:
        """Do again what this operator took back last. Refused when there is nothing."""
        return self.call(RedoEdit())

    def hold_instance(self, name: str) -> InstanceState:
        """Take hold of an instance, to drag it: nobody else may move or remove it until it is released.

        Each call about the instance renews the hold; it ends 2 s after the last. Refused while somebody else holds it.
        """
        return self.call(HoldInstance(name=name))

    def release_instance(self, name: str) -> InstanceState:
        """Let go of an instance."""
        return self.call(ReleaseInstance(name=name))

    def remove_instance(self, name: str) -> None:
        """Take an instance away. Refused while somebody else holds it."""
        self.call(RemoveInstance(name=name))

    def instances(self) -> list[InstanceState]:
        """All instances."""
        return self.call(GetInstances()).instances
