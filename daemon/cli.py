"""`handrail daemon`, `hardware` and `safety ...`: what the robot that is up says of its loop, its drives, and what holds it."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import typer

from handrail.keepalive import Keepalive
from handrail.messages import (
    Base,
    DaemonStatus,
    GetBase,
    GetHardware,
    GetSafety,
    GetStatus,
    GetTiming,
    HardwareComponent,
    HardwareStatus,
    LoopTiming,
    SafetyReport,
    SafetyRule,
    SetSpeed,
    Tared,
    TareSensor,
    TimeDistribution,
)
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError

daemon = typer.Typer(help="The control daemon.", no_args_is_help=True, add_completion=False)
safety = typer.Typer(help="Safety rules.", no_args_is_help=True, add_completion=False)
hardware = typer.Typer(help="Drives and devices.", no_args_is_help=True, add_completion=False)

RUNTIME = typer.Option(help="The robot's runtime folder.", show_default="$HANDRAIL_RUNTIME, else this user's")
_ROWS, _BAR = 16, 32
"""of a printed histogram: at most so many rows where that is finer than octaves; width of its longest bar"""


@daemon.callback()
def _daemon() -> None:
    """The control daemon of the robot that is up (docs/architecture.md)."""


@hardware.callback()
def _hardware() -> None:
    """The drives and devices of the robot that is up."""


@safety.callback()
def _safety() -> None:
    """What holds the robot that is up, and why (docs/safety.md)."""


@daemon.command()
def stats(
    json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON, with every bin.")] = False,
    reset: Annotated[bool, typer.Option("--reset", help="Then count anew.")] = False,
    runtime: Annotated[Path | None, RUNTIME] = None,
) -> None:
    """How long the loop's cycles work, how late they start, and how many periods they missed, since its start."""
    timing: LoopTiming = ask("daemon stats", GetTiming(reset=reset), runtime)
    if json:
        print(msgspec.json.format(msgspec.json.encode(timing), indent=1).decode())
        return
    clock = {"wall": "wall clock", "lockstep": "lock-step"}[timing.clock]
    print(f"{timing.cycles} cycles of {timing.period_us:g} µs, {clock}")
    print(f"{timing.misses} periods missed, at most {timing.longest_run} in a row")
    print(f"overrun: {timing.overrun_policy}")
    told = [("work", timing.work), ("lateness", timing.late)]
    told = [(name, of) for name, of in told if any(of.counts)]
    if told:
        heads = ("µs", "p50", "p90", "p99", "max")
        rows = [(name, *(f"{t:.1f}" for t in (of.p50_us, of.p90_us, of.p99_us, of.max_us))) for name, of in told]
        print("", *aligned([heads, *rows]), sep="\n")
    for name, of in told:
        print("", name, *_histogram(of, timing.edges_us), sep="\n")


@daemon.command()
def base(
    json: Annotated[bool, typer.Option("--json", help="Print the message as JSON.")] = False,
    runtime: Annotated[Path | None, RUNTIME] = None,
) -> None:
    """Where the robot's base is in the world, what tells that, and which feet hold.

    Exit status 1: nothing tells where it is.
    """
    told: Base = ask("daemon base", GetBase(), runtime)
    if json:
        print(msgspec.json.format(msgspec.json.encode(told), indent=1).decode())
    else:
        print(*_based(told), sep="\n")
    if told.source == "none":
        sys.exit(1)


@daemon.command()
def speed(
    percent: Annotated[float | None, typer.Argument(min=10.0, max=100.0, help="Of the speed as planned.")] = None,
    action: Annotated[str, typer.Option(help="One action's id; left out: every motion, until it is set anew.")] = "",
    runtime: Annotated[Path | None, RUNTIME] = None,
) -> None:
    """Set how fast motions run, in mid-motion too, within the joints' limits (docs/timing.md); without a number, print it."""
    if percent is not None:
        ask("daemon speed", SetSpeed(share=percent / 100.0, id=action), runtime)
    if not action:
        told: DaemonStatus = ask("daemon speed", GetStatus(), runtime)
        print(f"motions run at {told.speed * 100:.4g} % of the planned speed")


