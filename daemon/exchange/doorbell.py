"""Doorbells: how one process wakes another that sleeps, without ever waiting for it."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from pathlib import Path

BELL_PERIOD_NS = 10_000_000
"""of wall time, after which the server is woken when nothing else happens: in lock-step it then finds several states at once"""


class Doorbell:
    """The side that is woken: a datagram socket to select on. Make it before telling anybody that you are ready."""

    def __init__(self, path: Path):
        self._path = path
        with contextlib.suppress(FileNotFoundError):
            path.unlink()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.bind(str(path))
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def fileno(self) -> int:
        return self._socket.fileno()

    def wait(self, timeout_s: float | None) -> bool:
        """True as soon as it was rung since the last `wait` or `clear`; False when it was not in time."""
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return False
        self.clear()
        return True

    def clear(self) -> None:
        """Forget that it was rung. Call before looking at what it announces, so that nothing is missed."""
        while self._poll.poll(0):  # asking costs less than trying in vain, which the last try always would be
            with contextlib.suppress(BlockingIOError):
                self._socket.recv(16)

    def close(self) -> None:
        self._socket.close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()


class Bell:
    """The side that wakes: `ring` never waits and never fails."""

    def __init__(self, path: Path):
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._connected = False

    def ring(self) -> bool:
        """Wake whoever listens. False when nobody does: no process has made that doorbell, or it has died."""
        try:
            if not self._connected:
                self._socket.connect(self._path)
                self._connected = True
            self._socket.send(b"!")
        except BlockingIOError:
            return True  # its queue is full of rings already
        except (FileNotFoundError, ConnectionRefusedError):
            again, self._connected = self._connected, False
            return again and self.ring()  # who listened has died: another may listen there now
        return True

    def close(self) -> None:
        self._socket.close()


class PacedBell(Bell):
    """Rings at once when something happened, else now and then."""

    def __init__(self, path: Path, period_ns: int = BELL_PERIOD_NS):
        """`period_ns`: of wall time, after which it rings when nothing happened."""
        super().__init__(path)
        self._period_ns, self._rang_ns = period_ns, 0

    def tell(self, happened: bool) -> None:
        """Ring, if it is time to."""
        now = time.monotonic_ns()
        if happened or now - self._rang_ns >= self._period_ns:
            self._rang_ns = now
            self.ring()


def server_doorbell(folder: Path) -> Path:
    """Where the server listens for the loop, in the runtime folder."""
    return folder / "server.bell"


def loop_doorbell(folder: Path) -> Path:
    """Where the loop listens for the server while it holds time, in the runtime folder."""
    return folder / "loop.bell"
