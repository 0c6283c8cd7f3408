"""Compiled: vectors as tuples of three, rotations of nine by rows; inside a kernel they cost nothing."""

from __future__ import annotations

import math

from numba import njit

FAST = {"contract", "reassoc", "arcp", "nsz"}
"""what the compiler may assume of floats: anything but that they are finite"""


@njit(fastmath=FAST, error_model="numpy")
def cross(a, b):  # type: ignore[no-untyped-def]
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(fastmath=FAST, error_model="numpy")
def dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(fastmath=FAST, error_model="numpy")
def add(a, b):  # type: ignore[no-untyped-def]
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@njit(fastmath=FAST, error_model="numpy")
def minus(a, b):  # type: ignore[no-untyped-def]
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@njit(fastmath=FAST, error_model="numpy")
def times(s, a):  # type: ignore[no-untyped-def]
    return (s * a[0], s * a[1], s * a[2])


@njit(fastmath=FAST, error_model="numpy")
def rotate(r, a):  # type: ignore[no-untyped-def]
    """R a"""
    return (
        r[0] * a[0] + r[1] * a[1] + r[2] * a[2],
        r[3] * a[0] + r[4] * a[1] + r[5] * a[2],
        r[6] * a[0] + r[7] * a[1] + r[8] * a[2],
    )


@njit(fastmath=FAST, error_model="numpy")
def rotate_back(r, a):  # type: ignore[no-untyped-def]
    """Rᵀ a"""
    return (
        r[0] * a[0] + r[3] * a[1] + r[6] * a[2],
        r[1] * a[0] + r[4] * a[1] + r[7] * a[2],
        r[2] * a[0] + r[5] * a[1] + r[8] * a[2],
    )


@njit(fastmath=FAST, error_model="numpy")
def product(a, b):  # type: ignore[no-untyped-def]
    """A B"""
    x = rotate(a, (b[0], b[3], b[6]))
    y = rotate(a, (b[1], b[4], b[7]))
    z = rotate(a, (b[2], b[5], b[8]))
    return (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])


@njit(fastmath=FAST, error_model="numpy")
def transposed(a):  # type: ignore[no-untyped-def]
    return (a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8])


@njit(fastmath=FAST, error_model="numpy")
def three(row, first):  # type: ignore[no-untyped-def]
    return (row[first], row[first + 1], row[first + 2])


@njit(fastmath=FAST, error_model="numpy")
def nine(row, first):  # type: ignore[no-untyped-def]
    return (
        row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4],
        row[first + 5], row[first + 6], row[first + 7], row[first + 8],
    )  # fmt: skip


@njit(fastmath=FAST, error_model="numpy")
def by_columns(row):  # type: ignore[no-untyped-def]
    """A rotation from pinocchio's memory."""
    return (row[0], row[3], row[6], row[1], row[4], row[7], row[2], row[5], row[8])


@njit
def rotation_vector(r):  # type: ignore[no-untyped-def]
    """log(R) (3,) rad, for every angle up to π.

    Up to a quarter turn from R − Rᵀ, beyond it from the quaternion by Shepperd's largest component: near π the former vanishes.
    """
    trace = r[0] + r[4] + r[8]
    skew = (0.5 * (r[7] - r[5]), 0.5 * (r[2] - r[6]), 0.5 * (r[3] - r[1]))
    if trace > 1.0:
        sine = math.sqrt(dot(skew, skew))
        angle = math.atan2(sine, 0.5 * (trace - 1.0))
        return times(angle / sine if sine > 1e-9 else 1.0, skew)
    if r[0] >= r[4] and r[0] >= r[8]:
        axis = (1.0 + r[0] - r[4] - r[8], r[1] + r[3], r[2] + r[6])
        w = r[7] - r[5]
    elif r[4] >= r[8]:
        axis = (r[1] + r[3], 1.0 - r[0] + r[4] - r[8], r[5] + r[7])
        w = r[2] - r[6]
    else:
        axis = (r[2] + r[6], r[5] + r[7], 1.0 - r[0] - r[4] + r[8])
        w = r[3] - r[1]
    length = math.sqrt(dot(axis, axis))
    if w < 0.0:
        length, w = -length, -w
    return times(2.0 * math.atan2(abs(length), w) / length, axis)


@njit(fastmath=FAST, error_model="numpy")
def rotation_of(v):  # type: ignore[no-untyped-def]
    """exp(v): the turn by |v| rad about v (Rodrigues)."""
    square = dot(v, v)
    if square < 1e-8:
        s, c = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = math.sqrt(square)
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    x, y, z = v
    return (
        1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y,
        c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x,
        c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y),
    )  # fmt: skip


@njit(fastmath=FAST, error_model="numpy")
def put(row, first, values):  # type: ignore[no-untyped-def]
    """A vector, or a rotation, into a row's columns from `first` on."""
    for i in range(len(values)):
        row[first + i] = values[i]
