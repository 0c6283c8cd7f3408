"""What the verbs of `handrail can` have in common: their options, the bus that these name, and how problems are said.

A verb that works on any bus is decorated with `on_a_bus`, and gets its options `--interface`, `--bitrate`, `--data-bitrate` and
`--runtime` as one `Place`.
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Place:
    """Which bus a verb works on."""

    interface: str
    rates: tuple[int, int]
    """bit/s: nominal, and of CAN FD's data phase"""
    runtime: Path | None

    def open(self, channel: str | None, program: str, filters: list[str] | None = None) -> can.BusABC:
        """Join it. Raises ValueError, BusLost, can.CanError."""
        wanted = [parse_filter(text) for text in filters or []]
        bus: can.BusABC
        if self.interface == "handrail":
            bus = HandrailBus(channel, runtime=self.runtime, timeout=1.0, name=f"{program}-{os.getpid()}")
        else:
            from hal.can import real_port

            if channel is None:
                raise ValueError(
                    f"--interface {self.interface}: the channel is missing; `handrail can interfaces` lists what there is"
                )
            bus = real_port.open_bus(self.interface, channel, *self.rates)
        if wanted:
            bus.set_filters(wanted)
        return bus


def _place(
    interface: Interface = "handrail",
    bitrate: BitRate = 1_000_000,
    data_bitrate: DataBitRate = 5_000_000,
    runtime: RuntimeFolder = None,
) -> Place:
    return Place(interface, (bitrate, data_bitrate), runtime)


def on_a_bus(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a verb the options that say which bus; it gets what they say as its parameter `place`."""
    options = inspect.signature(_place, eval_str=True).parameters
    own = inspect.signature(verb, eval_str=True).parameters

    def with_options(**given: Any) -> None:
        verb(place=_place(**{name: given.pop(name) for name in options}), **given)

    shown = [*(parameter for name, parameter in own.items() if name != "place"), *options.values()]
    shown = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in shown]
    with_options.__name__, with_options.__doc__ = verb.__name__, verb.__doc__
    with_options.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]  # what typer reads
    return with_options


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
