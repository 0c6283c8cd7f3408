"""`handrail watch`: events of the robot that is up, those that were chosen, a line each."""

from __future__ import annotations

import contextlib
import sys
import time
from typing import Annotated, Any

import msgspec
import typer

from handrail.client import DEFAULT_ADDRESS, Part, Selection, Unreachable, connect
from handrail.link.codec import REMOTE_EVENTS
from handrail.link.keys import KeysError
from handrail.robot_option import ConnectTo, Keys


def watch(
    kinds: Annotated[
        list[str] | None, typer.Argument(help="Types of events, e.g. RunState LogLine; none: which there are.")
    ] = None,
    *,
    rate: Annotated[float, typer.Option(help="Hz, at most: the newest comes, what was in between is left out.")] = 0.0,
    fields: Annotated[str, typer.Option(help="Those that travel, comma-separated; none: all.")] = "",
    where: Annotated[
        list[str] | None,
        typer.Option(help="FIELD=PATTERN|PATTERN: only events that match, e.g. 'level=warning|error'."),
    ] = None,
    count: Annotated[int, typer.Option(min=0, help="End after so many, 0: never.")] = 0,
    robot: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Show events as JSON, a line each, until Ctrl-C; at the end, what they cost the link. Only what was chosen is sent.

    Exit status 1: there is no such type or field; 3: no robot.
    """
    if not kinds:
        for name, kind in sorted(REMOTE_EVENTS.items()):
            typer.echo(f"{name}: {', '.join(kind.__struct_fields__)}")  # type: ignore[attr-defined]
        return
    try:
        chosen = [_selection(name, rate, fields, where or []) for name in kinds]
        with connect(robot, keys) as client, client.subscribe(*chosen) as events:
            before, begin, seen = client.traffic[1], time.monotonic(), 0
            with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
                for event in events:
                    print(msgspec.json.encode(_shown(event)).decode(), flush=True)
                    seen += 1
                    if seen == count:
                        break
            took = max(time.monotonic() - begin, 1e-3)
            spent = client.traffic[1] - before
            typer.echo(f"{seen} events, {spent} bytes, {8 * spent / took / 1000:.1f} kbit/s", err=True)
    except (ValueError, KeysError, Unreachable) as problem:
        typer.echo(f"handrail watch: {problem}", err=True)
        sys.exit(3 if isinstance(problem, Unreachable) else 1)


def _selection(name: str, rate: float, fields: str, where: list[str]) -> Selection:
    if name not in REMOTE_EVENTS:
        raise ValueError(f"got {name!r}, no type of events; expected some of {', '.join(sorted(REMOTE_EVENTS))}")
    pairs = [each.partition("=") for each in where]
    if odd := next((each for (_, equals, _), each in zip(pairs, where, strict=True) if not equals), None):
        raise ValueError(f"--where: got {odd!r}; expected FIELD=PATTERN")
    chosen = tuple(each.strip() for each in fields.split(",") if each.strip())
    return Selection(REMOTE_EVENTS[name], rate, chosen, {key: tuple(text.split("|")) for key, _, text in pairs})


def _shown(event: Any) -> Any:
    return {"type": event.kind, **event.values} if isinstance(event, Part) else event
