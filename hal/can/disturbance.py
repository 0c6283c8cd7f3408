"""Faults acting on the virtual bus (hal.can.faults says what each kind does).

What happens to a frame before it reaches its queue is decided here, frame by frame (`lay`): drop, delay, duplicate, reorder,
corrupt, stuck. What happens on the wire or to a whole node is written into the state that hal.can.transit runs on, whenever a
fault begins or ends (`apply`): bit_error, babble, bus_off, cut. Every fault draws from random numbers of its own.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np
import numpy.typing as npt

from hal.can import transit
from hal.can.confinement import OFF, OUTSIDE, SEEN
from hal.can.faults import Fault
from hal.can.frames import EXTENDED, REMOTE

_ON_THE_WAY = ("drop", "delay", "duplicate", "reorder", "corrupt", "stuck")
_STANDARD = 0x7FF
_MOST_REMEMBERED = 1000
"""ended faults whose hits are still reported"""


@dataclass
class _Acting:
    """A fault on the bus."""

    fault: Fault
    begins: int
    ends: int
    """ns of the bus's clock"""
    began: bool = False
    over: bool = False
    hits: int = 0
    slot: int = -1
    """bit_error: its row of State.errors"""
    rng: np.random.Generator = field(init=False)
    frozen: dict[tuple[int, int], npt.NDArray[np.uint8]] = field(default_factory=dict)
    """stuck: (channel, identifier) → data"""
    held: dict[tuple[int, int], npt.NDArray[np.void]] = field(default_factory=dict)
    """reorder: (channel, node) → the frame that waits for the next"""

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.fault.seed)

    @property
    def due(self) -> int:
        return min(self.ends, self.ends if self.began else self.begins)

    @property
    def left(self) -> int | None:
        return None if self.fault.count is None else self.fault.count - self.hits


