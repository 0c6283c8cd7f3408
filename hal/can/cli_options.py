"""What the verbs of `handrail can` have in common: their options, the bus that these name, and how problems are said."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NoReturn

import can
import typer

from hal.can.interface import HandrailBus
from handrail.config import ConfigError

Channels = Annotated[
    str | None, typer.Argument(help="A channel, or several with commas between.", show_default="all channels")
]
RuntimeFolder = Annotated[
    Path | None,
    typer.Option("--runtime", help="The robot's runtime folder.", show_default="$HANDRAIL_RUNTIME, else this user's"),
]
Interface = Annotated[
    str,
    typer.Option("--interface", "-i", help="A real bus instead: python-can's name, e.g. socketcan (see `interfaces`)."),
]
BitRate = Annotated[int, typer.Option("--bitrate", min=1, help="Of a real bus, bit/s.")]
DataBitRate = Annotated[int, typer.Option("--data-bitrate", min=1, help="Of a real bus's data phase, bit/s.")]
Filter = Annotated[
    list[str] | None,
    typer.Option("--filter", "-f", help="Only identifiers that match: ID:MASK in hex, e.g. 200:7C0. Repeatable."),
]
DbcFile = Annotated[
    Path | None,
    typer.Option(
        "--dbc", help="The DBC to read frames by.", show_default="those of all drive families", dir_okay=False
    ),
]


def fail(verb: str, problem: object) -> NoReturn:
    sys.exit(f"handrail can {verb}: {problem}")


@contextmanager
def in_words(verb: str) -> Iterator[None]:
    """What goes wrong becomes one line for people and exit status 1."""
    try:
        yield
    except (ValueError, OSError, can.CanError, ConfigError) as error:
        fail(verb, error)


def open_bus(
    channel: str | None,
    interface: str,
    rates: tuple[int, int],
    runtime: Path | None,
    program: str,
    filters: list[str] | None = None,
) -> can.BusABC:
    """The bus that the options name. Raises ValueError, BusLost, can.CanError."""
    wanted = [parse_filter(text) for text in filters or []]
    bus: can.BusABC
    if interface == "handrail":
        bus = HandrailBus(channel, runtime=runtime, timeout=1.0, name=f"{program}-{os.getpid()}")
    else:
        from hal.can import real_port

        if channel is None:
            raise ValueError(
                f"--interface {interface}: the channel is missing; `handrail can interfaces` lists what there is"
            )
        bus = real_port.open_bus(interface, channel, *rates)
    if wanted:
        bus.set_filters(wanted)
    return bus


def parse_filter(text: str) -> Any:
    identifier, colon, mask = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return {"can_id": int(identifier, 16), "can_mask": int(mask, 16)}
    except ValueError as error:
        raise ValueError(f"--filter {text!r}; expected ID:MASK in hex, e.g. 200:7C0") from error


def names_of(bus: can.BusABC, channel: str | None) -> list[str]:
    """The channels that a bus is on, by name."""
    return [info.name for info in bus.channels] if isinstance(bus, HandrailBus) else [str(channel)]


def matches(message: can.Message, wanted: Any) -> bool:
    return (message.arbitration_id ^ wanted["can_id"]) & wanted["can_mask"] == 0
