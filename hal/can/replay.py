"""Sending a capture again, as it was or faster."""

from __future__ import annotations

import sqlite3
import struct
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import can
from can.io.blf import BLFParseError

_FULL_S = 0.5
"""a transmit queue that stays full for so long ends a replay"""

# What python-can's readers raise on files that are none, or cut off.
_BROKEN = (
    ValueError, OSError, EOFError, LookupError, TypeError, AttributeError, struct.error, zlib.error, sqlite3.Error, can.CanError,
    BLFParseError,
)  # fmt: skip


@dataclass
class Replayed:
    """What became of a capture's frames."""

    sent: int = 0
    skipped: int = 0
    """error frames, which only controllers can send"""
    latest_ns: int = 0
    """the most that a frame was sent after its time"""


def read_log(file: Path) -> Iterator[can.Message]:
    """The messages of a log in any format that python-can reads. Raises ValueError naming the file."""
    if not file.is_file():
        raise ValueError(f"log file {file}: there is none")
    try:
        reader = can.LogReader(file)
        with reader:
            yield from reader
    except _BROKEN as error:
        raise ValueError(f"log file {file}: can't be read ({error or type(error).__name__})") from error


def channel_of(channel: object, names: Sequence[str]) -> str | None:
    """The bus's channel for one as a log file has it: by name, else by number (BLF and ASC keep numbers only: `can1` is 1),
    else the only one; None where none fits."""
    if channel in names:
        return str(channel)
    if isinstance(channel, int) or (isinstance(channel, str) and channel.isdecimal()):
        number = int(channel)
        for name in names:
            digits = name[len(name.rstrip("0123456789")) :]
            if digits and int(digits) == number:
                return name
        if number < len(names):
            return names[number]
    return names[0] if len(names) == 1 else None


def replay(
    messages: Iterable[can.Message],
    bus: can.BusABC,
    route: Callable[[can.Message], str],
    *,
    speed: float = 1.0,
    ended: Callable[[float], bool] = lambda wait: time.sleep(wait) or False,  # type: ignore[func-returns-value]
    clock: Callable[[], float] = time.perf_counter,
) -> Replayed:
    """Send messages at the distances in time that they had, divided by `speed`; 0: at once, as fast as the bus takes them.

    route: gives each message's channel on this bus. `ended`: waits so many s, True when it shall end.
    Raises can.CanOperationError when the bus ends or stays full, ValueError as `route` does.
    """
    done, first, began = Replayed(), None, clock()
    for message in messages:
        if message.is_error_frame:
            done.skipped += 1
            continue
        if first is None:
            first = message.timestamp
        if speed > 0.0:
            due = began + (message.timestamp - first) / speed
            if (wait := due - clock()) > 0.0 and ended(wait):
                break
            done.latest_ns = max(done.latest_ns, round((clock() - due) * 1e9))
        elif done.sent % 256 == 0 and ended(0.0):
            break
        message.channel, message.is_rx = route(message), False
        bus.send(message, timeout=_FULL_S)
        done.sent += 1
    return done