class Disturbance:
    """All faults of one hub, and the frames that they hold back."""

    def __init__(self, state: transit.State, channels: Sequence[str], names: list[str]):
        """`names`: of the nodes by number, kept up to date by the hub; call `apply` after a change."""
        self._state, self._channels, self._names = state, list(channels), names
        self._acting: dict[int, _Acting] = {}
        self._ended_hits: dict[int, int] = {}
        self._next_number = 1
        self._delayed: list[tuple[int, int, int, npt.NDArray[np.void]]] = []  # (when, serial, node, frame)
        self._serial = 0

    def __bool__(self) -> bool:
        """True while a fault is there, waiting or acting, or a frame is held back."""
        return bool(self._acting or self._delayed)

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
        if fault.channel is not None and fault.channel not in self._channels:
            raise ValueError(f"fault: channel {fault.channel!r}; expected one of {self._channels}")
        if fault.node is None and fault.kind in ("babble", "bus_off"):
            raise ValueError(f"fault {fault.kind}: node is missing; expected a node's name")
        if fault.kind == "bit_error" and not self._free_slots():
            raise ValueError(f"fault bit_error: {transit.MOST_ERRORS} of this kind are on the bus already")

    def add(self, fault: Fault, now: int) -> int:
        """Lay a fault on the bus at the time `now` (ns); returns its number. Raises ValueError when it can't ever act."""
        self.check(fault)
        begins = now + round(fault.after * 1e9)
        ends = transit.NEVER if fault.duration is None else begins + round(fault.duration * 1e9)
        number, self._next_number = self._next_number, self._next_number + 1
        acting = _Acting(fault, begins, ends)
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
        if self._delayed:
            events.append(self._delayed[0][0])
        return min(events, default=transit.NEVER)

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
            fault, where = acting.fault, self._where(acting.fault)
            match fault.kind:
                case "cut":
                    outside |= where
                case "bus_off":
                    held_off |= where
                case "babble":
                    babble[where & s.present] = fault.can_id or 0
                case "bit_error":
                    s.error_nodes[acting.slot] = self._nodes(fault)
        self._write(outside, held_off, babble, now)

    def lay(
        self, records: npt.NDArray[np.void], node: npt.NDArray[np.int64], now: int
    ) -> tuple[npt.NDArray[np.void], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """What becomes of frames (hub's channel indices) on their way to the queues: (frames, nodes, marks) to be queued.

        `records` may be changed in place.
        """
        marks = np.zeros(len(records), np.int64)
        back: set[int] = set()  # rows that don't go on now
        after: dict[int, list[npt.NDArray[np.void]]] = {}  # row → frames that go on behind it
        for acting in self._acting.values():
            kind = acting.fault.kind
            if not acting.began or kind not in _ON_THE_WAY:
                continue
            matching = np.flatnonzero(self._matches(acting.fault, records, node))
            if kind == "reorder":
                # Every frame of the node on the channel may be the one that the held frame waits for.
                self._reorder(acting, matching, records, node, back, after)
                continue
            for row in self._hit(acting, matching):
                match kind:
                    case "drop":
                        marks[row] |= transit.DROP
                    case "duplicate":
                        marks[row] |= transit.TWICE
                    case "delay" if row not in back:
                        self._serial += 1
                        when = now + round(acting.fault.delay * 1e9)
                        heapq.heappush(
                            self._delayed, (when, self._serial, int(node[row]), records[row : row + 1].copy())
                        )
                        back.add(row)
                    case "corrupt":
                        _flip(acting.rng, records[row : row + 1])
                    case "stuck":
                        record = records[row]
                        key = (int(record["bus"]), int(record["can_id"]) | (int(record["flags"]) & EXTENDED) << 32)
                        record["data"] = acting.frozen.setdefault(key, record["data"].copy())
        if not back and not after:
            return records, node, marks
        parts, nodes, kept = [], [], []
        for row in range(len(records)):
            if row not in back:
                parts.append(records[row : row + 1])
                nodes.append(node[row])
                kept.append(marks[row])
            for held in after.get(row, ()):
                parts.append(held)
                nodes.append(node[row])
                kept.append(0)
        return np.concatenate([records[:0], *parts]), np.array(nodes, np.int64), np.array(kept, np.int64)

    def due(self, now: int) -> list[tuple[int, int, npt.NDArray[np.void]]]:
        """Delayed frames whose time has come: (ns when, node, frame), first the first."""
        ready = []
        while self._delayed and self._delayed[0][0] <= now:
            when, _, node, record = heapq.heappop(self._delayed)
            ready.append((when, node, record))
        return ready

    # --------------------------------------------------------------------------------------------------------- who and what

    def _nodes(self, fault: Fault) -> npt.NDArray[np.bool_]:
        if fault.node is None:
            return np.ones(len(self._names), np.bool_)
        return np.array([fnmatchcase(name, fault.node) for name in self._names], np.bool_)

    def _where(self, fault: Fault) -> npt.NDArray[np.bool_]:
        """(channels, nodes) that a fault is about."""
        channels = np.array([fault.channel in (None, name) for name in self._channels], np.bool_)
        return channels[:, None] & self._nodes(fault)[None, :]

    def _matches(
        self, fault: Fault, records: npt.NDArray[np.void], node: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.bool_]:
        hit = self._where(fault)[records["bus"], node]
        if fault.can_id is not None:
            hit &= (records["can_id"] & np.uint32(fault.mask)) == (fault.can_id & fault.mask)
            hit &= ((records["flags"] & EXTENDED) != 0) == (fault.can_id > _STANDARD)
        return hit

    def _hit(self, acting: _Acting, matching: npt.NDArray[np.int64]) -> list[int]:
        fault = acting.fault
        if fault.probability < 1.0:
            matching = matching[acting.rng.random(len(matching)) < fault.probability]
        if acting.left is not None:
            matching = matching[: acting.left]
        acting.hits += len(matching)
        return [int(row) for row in matching]

    def _reorder(
        self,
        acting: _Acting,
        matching: npt.NDArray[np.int64],
        records: npt.NDArray[np.void],
        node: npt.NDArray[np.int64],
        back: set[int],
        after: dict[int, list[npt.NDArray[np.void]]],
    ) -> None:
        may_be_held = set(matching.tolist())
        for row in range(len(records)):
            key = (int(records["bus"][row]), int(node[row]))
            if key in acting.held:
                after.setdefault(row, []).append(acting.held.pop(key))
            elif row in may_be_held and row not in back and self._hit(acting, np.array([row])):
                acting.held[key] = records[row : row + 1].copy()
                back.add(row)

    # ------------------------------------------------------------------------------------------------------ wire and nodes

    def _free_slots(self) -> list[int]:
        taken = {acting.slot for acting in self._acting.values()}
        return [slot for slot in range(transit.MOST_ERRORS) if slot not in taken]

    def _is_spent(self, acting: _Acting) -> bool:
        """It has hit as many frames as it was to."""
        if acting.slot >= 0:
            return acting.began and int(self._state.errors[acting.slot, transit.LEFT]) == 0
        return acting.left == 0 and not acting.held

    def _begin_errors(self, acting: _Acting) -> None:
        fault, row = acting.fault, self._state.errors[acting.slot]
        channels = [fault.channel in (None, name) for name in self._channels]
        row[transit.BUS_MASK] = sum(1 << bus for bus, meant in enumerate(channels) if meant)
        row[transit.CAN_ID] = -1 if fault.can_id is None else fault.can_id
        row[transit.ID_MASK] = fault.mask
        row[transit.EXTENDED_ID] = fault.can_id is not None and fault.can_id > _STANDARD
        row[transit.LEFT] = -1 if fault.count is None else fault.count
        row[transit.CHANCE] = round(fault.probability * 2**53)
        row[transit.HITS] = 0
        self._state.random[acting.slot] = acting.rng.integers(2**63)

    def _hits(self, acting: _Acting) -> int:
        if not acting.began:
            return 0
        if acting.slot >= 0:
            return int(self._state.errors[acting.slot, transit.HITS])
        if acting.fault.kind == "babble":
            return int(self._state.babble[:, :, 2][self._where(acting.fault)].sum())
        return acting.hits

    def _end(self, number: int, acting: _Acting, now: int) -> None:
        self._ended_hits[number] = self._hits(acting)
        for stale in list(self._ended_hits)[:-_MOST_REMEMBERED]:
            del self._ended_hits[stale]
        if acting.slot >= 0:
            self._state.errors[acting.slot] = 0
            self._state.error_nodes[acting.slot] = False
        for (_, node), record in acting.held.items():
            self._serial += 1
            heapq.heappush(self._delayed, (now, self._serial, node, record))
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
            row = s.wire[bus, transit.ROW]
            if row >= 0 and s.link[row, transit.NODE] == who:
                transit.take_off(s, bus, now)
        s.counters[:, :, OUTSIDE] = outside
        off = s.counters[:, :, OFF]
        for bus, who in zip(*np.nonzero(held_off & (off != 2)), strict=True):
            transit.flush(s, bus, who)
        for bus, who in zip(*np.nonzero(~held_off & (off == 2)), strict=True):
            s.counters[bus, who, OFF], s.counters[bus, who, SEEN] = 1, transit.recessive(s, bus, now)
        off[held_off] = 2
        begun = (babble >= 0) & (s.babble[:, :, 0] < 0)
        s.babble[:, :, 0] = babble
        s.babble[:, :, 1][begun] = now
        s.babble[:, :, 2][begun] = 0


def _flip(rng: np.random.Generator, record: npt.NDArray[np.void]) -> None:
    """Flip one to three bits of a frame's data; a frame without data stays as it is."""
    length = 0 if int(record["flags"][0]) & REMOTE else int(record["length"][0])
    if length:
        for bit in rng.choice(8 * length, int(rng.integers(1, 4)), replace=False):
            record["data"][0, bit // 8] ^= 1 << (bit % 8)
