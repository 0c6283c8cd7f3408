"""STOP and nothing else, on a connection and a thread of its own, so that neither a call that waits for its answer nor a window
that draws nothing any more is in its way. It repeats until the robot answers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

from handrail.messages import Message, Stop
from handrail.topics import RefusedError
from tablet_client.models.arrivals import StopProgress

_TIMEOUT = 0.7  # s, of one attempt
_PAUSE = 0.2  # s, between attempts
_ATTEMPTS = 15


class Caller(Protocol):
    """What is needed of `handrail.client.Client`."""

    def call(self, message: Message, timeout_s: float | None = None) -> Any: ...
    def close(self) -> None: ...


class Stopper:
    """Keeps a connection ready for STOP. `tell` hears how it fares, on the stopper's thread."""

    def __init__(self, client: Caller, tell: Callable[[StopProgress], None]):
        self._client, self._tell = client, tell
        self._over = threading.Event()
        self._wanted = threading.Event()
        self._reason = ""
        self._thread = threading.Thread(target=self._run, name="tablet-stopper", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, reason: str) -> None:
        """Send STOP now, and again until it is answered. Returns at once."""
        self._reason = reason
        self._wanted.set()

    def close(self, timeout: float = 2.0) -> None:
        """End the thread, waiting at most `timeout` s; a STOP that is still out there is abandoned."""
        self._over.set()
        self._wanted.set()
        self._client.close()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def _run(self) -> None:
        while self._wanted.wait() and not self._over.is_set():
            self._wanted.clear()
            self._send()

    def _send(self) -> None:
        """Send STOP until it is answered or hopeless."""
        why = ""
        for attempt in range(1, _ATTEMPTS + 1):
            self._tell(StopProgress("sending", attempt, why))
            try:
                self._client.call(Stop(reason=self._reason), _TIMEOUT)
            except (ConnectionError, OSError, RefusedError) as error:
                why = str(error)
                if self._over.wait(_PAUSE):
                    return
            else:
                self._tell(StopProgress("answered", attempt))
                return
        self._tell(StopProgress("failed", _ATTEMPTS, why))
