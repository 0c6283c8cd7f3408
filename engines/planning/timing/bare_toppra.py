"""toppra without matplotlib: what it imports that for are plots that nobody asks for here, and it takes longer than toppra."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

_LEFT_OUT = ("matplotlib", "matplotlib.pyplot")


@contextmanager
def _without_plots() -> Iterator[None]:
    """Imports of matplotlib find an empty module, unless somebody had the real one already."""
    missing = [] if "matplotlib.pyplot" in sys.modules else [name for name in _LEFT_OUT if name not in sys.modules]
    for name in missing:
        sys.modules[name] = ModuleType(name)
    if "matplotlib" in missing:
        sys.modules["matplotlib"].pyplot = sys.modules["matplotlib.pyplot"]  # type: ignore[attr-defined]
    try:
        yield
    finally:
        for name in missing:
            del sys.modules[name]


with _without_plots():
    import toppra
    from toppra import algorithm, constraint

logging.getLogger("toppra").setLevel(logging.ERROR)  # it warns of numerics on every short path

__all__ = ["algorithm", "constraint", "toppra"]
