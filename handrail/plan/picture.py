"""A plan as a picture (matplotlib, to a file): joints, clearance, margins, residual, torque over time, the tool's way in space."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handrail.messages import PlanPreview, PlanSeries, PlanWaypoint
from handrail.plan.words import WORST_COLOUR, asked_for, figure_of, short, worst_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PAPER: Any = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
_MOVED = 0.005
"""rad, a joint that moves less is left out"""
_MUTED, _LINE = "#6b7680", "#c9d0d6"


def draw(plan: PlanPreview, png: Path) -> None:
    """Draw a plan with its details (`GetPlan(details=True)`) to a file. Raises ValueError when there are none, or no ghost."""
    if not plan.segments or not plan.measures:
        raise ValueError(f"plan {plan.id}: has no ghost or no measures to draw; expected a plan with its details")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 10.5), layout="constrained")
    left, right = _split(figure, 1, 2, width_ratios=(1.55, 1.0))
    rows: list[Axes] = list(left.subplots(5, 1, sharex=True, height_ratios=(2.4, 1.5, 1.1, 1.1, 1.4)))
    _joints(rows[0], plan)
    _nearest(rows[1], plan, "clearance", 1000.0, "clearance, mm")
    _nearest(rows[2], plan, "limit_margin", 180.0 / math.pi, "margin to a\njoint limit, °")
    _residual(rows[3], plan)
    _nearest(rows[4], plan, "torque_share", 100.0, "torque,\n% of the limit")
    rows[-1].set_xlabel("time, s")
    for axes in rows:
        axes.grid(alpha=0.25)
        axes.margins(x=0.01)
        axes.spines[["top", "right"]].set_visible(False)
        for waypoint in plan.waypoints[:-1]:
            axes.axvline(waypoint.time, color=_LINE, linewidth=1, zorder=0)
    _names(rows[0], plan)

    above, below = _split(right, 2, 1, height_ratios=(1.75, 1.0))
    _space(above.add_subplot(projection="3d"), plan)
    _table(below.subplots(), plan)
    state = "fresh" if plan.fresh else f"stale: {plan.stale_because}"
    title = f"{plan.label}, {plan.arm} arm, {plan.duration:.2f} s   ({plan.id}, {short(state, 110)})"
    figure.suptitle(title, fontsize=13, color="black" if plan.fresh else WORST_COLOUR, x=0.01, ha="left")
    figure.savefig(png, dpi=110)


def _split(figure: Any, rows: int, columns: int, **ratios: tuple[float, float]) -> tuple[Any, Any]:
    first, second = figure.subfigures(rows, columns, **ratios)
    return first, second


def knots(plan: PlanPreview) -> tuple[np.ndarray, np.ndarray]:
    """All segments one after the other: (k,) s from the plan's start, (k, m) rad."""
    times, start = [], 0.0
    for segment in plan.segments:
        times.append(np.asarray(segment.times) + start)
        start = float(times[-1][-1])
    return np.concatenate(times), np.vstack([segment.positions for segment in plan.segments])


def _joints(axes: Axes, plan: PlanPreview) -> None:
    times, positions = knots(plan)
    for row in np.flatnonzero(np.ptp(positions, axis=0) > _MOVED):
        name = plan.joints[row]
        axes.plot(times, np.degrees(positions[:, row]), color=_colour(plan, name, 0), linewidth=1.6, label=name)
    axes.set_ylabel("joint position, °")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)


def _colour(plan: PlanPreview, who: str, number: int) -> str:
    """A joint's colour is the same in every plot."""
    return f"C{(plan.joints.index(who) if who in plan.joints else number) % 10}"


def _names(axes: Axes, plan: PlanPreview) -> None:
    begin = 0.0
    for number, waypoint in enumerate(plan.waypoints):
        # Short segments stand beside each other: every other name is a line higher.
        lift, middle = 1.02 + 0.075 * (number % 2), (begin + waypoint.time) / 2
        axes.text(
            middle, lift, waypoint.name, transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=9
        )
        begin = waypoint.time


