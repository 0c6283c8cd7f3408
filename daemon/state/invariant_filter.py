"""The free base's inertial sensor, followed by a contact-aided invariant extended Kalman filter: compiled steps of it.

Source: Hartley, Ghaffari, Eustice, Grizzle: Contact-aided invariant extended Kalman filtering for robot state estimation, IJRR
39(4), 2020 (right-invariant error, §IV; offsets, §V). With orientation R, velocity v and position p of the sensor and the anchors
dᵢ of the feet in contact, all in the world, the error of an estimate X̂ is ξ with X̂ = exp(ξ) X; of the sensor's offsets it is the
difference. Then ξ̇ depends on the state by the offsets alone, and a foot seen at y in the sensor's axes tells
R̂ y + p̂ − d̂ = ξ_p − ξ_d, whatever the state is. A foot that is further from its anchor than the filter can believe has slipped,
and is anchored anew where it is (Bloesch, Gehring, Fankhauser, Hutter, Hoepflinger, Siegwart: State estimation for legged robots
on unstable and slippery terrain, IROS 2013, reject it). Nothing that touches the ground tells how fast a robot that hangs moves:
that a still one does not is then a measurement (Skog, Händel, Nilsson, Rantakokko: Zero-velocity detection, T-BME 57(11), 2010).

All numbers lie in one array, by place, and functions are told places: what is written first. Behind what is named below each foot
has `FOOT` numbers, from `FEET` on: its anchor m and its place in the sensor's axes m first. The covariance of ξ is an array (m²,),
m = 15 + 3 n: R, v, p, offsets of angular velocity and acceleration, dᵢ; it is zero for feet that are not anchored.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
"""m/s², downwards"""

# Places are numpy's integers: Python's would be taken for literals, and functions compiled anew for each.
R, V, P, OMEGA_OFFSET, ACCELERATION_OFFSET = np.array([0, 9, 12, 15, 18])
"""of the state: by rows; m/s; m; rad/s and m/s², the sensor's axes"""
OMEGA, ACCELERATION = np.array([21, 24])
"""what the sensor measured: rad/s, m/s²"""
BASE, BASE_PLACE = np.array([27, 36])
"""the base in the sensor's axes: rotation by rows, m"""
WORK = np.int64(39)
"""48 numbers for whoever computes, and of this file's functions for all but the plain ones"""
MOST_FEET = 4
ERROR, ROW = np.array([87, 102 + 3 * MOST_FEET])
"""of what is being measured: up to 15 + 3 · MOST_FEET numbers each"""
OTHERS, FEET = np.array([117 + 6 * MOST_FEET, 157 + 6 * MOST_FEET])
"""40 numbers for whoever shares the array; where the feet's begin"""
FOOT = np.int64(80)
ANCHOR, PLACE = np.array([0, 3])
EV, EP, EG, EA, ED = np.array([3, 6, 9, 12, 15])
"""where the parts of ξ begin, after R's"""
_NONE = np.int64(-1)

# Densities: several times a good sensor's own, since links bend and shake where the model is rigid.
GYRO_NOISE, ACCELERATION_NOISE = 5e-4, 5e-3
"""rad/s/√Hz, m/s²/√Hz"""
GYRO_WALK, ACCELERATION_WALK = 1e-5, 1e-4
"""rad/s²/√Hz, m/s³/√Hz: of the offsets"""
FOOT_WALK, FOOT_NOISE = 5e-4, 1e-3
"""m/√s that a foot in contact may creep; m, error of where the legs say that it is"""
STILL_NOISE = 0.01
"""m/s, of a robot that hangs still"""
SLIPPED = 25.0
"""squared Mahalanobis distance (three degrees of freedom) beyond which a foot has slipped: of others, 2 in 10⁵ are so far"""
TILT_AT_START, VELOCITY_AT_START = 0.1, 0.1
GYRO_OFFSET_AT_START, ACCELERATION_OFFSET_AT_START = 5e-3, 0.05
"""standard deviations: rad, m/s, rad/s, m/s²"""

_EXACT = 1e-10  # m²: what begins at a place is there

inner = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)  # type: ignore[call-overload]
"""compiled for callers that are compiled, which takes half the time"""


@inner
def cross(x, to, a, b):  # type: ignore[no-untyped-def]
    i = x[a + 1] * x[b + 2] - x[a + 2] * x[b + 1]
    j = x[a + 2] * x[b] - x[a] * x[b + 2]
    x[to + 2] = x[a] * x[b + 1] - x[a + 1] * x[b]
    x[to], x[to + 1] = i, j


