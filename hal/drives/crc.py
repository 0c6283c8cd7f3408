"""Cyclic redundancy checks of drive families, by name, as reveng's catalogue defines them.

CRC-16/CCITT-FALSE, Handrail's own, goes eight bytes a step: the CRC of a block is the XOR of what each of its bytes contributes
from its place (slicing by eight, Kounavis and Berry, "Novel table lookup-based algorithms for high-performance CRC generation",
2008). The others go byte by byte.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from handrail.compiled import compiled

NONE = -1
WIDTH, START, REFLECTED, XOR = range(4)
"""Columns of SPECS."""

# name → width, polynomial, start, reflected, final XOR
_CATALOGUE = {
    "crc16_ccitt_false": (16, 0x1021, 0xFFFF, 0, 0),
    "crc16_modbus": (16, 0x8005, 0xFFFF, 1, 0),
    "crc16_xmodem": (16, 0x1021, 0, 0, 0),
    "crc8_sae_j1850": (8, 0x1D, 0xFF, 0, 0xFF),
    "crc8_autosar": (8, 0x2F, 0xFF, 0, 0xFF),
    "crc8_smbus": (8, 0x07, 0, 0, 0),
    "crc32": (32, 0x04C11DB7, 0xFFFFFFFF, 1, 0xFFFFFFFF),
}
NAMES = tuple(_CATALOGUE)
"""Algorithms that a family may name; its place here is an algorithm's number in the kernels."""


def _mirrored(value: int, bits: int) -> int:
    return int(f"{value:0{bits}b}"[::-1], 2)


def _table(width: int, polynomial: int, reflected: int) -> npt.NDArray[np.int64]:
    """(256,) what one byte makes of a register that is zero but for it."""
    table, mask = np.zeros(256, np.int64), (1 << width) - 1
    for byte in range(256):
        crc = (_mirrored(byte, 8) if reflected else byte) << (width - 8)
        for _ in range(8):
            crc = (crc << 1 ^ polynomial if crc >> (width - 1) else crc << 1) & mask
        table[byte] = _mirrored(crc, width) if reflected else crc
    return table


SPECS = np.array([(width, start, reflected, xor) for width, _, start, reflected, xor in _CATALOGUE.values()], np.int64)
_TABLES = np.array([_table(width, polynomial, reflected) for width, polynomial, _, reflected, _ in _CATALOGUE.values()])


def _slices() -> npt.NDArray[np.uint16]:
    """(8, 256): what a byte contributes to CRC-16/CCITT-FALSE with 0..7 bytes behind it."""
    slices = np.zeros((8, 256), np.uint16)
    slices[0] = _TABLES[0]
    for behind in range(1, 8):
        before = slices[behind - 1]
        slices[behind] = (before << np.uint16(8)) ^ slices[0][before >> np.uint16(8)]
    return slices


_SLICES = _slices()


@compiled
def crc16(words, first, length):
    """CRC-16/CCITT-FALSE of `length` bytes that begin at words[first] (uint64, little-endian)."""
    crc = np.int64(0xFFFF)
    for word in range(first, first + (length >> 3)):
        # The first byte sits lowest; the CRC so far acts on the first two.
        block = words[word] ^ np.uint64(crc >> 8 | (crc & 0xFF) << 8)
        crc = np.int64(0)
        for place in range(8):
            crc ^= np.int64(_SLICES[7 - place, (block >> np.uint64(8 * place)) & np.uint64(0xFF)])
    rest = words[first + (length >> 3)] if length & 7 else np.uint64(0)
    for place in range(length & 7):
        byte = np.int64((rest >> np.uint64(8 * place)) & np.uint64(0xFF))
        crc = (crc << 8 & 0xFF00) ^ np.int64(_SLICES[0, crc >> 8 ^ byte])
    return crc


@compiled
def crc_of(words, first, begin, end, algorithm):
    """CRC of the bytes `begin` to `end` (exclusive) of the data that starts at words[first], by number of algorithm."""
    if algorithm == 0 and begin == 0:
        return crc16(words, first, end)
    width, reflected = SPECS[algorithm, WIDTH], SPECS[algorithm, REFLECTED]
    crc, mask = SPECS[algorithm, START], (np.int64(1) << width) - 1
    for place in range(begin, end):
        byte = np.int64((words[first + (place >> 3)] >> np.uint64(8 * (place & 7))) & np.uint64(0xFF))
        if reflected:
            crc = (crc >> 8) ^ _TABLES[algorithm, (crc ^ byte) & 0xFF]
        else:
            crc = ((crc << 8) & mask) ^ _TABLES[algorithm, (crc >> (width - 8)) ^ byte]
    return crc ^ SPECS[algorithm, XOR]