def _nearest(axes: Axes, plan: PlanPreview, name: str, factor: float, label: str) -> None:
    """A measure, its area coloured by what it is about, the worst sample with its words."""
    axes.set_ylabel(label)
    series = plan.measures.get(name)
    if series is None or not series.values:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", va="center", color=_MUTED)
        return
    times, values = np.array(series.times), factor * np.array(series.values)
    axes.plot(times, values, color="#30363c", linewidth=1.2, zorder=3)
    for number, who in enumerate(series.names):
        about = np.array(series.which) == number
        # An area from a sample of its own to the next one, so that nothing is left white where it changes.
        reached = about | np.concatenate([[False], about[:-1]])
        shade: Any = {"color": _colour(plan, who, number), "alpha": 0.4, "linewidth": 0}
        axes.fill_between(times, 0.0, values, where=reached.tolist(), label=who, **shade)
    row = int(values.argmin() if name != "torque_share" else values.argmax())
    axes.plot(times[row], values[row], "o", color=WORST_COLOUR, markersize=6, zorder=4)
    right = times[row] > 0.6 * plan.duration
    axes.annotate(
        figure_of(name, series.values[row]),
        (float(times[row]), float(values[row])),
        xytext=(-8 if right else 8, 7),
        textcoords="offset points",
        ha="right" if right else "left",
        fontsize=9,
        color=WORST_COLOUR,
        fontweight="bold",
        bbox=_PAPER,
        zorder=5,
    )
    axes.set_ylim(bottom=min(0.0, float(values.min()) * 1.15), top=float(values.max()) * 1.25 or 1.0)
    if series.names:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)


def _residual(axes: Axes, plan: PlanPreview) -> None:
    axes.set_ylabel("tool from\nits goal, mm")
    series = plan.measures.get("residual")
    if series is None:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", va="center", color=_MUTED)
        return
    axes.plot(series.times, 1000 * np.array(series.values), ".", color="#30363c", markersize=5)
    axes.set_ylim(bottom=0.0, top=max(0.1, 1300 * max(series.values)))
    if tilt := plan.measures.get("tilt"):
        other = axes.twinx()
        other.plot(tilt.times, np.degrees(tilt.values), "+", color="C1", markersize=5)
        other.set_ylabel("tilt, °", color="C1")
        other.set_ylim(bottom=0.0, top=max(0.1, 1.3 * math.degrees(max(tilt.values))))
        other.spines[["top"]].set_visible(False)


def _space(axes: Any, plan: PlanPreview) -> None:
    """The tool's way, coloured by clearance, its waypoints by name, the instances as frames."""
    axes.set_title("way of the tool's tip in the world, m", fontsize=10)
    tool = np.array(plan.tool)
    if not len(tool):
        return
    times = knots(plan)[0]
    dense = np.linspace(0.0, times[-1], 240)
    way = np.column_stack([np.interp(dense, times, column) for column in tool.T])
    near = _at(plan.measures.get("clearance"), dense)
    axes.plot(*way.T, color=_LINE, linewidth=1)
    shown = axes.scatter(*way.T, c=1000 * near, cmap="RdYlGn", s=9, vmin=0.0, vmax=max(60.0, float(1000 * near.min())))
    axes.figure.colorbar(shown, ax=axes, shrink=0.55, pad=0.1, label="clearance, mm")
    for waypoint in plan.waypoints:
        place = np.array([np.interp(waypoint.time, times, column) for column in tool.T])
        axes.plot(*[[value] for value in place], "o", color="#1f3a5f", markersize=5)
    begin = tool[0]
    axes.plot(*[[value] for value in begin], "s", color="black", markersize=6)
    axes.text(*begin, "  start", fontsize=8)
    lift = 0.05 * float(np.ptp(np.vstack([way, tool]), axis=0).max())
    for place, words in _places(plan, tool, times):
        axes.text(
            place[0], place[1], place[2] + lift, words, fontsize=9, fontweight="bold", color="#1f3a5f", ha="center"
        )
    from scipy.spatial.transform import Rotation

    size = max(0.06, 0.25 * float(np.ptp(way, axis=0).max()))
    for instance in plan.origin.instances if plan.origin else []:
        pose = instance.pose_in_world
        origin, axis = np.array(pose.position), Rotation.from_quat(pose.orientation).as_matrix()
        for column, colour in zip(axis.T, ("tab:red", "tab:green", "tab:blue"), strict=True):
            axes.plot(*np.column_stack([origin, origin + size * column]), color=colour, linewidth=2)
        axes.text(*origin, f"  {instance.name}", fontsize=9, fontweight="bold")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_box_aspect(None, zoom=1.4)
    axes.tick_params(labelsize=7)
    axes.view_init(elev=22, azim=-125)
    for name in "xyz":
        getattr(axes, f"set_{name}label")(name, fontsize=8)