@inner
def turn(x, to, r, v):  # type: ignore[no-untyped-def]
    """R v, for a rotation by rows."""
    a, b, c = x[v], x[v + 1], x[v + 2]
    for i in range(3):
        x[to + i] = x[r + 3 * i] * a + x[r + 3 * i + 1] * b + x[r + 3 * i + 2] * c


@inner
def turn_back(x, to, r, v):  # type: ignore[no-untyped-def]
    """Rᵀ v."""
    a, b, c = x[v], x[v + 1], x[v + 2]
    for i in range(3):
        x[to + i] = x[r + i] * a + x[r + 3 + i] * b + x[r + 6 + i] * c


@inner
def product(x, to, a, b):  # type: ignore[no-untyped-def]
    """A B, rotations by rows; not in place of B."""
    for i in range(0, 9, 3):
        p, q, r = x[a + i], x[a + i + 1], x[a + i + 2]
        for j in range(3):
            x[to + i + j] = p * x[b + j] + q * x[b + 3 + j] + r * x[b + 6 + j]


@inner
def rotation(x, to, v, share):  # type: ignore[no-untyped-def]
    """exp of a share of the rotation vector at v, rad, by rows (Rodrigues)."""
    a, b, c = share * x[v], share * x[v + 1], share * x[v + 2]
    square = a * a + b * b + c * c
    s, k = 1.0 - square / 6.0, 0.5 - square / 24.0
    if square > 1e-8:
        angle = math.sqrt(square)
        s, k = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    x[to], x[to + 4], x[to + 8] = 1.0 - k * (b * b + c * c), 1.0 - k * (a * a + c * c), 1.0 - k * (a * a + b * b)
    x[to + 1], x[to + 3] = k * a * b - s * c, k * a * b + s * c
    x[to + 2], x[to + 6] = k * a * c + s * b, k * a * c - s * b
    x[to + 5], x[to + 7] = k * b * c - s * a, k * b * c + s * a


@inner
def _moved(x, line, first, step, n, h):  # type: ignore[no-untyped-def]
    """Every `step`th of `line` from `first` on, an error (or a line of its covariances), ← Φ of it: what it is h s later.

    Hartley et al. 2020, eq. 37: ξ̇_R = −R ζ_ω, ξ̇_v = g × ξ_R − v × R ζ_ω − R ζ_a, ξ̇_p = ξ_v − p × R ζ_ω, ξ̇_d = −d × R ζ_ω.
    """
    for i in range(3):
        x[WORK + i], x[WORK + 3 + i] = h * line[first + (EG + i) * step], h * line[first + (EA + i) * step]
    turn(x, WORK, R, WORK)
    turn(x, WORK + 3, R, WORK + 3)
    x[WORK + 6], x[WORK + 7], x[WORK + 8] = GRAVITY * h * line[first + step], -GRAVITY * h * line[first], 0.0
    cross(x, WORK + 9, P, WORK)
    cross(x, WORK + 12, V, WORK)
    for i in range(3):
        v = first + (EV + i) * step
        line[first + (EP + i) * step] += h * (line[v] + 0.5 * x[WORK + 6 + i]) - x[WORK + 9 + i]
        line[v] += x[WORK + 6 + i] - x[WORK + 12 + i] - x[WORK + 3 + i]
        line[first + i * step] -= x[WORK + i]
    for foot in range(n):
        cross(x, WORK + 9, FEET + FOOT * foot + ANCHOR, WORK)
        for i in range(3):
            line[first + (ED + 3 * foot + i) * step] -= x[WORK + 9 + i]


