"""The operator's side of a keepalive: each challenge is answered at a third of the timeout, as long as somebody is there.

The answer is a hash of the challenge and the owner, so that a packet that is sent again, or a process that sends the same for ever,
keeps nothing alive.
"""

from __future__ import annotations

import contextlib
import hashlib
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from handrail.messages import BindKeepalive, Challenge, GetChallenge, KeepAlive, ReleaseKeepalive
from handrail.topics import RefusedError, Unreachable


def answer(challenge: str, owner: str) -> str:
    """The one answer to a challenge that counts: SHA-256 of `challenge:owner`, in hexadecimal digits."""
    return hashlib.sha256(f"{challenge}:{owner}".encode()).hexdigest()


class Keepalive:
    """While the block runs, `owner` is alive; when its process dies or hangs, or `alive` says no, the robot holds, then stops.

    `call`: a caller of the daemon's calls that nobody else uses meanwhile (topics.Caller.call, or Client.call).
    """

    def __init__(
        self,
        call: Callable[[Any], Any],
        owner: str,
        timeout_s: float,
        alive: Callable[[], bool] = lambda: True,
    ):
        self._call, self._owner, self._timeout_s, self._alive = call, owner, timeout_s, alive
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="keepalive", daemon=True)
        self.lost = ""
        """why nothing binds the owner any more; empty: something does"""

    def __enter__(self) -> Self:
        """Raises RefusedError, Unreachable."""
        self._challenge = self._call(BindKeepalive(owner=self._owner, timeout_s=self._timeout_s)).challenge
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ended on purpose, the robot is let go; by an exception, it holds and stops."""
        self._ending.set()
        self._thread.join()
        if kind is None and not self.lost:
            self._call(ReleaseKeepalive(owner=self._owner))

    def wait(self) -> None:
        """Until nothing binds the owner any more."""
        self._thread.join()

    def _run(self) -> None:
        while not self.lost and not self._ending.wait(self._timeout_s / 3):
            if self._alive():
                self._answer()

    def _answer(self) -> None:
        try:
            told: Challenge = self._call(KeepAlive(owner=self._owner, answer=answer(self._challenge, self._owner)))
            self._challenge = told.challenge
        except Unreachable:
            pass  # the next third may reach it
        except RefusedError as refused:
            if refused.refusal.field != "answer":  # the daemon has damped the robot: that is final
                self.lost = str(refused)
                return
            with contextlib.suppress(Unreachable):  # its server was started anew, and has forgotten the challenge
                self._challenge = self._call(GetChallenge(owner=self._owner)).challenge
