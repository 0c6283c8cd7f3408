"""How a node that steps by itself is kept to what it may take: outputs at most so often, a share of a core at most."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

TELL_S = 10.0
"""between two words about the same thing"""
_LOOK_S = 1.0
"""over which it is counted how often something is written: a burst is no flood"""
_SLACK = 0.9
"""of a period: a clock that jitters is no flood"""


@dataclass
class _Port:
    period_s: float
    told_at: float = float("-inf")
    waits: bool = False
    """for its turn"""
    counted_from: float = float("-inf")
    written: int = 0
    noted_at: float = float("-inf")


class Rates:
    """Which outputs may be told now. Times are monotonic s."""

    def __init__(self, rates: Mapping[str, float], note: Callable[[str], None]):
        """`rates`: Hz by output; `note`: called with words for a person where something is left out."""
        self._ports = {name: _Port(1.0 / rate) for name, rate in rates.items()}
        self._note = note

    def due(self, written: Collection[str], now: float) -> list[str]:
        """After a step that wrote these: those whose turn has come, among them what waited for it."""
        due = []
        for name, port in self._ports.items():
            if name in written:
                port.written += 1
                port.waits = True
            if not port.waits:
                continue
            if now - port.told_at >= _SLACK * port.period_s:
                port.told_at, port.waits = now, False
                due.append(name)
            else:
                self._left_out(name, port, now)
        return due

    def _left_out(self, name: str, port: _Port, now: float) -> None:
        counted_s = now - port.counted_from
        if counted_s < _LOOK_S:
            return
        rate = port.written / counted_s
        if rate > 1.1 / port.period_s and now - port.noted_at >= TELL_S:
            port.noted_at = now
            self._note(
                f"output {name}: is written {rate:.3g} times a second, declared {1 / port.period_s:.3g}: "
                f"told that often, its newest value each time"
            )
        port.counted_from, port.written = now, 0


class Share:
    """How long to rest after a step, so that a node uses no more than its share of a core."""

    def __init__(self, share: float, note: Callable[[str], None]):
        self._share, self._note = share, note
        self._noted_at = float("-inf")

    def rest_until(self, began: float, used_s: float, due: float) -> float:
        """When the next step may begin. Times are monotonic s; `used_s`: processor time of the step that began at `began`."""
        rested = began + used_s / self._share
        if rested <= due or self._share >= 1.0:
            return due
        if began - self._noted_at >= TELL_S:
            self._noted_at = began
            self._note(
                f"a step uses {used_s:.3g} s of a core, its share is {100 * self._share:.3g} %: "
                f"it steps every {rested - began:.3g} s"
            )
        return rested
