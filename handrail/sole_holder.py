"""One process at a time: a lock file that says who holds it, and that the kernel opens again when that process ends, however."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class HeldElsewhere(Exception):
    """Another process holds the lock; `process` is its id as it wrote it."""

    def __init__(self, process: str):
        super().__init__(f"held by process {process}")
        self.process = process


@contextmanager
def sole_holder(file: Path) -> Iterator[None]:
    """Hold `file` for this process. Raises HeldElsewhere, or OSError where the file can't be opened."""
    lock = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise HeldElsewhere(os.read(lock, 32).decode(errors="replace").strip()) from error
        os.ftruncate(lock, 0)
        os.write(lock, f"{os.getpid()}\n".encode())
        yield
    finally:
        os.close(lock)
