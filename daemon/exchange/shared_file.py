"""A file of shared memory that the loop makes at every start and the processes beside it map.

It is made anew each time, under a new inode: whoever had mapped the old one notices by the inode and maps again. (Truncating
a mapped file instead would kill its readers with SIGBUS.)
"""

from __future__ import annotations

import contextlib
import mmap
import os
import time
from pathlib import Path

import numpy as np

LINE = 64
"""bytes of a cache line: words that different processes write never share one"""
WORDS = 3 * LINE // 8
"""header in 8-byte words. Line 0: mark, record size, count, payload size, start; lines 1 and 2: a counter each"""
COUNTER, OTHER_COUNTER = 8, 16


class SharedFileError(RuntimeError):
    """A shared file that can't be used: it was written by another version, or is none of ours."""


def whole_lines(size: int) -> int:
    """`size` in bytes, rounded up to whole cache lines."""
    return -(-size // LINE) * LINE


def create(path: Path, size: int, *, magic: int, record_size: int, count: int, payload_size: int = 0) -> mmap.mmap:
    """A zeroed file of `size` bytes with its header, put at `path` whole, as a new inode; mapped for writing."""
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    with contextlib.suppress(FileNotFoundError):
        fresh.unlink()
    descriptor = os.open(fresh, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        os.ftruncate(descriptor, size)
        memory = mmap.mmap(descriptor, size)
    finally:
        os.close(descriptor)
    np.frombuffer(memory, np.int64, 5)[:] = (magic, record_size, count, payload_size, time.monotonic_ns())
    os.replace(fresh, path)
    return memory


def drop_unless_fit(path: Path, *, magic: int, record_size: int) -> bool:
    """Remove a file that no process uses where `Attached` would refuse it: another robot or version left it. True: removed."""
    try:
        Attached(path, magic, record_size).refresh()
    except (SharedFileError, ValueError, OSError):  # ValueError: too short to be mapped, or for its header
        path.unlink(missing_ok=True)
        return True
    return False


class Attached:
    """A file that another process makes, mapped again whenever that process has started anew."""

    def __init__(self, path: Path, magic: int, record_size: int):
        self._path, self._magic, self._record_size = path, magic, record_size
        self._inode = -1
        self.generation = 0
        """how many files have been mapped: goes up by one whenever the loop has started anew"""
        self.count = self.payload_size = 0
        self.memory: mmap.mmap | None = None

    def refresh(self) -> bool:
        """Map what lies at the path now. False while there is nothing. Raises SharedFileError for a file that is not ours."""
        try:
            inode = os.stat(self._path).st_ino
        except FileNotFoundError:
            return self.memory is not None
        if inode == self._inode:
            return True
        with self._path.open("r+b") as file:
            # Map and remember the same file, even when another start replaces it between the two calls.
            inode = os.fstat(file.fileno()).st_ino
            memory = mmap.mmap(file.fileno(), 0)
        magic, record_size, count, payload_size, _start = np.frombuffer(memory, np.int64, 5)
        if magic != self._magic or record_size != self._record_size:
            raise SharedFileError(
                f"{self._path}: record of {record_size} bytes under mark {magic:#x}; expected {self._record_size} bytes "
                f"under {self._magic:#x}. Loop and server are of different versions: restart both"
            )
        self.memory, self._inode = memory, inode
        self.count, self.payload_size = int(count), int(payload_size)
        self.generation += 1
        return True
