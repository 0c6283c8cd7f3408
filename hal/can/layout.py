"""A DBC file's messages as tables that kernels walk. cantools reads the file once; the tables are kept in the user's cache.

Reading a DBC takes longer than most of what a process on the bus starts with, and every one of them needs it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import numpy.typing as npt

from hal.can.frames import BRS, EXTENDED, FD
from handrail.robot.urdf import cache_folder, cached

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

START, LENGTH, KIND = 0, 1, 2
"""Columns of `MessageLayout.places`."""
SCALE, OFFSET, LOW, HIGH = 0, 1, 2, 3
"""Columns of `MessageLayout.scales`; LOW and HIGH bound the raw value."""
SIGNED, BIG_ENDIAN, FLOAT = 1, 2, 4
"""Bits of KIND."""

_WIDEST = 53
"""Bits of an integer that float64 holds exactly."""
_VERSION = 1
"""part of the cache's key: raise it when the tables change"""


@dataclass(frozen=True)
class MessageLayout:
    """One message of a DBC file as tables."""

    name: str
    frame_id: int
    length: int
    """bytes"""
    head: int
    """word 1 of its records on bus 0: identifier, length, flags"""
    signals: tuple[str, ...]
    places: npt.NDArray[np.int64]
    """(s, 3) START: bit of the data, as DBC counts for little-endian signals; for big-endian ones the bit from the first
    byte's highest on; LENGTH: bits; KIND"""
    scales: npt.NDArray[np.float64]
    """(s, 4) SCALE, OFFSET, LOW, HIGH"""

    def rows(self, names: Sequence[str]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """`places` and `scales` of these signals, in this order. Raises KeyError naming message and signal."""
        missing = [name for name in names if name not in self.signals]
        if missing:
            raise KeyError(f"message {self.name}: no signal {missing[0]}; it has {', '.join(self.signals)}")
        index = [self.signals.index(name) for name in names]
        return np.ascontiguousarray(self.places[index]), np.ascontiguousarray(self.scales[index])


class Unfit(msgspec.Struct, frozen=True, tag=True):
    """A message that can't be laid out: why."""

    problem: str


class _Kept(msgspec.Struct, frozen=True, tag=True):
    """A MessageLayout in the cache; the tables as bytes."""

    name: str
    frame_id: int
    length: int
    head: int
    signals: tuple[str, ...]
    places: bytes
    scales: bytes

    def layout(self) -> MessageLayout:
        """The tables again; writable, since kernels would be compiled anew for what is not."""
        places = np.frombuffer(self.places, np.int64).reshape(-1, 3).copy()
        scales = np.frombuffer(self.scales, np.float64).reshape(-1, 4).copy()
        return MessageLayout(self.name, self.frame_id, self.length, self.head, self.signals, places, scales)


_decoder = msgspec.msgpack.Decoder(dict[str, _Kept | Unfit])


def read_database(file: str | os.PathLike[str]) -> Database:
    """A DBC file as cantools has it. Raises ValueError naming the file where it can't be read."""
    import cantools  # most processes find all that they need in the cache, and do without
    from cantools.database.can import Database

    try:
        database = cantools.database.load_file(os.fspath(file), database_format="dbc")
    except (OSError, cantools.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: no DBC file that can be read: {error}") from error
    assert isinstance(database, Database)  # what cantools makes of a DBC
    return database


def layouts(file: str | os.PathLike[str]) -> dict[str, MessageLayout | Unfit]:
    """Every message of a DBC file by name. Raises ValueError naming the file where it can't be read."""
    try:
        text = Path(file).read_bytes()
    except OSError as error:
        raise ValueError(f"{file}: no DBC file that can be read: {error}") from error
    name = f"dbc{_VERSION}-{hashlib.sha256(text).hexdigest()[:24]}.msgpack"
    with contextlib.suppress(OSError, msgspec.DecodeError):
        kept = _decoder.decode((cache_folder() / name).read_bytes())
        return {name: entry if isinstance(entry, Unfit) else entry.layout() for name, entry in kept.items()}
    made = layouts_of(read_database(file).messages)
    with contextlib.suppress(OSError):  # a cache that can't be written is done without
        cached(msgspec.msgpack.encode(_to_keep(made)), name)
    return made


def layouts_of(messages: Iterable[Message]) -> dict[str, MessageLayout | Unfit]:
    """Messages of cantools by name."""
    made: dict[str, MessageLayout | Unfit] = {}
    for message in messages:
        try:
            made[message.name] = _layout(message)
        except ValueError as problem:
            made[message.name] = Unfit(str(problem))
    return made


def _to_keep(made: Mapping[str, MessageLayout | Unfit]) -> dict[str, _Kept | Unfit]:
    return {
        name: one
        if isinstance(one, Unfit)
        else _Kept(
            one.name, one.frame_id, one.length, one.head, one.signals, one.places.tobytes(), one.scales.tobytes()
        )
        for name, one in made.items()
    }


def _layout(message: Message) -> MessageLayout:
    if message.is_multiplexed():
        raise ValueError(f"message {message.name}: multiplexed; expected a message whose signals are always all there")
    places = np.zeros((len(message.signals), 3), np.int64)
    scales = np.zeros((len(message.signals), 4))
    for row, signal in enumerate(message.signals):
        places[row], scales[row] = _signal(message, signal)
    flags = (EXTENDED if message.is_extended_frame else 0) | (FD | BRS if message.is_fd else 0)
    return MessageLayout(
        name=message.name,
        frame_id=message.frame_id,
        length=message.length,
        head=message.frame_id | message.length << 32 | flags << 40,
        signals=tuple(signal.name for signal in message.signals),
        places=places,
        scales=scales,
    )


def _signal(message: Message, signal: Signal) -> tuple[Any, Any]:
    big = signal.byte_order == "big_endian"
    kind = (SIGNED if signal.is_signed else 0) | (BIG_ENDIAN if big else 0) | (FLOAT if signal.is_float else 0)
    if signal.is_float and signal.length not in (32, 64):
        raise ValueError(f"message {message.name}: {signal.name}: a float of {signal.length} bits; expected 32 or 64")
    if not signal.is_float and signal.length > _WIDEST:
        raise ValueError(f"message {message.name}: {signal.name}: {signal.length} bits; expected at most {_WIDEST}")
    # DBC gives a big-endian signal's start as its highest bit, counted within little-endian bytes.
    start = 8 * (signal.start // 8) + 7 - signal.start % 8 if big else signal.start
    low, high = (
        (-(1 << signal.length - 1), (1 << signal.length - 1) - 1) if signal.is_signed else (0, (1 << signal.length) - 1)
    )
    if signal.is_float:
        low, high = 0, 0
    return (start, signal.length, kind), (signal.scale, signal.offset, low, high)
