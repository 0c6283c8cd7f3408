"""Who started the actions that run, and whether they are still alive: owners check in, or their actions are ended."""

from __future__ import annotations

import zlib
from collections.abc import Iterable

from handrail.topics import refuse

TIMEOUT_S = 1.0
"""s of wall time that a running action's owner may stay silent (messages.CheckIn)"""


class Owners:
    """Owners' names, their numbers in the loop's records, and when each was last heard."""

    def __init__(self, timeout_s: float = TIMEOUT_S):
        self._timeout_s = timeout_s
        self._names: dict[int, str] = {}
        self._heard: dict[int, float] = {}

    def number(self, name: str) -> int:
        """The owner's number, never 0. It follows from the name alone, so that a server that has started anew knows whose
        action it finds running. Raises RefusedError in the unlikely case that two names share one.
        """
        number = zlib.crc32(name.encode()) or 1
        if self._names.setdefault(number, name) != name:
            raise refuse("this owner's name can't be told from another's", "owner", name, "another name")
        return number

    def name(self, number: int) -> str:
        """The owner's name, or its number in words where it has not spoken yet."""
        return self._names.get(number, f"owner {number}")

    def check_in(self, name: str, now: float) -> None:
        """Heard from `name` at `now` (s, monotonic wall time)."""
        self._heard[self.number(name)] = now

    def lost(self, running: Iterable[int], now: float) -> list[int]:
        """Those of the owners of running actions who have been silent for too long, each once a timeout."""
        running = set(running)
        # Who has never been heard, or owns nothing that runs, begins a full timeout with the action.
        self._heard = {number: heard for number, heard in self._heard.items() if number in running}
        silent = [number for number in running if now - self._heard.setdefault(number, now) > self._timeout_s]
        for number in silent:
            self._heard[number] = now
        return sorted(silent)
