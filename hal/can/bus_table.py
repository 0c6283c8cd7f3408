"""Tables of a bus for people: how loaded it is, by which identifiers, and how its nodes fare."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from hal.can.control import BusReport, ChannelState, NodeState

_STATE_STYLE = {"error_active": "green", "error_passive": "yellow", "bus_off": "bold red", "cut": "bold red"}
_FULL = 0.8
"""share of a bus's time above which it is shown as too full for frames to come in time"""

Name = Callable[[int, bool], str]
"""(identifier, extended) → what the DBC calls the message, "" where it has none"""


@dataclass(frozen=True)
class Rate:
    """One identifier between two reports; None where the bus's clock stood still."""

    can_id: int
    extended: bool
    total: int
    per_s: float | None
    load: float | None


def rates(report: BusReport, before: BusReport | None) -> dict[str, list[Rate]]:
    """Channel → its identifiers, the one that costs most first."""
    passed = (report.time_ns - before.time_ns) * 1e-9 if before else 0.0
    past = {
        (channel.name, of.can_id, of.extended): of
        for channel in (before.channels if before else [])
        for of in channel.identifiers
    }
    found: dict[str, list[Rate]] = {}
    for channel in report.channels:
        rows = []
        for of in channel.identifiers:
            old = past.get((channel.name, of.can_id, of.extended))
            frames, busy = of.frames - (old.frames if old else 0), of.busy_ns - (old.busy_ns if old else 0)
            moving = passed > 0.0
            rows.append(
                Rate(
                    of.can_id,
                    of.extended,
                    of.frames,
                    frames / passed if moving else None,
                    busy * 1e-9 / passed if moving else None,
                )
            )
        # Where nothing is known of now, what has cost most so far.
        cost = {(of.can_id, of.extended): of.busy_ns for of in channel.identifiers}
        rows.sort(key=lambda row: (-(row.load or 0.0), -cost[row.can_id, row.extended], row.can_id))
        found[channel.name] = rows
    return found


def channel_load(report: BusReport, before: BusReport | None, channel: ChannelState) -> float:
    """Share of the time in use between the two reports, or the hub's own figure where there is only one."""
    old = next((c for c in before.channels if c.name == channel.name), None) if before else None
    if before is None or old is None or report.time_ns <= before.time_ns:
        return channel.load
    return (channel.busy_ns - old.busy_ns) / (report.time_ns - before.time_ns)


def as_json(report: BusReport, before: BusReport | None) -> bytes:
    """The report with each channel's `load` and each identifier's `frames_per_s` and `load` between the two, as JSON."""
    document: dict[str, Any] = msgspec.to_builtins(report, str_keys=True)
    document.pop("type", None)
    by_channel = rates(report, before)
    for channel, told in zip(document["channels"], report.channels, strict=True):
        channel["load"] = channel_load(report, before, told)
        known = {(row.can_id, row.extended): row for row in by_channel[told.name]}
        for of in channel["identifiers"]:
            row = known[of["can_id"], of["extended"]]
            of["frames_per_s"], of["load"] = row.per_s, row.load
    return msgspec.json.format(msgspec.json.encode(document), indent=2)


def _count(number: int | None) -> str:
    return "-" if number is None else str(number)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"


def _channels(report: BusReport, before: BusReport | None) -> Table:
    table = Table(title="channels", title_justify="left", box=None, pad_edge=False)
    for heading in ("channel", "bit/s", "data bit/s", "load", "", "frames", "error frames"):
        table.add_column(heading, justify="left" if heading in ("channel", "") else "right")
    for channel in report.channels:
        load = channel_load(report, before, channel)
        bar = Text("█" * round(20 * min(1.0, load)), style="red" if load > _FULL else "green")
        table.add_row(
            channel.name, f"{channel.bitrate:,}", f"{channel.data_bitrate:,}",
            Text(_percent(load), style="bold red" if load > _FULL else ""), bar,
            f"{channel.frames:,}", Text(f"{channel.error_frames:,}", style="red" if channel.error_frames else ""),
        )  # fmt: skip
    return table


def _identifiers(report: BusReport, before: BusReport | None, name: Name, most: int | None) -> Table:
    table = Table(title="identifiers, by load", title_justify="left", box=None, pad_edge=False)
    for heading in ("channel", "identifier", "message", "frames/s", "load", "frames"):
        table.add_column(heading, justify="left" if heading in ("channel", "message") else "right")
    by_channel = rates(report, before)
    rows = [(channel, row) for channel, those in by_channel.items() for row in those]
    rows.sort(key=lambda pair: -(pair[1].load or 0.0))
    for channel, row in rows[:most]:
        shown = f"{row.can_id:08X}" if row.extended else f"{row.can_id:03X}"
        rate = "-" if row.per_s is None else f"{row.per_s:,.0f}"
        table.add_row(channel, shown, name(row.can_id, row.extended), rate, _percent(row.load), f"{row.total:,}")
    if most is not None and len(rows) > most:
        table.add_row("", "", f"... and {len(rows) - most} more (--all)")
    return table


def _nodes(nodes: list[NodeState], most: int | None) -> Table:
    table = Table(title="nodes", title_justify="left", box=None, pad_edge=False)
    for heading in ("node", "channel", "state", "TEC", "REC", "waiting", "overflows"):
        table.add_column(heading, justify="left" if heading in ("node", "channel", "state") else "right")
    # Those in trouble first.
    ordered = sorted(
        nodes,
        key=lambda node: (node.state == "error_active", -(node.transmit_errors or 0), -(node.receive_errors or 0)),
    )
    for node in ordered[:most]:
        style = _STATE_STYLE.get(node.state, "")
        table.add_row(
            node.name, node.channel, Text(node.state.replace("_", " "), style=style), _count(node.transmit_errors),
            _count(node.receive_errors), f"{node.waiting:,}", f"{node.overflows:,}",
        )  # fmt: skip
    if most is not None and len(nodes) > most:
        table.add_row(f"... and {len(nodes) - most} more (--all)")
    return table


def fault_table(report: BusReport) -> Table:
    """The faults on the bus, with how many frames each has hit."""
    table = Table(title="faults", title_justify="left", box=None, pad_edge=False)
    for heading in ("number", "fault", "hits"):
        table.add_column(heading, justify="left" if heading == "fault" else "right")
    for number, fault in report.faults.items():
        given = msgspec.to_builtins(fault)
        default = msgspec.to_builtins(type(fault)(kind=fault.kind))
        words = [f"{key} {value}" for key, value in given.items() if key != "kind" and value != default[key]]
        if fault.can_id is not None:
            words = [f"can_id {fault.can_id:#x}" if word.startswith("can_id ") else word for word in words]
        table.add_row(str(number), ", ".join([f"[bold]{fault.kind}[/]", *words]), str(report.hits.get(number, 0)))
    return table


def tables(
    report: BusReport, before: BusReport | None, name: Name, *, identifiers: int | None = None, nodes: int | None = None
) -> RenderableType:
    """Everything about the bus; `identifiers`, `nodes`: most rows of those tables (None: all)."""
    timing = "bit timing kept" if report.timing else "bit timing off (frames pass at once)"
    parts: list[RenderableType] = [
        Text(f"bus time {report.time_ns * 1e-9:.3f} s, {timing}"),
        _channels(report, before),
        _identifiers(report, before, name, identifiers),
    ]
    if report.nodes:
        parts.append(_nodes(report.nodes, nodes))
    if report.faults:
        parts.append(fault_table(report))
    spaced = [piece for part in parts for piece in (part, Text(""))]
    return Group(*spaced)
