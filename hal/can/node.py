"""A process on the virtual bus, as the hub sees it: what it listens to, and what waits for it while it is slow."""

from __future__ import annotations

import errno
import socket
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from hal.can import datagrams
from hal.can.frames import BYTES, LOST, MAX_CHANNELS, RECORD


class Node:
    """One process. Nothing here blocks: what its socket does not take waits in a bounded queue, then is dropped."""

    def __init__(self, connection: socket.socket, number: int, room: int):
        """`number`: who it is to the arbitration; `room`: records that may wait for it."""
        self.connection, self.number, self._room = connection, number, room
        self.greeted = False
        self.name = f"node{number}"
        self.control = False
        """it is about the bus, not on it"""
        self.own_frames = False
        """it also wants to hear what it sent"""
        self.ticks = False
        """it wants to know when a cycle of a plant in lock-step is over"""
        self.inbound = np.full(MAX_CHANNELS, -1, np.int64)
        """its index of a channel → the hub's, −1 where it has none"""
        self.outbound = np.full(MAX_CHANNELS, -1, np.int64)
        """the hub's index of a channel → its own, −1 where it does not listen"""
        self.hears_all = False
        """it listens to every channel, and counts them as the hub does"""
        self.spared = 0
        """polls in which it is not asked for a second datagram"""
        self._queue: deque[bytes] = deque()
        self._queued = 0
        self._untold = 0  # records dropped since it was last told

    def listen_to(self, places: Sequence[int], channels: int) -> None:
        """It wants these of the hub's `channels` channels, and counts them in this order."""
        self.inbound[: len(places)] = places
        self.outbound[list(places)] = range(len(places))
        self.hears_all = list(places) == list(range(channels))

    @property
    def unread(self) -> int:
        """Records that wait here until the socket has room."""
        return self._queued

    @property
    def waiting(self) -> bool:
        """True while something waits until the socket has room."""
        return bool(self._queue)

    def send(self, words: npt.NDArray[np.uint64], first: int, n: int) -> bool:
        """Send n records now if that can be, from record `first` on; False: `keep` them."""
        if self._queue:
            return False
        # Any other error says that it left; the hub hears of it when it reads.
        return datagrams.post(self.connection.fileno(), words, first, n) != errno.EAGAIN

    def keep(self, datagram: bytes, clock: Callable[[], int]) -> int:
        """Queue records until there is room; returns how many were dropped since too many wait already."""
        count = len(datagram) // BYTES
        if self._queued + count > self._room:
            self._untold += count
            return count
        if self._untold:
            self._tell(clock())
        self._queue.append(datagram)
        self._queued += count
        return 0

    def flush(self, clock: Callable[[], int]) -> bool:
        """Send what waits, as far as there is room; returns `waiting`."""
        try:
            while self._queue:
                self.connection.send(self._queue[0])
                self._queued -= len(self._queue.popleft()) // BYTES
                if self._untold and not self._queue:
                    self._tell(clock())
        except BlockingIOError:
            pass
        except OSError:
            self._queue.clear()
            self._queued = 0
        return self.waiting

    def _tell(self, time_ns: int) -> None:
        """Queue the notice of loss, in the place where the frames are missing."""
        notice = np.zeros(1, RECORD)
        notice["flags"], notice["can_id"], notice["time_ns"] = LOST, self._untold, time_ns
        self._queue.append(notice.tobytes())
        self._queued, self._untold = self._queued + 1, 0
