"""Two hands of one activity along a template's `sync`: each goes its own way between its points, where they are at one time.

Where both go freely, one plan has both; lines take as long as the longest of them. Else whoever is there first waits. When one hand
can't go on, the other one stops.
"""

from __future__ import annotations

import contextlib
import contextvars
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Protocol

from affordance_templates.binding import BoundWaypoint, schedule
from affordance_templates.placement import Array
from affordance_templates.template import Sync
from engines.activities import lines
from engines.activities.base import ActivityFailed
from engines.activities.meetings import Leg
from engines.runs.motion import Motion
from handrail.topics import Unreachable


class Hand(Protocol):
    """One arm along its own trajectory: a `TrajectoryActivity`."""

    cancelled: threading.Event

    def go(self, waypoints: Sequence[BoundWaypoint]) -> None:
        """To all of them. Raises ActivityFailed."""

    def shape(self, waypoint: BoundWaypoint) -> None:
        """Give the hand the shape that the waypoint asks for, if it asks for one. Raises ActivityFailed."""

    def standing(self) -> Array:
        """(4, 4) of the tip in the world."""


class Together:
    """The hands, by the trajectory that each goes along."""

    def __init__(self, hands: Mapping[str, Hand], motion: Motion):
        self._hands, self._motion = hands, motion

    def stop(self) -> None:
        """End what they do, from any thread."""
        for hand in self._hands.values():
            hand.cancelled.set()
        self._motion.interrupt()

    def go(self, leg: Leg) -> None:
        """Each its own way, until all are there. Raises ActivityFailed as the first one did that could not."""
        timed = self._timed(leg)
        self._beside({name: timed[name] for name in self._hands if timed[name]}, shaping=False)

    def shape(self, leg: Leg) -> None:
        """Their shapes at a meeting that a plan has led them to."""
        self._beside({name: way for name, way in leg.ways.items() if way and way[-1].fingers}, shaping=True)

    def _beside(self, ways: Mapping[str, Sequence[BoundWaypoint]], *, shaping: bool) -> None:
        failures: list[Exception] = []

        def one(name: str) -> None:
            hand = self._hands[name]
            try:
                if shaping:
                    hand.shape(ways[name][-1])
                else:
                    hand.go(ways[name])
            except Exception as problem:
                failures.append(problem)  # the first is told; those of hands that it stops come after it
                with contextlib.suppress(Unreachable):
                    self.stop()
                if not isinstance(problem, ActivityFailed):
                    raise

        with ThreadPoolExecutor(max(len(ways), 1), thread_name_prefix="hand") as threads:
            # With what this thread counts on: the release that the program was deployed from.
            under_way = [threads.submit(contextvars.copy_context().run, one, name) for name in ways]
        for each in under_way:
            each.result()
        if failures:
            raise failures[0]

    def _timed(self, leg: Leg) -> Mapping[str, Sequence[BoundWaypoint]]:
        """The same ways, as long as they have to be to end at one time; lines alone have a time beforehand."""
        ways = {name: way for name, way in leg.ways.items() if way}
        durations: dict[str, list[float]] = {}
        for name, way in ways.items():
            here = self._hands[name].standing()
            durations[name] = []
            for waypoint in way:
                line = lines.to(waypoint, here)
                if line is None:
                    return leg.ways
                here, seconds = line
                durations[name].append(seconds)
        meeting = {name: len(way) - 1 for name, way in ways.items()}
        times = schedule(Sync(leg.name, tuple(ways), (meeting,)), durations)
        timed: dict[str, Sequence[BoundWaypoint]] = {name: () for name in leg.ways}
        for name, way in ways.items():
            before = [0.0, *times[name]]
            timed[name] = [
                replace(each, waypoint=replace(each.waypoint, duration=after - start)) if seconds else each
                for each, start, after, seconds in zip(way, before, times[name], durations[name], strict=False)
            ]
        return timed
