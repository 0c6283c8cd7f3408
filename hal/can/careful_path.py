"""The careful path of the hub: what comes queues up, and is passed on when it ends on its bus (hal.can.traffic).

It is walked while the bus keeps bit timing, while a fault is there, and until the last trace of one is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from hal.can.alarm import Alarm
from hal.can.bus_state import NEVER
from hal.can.frames import EXTENDED
from hal.can.quick_path import MOST_NODES, QuickPath
from hal.can.traffic import Traffic


class CarefulPath:
    """Turns of a bus on which frames take their time or meet faults; it shares inbox and records with the quick path."""

    def __init__(self, quick: QuickPath, traffic: Traffic):
        self._quick, self._traffic = quick, traffic
        self._unread: list[npt.NDArray[np.void]] = []
        self._cycle: tuple[int, int, int] | None = None  # lock-step: period in ns, identifiers of Sync and HoldTime
        self.heard: tuple[int, int] | None = None
        """lock-step: how many Sync and HoldTime the last turn took in, whatever the bus then did to them"""

    @property
    def needed(self) -> bool:
        """Frames may be under way that nobody sends any more: bit timing is on, or a fault is or was on the bus."""
        return self._traffic.careful or bool(self._unread)

    def lockstep(self, period_ns: int, sync: int, hold: int) -> None:
        """See Hub.lockstep."""
        self._cycle = (period_ns, sync, hold)

    def turn(self, n: int, now: int, *, takes_in: bool = True) -> int:
        """Queue the n records of the inbox at `now` (ns); returns how many ended, which are in the quick path's records then.

        takes_in: they are other processes'.
        """
        quick, ahead = self._quick, 0
        records, node = quick.inbox_records[:n], quick.inbox_senders[:n]
        if self._cycle is not None:
            ahead, sync, hold = self._cycle
            if takes_in:
                first = np.where((records["bus"] == 0) & (records["flags"] & EXTENDED == 0), records["can_id"], -1)
                self.heard = int(np.count_nonzero(first == sync)), int(np.count_nonzero(first == hold))
                if self.heard[1]:
                    records, node = records[first != hold], node[first != hold]
        return self._traffic.turn(records, node, now, ahead, quick.carried, quick.senders)

    def leave_unread(self, count: int) -> None:
        """Of the records that ended while the hub's own nodes sent, keep those of other processes for the next `read`."""
        if len(records := self._from_others(count)):
            self._unread.append(records.copy())

    def read(self, count: int) -> npt.NDArray[np.void]:
        """Of the records that ended, and of those left unread before, those that other processes sent."""
        records = self._from_others(count)
        if self._unread:
            records = np.concatenate([*self._unread, records])
            self._unread.clear()
        return records

    def wait(self, alarm: Alarm, clock: Callable[[], int], deadline: float | None) -> float | None:
        """How long epoll may wait; the alarm ends that when a frame ends on the bus, or at the deadline."""
        if self._unread:
            return 0.0
        left = None if deadline is None else deadline - time.monotonic()
        if self._cycle is not None or (left is not None and left <= 0.0):
            return left if left is None else max(0.0, left)  # in lock-step the clock moves only between two calls
        when = self._traffic.next_event()
        until_event = None if when == NEVER else when - clock()
        until_deadline = None if left is None else int(left * 1e9)
        alarm.set(min((d for d in (until_event, until_deadline) if d is not None), default=None))
        return None

    def _from_others(self, count: int) -> npt.NDArray[np.void]:
        return self._quick.records[:count][self._quick.senders[:count] < MOST_NODES]
