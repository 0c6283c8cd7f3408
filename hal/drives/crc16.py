"""CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, no reflection, no final XOR; of "123456789" it is 0x29B1.

Eight bytes a step: the CRC of a block is the XOR of what each of its bytes contributes from its place (slicing by eight,
Kounavis and Berry, "Novel table lookup-based algorithms for high-performance CRC generation", 2008).
"""

from __future__ import annotations

import numpy as np
from numba import njit


def _tables() -> np.ndarray:
    """(8, 256): what a byte contributes with 0..7 bytes behind it."""
    table = np.zeros((8, 256), np.uint16)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
        table[0, byte] = crc
    for behind in range(1, 8):
        before = table[behind - 1]
        table[behind] = (before << np.uint16(8)) ^ table[0][before >> np.uint16(8)]
    return table


_TABLES = _tables()


@njit(cache=True)
def crc16(words, first, length):
    """CRC of `length` bytes that begin at words[first] (uint64, little-endian)."""
    crc = np.int64(0xFFFF)
    for word in range(first, first + (length >> 3)):
        # The first byte sits lowest; the CRC so far acts on the first two.
        block = words[word] ^ np.uint64(crc >> 8 | (crc & 0xFF) << 8)
        crc = np.int64(0)
        for place in range(8):
            crc ^= np.int64(_TABLES[7 - place, (block >> np.uint64(8 * place)) & np.uint64(0xFF)])
    rest = words[first + (length >> 3)] if length & 7 else np.uint64(0)
    for place in range(length & 7):
        byte = np.int64((rest >> np.uint64(8 * place)) & np.uint64(0xFF))
        crc = (crc << 8 & 0xFF00) ^ np.int64(_TABLES[0, crc >> 8 ^ byte])
    return crc
