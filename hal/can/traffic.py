"""All that is under way on the hub's careful path: frames queue, take their time on the bus, and meet the faults laid on it.

It is walked while the bus keeps bit timing, while a fault is there, and until the last trace of one is gone (an error counter, a
frame that is held back). `queues` and `transit` have the kernels, `confinement` the rules of error counters, `disturbance` the
faults.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.can import bus_state, confinement, queues, transit
from hal.can.disturbance import Disturbance
from hal.can.frames import RECORD, WORDS
from hal.can.tally import Tally
from hal.can.timing import BusTiming


class Traffic:
    """All that is on its way on a hub's channels, node by node."""

    def __init__(
        self,
        channels: list[BusTiming],
        tallies: Tally,
        names: list[str],
        *,
        timing: bool,
        fifo: int,
    ):
        """tallies: the hub's. names: of the nodes by number, kept up to date by the hub.

        timing: frames take their time; fifo: frames that a node's transmit queue on one channel holds.
        """
        self.timing, self._fifo, self._channels = timing, fifo, range(len(channels))
        self._state = bus_state.make(tallies.bitrates, tallies.totals, tallies.identifiers, len(names))
        self.disturbance = Disturbance(self._state, [c.name for c in channels], names)
        self.careful = timing
        """False: nothing here has anything to do, and the hub's quick path is as good"""
        self.impaired = False
        """some node is bus-off, or its cable is cut: not everybody hears"""
        self._timed = np.full(len(channels), timing)
        self._rooms = np.zeros(len(channels), np.int64)
        self._set_timed()
        self._then = bus_state.NEVER
        self._warm(names)

    def _warm(self, names: list[str]) -> None:
        # Compile every kernel now: a bus that stops for that when its first fault comes would be a fault of its own.
        s = bus_state.make(self._state.bitrates, self._state.totals.copy(), self._state.identifiers.copy(), len(names))
        one, zero = np.zeros(WORDS, np.uint64), np.zeros(1, np.int64)
        queues.put(s, one, zero, zero, 1, 0, self._rooms)
        transit.run_all(s, 0, bus_state.NEVER, self._timed, np.zeros(WORDS, np.uint64), zero, 0)
        queues.trim(s, self._fifo)
        queues.flush(s, 0, 0)
        transit.take_off(s, 0, 0)
        bus_state.recessive(s, 0, 0)
        queues.is_quiet(s)
        confinement.is_passive(s.counters, 0, 0)

    def join(self, number: int, channels: list[int]) -> None:
        """A node has come on these channels: error active, nothing to send."""
        s = self._state
        s.counters[:, number], s.queue[:, number, bus_state.OVERFLOWS] = 0, 0
        s.present[:, number] = False
        s.present[channels, number] = True

    def leave(self, number: int) -> None:
        """A node has gone. What it had queued is still sent, as far as it can be."""
        s = self._state
        for bus in self._channels:
            if not confinement.takes_part(s.counters, bus, number):
                queues.flush(s, bus, number)
        s.present[:, number] = False

    def is_sending(self, number: int) -> bool:
        """A node, perhaps one that has gone, has frames in a queue."""
        return bool(self._state.queue[:, number, bus_state.LENGTH].any())

    def changed(self, now: int) -> None:
        """Nodes came or went, or faults did: they apply from now on."""
        if self.disturbance:
            self.careful = True
            self._apply(now)

    def clear(self, number: int | None, now: int) -> int:
        """Take back one fault or all (None); see Disturbance.clear."""
        count = self.disturbance.clear(number, now)
        self._apply(now)
        return count

    def hears(self, numbers: npt.NDArray[np.int64], channels: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """(k,) whether each of k nodes hears anything on the channel beside it: not when it is bus-off or its cable is cut."""
        counters = self._state.counters[channels, numbers]
        return (counters[:, confinement.OFF] == 0) & (counters[:, confinement.OUTSIDE] == 0)

    def turn(
        self,
        records: npt.NDArray[np.void],
        node: npt.NDArray[np.int64],
        now: int,
        ahead: int,
        out: npt.NDArray[np.uint64],
        out_node: npt.NDArray[np.int64],
    ) -> int:
        """Queue new frames at `now` (ns), and run all channels until `ahead` ns later.

        `out` and `out_node` get the frames that ended and who sent them, in the order of their ends; returns how many.
        """
        k = 0
        if self.disturbance:
            while (event := self.disturbance.next_event()) <= now:
                k, *_ = transit.run_all(self._state, event, event, self._timed, out, out_node, k)
                self._apply(event)
                for when, who, record in self.disturbance.due(event):
                    self._put(record, np.array([who]), np.zeros(1, np.int64), when)
        if len(records):
            marks = np.zeros(len(records), np.int64)
            self._put(*(self.disturbance.lay(records, node, now) if self.disturbance else (records, node, marks)), now)
        k, self._then, self.impaired = transit.run_all(self._state, now, now + ahead, self._timed, out, out_node, k)
        if self.disturbance and self.disturbance.next_event() <= now:
            self._apply(now)  # it has hit its last frame
        if not self.timing:
            queues.trim(self._state, self._fifo)
            if not self.disturbance and queues.is_quiet(self._state):
                self.careful = False
        if k > 1 and len(self._channels) > 1:
            ended = out.view(RECORD)
            order = np.argsort(ended["time_ns"][:k], kind="stable")
            ended[:k], out_node[:k] = ended[order], out_node[order]
        return k

    def next_event(self) -> int:
        """ns of the clock when `turn` has something to do again, if nobody sends; bus_state.NEVER: not by itself."""
        return min(self._then, self.disturbance.next_event()) if self.disturbance else self._then

    def of_node(self, number: int, bus: int) -> tuple[str, int, int, int, int]:
        """(state, transmit errors, receive errors, frames waiting, overflows) of a node on a channel."""
        s = self._state
        counters, queue = s.counters[bus, number], s.queue[bus, number]
        return (
            confinement.state(s.counters, bus, number),
            int(counters[confinement.TEC]),
            int(counters[confinement.REC]),
            int(queue[bus_state.LENGTH]),
            int(queue[bus_state.OVERFLOWS]),
        )

    def _apply(self, now: int) -> None:
        self.disturbance.apply(now)
        self._set_timed()
        self._then = now  # what ends next may be another frame than before
        counters = self._state.counters
        self.impaired = bool(counters[:, :, confinement.OFF].any() or counters[:, :, confinement.OUTSIDE].any())

    def _set_timed(self) -> None:
        """Which channels keep time, and how much a FIFO takes at once: where frames go at once, it is cut to size behind."""
        self._timed[:] = self.timing | self.disturbance.keeps_time()
        self._rooms[:] = np.where(self._timed, self._fifo, bus_state.POOL)

    def _put(
        self, records: npt.NDArray[np.void], node: npt.NDArray[np.int64], marks: npt.NDArray[np.int64], when: int
    ) -> None:
        words = np.ascontiguousarray(records).view(np.uint64)
        queues.put(self._state, words, node, marks, len(records), when, self._rooms)
