"""Signals in CAN frames, as a DBC file lays them out: whole batches of frames at once, in place, by compiled kernels.

cantools reads the DBC when the program starts; its messages become small tables, which the kernels walk. Drive families build
their own tables from a `MessageLayout` (hal.drives.program); anything else uses `Codec.encode` and `Codec.decode`.

Physical values are float64. A raw value is round-half-even((value − offset) / scale), as in cantools; what does not fit the
signal's bits saturates.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cantools
import numpy as np
import numpy.typing as npt
from cantools.database.can import Database, Message, Signal

from hal.can.frames import BRS, DATA, EXTENDED, FD, RECORD, WORDS
from handrail.compiled import compiled

START, LENGTH, KIND = 0, 1, 2
"""Columns of `MessageLayout.places`."""
SCALE, OFFSET, LOW, HIGH = 0, 1, 2, 3
"""Columns of `MessageLayout.scales`; LOW and HIGH bound the raw value."""
SIGNED, BIG_ENDIAN, FLOAT = 1, 2, 4
"""Bits of KIND."""

_WIDEST = 53
"""Bits of an integer that float64 holds exactly."""


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


class Codec:
    """The messages of one DBC file."""

    def __init__(self, database: Database):
        self.database = database
        self._layouts: dict[str, MessageLayout] = {}

    @classmethod
    def from_file(cls, file: str | os.PathLike[str]) -> Codec:
        """Read a DBC file. Raises ValueError naming the file where cantools can't read it."""
        try:
            database = cantools.database.load_file(os.fspath(file), database_format="dbc")
        except (OSError, cantools.Error, UnicodeDecodeError) as error:
            raise ValueError(f"{file}: no DBC file that can be read: {error}") from error
        assert isinstance(database, Database)  # what cantools makes of a DBC
        return cls(database)

    def layout(self, name: str) -> MessageLayout:
        """A message's tables. Raises KeyError when the DBC has none of that name, ValueError when it is multiplexed, holds
        integers above 53 bits or floats of 16."""
        if name not in self._layouts:
            try:
                message = self.database.get_message_by_name(name)
            except KeyError as error:
                raise KeyError(f"message {name}: not in the DBC") from error
            self._layouts[name] = _layout(message)
        return self._layouts[name]

    def encode(
        self, name: str, values: npt.ArrayLike, out: npt.NDArray[np.void], *, bus: int = 0
    ) -> npt.NDArray[np.void]:
        """Write one frame a row of `values` (k, s), in the order of `layout(name).signals`, to out[:k]; returns that view.

        Raises ValueError naming message, signal, row and value for what is not finite, and where shapes don't fit.
        """
        layout = self.layout(name)
        table = np.ascontiguousarray(values, np.float64)
        if table.ndim != 2 or table.shape[1] != len(layout.signals) or len(out) < len(table):
            raise ValueError(
                f"message {name}: values of shape {table.shape} into {len(out)} records; "
                f"expected (k, {len(layout.signals)}) into at least k"
            )
        frames = out[: len(table)]
        head = np.uint64(layout.head | bus << 48)
        bad = _encode(frames.view(np.uint64), head, table, layout.places, layout.scales)
        if bad >= 0:
            row, column = divmod(bad, len(layout.signals))
            raise ValueError(
                f"message {name}: {layout.signals[column]}: {table[row, column]} in row {row}; expected a finite number"
            )
        return frames

    def decode(self, name: str, records: npt.NDArray[np.void]) -> npt.NDArray[np.float64]:
        """Physical values (k, s) of k frames of this message, in the order of `layout(name).signals`.

        The frames' identifiers are not looked at. Raises ValueError when one is shorter than the message.
        """
        layout = self.layout(name)
        records = np.ascontiguousarray(records, RECORD)
        if len(records) and int(records["length"].min()) < layout.length:
            raise ValueError(f"message {name}: a frame of {records['length'].min()} bytes; expected {layout.length}")
        out = np.empty((len(records), len(layout.signals)))
        _decode(records.view(np.uint64), out, layout.places, layout.scales)
        return out


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


