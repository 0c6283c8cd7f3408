"""Points that fill a cube evenly, the same ones every time: Halton's sequence.

scipy.stats has it too, and takes longer to import than all else that the planner needs.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count as numbers
from itertools import islice

import numpy as np
from numpy.typing import NDArray


def halton(count: int, dimensions: int) -> NDArray[np.float64]:
    """(count, dimensions) in (0, 1), from the sequence's second point on: the first is the corner 0.

    Coordinate j is the van der Corput sequence of the j-th prime base: the index's digits, mirrored at the point
    (J. H. Halton, Numerische Mathematik 2, 1960).
    """
    points = np.zeros((count, dimensions))
    for column, base in enumerate(islice(_primes(), dimensions)):
        index, place = np.arange(1, count + 1), 1.0
        while index.any():
            index, digit = np.divmod(index, base)
            place /= base
            points[:, column] += digit * place
    return points


def _primes() -> Iterator[int]:
    for number in numbers(2):
        if all(number % smaller for smaller in range(2, number)):
            yield number