@hardware.command()
def status(runtime: Annotated[Path | None, RUNTIME] = None) -> None:
    """Every drive and device: life in ros2_control's words, CiA 402 state, error, heat, age, versions, channel, its state.

    Exit status 1: something is wrong with one of them, which is then said below.
    """
    told: HardwareStatus = ask("hardware status", GetHardware(), runtime)
    heads = ("component", "family", "channel", "bus", "life", "state", "error", "°C", "age", "firmware", "protocol")
    print(*aligned([heads, *map(_row, told.components)]), sep="\n")
    if wrong := [f"{part.name}: {part.problem}" for part in told.components if part.problem]:
        sys.exit("\n".join(f"handrail hardware status: {line}" for line in wrong))


@hardware.command()
def tare(
    sensor: Annotated[str, typer.Argument(help="A force-torque sensor, as `status` names it.")],
    runtime: Annotated[Path | None, RUNTIME] = None,
) -> None:
    """Let a force-torque sensor forget its offset, while the robot stands and nothing touches what the sensor carries."""
    told: Tared = ask("hardware tare", TareSensor(sensor=sensor), runtime)
    print(f"{told.sensor}: {told.offset:.3f} N off, forgotten until the loop ends")
    print("If anything touched it softly (less than 5 N, 1 N·m), that was forgotten, too: free it and tare again.")


@safety.command()
def explain(
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
    runtime: Annotated[Path | None, RUNTIME] = None,
) -> None:
    """Which safety rule holds the robot now, why, and how to recover; then what else has tripped since the loop's start.

    Exit status 1: a rule holds the robot.
    """
    told: SafetyReport = ask("safety explain", GetSafety(), runtime)
    if json:
        print(msgspec.json.format(msgspec.json.encode(told), indent=1).decode())
    else:
        print(*_explained(told), sep="\n")
    if any(rule.holds for rule in told.rules):
        sys.exit(1)


@safety.command()
def keepalive(
    owner: Annotated[str, typer.Argument(help="Whose actions it binds, as in StartAction.owner.")],
    timeout: Annotated[float, typer.Option(min=0.1, max=60.0, help="s that the daemon waits for an answer.")] = 1.0,
    runtime: Annotated[Path | None, RUNTIME] = None,
) -> None:
    """Keep an owner alive while this runs; when it is killed, hangs or loses the robot, that holds, settles, and is damped.

    Ctrl-C lets the robot go: it is no longer bound.
    """
    try:
        place = Runtime.at(runtime, make=False)
        place.robot_up()
        with closing(Caller(place.endpoint("daemon.call"), timeout_s=timeout)) as caller:
            with Keepalive(caller.call, owner, timeout) as kept, contextlib.suppress(KeyboardInterrupt):
                print(f"{owner} is kept alive: Ctrl-C lets the robot go", flush=True)
                kept.wait()
            if kept.lost:
                sys.exit(f"handrail safety keepalive: {kept.lost}")
    except (OSError, ValueError, RefusedError) as error:
        sys.exit(f"handrail safety keepalive: {error}")


@safety.command()
def leases(runtime: Annotated[Path | None, RUNTIME] = None) -> None:
    """Who has taken which part of the body: nobody else may command it."""
    told: DaemonStatus = ask("safety leases", GetStatus(), runtime)
    rows = [(lease.part, lease.owner, str(lease.epoch)) for lease in told.leases]
    print(*(aligned([("part", "owner", "epoch"), *rows]) if rows else ["every part is free"]), sep="\n")


_TELLS = {
    "feet": "by its feet and the inertial sensor",
    "still": "it hangs still: no foot holds, and the inertial sensor says that it does not move",
    "inertial": "by the inertial sensor alone, no foot holds: errors grow",
}
"""Base.source → what that means"""


def _based(told: Base) -> list[str]:
    if told.source == "fixed":
        return ["the base is fixed: its frame is the world's"]
    since = f"for {(told.time_ns - told.since_ns) * 1e-9:.1f} s"
    x, y, z = told.pose_in_world.position
    i, j, k, w = told.pose_in_world.orientation
    angles = (
        math.atan2(2 * (w * i + j * k), 1 - 2 * (i * i + j * j)),
        math.asin(max(-1.0, min(1.0, 2 * (w * j - i * k)))),
        math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)),
    )
    roll, pitch, yaw = map(math.degrees, angles)
    place = f"x {x:.3f}  y {y:.3f}  z {z:.3f} m  roll {roll:.2f}  pitch {pitch:.2f}  yaw {yaw:.2f}°"
    if told.source == "none":
        lines = [f"nobody knows where the base is, {since}: {told.problem}", f"  last known  {place}"]
    else:
        error = f"± {told.position_deviation * 1e3:.1f} mm, {math.degrees(told.orientation_deviation):.2f}°"
        speed = math.hypot(*told.linear_velocity), math.degrees(math.hypot(*told.angular_velocity))
        lines = [f"{place}  ({error})", f"  moves  {speed[0]:.3f} m/s, {speed[1]:.2f} °/s"]
        lines.append(f"  told   {_TELLS[told.source]}, {since}")
    heads = ("foot", "holds", "N up", "N along x", "N along y")
    rows = [
        (foot.name, "yes" if foot.holds else "no", *(str(round(foot.force[i])) for i in (2, 0, 1)))
        for foot in told.feet
    ]
    return [*lines, "", *aligned([heads, *rows])] if rows else lines