@inner
def predict(x, covariance, anchored, n, h):  # type: ignore[no-untyped-def]
    """Go on by h s with what the sensor measured. anchored (n,): 1 for feet that are."""
    m = ED + 3 * n
    for i in range(2 * m):  # columns, then rows
        _moved(x, covariance, i if i < m else (i - m) * m, m if i < m else 1, n, h)
    # The angular velocity's noise, seen from the world's origin, is [I, v×, p×, d×] white noise: a column an axis of it.
    for axis in range(3):
        for i in range(m):
            x[ROW + i] = 0.0
        for i in range(3):
            x[WORK + i] = 0.0
        x[WORK + axis] = x[ROW + axis] = 1.0
        cross(x, ROW + EV, V, WORK)
        cross(x, ROW + EP, P, WORK)
        for foot in range(n):
            if anchored[foot]:
                cross(x, ROW + ED + 3 * foot, FEET + FOOT * foot + ANCHOR, WORK)
        for i in range(m):
            gain = GYRO_NOISE**2 * h * x[ROW + i]
            for j in range(m):
                covariance[i * m + j] += gain * x[ROW + j]
    for i in range(m):
        for j in range(i):
            both = 0.5 * (covariance[i * m + j] + covariance[j * m + i])
            covariance[i * m + j] = covariance[j * m + i] = both
    for i in range(3):
        covariance[(EV + i) * (m + 1)] += ACCELERATION_NOISE**2 * h
        covariance[(EG + i) * (m + 1)] += GYRO_WALK**2 * h
        covariance[(EA + i) * (m + 1)] += ACCELERATION_WALK**2 * h
        for foot in range(n):
            if anchored[foot]:
                covariance[(ED + 3 * foot + i) * (m + 1)] += FOOT_WALK**2 * h

    for i in range(3):
        x[WORK + i] = x[OMEGA + i] - x[OMEGA_OFFSET + i]
        x[WORK + 3 + i] = x[ACCELERATION + i] - x[ACCELERATION_OFFSET + i]
    rotation(x, WORK + 6, WORK, 0.5 * h)
    product(x, WORK + 15, R, WORK + 6)
    turn(x, WORK + 3, WORK + 15, WORK + 3)  # in the middle of the step
    product(x, R, WORK + 15, WORK + 6)
    x[WORK + 5] -= GRAVITY
    for i in range(3):
        x[P + i] += h * (x[V + i] + 0.5 * h * x[WORK + 3 + i])
        x[V + i] += h * x[WORK + 3 + i]


@inner
def anchor(x, covariance, foot, n):  # type: ignore[no-untyped-def]
    """A foot is anchored where it is seen."""
    m, at, d = ED + 3 * n, FEET + FOOT * foot, ED + 3 * foot
    turn(x, at + ANCHOR, R, at + PLACE)
    for i in range(3):
        x[at + ANCHOR + i] += x[P + i]
        for j in range(m):
            covariance[(d + i) * m + j] = covariance[(EP + i) * m + j]
    for i in range(3):
        for j in range(m):
            covariance[j * m + d + i] = covariance[j * m + EP + i]
    for i in range(3):
        covariance[(d + i) * (m + 1)] += FOOT_NOISE**2


@inner
def release(covariance, foot, n):  # type: ignore[no-untyped-def]
    """A foot is anchored no more."""
    m, d = ED + 3 * n, ED + 3 * foot
    for i in range(3):
        for j in range(m):
            covariance[(d + i) * m + j] = covariance[j * m + d + i] = 0.0


@inner
def _off(x, to, foot):  # type: ignore[no-untyped-def]
    """R y + p − d: how far a foot is seen from its anchor."""
    at = FEET + FOOT * foot
    turn(x, to, R, at + PLACE)
    for i in range(3):
        x[to + i] += x[P + i] - x[at + ANCHOR + i]


@inner
def slipped(x, covariance, foot, n):  # type: ignore[no-untyped-def]
    """An anchored foot is further from its anchor than can be: zᵀ S⁻¹ z, by Cholesky's S = L Lᵀ."""
    m, d, at = ED + 3 * n, ED + 3 * foot, WORK + 3
    _off(x, WORK, foot)
    total = 0.0
    for i in range(3):
        rest = x[WORK + i]
        for j in range(i + 1):
            s = covariance[(EP + i) * m + EP + j] + covariance[(d + i) * m + d + j]
            s -= covariance[(EP + i) * m + d + j] + covariance[(d + i) * m + EP + j]
            for k in range(j):
                s -= x[at + 3 * i + k] * x[at + 3 * j + k]
            x[at + 3 * i + j] = math.sqrt(s + FOOT_NOISE**2) if i == j else s / x[at + 4 * j]
            if j < i:
                rest -= x[at + 3 * i + j] * x[WORK + j]
        x[WORK + i] = rest / x[at + 4 * i]
        total += x[WORK + i] ** 2
    return not total <= SLIPPED


@inner
def _take(x, covariance, plus, minus, variance, z, n):  # type: ignore[no-untyped-def]
    """What was measured at z, ξ[plus:] − ξ[minus:] (−1: the one alone) with one variance an axis, one by one: into ERROR."""
    m = ED + 3 * n
    for k in range(3):
        for j in range(m):
            x[ROW + j] = covariance[(plus + k) * m + j]
        rest = x[z + k] - x[ERROR + plus + k]
        s = variance + x[ROW + plus + k]
        if minus >= 0:
            for j in range(m):
                x[ROW + j] -= covariance[(minus + k) * m + j]
            rest += x[ERROR + minus + k]
            s = variance + x[ROW + plus + k] - x[ROW + minus + k]
        for i in range(m):
            gain = x[ROW + i] / s
            x[ERROR + i] += gain * rest
            for j in range(m):
                covariance[i * m + j] -= gain * x[ROW + j]