@compiled
def get_bits(words, first, start, length):
    """`length` (≤ 64) little-endian bits from bit `start` of the data that begins at words[first], as uint64."""
    word, shift = first + (start >> 6), start & 63
    raw = words[word] >> np.uint64(shift)
    if shift + length > 64:
        raw |= words[word + 1] << np.uint64(64 - shift)
    if length < 64:
        raw &= (np.uint64(1) << np.uint64(length)) - np.uint64(1)
    return raw


@compiled
def put_bits(words, first, start, length, raw):
    """Set `length` (≤ 64) little-endian bits, zero before, to `raw` (uint64, no bits above)."""
    word, shift = first + (start >> 6), start & 63
    words[word] |= raw << np.uint64(shift)
    if shift + length > 64:
        words[word + 1] |= raw >> np.uint64(64 - shift)


@compiled
def get_big_endian(words, first, start, length):
    raw, left, position = np.uint64(0), length, start
    while left > 0:
        byte = (words[first + (position >> 6)] >> np.uint64(8 * ((position >> 3) & 7))) & np.uint64(0xFF)
        room = 8 - (position & 7)
        take = min(room, left)
        part = (byte >> np.uint64(room - take)) & ((np.uint64(1) << np.uint64(take)) - np.uint64(1))
        raw = raw << np.uint64(take) | part
        left, position = left - take, position + take
    return raw


@compiled
def put_big_endian(words, first, start, length, raw):
    left, position = length, start
    while left > 0:
        room = 8 - (position & 7)
        take = min(room, left)
        part = (raw >> np.uint64(left - take)) & ((np.uint64(1) << np.uint64(take)) - np.uint64(1))
        shift = 8 * ((position >> 3) & 7) + room - take
        words[first + (position >> 6)] |= part << np.uint64(shift)
        left, position = left - take, position + take


# The kernels below take the table and a row of it, not the row: a slice costs reference counting.


@compiled
def to_raw(value, scales, row):
    """The raw integer of a finite physical value, saturated, by a row of MessageLayout.scales."""
    raw = np.rint((value - scales[row, OFFSET]) / scales[row, SCALE])
    return np.int64(min(max(raw, scales[row, LOW]), scales[row, HIGH]))


@compiled
def sign_extended(raw, places, row):
    """Raw bits (uint64) as the integer that they mean."""
    if places[row, KIND] & SIGNED:
        shift = 64 - places[row, LENGTH]
        return np.int64(raw << np.uint64(shift)) >> shift
    return np.int64(raw)


@compiled
def _encode(words, head, values, places, scales):
    """−1, or the flat index of the first value that is not finite."""
    for row in range(values.shape[0]):
        first = WORDS * row + DATA
        words[WORDS * row] = np.uint64(0)
        words[WORDS * row + 1] = head
        for i in range(8):
            words[first + i] = np.uint64(0)
        for s in range(values.shape[1]):
            value, start, length, kind = values[row, s], places[s, START], places[s, LENGTH], places[s, KIND]
            if kind & FLOAT:
                scaled = (value - scales[s, OFFSET]) / scales[s, SCALE]
                if length == 32:
                    bits = np.uint64(np.float32(scaled).view(np.uint32))
                else:
                    bits = np.float64(scaled).view(np.uint64)
            else:
                if not np.isfinite(value):
                    return row * values.shape[1] + s
                bits = np.uint64(to_raw(value, scales, s)) & ((np.uint64(1) << np.uint64(length)) - np.uint64(1))
            if kind & BIG_ENDIAN:
                put_big_endian(words, first, start, length, bits)
            else:
                put_bits(words, first, start, length, bits)
    return -1


@compiled
def _decode(words, out, places, scales):
    for row in range(out.shape[0]):
        first = WORDS * row + DATA
        for s in range(out.shape[1]):
            start, length, kind = places[s, START], places[s, LENGTH], places[s, KIND]
            if kind & BIG_ENDIAN:
                bits = get_big_endian(words, first, start, length)
            else:
                bits = get_bits(words, first, start, length)
            if kind & FLOAT:
                if length == 32:
                    raw = np.float64(np.uint32(bits).view(np.float32))
                else:
                    raw = np.uint64(bits).view(np.float64)
            else:
                raw = np.float64(sign_extended(bits, places, s))
            out[row, s] = raw * scales[s, SCALE] + scales[s, OFFSET]
