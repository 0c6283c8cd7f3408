"""Large arrays between a node and its host: through blocks of memory that both map, instead of through their socket.

A block is a memfd (memfd_create(2)): it has no name, so the kernel frees it once nobody maps it, however its users ended. It is
written by one end and read by the other, and holds one array at a time; its first word says whether the reader still looks at it.
The reader gets read-only views, and a block is free again when the last of them is gone; a writer that finds none free goes on.
"""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os
import struct
import weakref
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST_BYTES = 1 << 16
"""smaller arrays go through the socket"""
BLOCKS = 8
MOST_BYTES = 1 << 28
"""of all blocks of one end together"""
_MARK = "\0block"
_HEADER = 64
_USED = struct.Struct("<q")
# Nobody can make it shorter: who reads beyond the end of a mapped file is killed.
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW


@dataclass
class _Block:
    number: int
    memory: mmap.mmap
    size: int
    descriptor: int = -1
    """of a block that the other end has not seen yet"""

    @property
    def free(self) -> bool:
        return _USED.unpack_from(self.memory)[0] == 0


class Writer:
    """The blocks that one end writes. For one thread at a time."""

    def __init__(self) -> None:
        self._blocks: list[_Block] = []
        self._next = 0
        self._gone: list[int] = []

    def prepared(self, values: Mapping[str, Any], *, leave_out: bool) -> tuple[dict[str, Any], list[int], list[str]]:
        """Values as they travel, descriptors that travel along, and names of those that were left out.

        :param leave_out: arrays for which no block is free, rather than to send them through the socket
        """
        travel: dict[str, Any] = {}
        descriptors: list[int] = []
        left_out: list[str] = []
        for name, value in values.items():
            if not isinstance(value, np.ndarray):
                travel[name] = value
                continue
            put = self._put(value) if value.nbytes >= LEAST_BYTES else None
            if put is not None:
                travel[name], more = put
                descriptors += more
            elif leave_out and value.nbytes >= LEAST_BYTES:
                left_out.append(name)
            else:
                travel[name] = inline(value)
        return travel, descriptors, left_out

    def close(self) -> None:
        """Let go of all blocks; those that the other end looks at stay."""
        for block in self._blocks:
            block.memory.close()
        self._blocks.clear()

    def _put(self, array: np.ndarray) -> tuple[dict[str, Any], list[int]] | None:
        """What travels instead of an array, with the descriptor of a new block; None: no block is free."""
        block = self._free_block(array.nbytes)
        if block is None:
            return None
        there = np.frombuffer(block.memory, array.dtype, array.size, _HEADER).reshape(array.shape)
        there[...] = array
        del there  # what looks at memory keeps it from being closed
        _USED.pack_into(block.memory, 0, 1)
        descriptors = [block.descriptor] if block.descriptor >= 0 else []
        told = {"shape": list(array.shape), "dtype": array.dtype.str, "size": block.size, "new": bool(descriptors)}
        gone, self._gone, block.descriptor = self._gone, [], -1
        return {_MARK: block.number, "gone": gone, **told}, descriptors

    def _free_block(self, wanted: int) -> _Block | None:
        free = [block for block in self._blocks if block.free]
        fitting = [block for block in free if block.size >= wanted]
        if fitting:
            return min(fitting, key=lambda block: block.size)
        size = 1 << (wanted - 1).bit_length()
        # Those that have become too small make room for a larger one.
        while free and (len(self._blocks) >= BLOCKS or self._total() + size > MOST_BYTES):
            block = free.pop()
            self._blocks.remove(block)
            self._gone.append(block.number)
        if len(self._blocks) >= BLOCKS or self._total() + size > MOST_BYTES:
            return None
        descriptor = os.memfd_create("handrail node", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(descriptor, _HEADER + size)
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, _SEALS)
        block = _Block(self._next, mmap.mmap(descriptor, _HEADER + size), size, descriptor)
        self._next += 1
        self._blocks.append(block)
        return block

    def _total(self) -> int:
        return sum(block.size for block in self._blocks)


class Reader:
    """The blocks that the other end writes. For one thread at a time; views may be dropped in any."""

    def __init__(self) -> None:
        self._blocks: dict[int, mmap.mmap] = {}
        self.descriptors: deque[int] = deque()
        """that came along, in order"""

    def taken(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The values with arrays where blocks travelled. Raises ValueError for a block that is none."""
        return {name: self._array(value) if _is_block(value) else value for name, value in values.items()}

    def _array(self, told: dict[str, Any]) -> np.ndarray:
        for number in told["gone"]:
            self._blocks.pop(number, None)
        if told["new"]:
            self._blocks[told[_MARK]] = _mapped(self.descriptors.popleft(), told["size"])
        memory = self._blocks[told[_MARK]]
        dtype, shape = np.dtype(told["dtype"]), tuple(told["shape"])
        # All views hold this one object: NumPy would let go of an array between them and the memory.
        held = (ctypes.c_char * (dtype.itemsize * int(np.prod(shape)))).from_buffer(memory, _HEADER)
        weakref.finalize(held, _USED.pack_into, memory, 0, 0)
        array = np.frombuffer(held, dtype).reshape(shape)
        array.flags.writeable = False
        return array

    def close(self) -> None:
        """Let go of all blocks; those in use stay until their last view is gone."""
        self._blocks.clear()
        while self.descriptors:
            os.close(self.descriptors.popleft())


def _is_block(value: Any) -> bool:
    return isinstance(value, dict) and _MARK in value


def _mapped(descriptor: int, size: int) -> mmap.mmap:
    try:
        if fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) & _SEALS != _SEALS:
            raise ValueError("a block of memory that may shrink; expected a sealed one")
        return mmap.mmap(descriptor, _HEADER + size)
    finally:
        os.close(descriptor)


def inline(array: np.ndarray) -> dict[str, Any]:
    """An array as it goes through the socket."""
    return {"shape": list(array.shape), "dtype": array.dtype.str, "data": np.ascontiguousarray(array).tobytes()}
