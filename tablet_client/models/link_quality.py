"""How good the link is: how long a call takes there and back, how many got no answer, and what it carries."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from tablet_client.models.arrivals import Pinged

Quality = Literal["unknown", "good", "slow", "bad"]

_PINGS = 60
"""the last minute's, at one a second"""
_RATE_S = 10.0
_SLOW_S, _BAD_S = 0.15, 0.6
"""there and back, half of the calls: from here on a hand notices, and waits"""
_BAD_LOSS = 0.1
_CLASSES: Mapping[str, str] = {
    "": "answers",
    "RobotState": "robot",
    "DaemonStatus": "robot",
    "DeviceStates": "robot",
    "ActionEvent": "robot",
    "PointCloud": "camera",
    "PortValue": "output",
    "LogLine": "output",
}
"""type of event → what it is counted as; others are the engine's: instances, plans, runs, questions"""
CLASSES = ("robot", "camera", "engine", "output", "answers")


@dataclass(frozen=True)
class Figures:
    """Of the last minute; what it carries, of the last 10 s."""

    quality: Quality = "unknown"
    latency_s: float = 0.0
    """there and back, the middle one"""
    worst_s: float = 0.0
    loss: float = 0.0
    """share of the calls that got no answer in time"""
    rate: float = 0.0
    """bytes/s received"""
    rates: tuple[tuple[str, float], ...] = ()
    """class → bytes/s received, the greatest first"""


class LinkQuality:
    """The last minute's calls that asked for nothing but an answer."""

    def __init__(self) -> None:
        self._pings: deque[Pinged] = deque(maxlen=_PINGS)

    def take(self, ping: Pinged) -> None:
        if self._pings and sum(ping.received.values()) < sum(self._pings[-1].received.values()):
            self._pings.clear()  # another connection counts anew
        self._pings.append(ping)

    def clear(self) -> None:
        """Another robot."""
        self._pings.clear()

    def figures(self) -> Figures:
        """As they are now."""
        if not self._pings:
            return Figures()
        took = [ping.took_s for ping in self._pings if ping.took_s is not None]
        loss = 1.0 - len(took) / len(self._pings)
        latency = statistics.median(took) if took else 0.0
        bad = not took or latency > _BAD_S or loss > _BAD_LOSS
        quality: Quality = "bad" if bad else "slow" if latency > _SLOW_S or loss > 0.0 else "good"
        rates = self._rates()
        return Figures(quality, latency, max(took, default=0.0), loss, sum(rates.values()), _greatest_first(rates))

    def _rates(self) -> dict[str, float]:
        last = self._pings[-1]
        first = next(ping for ping in self._pings if last.at - ping.at <= _RATE_S)
        if last.at <= first.at:
            return {}
        rates: dict[str, float] = {}
        for kind, size in last.received.items():
            name = _CLASSES.get(kind, "engine")
            rates[name] = rates.get(name, 0.0) + (size - first.received.get(kind, 0)) / (last.at - first.at)
        return rates


def _greatest_first(rates: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(rates.items(), key=lambda pair: -pair[1]))


def settled(shown: float, now: float, least: float) -> float:
    """What is shown of a number that trembles: as before, unless it has changed by a quarter and by `least`."""
    return shown if abs(now - shown) < max(least, 0.25 * shown) else now
