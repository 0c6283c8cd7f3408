"""Pictures of a recording and of many runs (matplotlib, drawn to files)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from handrail.demo.report import Row
from handrail.demo.verdict import FORCE_LIMIT_N, NEEDED_DEG

_MOVED = 0.02
"""rad, a joint that moves less is left out of the plot"""


@dataclass(frozen=True)
class Joints:
    """Joints over a recording, with one row a sample."""

    names: tuple[str, ...]
    time_s: np.ndarray
    """(k,) from the first sample"""
    measured: np.ndarray
    """(k, n) rad"""
    commanded: np.ndarray
    """(k, n) rad"""


def read_joints(recording: Path) -> Joints:
    """Measured and commanded positions from a recording. Raises ValueError when it has none."""
    series: dict[str, dict[int, list[float]]] = {"/joint_states": {}, "/joint_commands": {}}
    names: tuple[str, ...] = ()
    with recording.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(topics=list(series)):
            joints = json.loads(message.data)["joints"]
            names = tuple(joint["name"] for joint in joints)
            series[channel.topic][message.log_time] = [joint["position"] for joint in joints]
    measured, commanded = series["/joint_states"], series["/joint_commands"]
    both = sorted(measured.keys() & commanded.keys())
    if not both:
        raise ValueError(f"{recording}: has no joint states; was the daemon up while it was recorded?")
    return Joints(
        names,
        (np.array(both) - both[0]) * 1e-9,
        np.array([measured[stamp] for stamp in both]),
        np.array([commanded[stamp] for stamp in both]),
    )


def tracking(recording: Path, out: Path) -> None:
    """Draw how the joints that moved followed their commands. Raises ValueError when the recording has no joint states."""
    from matplotlib.figure import Figure

    joints = read_joints(recording)
    moved = np.flatnonzero(np.ptp(joints.commanded, axis=0) > _MOVED)
    figure = Figure(figsize=(11, 7), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    for row, joint in enumerate(moved):
        colour = f"C{row % 10}"
        above.plot(joints.time_s, joints.measured[:, joint], color=colour, linewidth=1.2, label=joints.names[joint])
        above.plot(joints.time_s, joints.commanded[:, joint], color=colour, linewidth=0.8, linestyle="--")
        error = 1000 * (joints.measured[:, joint] - joints.commanded[:, joint])
        below.plot(joints.time_s, error, color=colour, linewidth=0.8)
    above.set_ylabel("joint position, rad\n(solid measured, dashed commanded)")
    below.set_ylabel("measured − commanded, mrad")
    below.set_xlabel("time, s")
    above.set_title("Joint tracking under impedance control (what is left is what the valve pushes back)")
    if len(moved):
        above.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.savefig(out, dpi=120)


def seeds(rows: Sequence[Row], out: Path) -> None:
    """Draw what each seed turned, and how hard it pressed at most."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    places = np.arange(len(rows))
    colours = ["tab:green" if row.success else "tab:red" for row in rows]
    above.bar(places, [row.turned_deg for row in rows], color=colours)
    above.axhline(NEEDED_DEG, color="black", linewidth=1, linestyle="--", label=f"needed: {NEEDED_DEG:g}°")
    above.set_ylabel("turned, degrees")
    below.bar(places, [row.peak_force_n for row in rows], color=colours)
    below.axhline(FORCE_LIMIT_N, color="black", linewidth=1, linestyle="--", label=f"limit: {FORCE_LIMIT_N:g} N")
    below.set_ylabel("peak contact force, N")
    below.set_xlabel("seed")
    below.set_xticks(places, [str(row.seed) for row in rows])
    for axes in (above, below):
        axes.grid(axis="y", alpha=0.3)
        axes.legend(loc="lower right", fontsize=8)
    above.set_title(f"The valve turned: {sum(row.success for row in rows)} of {len(rows)} seeds")
    figure.savefig(out, dpi=120)
