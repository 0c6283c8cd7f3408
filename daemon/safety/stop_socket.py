"""The operator stop's own way in: a Unix datagram socket that works with every other process dead.

``STOP reason`` latches the stop, ``CLEAR`` unlatches it; a sender that has an address is answered ``stopped`` or ``cleared``.
What is no ``CLEAR`` but begins with ``STOP`` stops: a stop must not fail over its spelling.
"""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

REASON_LENGTH = 200
"""characters"""


class StopRequest(NamedTuple):
    """One datagram's meaning."""

    stop: bool
    """False: clear"""
    reason: str


class StopSocket:
    """Bound at Runtime.stop; read first in every cycle, never waits."""

    def __init__(self, path: Path):
        """Raises ValueError when another loop listens there: a stop must never miss the loop that moves the robot."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
            if probe.connect_ex(str(path)) == 0:
                raise ValueError(f"another loop listens at {path}: end that one, or use another runtime folder")
        self._path = path
        with contextlib.suppress(FileNotFoundError):
            path.unlink()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.bind(str(path))
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def fileno(self) -> int:
        """Readable when a datagram waits."""
        return self._socket.fileno()

    def waiting(self) -> bool:
        """True when something has arrived. Asking costs less than trying in vain, which nearly every try would be."""
        return bool(self._poll.poll(0))

    def requests(self) -> Iterator[StopRequest]:
        """What has arrived, in order. Each sender is answered after its request has been acted upon."""
        while self.waiting():
            try:
                data, sender = self._socket.recvfrom(4096)
            except BlockingIOError:
                return
            request = parse(data)
            if request is None:
                self._answer(b"expected STOP reason, or CLEAR", sender)
                continue
            yield request
            self._answer(b"stopped" if request.stop else b"cleared", sender)

    def _answer(self, text: bytes, sender: str | None) -> None:
        if sender:
            with contextlib.suppress(OSError):  # whoever asked may be gone, or not listen: the stop stands
                self._socket.sendto(text, sender)

    def close(self) -> None:
        self._socket.close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()


def parse(data: bytes) -> StopRequest | None:
    """The request in a datagram; None where it is none."""
    text = data.decode("utf-8", errors="replace").strip()
    if text == "CLEAR":
        return StopRequest(False, "")
    if text.upper().startswith("STOP"):
        return StopRequest(True, text[4:].strip()[:REASON_LENGTH])
    return None
