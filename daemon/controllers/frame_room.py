"""How fast the rate may change at which a frame's path is run: what the path leaves of the joints' limits.

A line's pose is run through as a share σ(s) of one twist d, so joints that follow it do q' = g σ' with g = J⁺ d, and by s
q″ = g σ″ + g_σ σ'², q‴ = g σ‴ + 3 g_σ σ' σ″ to first order in how g changes along the way, g_σ = ∂g/∂σ: g is looked at where the
robot is, and where the next second of the path will have led it. J⁺ is damped, as the controllers' own is, so that a singular
posture asks for no more than they would.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.references import HORIZON, LEAST_ROOM, MAX_RATE_CHANGE, MAX_RATE_JERK, HermitePath, LinePath
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

JACOBIAN_DAMPING = 0.05
_LOOKS = 21
_SHORTEST = 0.05
"""s over which gains change at least: what is left of a path may be next to nothing"""


def damped_inverse(jacobian: Array) -> Array:
    """Jᵀ (J Jᵀ + λ² I)⁻¹, (m, 6) (Nakamura and Hanafusa 1986)."""
    normal = jacobian @ jacobian.T
    normal.flat[::7] += JACOBIAN_DAMPING**2
    return np.asarray(np.linalg.solve(normal, jacobian).T, np.float64)


def frame_room(
    path: LinePath,
    s: float,
    kinematics: Kinematics,
    frame: str,
    rows: NDArray[np.int64],
    position: Array,
    limits: Array,
    axes: Array | None = None,
) -> tuple[float, float]:
    """The rate's acceleration 1/s and jerk 1/s² for which the next second of a frame's path leaves room, from `s` on.

    `rows` (m,): joints that bring it there, at `position` (n,) rad; `limits` (2, m): rad/s² and rad/s³ that they may do;
    `axes` (3, 3): those that the path is said in, seen from the base; None: the base's.
    """
    ahead = np.linspace(s, min(s + HORIZON, path.length), _LOOKS)
    share, *derivatives = path.shares(ahead)
    slope, bend, twitch = (float(np.abs(one).max()) for one in derivatives)
    twist = path.twist(s)
    if axes is not None:
        twist = np.concatenate((axes @ twist[:3], axes @ twist[3:]))
    here = damped_inverse(kinematics.jacobian(position, frame)[:, rows]) @ twist
    then, way = position.copy(), float(share[-1] - share[0])
    then[rows] += here * way
    there = damped_inverse(kinematics.jacobian(then, frame)[:, rows]) @ twist
    most = np.maximum(np.abs(here), np.abs(there))
    turn = np.abs(there - here) / max(way, 1e-3)
    return left(
        np.array((most * slope, most * bend + turn * slope**2, most * twitch + 3 * turn * slope * bend)), limits
    )


def point_room(
    path: HermitePath, s: float, kinematics: Kinematics, frame: str, rows: NDArray[np.int64], position: Array,
    limits: Array, axes: Array,
) -> tuple[float, float]:  # fmt: skip
    """As `frame_room`, of a path of three columns in m: how the gains change is looked at over that second as a whole."""
    ahead = min(s + HORIZON, path.length)
    here, way = _gain(kinematics, frame, rows, position, axes), path.place(ahead) - path.place(s)
    then = position.copy()
    then[rows] += here @ way
    there = _gain(kinematics, frame, rows, then, axes)
    most = np.maximum(np.abs(here), np.abs(there))
    change = np.abs(there - here) / max(ahead - s, _SHORTEST)
    speed, bend, twitch = path.most(s)
    return left(np.array((most @ speed, most @ bend + change @ speed, most @ twitch + 3 * change @ bend)), limits)


def _gain(kinematics: Kinematics, frame: str, rows: NDArray[np.int64], position: Array, axes: Array) -> Array:
    """(m, 3) of joints' velocities over a frame's, which does not turn."""
    return damped_inverse(kinematics.jacobian(position, frame)[:, rows])[:, :3] @ axes


def left(most: Array, limits: Array) -> tuple[float, float]:
    """As `frame_room`, of joints whose velocity, acceleration and jerk by s are at `most` these, (3, m)."""
    velocity = most[0] + 1e-12
    change = np.maximum(limits[0] - most[1], LEAST_ROOM * limits[0]) / velocity
    rate = min(float(change.min()), MAX_RATE_CHANGE)
    jerk = np.maximum(limits[1] - most[2] - 3.0 * most[1] * rate, LEAST_ROOM * limits[1]) / velocity
    return rate, min(float(jerk.min()), MAX_RATE_JERK)


def least(rooms: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """What all of them leave."""
    found = [(MAX_RATE_CHANGE, MAX_RATE_JERK), *rooms]
    return min(change for change, _ in found), min(jerk for _, jerk in found)
