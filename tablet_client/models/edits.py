"""The operator's edits of instances on their way: shown at once, sent as the latest value at most 30 times a second, undone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from handrail.messages import InstanceState, Message, MoveInstance, PlaceInstance, Pose, RemoveInstance, SetParameters

RATE = 30.0  # Hz, of one instance's edits
_KEPT = 100
_Key = tuple[str, str]


@dataclass(frozen=True)
class Step:
    """One edit, both ways."""

    back: Message
    again: Message


class Edits:
    """What was edited here and is not yet known to the robot, and what can be taken back."""

    def __init__(self, known: Callable[[str], InstanceState | None]):
        """`known`: an instance as the robot told it last."""
        self._known = known
        self._waiting: dict[_Key, Message] = {}
        self._under_way: dict[_Key, Message] = {}
        self._sent_at: dict[_Key, float] = {}
        self._dragged: dict[str, Pose] = {}
        """instance → where it stood when its drag began"""
        self._turned: dict[_Key, float] = {}
        """instance, parameter → its value when its slider was touched"""
        self._done: list[Step] = []
        self._undone: list[Step] = []

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
        return bool(self._waiting)

    # ---------------------------------------------------------------------------------------------------------- edits

    def drag(self, name: str, pose: Pose) -> None:
        """An instance is being dragged: the latest place counts, and all of a drag is one step back."""
        if (known := self._current(name)) is not None:
            self._dragged.setdefault(name, known.pose_in_world)
            self._wait(MoveInstance(name=name, pose_in_world=pose))

    def drop(self, name: str) -> None:
        """A drag has ended where it last was."""
        before, now = self._dragged.pop(name, None), self._current(name)
        if before is not None and now is not None and before != now.pose_in_world:
            self._remember(
                MoveInstance(name=name, pose_in_world=before), MoveInstance(name=name, pose_in_world=now.pose_in_world)
            )

    def move(self, name: str, pose: Pose) -> None:
        """To a place that was typed in."""
        self.drag(name, pose)
        self.drop(name)

    def turn(self, name: str, parameter: str, value: float, before: float) -> None:
        """A parameter is being changed: the latest value counts. `before`: what it has."""
        self._turned.setdefault((name, parameter), before)
        other = self._waiting.get((name, "SetParameters"))
        given = other.parameters if isinstance(other, SetParameters) else {}
        self._wait(SetParameters(name=name, parameters={**given, parameter: value}))

    def let_go(self, name: str, parameter: str) -> None:
        """A parameter has the value that it shall keep."""
        before, now = self._turned.pop((name, parameter), None), self._current(name)
        if before is not None and now is not None and now.parameters.get(parameter) != before:
            self._remember(
                SetParameters(name=name, parameters={parameter: before}),
                SetParameters(name=name, parameters={parameter: now.parameters[parameter]}),
            )

    def place(self, name: str, template: str, pose: Pose, parameters: dict[str, float] | None = None) -> None:
        """Put a template into the world."""
        call = PlaceInstance(name=name, template=template, pose_in_world=pose, parameters=parameters or {})
        self._wait(call)
        self._remember(RemoveInstance(name=name), call)

    def remove(self, name: str) -> None:
        """Take an instance away."""
        known = self._known(name)
        if known is None:
            return
        for calls in (self._waiting, self._under_way):
            for kind in ("MoveInstance", "SetParameters"):
                calls.pop((name, kind), None)
        call = RemoveInstance(name=name)
        self._wait(call)
        self._remember(
            PlaceInstance(
                name=name, template=known.template, pose_in_world=known.pose_in_world, parameters=known.parameters
            ),
            call,
        )

    # ----------------------------------------------------------------------------------------------------------- undo

    @property
    def can_undo(self) -> bool:
        """Whether there is something to take back."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether something was taken back."""
        return bool(self._undone)

    def undo(self) -> None:
        """Take the last edit back."""
        if self._done:
            step = self._done.pop()
            self._undone.append(step)
            self._wait(step.back)

    def redo(self) -> None:
        """Do again what was taken back last."""
        if self._undone:
            step = self._undone.pop()
            self._done.append(step)
            self._wait(step.again)

    # -------------------------------------------------------------------------------------------------------- the line

    def want(self, now: float) -> list[Message]:
        """What to send: of each kind and instance the latest, one at a time, no sooner than 1/RATE s after the one before."""
        ready = [
            key
            for key in self._waiting
            if key not in self._under_way and now - self._sent_at.get(key, float("-inf")) >= 1 / RATE
        ]
        for key in ready:
            self._under_way[key], self._sent_at[key] = self._waiting.pop(key), now
        return [self._under_way[key] for key in ready]

    def answered(self, call: Message) -> None:
        """A call has come back, whatever became of it."""
        key = _key(call)
        if key is not None and self._under_way.get(key) is call:
            del self._under_way[key]

    def refused(self, call: Message) -> None:
        """A call was not carried out: nothing that came after it on the way is, and it can't be taken back."""
        key = _key(call)
        if key is None:
            return
        self.answered(call)
        self._waiting.pop(key, None)
        self._done = [step for step in self._done if step.again != call]
        self._undone = [step for step in self._undone if step.back != call]

    def clear(self) -> None:
        """The robot is gone: nothing is on its way any more."""
        self._waiting.clear()
        self._under_way.clear()
        self._dragged.clear()
        self._turned.clear()

    def _current(self, name: str) -> InstanceState | None:
        known = self._known(name)
        return None if known is None else self.shown(known)

    def _wait(self, call: Message) -> None:
        key = _key(call)
        assert key is not None
        self._waiting[key] = call

    def _remember(self, back: Message, again: Message) -> None:
        self._done.append(Step(back, again))
        del self._done[:-_KEPT]
        self._undone.clear()


def _key(call: Message) -> _Key | None:
    if isinstance(call, MoveInstance | SetParameters | PlaceInstance | RemoveInstance):
        return call.name, type(call).__name__
    return None
