"""pinocchio's vectors of placements and motions as numpy arrays, for compiled kernels: views, no copies (robot side only)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]


def placements(vector: Sequence[pin.SE3]) -> Array:
    """(n, 12): rotation by columns, translation. Raises RuntimeError for a pinocchio that lays its memory out otherwise."""
    n = len(vector)
    flat = [vector[i].rotation.T.reshape(-1) for i in range(min(n, 2))]
    view = _strided(flat[0], flat[-1], n, 12)
    for i in {0, n // 2, n - 1}:  # a std::vector: the others lie between
        expected = np.concatenate((vector[i].rotation.T.reshape(-1), vector[i].translation))
        if not np.array_equal(view[i], expected, equal_nan=True):
            raise RuntimeError(f"pinocchio {pin.__version__}: SE3 is not laid out as rotation by columns, translation")
    return view


def motions(vector: Sequence[pin.Motion]) -> Array:
    """(n, 6): linear, angular; forces as well. Raises RuntimeError as above."""
    n = len(vector)
    flat = [vector[i].vector for i in range(min(n, 2))]
    view = _strided(flat[0], flat[-1], n, 6)
    if any(not np.array_equal(view[i], vector[i].vector, equal_nan=True) for i in range(n)):
        raise RuntimeError(f"pinocchio {pin.__version__}: motions are not laid out as six numbers")
    return view


def _strided(first: Array, second: Array, n: int, width: int) -> Array:
    step = second.ctypes.data - first.ctypes.data if n > 1 else width * 8
    if step != width * 8:
        raise RuntimeError(f"pinocchio {pin.__version__}: elements are {step} bytes apart; expected {width * 8}")
    return np.lib.stride_tricks.as_strided(first, (n, width), (width * 8, 8))
