"""The operator's edits of instances on their way: shown at once, sent as the latest value at most 30 times a second.

What a finger is on is held at the engine, so nobody else moves it, and all of a drag is one step back. Undo and redo are the
engine's: it knows what others have changed since.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from handrail.messages import (
    HoldInstance,
    InstanceState,
    Message,
    MoveInstance,
    PlaceInstance,
    Pose,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    SetParameters,
    UndoEdit,
)

RATE = 30.0  # Hz, of one instance's edits
_RENEWED = 0.7  # s: a hold ends 2 s after it was renewed last
_Key = tuple[str, str]
_STEP: _Key = ("", "step")
_NEVER = float("-inf")


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
            move = calls.get((state.name, "MoveInstance"))
            if isinstance(move, MoveInstance):
                state = msgspec.structs.replace(state, pose_in_world=move.pose_in_world)
            change = calls.get((state.name, "SetParameters"))
            if isinstance(change, SetParameters):
                state = msgspec.structs.replace(state, parameters={**state.parameters, **change.parameters})
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

    def drag(self, name: str, pose: Pose) -> None:
        """An instance is being dragged: the latest place counts, and all of a drag is one step back."""
        if self._hold(name):
            self._wait(MoveInstance(name=name, pose_in_world=pose))

    def drop(self, name: str) -> None:
        """A finger is lifted from an instance: it stays where it last was, and others may have it."""
        self._barred.discard(name)
        if self._held.pop(name, _NEVER) > _NEVER:
            self._waiting.pop((name, "HoldInstance"), None)
            self._wait(ReleaseInstance(name=name))

    def move(self, name: str, pose: Pose) -> None:
        """To a place that was typed in."""
        if self._known(name) is not None:
            self._wait(MoveInstance(name=name, pose_in_world=pose))

    def turn(self, name: str, parameter: str, value: float) -> None:
        """A parameter is being changed: the latest value counts, and all of it until `drop` is one step back."""
        if not self._hold(name):
            return
        other = self._waiting.get((name, "SetParameters"))
        given = other.parameters if isinstance(other, SetParameters) else {}
        self._wait(SetParameters(name=name, parameters={**given, parameter: value}))

    def place(self, name: str, template: str, pose: Pose, parameters: dict[str, float] | None = None) -> None:
        """Put a template into the world."""
        self._wait(PlaceInstance(name=name, template=template, pose_in_world=pose, parameters=parameters or {}))

    def remove(self, name: str) -> None:
        """Take an instance away."""
        known = self._known(name)
        if known is None:
            return
        for calls in (self._waiting, self._under_way):
            for kind in ("MoveInstance", "SetParameters"):
                calls.pop((name, kind), None)
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
            for kind in ("HoldInstance", "MoveInstance", "SetParameters"):
                self._waiting.pop((call.name, kind), None)
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
        """A finger is on an instance. False: it is not there, or somebody else holds it."""
        if self._known(name) is None or name in self._barred:
            return False
        self._held.setdefault(name, _NEVER)  # asked for with what is sent next
        return True

    def _wait(self, call: Message) -> None:
        key = _key(call)
        assert key is not None
        self._waiting[key] = call


def _key(call: Message) -> _Key | None:
    if isinstance(call, UndoEdit | RedoEdit):
        return _STEP
    if isinstance(call, MoveInstance | SetParameters | PlaceInstance | RemoveInstance | HoldInstance | ReleaseInstance):
        return call.name, type(call).__name__
    return None
