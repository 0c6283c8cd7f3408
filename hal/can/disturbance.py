"""Faults acting on the virtual bus (hal.can.faults says what each kind does).

What happens to a frame before it reaches its queue is decided frame by frame (hal.can.interference). What happens on the wire or to
a whole node is written into the state that hal.can.transit runs on, whenever a fault begins or ends (`apply`): bit_error, babble,
bus_off, cut. Every fault draws from random numbers of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hal.can.acting import STANDARD, Acting, Reach
from hal.can.bus_state import (
    BUS_MASK,
    CAN_ID,
    CHANCE,
    EXTENDED_ID,
    HITS,
    ID_MASK,
    LEFT,
    MOST_ERRORS,
    NEVER,
    NODE,
    ROW,
    State,
    recessive,
)
from hal.can.confinement import OFF, OUTSIDE, SEEN
from hal.can.faults import Fault
from hal.can.interference import Interference
from hal.can.queues import flush
from hal.can.transit import take_off

_MOST_REMEMBERED = 1000
"""ended faults whose hits are still reported"""


class Disturbance:
    """All faults of one hub, and the frames that they hold back."""

    def __init__(self, state: State, channels: Sequence[str], names: list[str]):
        """`names`: of the nodes by number, kept up to date by the hub; call `apply` after a change."""
        self._state, self._reach = state, Reach(channels, names)
        self._interference = Interference(self._reach)
        self._acting: dict[int, Acting] = {}
        self._ended_hits: dict[int, int] = {}
        self._next_number = 1

    def __bool__(self) -> bool:
        """True while a fault is there, waiting or acting, or a frame is held back."""
        return bool(self._acting or self._interference)

    @property
    def faults(self) -> dict[int, Fault]:
        """Number → fault that waits or acts."""
        return {number: acting.fault for number, acting in self._acting.items()}

    @property
    def hits(self) -> dict[int, int]:
        """Number → frames hit so far, of ended faults too."""
        now = {number: self._hits(acting) for number, acting in self._acting.items()}
        return self._ended_hits | now

    def check(self, fault: Fault) -> None:
        """Raises ValueError when a fault can't ever act here."""
        if fault.channel is not None and fault.channel not in self._reach.channels:
            raise ValueError(f"fault: channel {fault.channel!r}; expected one of {self._reach.channels}")
        if fault.node is None and fault.kind in ("babble", "bus_off"):
            raise ValueError(f"fault {fault.kind}: node is missing; expected a node's name")
        if fault.kind == "bit_error" and not self._free_slots():
            raise ValueError(f"fault bit_error: {MOST_ERRORS} of this kind are on the bus already")

    def add(self, fault: Fault, now: int) -> int:
        """Lay a fault on the bus at the time `now` (ns); returns its number. Raises ValueError when it can't ever act."""
        self.check(fault)
        begins = now + round(fault.after * 1e9)
        ends = NEVER if fault.duration is None else begins + round(fault.duration * 1e9)
        number, self._next_number = self._next_number, self._next_number + 1
        acting = Acting(fault, begins, ends)
        if fault.kind == "bit_error":
            acting.slot = self._free_slots()[0]
        self._acting[number] = acting
        return number

    def clear(self, number: int | None, now: int) -> int:
        """Take back one fault or all (None); returns how many. Raises ValueError when there is no such fault."""
        if number is not None and number not in self._acting:
            raise ValueError(f"fault {number}: there is none of that number; expected one of {sorted(self._acting)}")
        chosen = list(self._acting.values()) if number is None else [self._acting[number]]
        for acting in chosen:
            acting.ends = min(acting.ends, now)
        self.apply(now)
        return len(chosen)

    def next_event(self) -> int:
        """ns of the bus's clock when the next fault begins or ends, or a held frame goes on; NEVER: none."""
        events = [0 if self._is_spent(acting) else acting.due for acting in self._acting.values()]
        return min([*events, self._interference.next_due()])

    def keeps_time(self) -> npt.NDArray[np.bool_]:
        """(channels,) where a fault needs frames to take their time, since it fills the bus."""
        return np.asarray((self._state.babble[:, :, 0] >= 0).any(axis=1))

    def apply(self, now: int) -> None:
        """Begin and end faults that are due at `now`, and write what they mean for nodes and wire into the state."""
        s = self._state
        for number, acting in list(self._acting.items()):
            if self._is_spent(acting):
                acting.ends = min(acting.ends, now)
            if acting.ends <= now:
                self._end(number, acting, now)
            elif acting.begins <= now and not acting.began:
                acting.began = True
                if acting.slot >= 0:
                    self._begin_errors(acting)
        outside, held_off = np.zeros_like(s.present), np.zeros_like(s.present)
        babble = np.full(s.present.shape, -1)
        for acting in self._acting.values():
            if not acting.began:
                continue
            fault, where = acting.fault, self._reach.where(acting.fault)
            match fault.kind:
                case "cut":
                    outside |= where
                case "bus_off":
                    held_off |= where
                case "babble":
                    babble[where & s.present] = fault.can_id or 0
                case "bit_error":
                    s.error_nodes[acting.slot] = self._reach.nodes(fault)
        self._write(outside, held_off, babble, now)

    def lay(
        self, records: npt.NDArray[np.void], node: npt.NDArray[np.int64], now: int
    ) -> tuple[npt.NDArray[np.void], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """What becomes of frames (hub's channel indices) on their way to the queues: (frames, nodes, marks) to be queued.

        `records` may be changed in place.
        """
        return self._interference.lay(self._acting.values(), records, node, now)

    def due(self, now: int) -> list[tuple[int, int, npt.NDArray[np.void]]]:
        """Delayed frames whose time has come: (ns when, node, frame), first the first."""
        return self._interference.due(now)

    # ------------------------------------------------------------------------------------------------------ wire and nodes

    def _free_slots(self) -> list[int]:
        taken = {acting.slot for acting in self._acting.values()}
        return [slot for slot in range(MOST_ERRORS) if slot not in taken]

    def _is_spent(self, acting: Acting) -> bool:
        """It has hit as many frames as it was to."""
        if acting.slot >= 0:
            return acting.began and int(self._state.errors[acting.slot, LEFT]) == 0
        return acting.left == 0 and not acting.held

    def _begin_errors(self, acting: Acting) -> None:
        fault, row = acting.fault, self._state.errors[acting.slot]
        row[BUS_MASK] = sum(1 << bus for bus in np.flatnonzero(self._reach.on(fault)).tolist())
        row[CAN_ID] = -1 if fault.can_id is None else fault.can_id
        row[ID_MASK] = fault.mask
        row[EXTENDED_ID] = fault.can_id is not None and fault.can_id > STANDARD
        row[LEFT] = -1 if fault.count is None else fault.count
        row[CHANCE] = round(fault.probability * 2**53)
        row[HITS] = 0
        self._state.random[acting.slot] = acting.rng.integers(2**63)

    def _hits(self, acting: Acting) -> int:
        if not acting.began:
            return 0
        if acting.slot >= 0:
            return int(self._state.errors[acting.slot, HITS])
        if acting.fault.kind == "babble":
            return int(self._state.babble[:, :, 2][self._reach.where(acting.fault)].sum())
        return acting.hits

    def _end(self, number: int, acting: Acting, now: int) -> None:
        self._ended_hits[number] = self._hits(acting)
        for stale in list(self._ended_hits)[:-_MOST_REMEMBERED]:
            del self._ended_hits[stale]
        if acting.slot >= 0:
            self._state.errors[acting.slot] = 0
            self._state.error_nodes[acting.slot] = False
        for (_, node), record in acting.held.items():
            self._interference.hold_until(now, node, record)
        del self._acting[number]

    def _write(
        self,
        outside: npt.NDArray[np.bool_],
        held_off: npt.NDArray[np.bool_],
        babble: npt.NDArray[np.int64],
        now: int,
    ) -> None:
        s = self._state
        for bus, who in zip(*np.nonzero((outside | held_off) & s.present), strict=True):
            row = s.wire[bus, ROW]
            if row >= 0 and s.link[row, NODE] == who:
                take_off(s, bus, now)
        s.counters[:, :, OUTSIDE] = outside
        off = s.counters[:, :, OFF]
        for bus, who in zip(*np.nonzero(held_off & (off != 2)), strict=True):
            flush(s, bus, who)
        for bus, who in zip(*np.nonzero(~held_off & (off == 2)), strict=True):
            s.counters[bus, who, OFF], s.counters[bus, who, SEEN] = 1, recessive(s, bus, now)
        off[held_off] = 2
        begun = (babble >= 0) & (s.babble[:, :, 0] < 0)
        s.babble[:, :, 0] = babble
        s.babble[:, :, 1][begun] = now
        s.babble[:, :, 2][begun] = 0
