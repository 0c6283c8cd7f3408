"""The operator's edits of instances on their way: shown at once, sent as the latest value at most 30 times a second.

Only the fields that were edited are sent: what another operator makes of the others stays. What a finger is on is held at the
engine, so nobody else moves it, and all of a drag is one step back. Undo and redo are the engine's: it knows what others have
changed since.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from handrail.messages import (
    AttachInstance,
    EditInstance,
    HoldInstance,
    InstanceState,
    Message,
    PlaceInstance,
    Pose,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    UndoEdit,
    Vector,
)
from handrail.messages.instances import Quaternion

RATE = 30.0  # Hz, of one instance's edits
_RENEWED = 0.7  # s: a hold ends 2 s after it was renewed last
_Key = tuple[str, str]
_STEP: _Key = ("", "step")
_NEVER = float("-inf")
_OF_ONE = (EditInstance, AttachInstance, PlaceInstance, RemoveInstance, HoldInstance, ReleaseInstance)


class Edits:
    """What was edited here and is not yet known to the robot, and what can be taken back."""

    def __init__(self, known: Callable[[str], InstanceState | None]):
        """`known`: an instance as the robot told it last."""
        self._known = known
        self._waiting: dict[_Key, Message] = {}
        self._under_way: dict[_Key, Message] = {}
        self._sent_at: dict[_Key, float] = {}
        self._held: dict[str, float] = {}
        """instance that a finger is on → when its hold was asked for last, s"""
        self._barred: set[str] = set()
        """those that a finger is on and somebody else holds"""
        self._steps: list[Message] = []
        """undo and redo, in order"""
        self.can_undo, self.can_redo = True, False
        """whether there may be something to take back (the engine knows), and whether something was taken back here"""

    # --------------------------------------------------------------------------------------------------------- shown

    def shown(self, state: InstanceState) -> InstanceState:
        """An instance as it stands once what is on its way has arrived."""
        for calls in (self._under_way, self._waiting):
            edit = calls.get((state.name, "EditInstance"))
            if isinstance(edit, EditInstance):
                pose = state.pose_in_world
                pose = Pose(position=edit.position or pose.position, orientation=edit.orientation or pose.orientation)
                state = msgspec.structs.replace(
                    state,
                    pose_in_world=pose,
                    parameters={**state.parameters, **edit.parameters},
                    joint_state={**state.joint_state, **edit.joints},
                )
        return state

    @property
    def waiting(self) -> bool:
        """Whether something is still to be sent."""
        return bool(self._waiting or self._steps or self._held)

    def held(self, name: str) -> bool:
        """Whether it is this operator who holds an instance: a finger is on it here, or has just left it."""
        release = (name, "ReleaseInstance")
        return name in self._held or release in self._waiting or release in self._under_way

    # ---------------------------------------------------------------------------------------------------------- edits

    def drag(self, name: str, *, position: Vector | None = None, orientation: Quaternion | None = None) -> None:
        """An instance is being dragged or turned: the latest place counts, and all of a drag is one step back.

        `position` in m, `orientation` (x, y, z, w), in the world.
        """
        if self._hold(name) and name not in self._barred:
            self._edit(EditInstance(name=name, position=position, orientation=orientation))

    def drop(self, name: str) -> None:
        """A finger is lifted from an instance: it stays where it last was, and others may have it."""
        self._barred.discard(name)
        if self._held.pop(name, _NEVER) > _NEVER:
            self._waiting.pop((name, "HoldInstance"), None)
            self._wait(ReleaseInstance(name=name))

    def move(self, name: str, *, position: Vector | None = None, orientation: Quaternion | None = None) -> None:
        """To a place that was typed in."""
        if (known := self._known(name)) is not None:
            self._edit(EditInstance(name=name, position=position, orientation=orientation, base=known.version))

    def set_joints(self, name: str, joints: dict[str, float]) -> None:
        """Say where an instance's joints are, rad or m, as the operator sees them."""
        if (known := self._known(name)) is not None:
            self._edit(EditInstance(name=name, joints=joints, base=known.version))

    def attach(self, name: str, *, link: str = "", instance: str = "") -> None:
        """Have an instance go along with a link or another instance; with neither, have it stand in the world."""
        if self._known(name) is not None:
            self._wait(AttachInstance(name=name, link=link, instance=instance))

    def turn(self, name: str, parameter: str, value: float) -> None:
        """A parameter is being changed: the latest value counts, and all of it until `drop` is one step back.

        Of what somebody else holds too: that only keeps others from moving it.
        """
        if self._hold(name):
            self._edit(EditInstance(name=name, parameters={parameter: value}))

    def place(self, name: str, template: str, pose: Pose, parameters: dict[str, float] | None = None) -> None:
        """Put a template into the world."""
        self._wait(PlaceInstance(name=name, template=template, pose_in_world=pose, parameters=parameters or {}))

    def remove(self, name: str) -> None:
        """Take an instance away."""
        known = self._known(name)
        if known is None:
            return
        for calls in (self._waiting, self._under_way):
            calls.pop((name, "EditInstance"), None)
        self._wait(RemoveInstance(name=name))

    # ----------------------------------------------------------------------------------------------------------- undo

    def undo(self) -> None:
        """Take the last edit back, once all that was done before has arrived."""
        self._steps.append(UndoEdit())

    def redo(self) -> None:
        """Do again what was taken back last."""
        self._steps.append(RedoEdit())

    # -------------------------------------------------------------------------------------------------------- the line

    def want(self, now: float) -> list[Message]:
        """What to send: of each kind and instance the latest, one at a time, no sooner than 1/RATE s after the one before.

        Nothing about an instance leaves before its hold is there, its release last, undo and redo when all else has arrived.
        """
        for name, asked in self._held.items():
            if now - asked >= _RENEWED and (name, "HoldInstance") not in self._under_way:
                self._held[name] = now
                self._waiting[(name, "HoldInstance")] = HoldInstance(name=name)
        ready = [
            key
            for key in self._waiting
            if key not in self._under_way
            and now - self._sent_at.get(key, _NEVER) >= 1 / RATE
            and not self._comes_later(*key)
        ]
        if self._steps and not self._waiting and not self._under_way:
            self._waiting[_STEP] = self._steps.pop(0)
            ready.append(_STEP)
        for key in ready:
            self._under_way[key], self._sent_at[key] = self._waiting.pop(key), now
        return [self._under_way[key] for key in ready]

    def _comes_later(self, name: str, kind: str) -> bool:
        if kind == "HoldInstance":
            return (name, "ReleaseInstance") in self._under_way
        if kind == "ReleaseInstance":
            others = {key for key in (*self._waiting, *self._under_way) if key[0] == name}
            return bool(others - {(name, kind)})
        return (name, "HoldInstance") in self._under_way or (name, "HoldInstance") in self._waiting

    def answered(self, call: Message) -> None:
        """A call was carried out."""
        if self._landed(call):
            if isinstance(call, UndoEdit):
                self.can_redo = True
            elif isinstance(call, RedoEdit):
                self.can_undo = True
            elif not isinstance(call, HoldInstance | ReleaseInstance):
                self.can_undo, self.can_redo = True, False

    def refused(self, call: Message) -> None:
        """A call was not carried out: nothing that came after it on the way is."""
        if not self._landed(call):
            return
        if isinstance(call, UndoEdit):
            self.can_undo, self._steps = False, []
        elif isinstance(call, RedoEdit):
            self.can_redo, self._steps = False, []
        elif isinstance(call, HoldInstance):
            if self._held.pop(call.name, None) is not None:
                self._barred.add(call.name)
            self._waiting.pop((call.name, "HoldInstance"), None)
            edit = self._waiting.pop((call.name, "EditInstance"), None)
            if isinstance(edit, EditInstance) and (edit.parameters or edit.joints):
                self._wait(msgspec.structs.replace(edit, position=None, orientation=None))
        elif (key := _key(call)) is not None:
            self._waiting.pop(key, None)

    def _landed(self, call: Message) -> bool:
        """Whether it was this one that was under way."""
        key = _key(call)
        if key is None or self._under_way.get(key) is not call:
            return False
        del self._under_way[key]
        return True

    def clear(self) -> None:
        """The robot is gone: nothing is on its way any more."""
        self._waiting.clear()
        self._under_way.clear()
        self._held.clear()
        self._barred.clear()
        self._steps.clear()

    def _hold(self, name: str) -> bool:
        """A finger is on an instance. False: it is not there."""
        if self._known(name) is None:
            return False
        if name not in self._barred:
            self._held.setdefault(name, _NEVER)  # asked for with what is sent next
        return True

    def _edit(self, edit: EditInstance) -> None:
        """Together with what of the same instance still waits: the later value of each field."""
        before = self._waiting.get((edit.name, "EditInstance"))
        if isinstance(before, EditInstance):
            edit = msgspec.structs.replace(
                edit,
                position=edit.position or before.position,
                orientation=edit.orientation or before.orientation,
                parameters={**before.parameters, **edit.parameters},
                joints={**before.joints, **edit.joints},
            )
        self._wait(edit)

    def _wait(self, call: Message) -> None:
        key = _key(call)
        assert key is not None
        self._waiting[key] = call


def _key(call: Message) -> _Key | None:
    if isinstance(call, UndoEdit | RedoEdit):
        return _STEP
    if isinstance(call, _OF_ONE):
        return call.name, type(call).__name__
    return None
