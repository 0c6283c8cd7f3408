"""What the robot measured in the last half minute, kept for plots: every joint's signals, and the estimated force at the tool.

All of that is kept all the time, so that a signal chosen after something happened shows what happened; ports of nodes are from when
they are chosen.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from handrail.messages import Message, NodeState, PortValue, RobotState
from tablet_client.models.port_signals import PREFIX, PortSignals

SPAN_S = 30.0
MOST_CHOSEN = 4
_ROWS = 3000  # 30 s at the 100 Hz that no link exceeds
_FORCES = ("force.x", "force.y", "force.z")
_DEG = 180.0 / np.pi
QUANTITIES = {
    "position": ("°", _DEG),
    "velocity": ("°/s", _DEG),
    "torque": ("N·m", 1.0),
    "command": ("°", _DEG),
    "error": ("°", _DEG),
}
"""of a joint; error: position − command"""


@dataclass(frozen=True)
class Curve:
    """One signal over the time that is shown."""

    name: str
    unit: str
    times: np.ndarray
    """s before the newest sample, all ≤ 0"""
    values: np.ndarray
    """in `unit`"""


@dataclass(frozen=True)
class _Samples:
    times: np.ndarray
    """ns, robot's clock, ascending"""
    values: np.ndarray
    """a row a sample: positions, velocities, torques, commands, force"""
    ports: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """of those that are chosen: times, ns, and values"""


class Signals:
    """The last `SPAN_S` of the robot's own time. A clock that jumps back begins anew: it is another run of the robot."""

    def __init__(self) -> None:
        self.chosen: list[str] = []
        """names, in the order in which they were chosen"""
        self.watched = False
        """somebody looks"""
        self._joints: tuple[str, ...] = ()
        self._ports = PortSignals(_ROWS)
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._times = np.empty(_ROWS, dtype=np.int64)
        self._values = np.empty((_ROWS, 4 * len(self._joints) + len(_FORCES)), dtype=np.float32)
        self._next = self._count = 0
        self._held: _Samples | None = None
        self._ports.forget()

    def describe(self, joints: tuple[str, ...]) -> None:
        """Which joints a robot's states tell of, in their order; another robot's begin anew."""
        if joints != self._joints:
            self._joints = joints
            self._begin_anew()
            self.chosen = [name for name in self.chosen if name in self.names]

    def take(self, state: RobotState) -> None:
        """One more sample; one that does not fit the robot, or is as old as the last, is none."""
        joints = len(self._joints)
        if not joints or len(state.position) != joints:
            return
        if self._count:
            last = self._times[self._next - 1]
            if state.time_ns == last:
                return
            if state.time_ns < last:
                self._begin_anew()
        row = self._values[self._next]
        for k, values in enumerate((state.position, state.velocity, state.torque, state.command)):
            row[k * joints : (k + 1) * joints] = values
        row[4 * joints :] = state.external_force
        self._times[self._next] = state.time_ns
        self._next = (self._next + 1) % _ROWS
        self._count = min(self._count + 1, _ROWS)

    def take_port(self, told: PortValue) -> None:
        """A value of a node's port; its time is that of the robot's newest state."""
        if self._count:
            self._ports.take(told, int(self._times[self._next - 1]))

    def hear(self, nodes: Iterable[NodeState]) -> None:
        """Which nodes run."""
        self._ports.hear(nodes)

    def want(self, now: float) -> Iterator[Message]:
        """The calls that are due; `now`: s, monotonic."""
        return self._ports.want(now, self.chosen)

    @property
    def ports(self) -> tuple[str, ...]:
        """Those of `names` that are a node's."""
        return self._ports.names

    @property
    def names(self) -> tuple[str, ...]:
        """All signals that there are: `JOINT.QUANTITY`, `force.x`, `node:NODE.PORT`."""
        joints = tuple(f"{joint}.{quantity}" for joint in self._joints for quantity in QUANTITIES)
        return _FORCES + joints + self._ports.names

    @property
    def joints(self) -> tuple[str, ...]:
        return self._joints

    @property
    def paused(self) -> bool:
        return self._held is not None

    def choose(self, name: str) -> str:
        """Show a signal; no more, if it is shown. Code of the reason why not; empty when done."""
        if name in self.chosen:
            self.chosen.remove(name)
            self._ports.drop(name)
        elif name not in self.names:
            return "no_signal"
        elif len(self.chosen) >= MOST_CHOSEN:
            return "too_many_signals"
        else:
            self.chosen.append(name)
        return ""

    def pause(self, on: bool) -> None:
        """Keep what is shown as it is. What arrives meanwhile is kept too, and shown afterwards."""
        self._held = self._latest() if on else None

    def curves(self) -> list[Curve]:
        """What is chosen."""
        samples = self._held or self._latest()
        times = (samples.times - samples.times[-1]) * 1e-9 if len(samples.times) else np.empty(0)
        return [self._curve(name, times, samples) for name in self.chosen]

    def csv(self) -> str:
        """What is shown, as a table: the robot's time in s, then a column a signal, named with its unit."""
        samples, curves = self._held or self._latest(), self.curves()
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["time [s]", *(f"{curve.name} [{curve.unit}]" for curve in curves)])
        times = (samples.times - samples.times[-1]) * 1e-9 if len(samples.times) else np.empty(0)
        columns = [_at(curve, times) for curve in curves]
        for k, time_ns in enumerate(samples.times):
            values = ("" if np.isnan(column[k]) else f"{column[k]:.6g}" for column in columns)
            table.writerow([f"{time_ns * 1e-9:.4f}", *values])
        return text.getvalue()

    def _latest(self) -> _Samples:
        """The samples that are no older than `SPAN_S`."""
        order = np.arange(self._next - self._count, self._next) % _ROWS
        times = self._times[order]
        if len(times):
            order = order[times >= times[-1] - round(SPAN_S * 1e9)]
        ports = {name: self._ports.samples(name) for name in self.chosen if name.startswith(PREFIX)}
        return _Samples(self._times[order], self._values[order], ports)

    def _curve(self, name: str, times: np.ndarray, samples: _Samples) -> Curve:
        joints, values = len(self._joints), samples.values
        if name.startswith(PREFIX):
            told, numbers = samples.ports.get(name, (np.empty(0, np.int64), np.empty(0)))
            newest = samples.times[-1] if len(samples.times) else 0
            recent = (told >= newest - round(SPAN_S * 1e9)) & (told <= newest)
            return Curve(name, self._ports.unit(name), (told[recent] - newest) * 1e-9, numbers[recent])
        if name in _FORCES:
            return Curve(name, "N", times, values[:, 4 * joints + _FORCES.index(name)])
        joint, _, quantity = name.rpartition(".")
        unit, factor = QUANTITIES[quantity]
        column, kinds = self._joints.index(joint), ("position", "velocity", "torque", "command")
        if quantity == "error":
            return Curve(name, unit, times, (values[:, column] - values[:, 3 * joints + column]) * factor)
        return Curve(name, unit, times, values[:, kinds.index(quantity) * joints + column] * factor)


def _at(curve: Curve, times: np.ndarray) -> np.ndarray:
    """A curve's values at other times, each as long as it stood; NaN before the first."""
    if not curve.name.startswith(PREFIX):
        return curve.values
    place = np.searchsorted(curve.times, times + 1e-9, side="right") - 1
    return np.where(place >= 0, curve.values[np.maximum(place, 0)] if len(curve.values) else np.nan, np.nan)