def _places(plan: PlanPreview, tool: np.ndarray, times: np.ndarray) -> list[tuple[np.ndarray, str]]:
    """Where waypoints are, with the numbers of all that are there: they may share a place."""
    found: list[tuple[np.ndarray, str]] = []
    for count, waypoint in enumerate(plan.waypoints, start=1):
        place = np.array([np.interp(waypoint.time, times, column) for column in tool.T])
        for number, (there, words) in enumerate(found):
            if np.linalg.norm(place - there) < 0.02:
                found[number] = (there, f"{words},{count}")
                break
        else:
            found.append((place, str(count)))
    return found


def _at(series: PlanSeries | None, times: np.ndarray) -> np.ndarray:
    return np.zeros(len(times)) if series is None else np.interp(times, series.times, series.values)


def _table(axes: Axes, plan: PlanPreview) -> None:
    """The waypoints' figures, the worst of each column in red, and what the plan was made from."""
    axes.set_axis_off()
    columns = ["", "waypoint", "at, s", "off, mm", "clear, mm", "margin, °", "torque, %"]
    rows = [[str(number), *_cells(waypoint)] for number, waypoint in enumerate(plan.waypoints, start=1)]
    table = axes.table(cellText=rows, colLabels=columns, loc="upper center", cellLoc="right", edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.auto_set_column_width(list(range(len(columns))))
    table.scale(1.0, 1.35)
    for row in range(len(rows) + 1):
        table[row, 1].get_text().set_horizontalalignment("left")
    for column in range(len(columns)):
        table[0, column].get_text().set_color(_MUTED)
    for column, name in ((3, "residual"), (4, "clearance"), (5, "limit_margin"), (6, "torque_share")):
        worst = worst_of(plan, name)
        if worst is not None and len(plan.waypoints) > 1:
            text = table[plan.waypoints.index(worst) + 1, column].get_text()
            text.set_color(WORST_COLOUR)
            text.set_fontweight("bold")
    axes.text(0.0, 0.0, "\n".join(_origin(plan)), transform=axes.transAxes, fontsize=8.5, va="bottom", color="#30363c")


def _cells(waypoint: PlanWaypoint) -> list[str]:
    def cell(value: float | None, factor: float, decimals: int) -> str:
        return "–" if value is None else f"{factor * value:.{decimals}f}"

    clearance, margin, torque = waypoint.clearance, waypoint.limit_margin, waypoint.torque_share
    return [
        waypoint.name,
        f"{waypoint.time:.2f}",
        cell(waypoint.residual, 1000.0, 2),
        cell(clearance.value if clearance else None, 1000.0, 0),
        cell(margin.value if margin else None, 180.0 / math.pi, 1),
        cell(torque.value if torque else None, 100.0, 0),
    ]


def _origin(plan: PlanPreview) -> list[str]:
    origin = plan.origin
    if origin is None:
        return []
    lines = [f"asked for: {asked_for(origin)}"]
    lines += [
        f"{instance.name}: {instance.template} {instance.template_hash[:8]}, version {instance.version}, at "
        f"({', '.join(f'{value:.3f}' for value in instance.pose_in_world.position)}) m"
        for instance in origin.instances
    ]
    lines.append(
        f"made at {origin.time_ns / 1e9:.3f} s of the robot's clock{f', by {origin.run}' if origin.run else ''}"
    )
    return lines