@inner
def stand(x, covariance, anchored, n):  # type: ignore[no-untyped-def]
    """Feet that are anchored stand still."""
    for i in range(ED + 3 * n):
        x[ERROR + i] = 0.0
    for foot in range(n):
        if anchored[foot]:
            _off(x, WORK, foot)
            _take(x, covariance, EP, ED + 3 * foot, FOOT_NOISE**2, WORK, n)
    _correct(x, n)


@inner
def hang_still(x, covariance, velocity, n):  # type: ignore[no-untyped-def]
    """The sensor moves at `velocity` m/s, its axes, as the joints between it and a base that stands still say."""
    for i in range(ED + 3 * n):
        x[ERROR + i] = 0.0
    turn(x, WORK, R, velocity)
    for i in range(3):
        x[WORK + i] = x[V + i] - x[WORK + i]
    _take(x, covariance, EV, _NONE, STILL_NOISE**2, WORK, n)
    _correct(x, n)


@inner
def _correct(x, n):  # type: ignore[no-untyped-def]
    """X̂ ← exp(−ξ) X̂, with ξ at ERROR."""
    rotation(x, WORK, ERROR, -1.0)
    for i in range(9):
        x[WORK + 9 + i] = x[R + i]
    product(x, R, WORK, WORK + 9)
    for part in range(2 + n):
        at = V + 3 * part if part < 2 else FEET + FOOT * (part - 2) + ANCHOR
        e = ERROR + (EV + 3 * part if part < 2 else ED + 3 * (part - 2))
        turn(x, at, WORK, at)
        cross(x, WORK + 18, ERROR, e)
        cross(x, WORK + 21, ERROR, WORK + 18)
        for i in range(3):  # the left Jacobian, to second order: a correction is small
            x[at + i] -= x[e + i] - 0.5 * x[WORK + 18 + i] + x[WORK + 21 + i] / 6.0
    for i in range(6):
        x[OMEGA_OFFSET + i] -= x[ERROR + EG + i]
    _straighten(x)


@inner
def _straighten(x):  # type: ignore[no-untyped-def]
    """R's rows at right angles and of length one again: rounding adds up over hours."""
    for row in range(0, 6, 3):
        along = 0.0
        if row:
            along = x[R] * x[R + 3] + x[R + 1] * x[R + 4] + x[R + 2] * x[R + 5]
        square = 0.0
        for i in range(row, row + 3):
            if row:
                x[R + i] -= along * x[R + i - 3]
            square += x[R + i] ** 2
        for i in range(row, row + 3):
            x[R + i] /= math.sqrt(square)
    cross(x, R + 6, R, R + 3)


def begin(x: Array, covariance: Array, place: Array, heading: float) -> None:
    """At rest, the base at `place` m with its x axis to `heading` rad, and tilted so that what the sensor feels is gravity's.

    covariance (m, m).
    """
    base = x[BASE : BASE + 9].reshape(3, 3)
    up = base.T @ x[ACCELERATION : ACCELERATION + 3]
    up /= np.linalg.norm(up)
    ahead = np.eye(3)[0 if abs(up[0]) < 0.99 else 1]  # one that looks straight up may have any heading
    ahead = ahead - up * (up @ ahead)
    ahead /= np.linalg.norm(ahead)
    left, c, s = np.cross(up, ahead), math.cos(heading), math.sin(heading)
    # Rows: where the world's axes are in the base's.
    sensor = np.array([c * ahead - s * left, s * ahead + c * left, up]) @ base.T
    x[R : R + 9] = sensor.ravel()
    x[P : P + 3] = place - sensor @ x[BASE_PLACE : BASE_PLACE + 3]
    x[V : V + 3] = x[OMEGA_OFFSET : OMEGA_OFFSET + 3] = x[ACCELERATION_OFFSET : ACCELERATION_OFFSET + 3] = 0.0
    variances = np.zeros(len(covariance))
    variances[EV:EP], variances[EP:EG] = VELOCITY_AT_START**2, _EXACT
    variances[EG:EA], variances[EA:ED] = GYRO_OFFSET_AT_START**2, ACCELERATION_OFFSET_AT_START**2
    covariance[...] = np.diag(variances)
    # What is not known is how the robot is tilted about its base, and ξ is about the world's origin: ξ_p = p × ξ_R.
    tilts = np.zeros((len(covariance), 2))
    tilts[:3] = np.eye(3)[:, :2]
    tilts[EP:EG] = np.cross(place, np.eye(3)[:2]).T
    covariance += TILT_AT_START**2 * tilts @ tilts.T
