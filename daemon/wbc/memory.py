"""Arrays that a kernel finds in one table: an argument of a compiled function costs 0.2 µs, and whole-body control needs forty."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Memory:
    """Named float64 (or int64) arrays, C-ordered; where they lie: `table` (k, 3), address, rows, columns, in the order of `names`.

    Whoever hands the table to a kernel keeps this object, and with it the arrays.
    """

    def __init__(self, names: tuple[str, ...]):
        self._number = {name: number for number, name in enumerate(names)}
        self._arrays: dict[str, Array] = {}
        self._owners: list[object] = []
        self.table = np.zeros((len(names), 3), np.int64)

    def make(self, name: str, rows: int, columns: int) -> Array:
        """A new array (rows, columns) of zeros."""
        return self.put(name, np.zeros((max(rows, 1), max(columns, 1))), rows, columns)

    def put_integers(self, name: str, array: Integers) -> None:
        """An array of int64 that somebody else made, for `integers`; C-ordered with two axes."""
        self.put(name, array.view(np.float64))
        self.hold(array)

    def put(self, name: str, array: Array, rows: int | None = None, columns: int | None = None) -> Array:
        """An array that somebody else made; it must be C-ordered float64 with two axes."""
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.ndim != 2:
            raise ValueError(f"{name}: got {array.dtype} {array.shape}; expected C-ordered float64 with two axes")
        shape = (array.shape[0] if rows is None else rows, array.shape[1] if columns is None else columns)
        self.table[self._number[name]] = array.ctypes.data, *shape
        self._arrays[name] = array
        return array

    def hold(self, owner: object) -> None:
        """Keep what owns an array's memory."""
        self._owners.append(owner)

    def __getitem__(self, name: str) -> Array:
        return self._arrays[name]


def _generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))


def _pointer(typing: Any, address: Any) -> Any:
    return types.CPointer(types.float64)(types.intp), _generate


def _integer_pointer(typing: Any, address: Any) -> Any:
    return types.CPointer(types.int64)(types.intp), _generate


pointer: Any = intrinsic(_pointer)
integer_pointer: Any = intrinsic(_integer_pointer)


@njit
def matrix(table, number):  # type: ignore[no-untyped-def]
    """The array `number` of a memory's table, (rows, columns)."""
    return carray(pointer(table[number, 0]), (table[number, 1], table[number, 2]))


@njit
def integers(table, number):  # type: ignore[no-untyped-def]
    """The same of one that was put there by `put_integers`."""
    return carray(integer_pointer(table[number, 0]), (table[number, 1], table[number, 2]))


@njit
def line(table, number, row):  # type: ignore[no-untyped-def]
    """One row of the array `number`, (columns,)."""
    columns = table[number, 2]
    return carray(pointer(table[number, 0] + 8 * row * columns), (columns,))


@njit
def fill(row, value):  # type: ignore[no-untyped-def]
    """row[:] = value, which compiles a hundred times slower."""
    for i in range(row.shape[0]):
        row[i] = value


@njit
def copy(source, target):  # type: ignore[no-untyped-def]
    """target[:] = source, likewise."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@njit
def vector(table, number):  # type: ignore[no-untyped-def]
    """The array `number` of a memory's table with one row, (columns,)."""
    return carray(pointer(table[number, 0]), (table[number, 2],))
