"""What becomes of frames on their way from a node to its queue, frame by frame: drop, delay, duplicate, reorder, corrupt, stuck."""

from __future__ import annotations

import heapq
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from hal.can.acting import Acting, Reach
from hal.can.bus_state import DROP, NEVER, TWICE
from hal.can.frames import EXTENDED, REMOTE

_ON_THE_WAY = ("drop", "delay", "duplicate", "reorder", "corrupt", "stuck")


class Interference:
    """Lays faults' hands on frames, and holds those back that come later."""

    def __init__(self, reach: Reach):
        self._reach = reach
        self._held: list[tuple[int, int, int, npt.NDArray[np.void]]] = []  # (when, serial, node, frame)
        self._serial = 0

    def __bool__(self) -> bool:
        """True while a frame is held back until its time."""
        return bool(self._held)

    def next_due(self) -> int:
        """ns of the bus's clock when the next frame goes on; NEVER: none."""
        return self._held[0][0] if self._held else NEVER

    def hold_until(self, when: int, node: int, record: npt.NDArray[np.void]) -> None:
        """A frame of this node's goes on at `when` (ns)."""
        self._serial += 1
        heapq.heappush(self._held, (when, self._serial, node, record))

    def due(self, now: int) -> list[tuple[int, int, npt.NDArray[np.void]]]:
        """Delayed frames whose time has come: (ns when, node, frame), first the first."""
        ready = []
        while self._held and self._held[0][0] <= now:
            when, _, node, record = heapq.heappop(self._held)
            ready.append((when, node, record))
        return ready

    def lay(
        self,
        faults: Iterable[Acting],
        records: npt.NDArray[np.void],
        node: npt.NDArray[np.int64],
        now: int,
    ) -> tuple[npt.NDArray[np.void], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """What becomes of frames (hub's channel indices) on their way to the queues: (frames, nodes, marks) to be queued.

        `records` may be changed in place.
        """
        marks = np.zeros(len(records), np.int64)
        back: set[int] = set()  # rows that don't go on now
        after: dict[int, list[npt.NDArray[np.void]]] = {}  # row → frames that go on behind it
        for acting in faults:
            kind = acting.fault.kind
            if not acting.began or kind not in _ON_THE_WAY:
                continue
            matching = self._reach.frames(acting.fault, records, node)
            if kind == "reorder":
                # Every frame of the node on the channel may be the one that the held frame waits for.
                _reorder(acting, matching, records, node, back, after)
                continue
            for row in acting.hit(matching):
                match kind:
                    case "drop":
                        marks[row] |= DROP
                    case "duplicate":
                        marks[row] |= TWICE
                    case "delay" if row not in back:
                        when = now + round(acting.fault.delay * 1e9)
                        self.hold_until(when, int(node[row]), records[row : row + 1].copy())
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


def _reorder(
    acting: Acting,
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
        elif row in may_be_held and row not in back and acting.hit(np.array([row])):
            acting.held[key] = records[row : row + 1].copy()
            back.add(row)


def _flip(rng: np.random.Generator, record: npt.NDArray[np.void]) -> None:
    """Flip one to three bits of a frame's data; a frame without data stays as it is."""
    length = 0 if int(record["flags"][0]) & REMOTE else int(record["length"][0])
    if length:
        for bit in rng.choice(8 * length, int(rng.integers(1, 4)), replace=False):
            record["data"][0, bit // 8] ^= 1 << (bit % 8)
