"""Compiled functions whose cache knows all the files that they are made of.

Numba looks at the file of a cached function alone: what it calls in other files may have changed, and old machine code goes on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache

_SOURCES = ("memory.py", "layout.py", "model.py", "rows.py", "kernels.py")


def _fingerprint() -> str:
    folder = Path(__file__).parent
    return hashlib.sha256(b"".join((folder / name).read_bytes() for name in _SOURCES)).hexdigest()


class _Cache(FunctionCache):
    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), _fingerprint())


def entry_point(**options: Any) -> Callable[[Any], Any]:
    """As numba.njit(cache=True, ...), of a function of this package's."""

    def decorate(function: Any) -> Any:
        dispatcher = njit(**options)(function)
        dispatcher._cache = _Cache(function)
        return dispatcher

    return decorate
