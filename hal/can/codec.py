"""Signals in CAN frames, as a DBC file lays them out: whole batches of frames at once, in place, by compiled kernels.

A DBC's messages become small tables (hal.can.layout), which the kernels walk. Drive families build their own tables from a
`MessageLayout` (hal.drives.program); anything else uses `Codec.encode` and `Codec.decode`.

Physical values are float64. A raw value is round-half-even((value − offset) / scale), as in cantools; what does not fit the
signal's bits saturates.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hal.can.frames import DATA, RECORD, WORDS
from hal.can.layout import (
    BIG_ENDIAN,
    FLOAT,
    HIGH,
    KIND,
    LENGTH,
    LOW,
    OFFSET,
    SCALE,
    SIGNED,
    START,
    MessageLayout,
    Unfit,
    layouts,
    layouts_of,
    read_database,
)
from handrail.compiled import compiled

if TYPE_CHECKING:
    from cantools.database.can import Database


class Codec:
    """The messages of one DBC file."""

    def __init__(self, messages: Mapping[str, MessageLayout | Unfit], file: str | os.PathLike[str]):
        self._messages, self._file = messages, file

    @classmethod
    def from_file(cls, file: str | os.PathLike[str]) -> Codec:
        """Read a DBC file. Raises ValueError naming the file where cantools can't read it."""
        return cls(layouts(file), file)

    @classmethod
    def from_database(cls, database: Database) -> Codec:
        """Of a DBC that cantools has read, or that was made."""
        codec = cls(layouts_of(database.messages), "")
        codec.database = database
        return codec

    @cached_property
    def database(self) -> Database:
        """All that the DBC says, as cantools has it."""
        return read_database(self._file)

    def layout(self, name: str) -> MessageLayout:
        """A message's tables. Raises KeyError when the DBC has none of that name, ValueError when it is multiplexed, holds
        integers above 53 bits or floats of 16."""
        if name not in self._messages:
            raise KeyError(f"message {name}: not in the DBC")
        found = self._messages[name]
        if isinstance(found, Unfit):
            raise ValueError(found.problem)
        return found

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
