"""Going over a part of a trajectory again: from where the robot stopped on it, back to its start or on to its end.

The way was collision-free when it was planned, so it needs no new planning; only its timing is made anew, from rest to rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handrail.messages import JointTrajectory

Array = NDArray[np.float64]

_SAMPLES = 400
_KNOTS = 60
_SPEED = 0.3  # share of the joints' velocity limits
_SHORTEST_S = 0.4
_PEAK = 1.875  # of a minimum-jerk profile's speed, over its mean


def hermite(times: Array, positions: Array, velocities: Array, at: Array) -> Array:
    """(j, m) rad: the cubic Hermite interpolation of knots (k,), (k, m), (k, m) at times (j,)."""
    index = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    step = (times[index + 1] - times[index])[:, None]
    s = (at - times[index])[:, None] / step
    return (
        (1 + 2 * s) * (1 - s) ** 2 * positions[index]
        + s * (1 - s) ** 2 * step * velocities[index]
        + s**2 * (3 - 2 * s) * positions[index + 1]
        + s**2 * (s - 1) * step * velocities[index + 1]
    )


def way(times: Array, positions: Array, velocities: Array, command: Array, *, back: bool) -> Array:
    """(j, m) rad: the path from the robot's command (m,) to the start (`back`) or the end of a trajectory.

    It begins exactly at the command, which lies on the path up to what a guard's stop left.
    """
    path = hermite(times, positions, velocities, np.linspace(0.0, float(times[-1]), _SAMPLES))
    nearest = int(np.abs(path - command).max(axis=1).argmin())
    rest = path[: nearest + 1][::-1] if back else path[nearest:]
    return np.vstack([command, rest[1:]])


def timed(joints: tuple[str, ...], path: Array, velocity_limit: Array) -> JointTrajectory | None:
    """A path (j, m) rad from rest to rest, at a minimum-jerk pace, slow against the joints' limits (m,) rad/s; None where it has
    no length.
    """
    steps = np.abs(np.diff(path, axis=0)).max(axis=1)
    if len(path) < 2 or steps.sum() < 1e-4:
        return None
    keep = np.append(True, steps > 1e-9)
    path = path[keep]
    along = np.append(0.0, np.cumsum(np.abs(np.diff(path, axis=0)).max(axis=1)))
    along /= along[-1]
    duration = _SHORTEST_S
    for _ in range(6):
        times = np.linspace(0.0, duration, _KNOTS)
        u = times / duration
        s = u**3 * (10 - 15 * u + 6 * u**2)
        positions = np.column_stack([np.interp(s, along, column) for column in path.T])
        velocities = np.gradient(positions, times, axis=0, edge_order=2)
        velocities[[0, -1]] = 0.0
        fastest = float((np.abs(velocities) / velocity_limit).max())
        if fastest <= _SPEED:
            break
        duration *= 1.05 * fastest / _SPEED
    return JointTrajectory(
        joints=list(joints), times=times.tolist(), positions=positions.tolist(), velocities=velocities.tolist()
    )
