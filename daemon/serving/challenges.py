"""Which challenge each owner with a keepalive has to answer next (handrail.keepalive), and whose it is to answer.

Whoever bound a keepalive over the link is known by his key, and nobody else's key answers or ends it. That is kept in a file of the
runtime folder: a server that was started anew goes on with it.
"""

from __future__ import annotations

import contextlib
import hmac
import secrets
from pathlib import Path

import msgspec

from handrail.keepalive import answer
from handrail.topics import refuse


class Challenges:
    """One open challenge an owner; each is good for one answer."""

    def __init__(self, file: Path | None = None) -> None:
        """Takes up what an earlier server left in `file`; one that can't be read counts as empty. None: nothing is kept."""
        self._open: dict[str, str] = {}
        self._file = file
        self._bound: dict[str, str] = {}
        if file is not None:
            with contextlib.suppress(FileNotFoundError, msgspec.DecodeError):
                self._bound = msgspec.json.decode(file.read_bytes(), type=dict[str, str])

    def allow(self, owner: str, by: str) -> None:
        """Raises RefusedError where another key than that of `by` has bound this owner. The robot's own machine may always."""
        binder = self._bound.get(owner, by)
        if by and by != binder:
            whose = f"{binder}'s key" if binder else "the robot's own machine"
            raise refuse(f"this keepalive was bound by {whose}", "owner", owner, "an owner that you have bound")

    def bind(self, owner: str, by: str) -> None:
        """From now on it is his."""
        if self._bound.get(owner) != by:
            self._bound[owner] = by
            self._write()

    def issue(self, owner: str) -> str:
        """A new challenge, in place of the one before."""
        self._open[owner] = secrets.token_hex(16)
        return self._open[owner]

    def check(self, owner: str, given: str) -> None:
        """Raises RefusedError unless `given` answers the open challenge, which is closed then. A wrong answer closes nothing."""
        challenge = self._open.get(owner)
        if challenge is None or not hmac.compare_digest(given, answer(challenge, owner)):
            raise refuse("a wrong answer: it does not count", "answer", given[:80], "the answer to the last challenge")
        del self._open[owner]

    def forget(self, owner: str) -> None:
        """He has nothing to answer: whoever binds him next may."""
        self._open.pop(owner, None)
        if self._bound.pop(owner, None) is not None:
            self._write()

    def _write(self) -> None:
        if self._file is None:
            return
        fresh = self._file.with_suffix(".new")
        fresh.write_bytes(msgspec.json.encode(self._bound))
        fresh.replace(self._file)