def _explained(told: SafetyReport) -> list[str]:
    holding = [rule for rule in told.rules if rule.holds]
    lines = []
    for rule in holding:
        lines += [f"{told.robot} is {told.state}, held by {_tripped(rule, told.time_ns)}"]
        lines += [f"  does     {rule.does}", f"  recover  {rule.recover}"]
    if not holding:
        lines.append(f"{told.robot} is {told.state}: no safety rule holds it")
        if told.state == "inactive":
            lines.append("  nobody has enabled it: its drives take no set-points and its brakes are closed")
    if before := [rule for rule in told.rules if not rule.holds]:
        lines += ["", "tripped before, since the loop's start:"]
        lines += [f"  {_tripped(rule, told.time_ns)}, {rule.times} in all" for rule in before]
    return lines


def _tripped(rule: SafetyRule, now_ns: int) -> str:
    detail = f" ({rule.detail})" if rule.detail else ""
    return f"{rule.rule}{detail}, {(now_ns - rule.last_time_ns) * 1e-9:.1f} s ago"


def _row(part: HardwareComponent) -> tuple[str, ...]:
    heat = "–" if part.temperature is None else f"{part.temperature:.1f}"
    numbers = (part.age, part.firmware_version, part.protocol_version)
    error = str(part.error) if part.error else "–"
    age, firmware, protocol = ("–" if number is None else str(number) for number in numbers)
    words = (part.family, part.channel, part.bus_state or "–", part.life, part.state or "–")
    return (part.name, *words, error, heat, age, firmware, protocol)


def ask(verb: str, call: msgspec.Struct, runtime: Path | None) -> Any:
    """The daemon's answer; exits with one line when there is none."""
    try:
        place = Runtime.at(runtime, make=False)
        if not (place.folder / "daemon.call").exists():  # spares the wait for an answer
            place.robot_up()
        with closing(Caller(place.endpoint("daemon.call"), timeout_s=2.0)) as caller:
            return caller.call(call)
    except (OSError, ValueError, RefusedError) as error:
        sys.exit(f"handrail {verb}: {error}")


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of words as lines, the columns below each other: numbers to the right, names to the left."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    right = [any(cell[:1].isdigit() for cell in column[1:]) for column in columns]
    return [
        "  ".join(
            f"{cell:>{w}}" if r else f"{cell:<{w}}" for cell, w, r in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in rows
    ]


def _histogram(of: TimeDistribution, edges_us: Sequence[float]) -> list[str]:
    """A bar for each group of bins from the shortest time that there was to the longest, as fine as `_ROWS` allow."""
    counts = np.array(of.counts)
    lower, upper = [0.0, *edges_us], [*edges_us, np.inf]
    first, last = np.flatnonzero(counts)[[0, -1]]
    # The first bin holds what is below all octaves: groups never mix it with them.
    width = next((w for w in (1, 2, 4, 8) if (last - 1) // w - (first - 1) // w < _ROWS), 8)
    rows, sums = [], []
    for group in range((first - 1) // width, (last - 1) // width + 1):
        start, end = (group * width + 1, min((group + 1) * width, len(counts) - 1)) if group >= 0 else (0, 0)
        sums.append(int(counts[start : end + 1].sum()))
        beyond = "" if np.isinf(upper[end]) else f"{upper[end]:.4g}"
        rows.append((f"{lower[start]:.4g}", "…", beyond))
    shown = [f"{count} {100 * count / counts.sum():6.2f} %" for count in sums]
    bars = ["█" * max(round(_BAR * count / max(sums)), count > 0) for count in sums]
    cells = [(*row, share.rjust(max(map(len, shown))), bar) for row, share, bar in zip(rows, shown, bars, strict=True)]
    return aligned([("from", "", "to µs", "cycles", ""), *cells])
