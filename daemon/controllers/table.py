"""The controllers that are loaded by name, and what state each is in: the loop's side, a few comparisons a cycle.

They are made beside the loop (daemon.controllers.workshop). Here they are switched on and off, several at once, in one cycle or
not at all. A controller that fails while it is active is unconfigured afterwards: configuring it makes it anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.actions.table import Refusal
from daemon.controllers.base import ChainableController, Controller, Ended
from daemon.controllers.manager import ActivationError, ChainError, ClaimError, CommandError, ControllerManager
from daemon.controllers.workshop import Done, Job, When, Workshop
from daemon.exchange import CONTROLLER_CHANGE, MAX_LOADED, Answer, ControllerState, Outcome
from hal.joint import JointCommand


@dataclass
class Slot:
    """One loaded controller."""

    state: ControllerState = ControllerState.LOADING
    """never ACTIVE: the manager knows who is"""
    name: str = ""
    controller: Controller | None = None
    onto: str = ""
    fallback: tuple[str, ...] = ()


class ControllerTable:
    """Up to MAX_LOADED controllers, each in a slot."""

    def __init__(self, manager: ControllerManager, workshop: Workshop):
        self._manager, self._workshop = manager, workshop
        self._slots: list[Slot | None] = [None] * MAX_LOADED
        self.roster = 0
        """goes up with every change but switches: number of the file (daemon.controllers.roster) that tells of it"""
        self.time_ns = self.cycle = 0
        """of the present cycle"""
        self._states = np.zeros(MAX_LOADED, np.uint8)
        self._changes = np.zeros(MAX_LOADED, CONTROLLER_CHANGE)

    def look(self) -> tuple[np.ndarray, np.ndarray]:
        """(MAX_LOADED,) uint8, ControllerState of each slot; (MAX_LOADED,) CONTROLLER_CHANGE, how it came to that."""
        states = np.array([self._state(number) for number in range(MAX_LOADED)], np.uint8)
        for number in np.flatnonzero(states != self._states).tolist():
            deactivated = self._states[number] == ControllerState.ACTIVE and states[number] == ControllerState.INACTIVE
            why = self._controller(number).ended if deactivated else Ended(Outcome.NONE)
            self._changes[number] = (int(why.outcome), why.joint, why.value, self.time_ns, self.cycle)
        self._states = states
        return states, self._changes

    # ------------------------------------------------------------------------------------------------- what is asked for

    def load(self, text: bytes) -> Refusal | None:
        """Have a controller loaded, as the LoadController `text` (JSON) says."""
        if None not in self._slots:
            return Refusal(Answer.TOO_MANY)
        number = self._slots.index(None)
        self._slots[number] = Slot()
        self._workshop.put(Job(self._changed(), number, text))
        return None

    def configure(self, mask: int, roster: int, text: bytes) -> Refusal | None:
        """Have a controller made anew that is not active, as the ConfigureController `text` (JSON) says."""
        found = self._idle(mask, roster)
        if isinstance(found, Refusal):
            return found
        slot = self._slots[found]
        assert slot is not None
        slot.state, slot.controller = ControllerState.LOADING, None
        self._workshop.put(Job(self._changed(), found, text))
        return None

    def unload(self, mask: int, roster: int) -> Refusal | None:
        """Forget a controller that is not active."""
        found = self._idle(mask, roster)
        if isinstance(found, Refusal):
            return found
        self._slots[found] = None
        self._workshop.put(Job(self._changed(), found, forget=True))
        return None

    def switch(self, come: int, go: int, roster: int, last: JointCommand) -> Refusal | None:
        """Start and end controllers (bit masks of slots) in this cycle; a refusal changes nothing."""
        if roster != self.roster:
            return Refusal(Answer.ROSTER_CHANGED)
        coming, going = _slots_in(come), _slots_in(go)
        for number in coming:
            if self._state(number) is not ControllerState.INACTIVE and number not in going:
                return Refusal(Answer.CONTROLLER_STATE, value=number)
        for number in going:
            if self._state(number) is not ControllerState.ACTIVE:
                return Refusal(Answer.CONTROLLER_STATE, value=number)
        newcomers = [self._controller(number) for number in coming]
        for number, controller in zip(coming, newcomers, strict=True):
            if not self._tie(number, controller):
                return Refusal(Answer.CHAIN_BROKEN, value=number)
        gone = [self._controller(number) for number in going]
        try:
            self._manager.switch(gone, newcomers, last)
        except ClaimError as error:
            isolated = self._manager.isolated[error.joint]
            return Refusal(Answer.ISOLATED if isolated else Answer.CLAIMED, error.joint)
        except ChainError as error:
            return Refusal(Answer.CHAIN_BROKEN, error.joint, self._number(error.controller))
        except ActivationError as error:
            return Refusal(Answer.NOT_ACTIVATED, value=self._number(error.controller))
        for controller in gone:
            controller.ended = Ended(Outcome.DONE)
        return None

    # --------------------------------------------------------------------------------------------------- what comes about

    def collect(self, time_ns: int) -> None:
        """Take what the workshop has finished; `time_ns`: of this cycle."""
        self.time_ns = time_ns
        while (done := self._workshop.finished()) is not None:
            self._take(done)

    def fail(self, controller: Controller) -> None:
        """A controller has failed: tell of it, and of one that was loaded keep nothing but its name."""
        number, name = self._number(controller), controller.name
        slot = self._slots[number] if number >= 0 else None
        if slot is not None:
            name, slot.state, slot.controller = slot.name, ControllerState.UNCONFIGURED, None
        elif isinstance(controller.error, CommandError):
            return  # its action ended, and said so
        assert controller.error is not None
        self._workshop.put(Job(self._changed(), number, failed=(name, controller.error)))

    def _take(self, done: Done) -> None:
        if done.state is ControllerState.EMPTY:
            self._slots[done.slot] = None
        else:
            self._slots[done.slot] = Slot(done.state, done.name, done.controller, done.onto, done.fallback)
        self._workshop.put(Job(self._changed(), done.slot))

    def _tie(self, number: int, controller: Controller) -> bool:
        """Resolve the names that a controller was loaded with. False where what it should command has no references."""
        slot = self._slots[number]
        assert slot is not None
        named = {other.name: other.controller for other in self._slots if other is not None}
        controller.fallbacks = tuple(found for name in slot.fallback if (found := named.get(name)) is not None)
        if slot.onto:
            onto = named.get(slot.onto)
            if not isinstance(onto, ChainableController):
                return False
            controller.onto = onto
        return True

    def _idle(self, mask: int, roster: int) -> int | Refusal:
        """The slot in a mask of one, if its controller may be made anew or forgotten."""
        if roster != self.roster:
            return Refusal(Answer.ROSTER_CHANGED)
        if len(numbers := _slots_in(mask)) != 1:
            return Refusal(Answer.MALFORMED)
        number = numbers[0]
        slot = self._slots[number]
        # What an active controller falls back to, or is chained to, stays as it is.
        needed = slot is not None and any(
            slot.controller is not None and any(slot.controller is f for f in (*active.fallbacks, active.onto))
            for active in self._manager.active
        )
        if needed or self._state(number) not in (ControllerState.UNCONFIGURED, ControllerState.INACTIVE):
            return Refusal(Answer.CONTROLLER_STATE, value=number)
        return number

    def _changed(self) -> When:
        self.roster += 1
        return When(self.roster, self.time_ns, self.cycle)

    def _state(self, number: int) -> ControllerState:
        slot = self._slots[number]
        if slot is None:
            return ControllerState.EMPTY
        if slot.controller is not None and any(slot.controller is active for active in self._manager.active):
            return ControllerState.ACTIVE
        return slot.state

    def _controller(self, number: int) -> Controller:
        slot = self._slots[number]
        assert slot is not None and slot.controller is not None, "its state was looked at"
        return slot.controller

    def _number(self, controller: Controller) -> int:
        for number, slot in enumerate(self._slots):
            if slot is not None and slot.controller is controller:
                return number
        return -1


def _slots_in(mask: int) -> list[int]:
    return [number for number in range(MAX_LOADED) if mask >> number & 1]
