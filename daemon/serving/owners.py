"""Who started the actions that run, and whether they are still alive: owners check in, or their actions are ended."""

from __future__ import annotations

import zlib
from collections.abc import Iterable

from handrail.topics import refuse

TIMEOUT_S = 1.0
"""s that a running action's owner may stay silent (messages.CheckIn), of the wall's time and of the robot's"""
LONGEST_TICK_S = 0.25
"""that counts of a time in which nobody looked: owners may have spoken while the server had no core to hear them on"""


class Owners:
    """Owners' names, their numbers in the loop's records, and when each was last heard.

    Their time goes on as the slower of the wall's and the robot's does. In lock-step a busy machine slows the robot's time and its
    owners alike; what has moved on by less than a second has not been without its owner for one.
    """

    def __init__(self, timeout_s: float = TIMEOUT_S):
        self._timeout_s = timeout_s
        self._now = 0.0
        self._looked: tuple[float, float | None] | None = None
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

    def tick(self, wall: float, robot: float | None) -> None:
        """Time goes on; to be called every tenth of a second or so: by so much a silence may be counted too long.

        :param wall: s, monotonic
        :param robot: s, the robot's clock; None while there is no loop to tell it
        """
        if self._looked is not None:
            wall_before, robot_before = self._looked
            passed = min(wall - wall_before, LONGEST_TICK_S)
            if robot is not None and robot_before is not None:
                passed = min(passed, max(robot - robot_before, 0.0))
            self._now += passed
        self._looked = wall, robot

    def check_in(self, name: str) -> None:
        """Heard from `name`."""
        self._heard[self.number(name)] = self._now

    def lost(self, running: Iterable[int]) -> list[int]:
        """Those of the owners of running actions who have been silent for too long, each once a timeout."""
        running, now = set(running), self._now
        # Who has never been heard, or owns nothing that runs, begins a full timeout with the action.
        self._heard = {number: heard for number, heard in self._heard.items() if number in running}
        silent = [number for number in running if now - self._heard.setdefault(number, now) > self._timeout_s]
        for number in silent:
            self._heard[number] = now
        return sorted(silent)
