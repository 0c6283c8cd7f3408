"""PyBullet, whose C code prints: imported without its banner, and kept off a process's standard output."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TextIO


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    kept = os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


with _silent_stderr():
    import pybullet


@contextlib.contextmanager
def own_stdout() -> Iterator[TextIO]:
    """Standard output for us alone: PyBullet's C code, which prints there too, gets standard error instead."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    with os.fdopen(kept, "w") as stdout:
        yield stdout


__all__ = ["own_stdout", "pybullet"]
