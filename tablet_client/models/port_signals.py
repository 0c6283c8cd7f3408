"""Numbers that flow through ports of nodes, kept for plots from when they are chosen: the link carries no others."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from handrail.messages import Message, NodeState, PortValue, WatchPort

PREFIX = "node:"
"""of their names: node:NODE.PORT"""
_SCALARS = ("number", "integer", "flag")
_RATE = 20.0  # Hz at most
_LASTS, _RENEWED = 10.0, 4.0  # s: how long values are told, and when that is asked for anew


class PortSignals:
    """Each value with the time, by the robot's clock, at which it arrived."""

    def __init__(self, rows: int):
        """`rows`: values of each port that are kept."""
        self._rows = rows
        self._units: dict[str, str] = {}
        """name → unit, of the ports that there are"""
        self._values: dict[str, deque[tuple[int, float]]] = {}
        self._asked: dict[str, float] = {}

    def hear(self, nodes: Iterable[NodeState]) -> None:
        """Which nodes run."""
        self._units = {
            f"{PREFIX}{node.name}.{port.name}": port.unit
            for node in nodes
            if node.state == "up"
            for port in node.ports
            if port.kind in _SCALARS
        }

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._units)

    def unit(self, name: str) -> str:
        """Empty: it has none, or its node does not run any more."""
        return self._units.get(name, "")

    def forget(self) -> None:
        """The robot's clock has begun anew."""
        self._values.clear()

    def drop(self, name: str) -> None:
        """It is not shown any more."""
        self._values.pop(name, None)
        self._asked.pop(name, None)

    def take(self, told: PortValue, time_ns: int) -> None:
        """A value, at the robot's time `time_ns`; one that nobody chose is none."""
        name = f"{PREFIX}{told.name}.{told.port}"
        if name in self._asked and isinstance(told.value, int | float):
            self._values.setdefault(name, deque(maxlen=self._rows)).append((time_ns, float(told.value)))

    def samples(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """(times in ns, values), oldest first."""
        found = list(self._values.get(name, ()))
        return np.array([time for time, _ in found], dtype=np.int64), np.array([value for _, value in found])

    def want(self, now: float, chosen: Sequence[str]) -> Iterator[Message]:
        """What to ask for; `now`: s, monotonic."""
        for name in chosen:
            if name.startswith(PREFIX) and now - self._asked.get(name, float("-inf")) >= _RENEWED:
                self._asked[name] = now
                node, _, port = name.removeprefix(PREFIX).rpartition(".")
                yield WatchPort(name=node, port=port, rate=_RATE, lasts=_LASTS)
