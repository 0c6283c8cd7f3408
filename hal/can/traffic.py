"""The careful path of the hub: frames queue, take their time on the bus, and meet the faults that are laid on it.

It is walked while the bus keeps bit timing, while a fault is there, and until the last trace of one is gone (an error counter, a
frame that is held back). `transit` has the kernels, `confinement` the rules of error counters, `disturbance` the faults.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.can import confinement, transit
from hal.can.disturbance import Disturbance
from hal.can.frames import RECORD, WORDS
from hal.can.timing import BusTiming

TURN_ROOM = 16384
"""frames that one turn delivers"""


class Traffic:
    """All that is on its way on a hub's channels, node by node."""

    def __init__(
        self,
        channels: list[BusTiming],
        totals: npt.NDArray[np.int64],
        identifiers: npt.NDArray[np.int64],
        names: list[str],
        *,
        timing: bool,
        fifo: int,
    ):
        """totals, identifiers: the hub's (hal.can.tally). names: of the nodes by number, kept up to date by the hub.

        timing: frames take their time; fifo: frames that a node's transmit queue on one channel holds.
        """
        bitrates = np.array([(c.bitrate, c.data_bitrate) for c in channels], np.int64)
        self.timing, self._fifo, self._channels = timing, fifo, range(len(channels))
        self._state = transit.make(bitrates, totals, identifiers, len(names))
        self.disturbance = Disturbance(self._state, [c.name for c in channels], names)
        self.careful = timing
        """False: nothing here has anything to do, and the hub's quick path is as good"""
        self._words = np.zeros(WORDS * TURN_ROOM, np.uint64)
        self._node = np.zeros(TURN_ROOM, np.int64)
        self._records = self._words.view(RECORD)
        self._rooms = np.zeros(len(channels), np.int64)
        self._warm(names)

    def _warm(self, names: list[str]) -> None:
        # Compile every kernel now: a bus that stops for that when its first fault comes would be a fault of its own.
        s = transit.make(self._state.bitrates, self._state.totals.copy(), self._state.identifiers.copy(), len(names))
        one, zero = np.zeros(WORDS, np.uint64), np.zeros(1, np.int64)
        transit.put(s, one, zero, zero, 1, 0, self._rooms)
        transit.run(s, 0, transit.NEVER, self._words, self._node, 0)
        transit.trim(s, self._fifo)
        transit.flush(s, 0, 0)
        transit.take_off(s, 0, 0)
        transit.catch_up(s, 0, 0)
        transit.next_time(s, 0)
        transit.is_quiet(s)
        confinement.is_passive(s.counters, 0, 0)

    def join(self, number: int, channels: list[int]) -> None:
        """A node has come on these channels: error active, nothing to send."""
        s = self._state
        s.counters[:, number], s.queue[:, number, transit.OVERFLOWS] = 0, 0
        s.present[:, number] = False
        s.present[channels, number] = True

    def leave(self, number: int) -> None:
        """A node has gone. What it had queued is still sent, as far as it can be."""
        s = self._state
        for bus in self._channels:
            if not confinement.takes_part(s.counters, bus, number):
                transit.flush(s, bus, number)
        s.present[:, number] = False

    def is_sending(self, number: int) -> bool:
        """A node, perhaps one that has gone, has frames in a queue."""
        return bool(self._state.queue[:, number, transit.LENGTH].any())

    def changed(self, now: int) -> None:
        """Nodes came or went, or faults did: they apply from now on."""
        if self.disturbance:
            self.careful = True
            self.disturbance.apply(now)

    def hears(self, numbers: npt.NDArray[np.int64], channels: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """(k,) whether each of k nodes hears anything on the channel beside it: not when it is bus-off or its cable is cut."""
        counters = self._state.counters[channels, numbers]
        return (counters[:, confinement.OFF] == 0) & (counters[:, confinement.OUTSIDE] == 0)

    def turn(
        self, records: npt.NDArray[np.void], node: npt.NDArray[np.int64], now: int, ahead: int
    ) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.int64], int]:
        """Queue new frames at `now` (ns), and run all channels until `ahead` ns later.

        Returns the frames that ended, in the order of their ends: words, nodes, how many.
        """
        k = 0
        while (event := self.disturbance.next_event()) <= now:
            k = self._run(event, k)
            self.disturbance.apply(event)
            for when, who, record in self.disturbance.due(event):
                self._put(record, np.array([who]), np.zeros(1, np.int64), when)
        self._catch_up(now)
        if len(records):
            self._put(*self.disturbance.lay(records, node, now), now)
        k = self._run(now + ahead, k)
        self._catch_up(now)
        if self.disturbance.next_event() <= now:
            self.disturbance.apply(now)  # it has hit its last frame
        if not self.timing:
            transit.trim(self._state, self._fifo)
            if not self.disturbance and transit.is_quiet(self._state):
                self.careful = False
        if k > 1 and len(self._channels) > 1:
            order = np.argsort(self._records["time_ns"][:k], kind="stable")
            self._records[:k], self._node[:k] = self._records[order], self._node[order]
        return self._words, self._node, k

    def next_event(self) -> int:
        """ns of the clock when `turn` has something to do again, if nobody sends; transit.NEVER: not by itself."""
        timed = [transit.next_time(self._state, int(bus)) for bus in np.flatnonzero(self._takes_time())]
        return min([self.disturbance.next_event(), *timed])

    def of_node(self, number: int, bus: int) -> tuple[str, int, int, int, int]:
        """(state, transmit errors, receive errors, frames waiting, overflows) of a node on a channel."""
        s = self._state
        counters, queue = s.counters[bus, number], s.queue[bus, number]
        return (
            confinement.state(s.counters, bus, number),
            int(counters[confinement.TEC]),
            int(counters[confinement.REC]),
            int(queue[transit.LENGTH]),
            int(queue[transit.OVERFLOWS]),
        )

    def _takes_time(self) -> npt.NDArray[np.bool_]:
        return np.ones(len(self._channels), np.bool_) if self.timing else self.disturbance.keeps_time()

    def _put(
        self, records: npt.NDArray[np.void], node: npt.NDArray[np.int64], marks: npt.NDArray[np.int64], when: int
    ) -> None:
        self._rooms[:] = np.where(self._takes_time(), self._fifo, transit.POOL)
        words = np.ascontiguousarray(records).view(np.uint64)
        transit.put(self._state, words, node, marks, len(records), when, self._rooms)

    def _catch_up(self, now: int) -> None:
        for bus in self._channels:
            transit.catch_up(self._state, bus, now)

    def _run(self, until: int, k: int) -> int:
        takes_time = self._takes_time()
        for bus in self._channels:
            k = transit.run(self._state, bus, until if takes_time[bus] else transit.NEVER, self._words, self._node, k)
        return k
