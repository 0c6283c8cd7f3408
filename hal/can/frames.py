"""CAN frames as rows of a numpy array: 80 bytes a frame, the same in memory, on the hub's socket and in the kernels.

A frame array is an ndarray of `RECORD`. Kernels read it as little-endian 64-bit words, ten a frame (`words`)::

    word 0      time_ns
    word 1      can_id (bits 0..31) | length (32..39) | flags (40..47) | bus (48..55) | zero (56..63)
    word 2..9   data, byte 0 in the lowest bits of word 2, as DBC files count little-endian bits
"""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt

if sys.byteorder != "little":
    raise ImportError("hal.can: frame arrays are read as little-endian words; this machine is big-endian")

RECORD = np.dtype(
    [
        ("time_ns", "<u8"),  # end of frame, on the clock of whoever runs the bus
        ("can_id", "<u4"),  # 11 bits, or 29 with EXTENDED
        ("length", "u1"),  # bytes of data: 0..8, and with FD also 12, 16, 20, 24, 32, 48, 64
        ("flags", "u1"),
        ("bus", "u1"),  # index in the list of channels that the process works with
        ("pad", "u1"),  # zero
        ("data", "u1", (64,)),  # zero beyond `length`
    ]
)
"""One CAN or CAN FD frame."""

BYTES = RECORD.itemsize
"""Bytes of one record."""
WORDS = BYTES // 8
"""64-bit words of one record."""
DATA = 2
"""The first of a record's words that hold data."""

BRS = 1
"""Flag: the data phase is sent at the data bit rate."""
ESI = 2
"""Flag: the sender is error passive."""
FD = 4
"""Flag: a CAN FD frame."""
EXTENDED = 8
"""Flag: the identifier has 29 bits."""
REMOTE = 16
"""Flag: a remote request (classic CAN only); `length` is the length asked for."""
LOST = 128
"""Flag: no frame but the hub's notice that `can_id` frames for this listener were dropped here, since it read too slowly."""
TICK = 64
"""Flag: no frame but the plant's notice, in lock-step, that a cycle is over: all that was said in it came before this."""

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Data lengths that a DLC of 0..15 stands for (ISO 11898-1, table 5)."""

MAX_CHANNELS = 16
"""Channels that one hub or port may carry."""


def empty(n: int) -> npt.NDArray[np.void]:
    """A frame array of n zero frames."""
    return np.zeros(n, RECORD)


def words(records: npt.NDArray[np.void]) -> npt.NDArray[np.uint64]:
    """The records' memory as 64-bit words, shape (10 n,); no copy. `records` must be contiguous."""
    return records.view(np.uint64)


class WordViews:
    """The words of arrays of records that come again and again: numpy asks Python whether a view of records is safe, 2 µs each."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[npt.NDArray[np.void], npt.NDArray[np.uint64]]] = {}

    def of(self, records: npt.NDArray[np.void]) -> npt.NDArray[np.uint64]:
        """As `words`. Of each length the array that came last is remembered, and kept."""
        known = self._known.get(len(records))
        if known is None or known[0] is not records:
            known = self._known[len(records)] = records, words(records)
        return known[1]


def fd_length(n: int) -> int:
    """The shortest length of a CAN FD frame that carries n bytes. Raises ValueError above 64."""
    for length in FD_LENGTHS:
        if length >= n:
            return length
    raise ValueError(f"CAN FD frame: {n} bytes of data; expected at most 64")
