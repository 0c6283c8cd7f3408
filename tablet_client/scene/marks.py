"""What marks things in the scene: waypoints by what an arm can reach, and the parts of a handle."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh

from tablet_client.scene import solids
from tablet_client.scene.meshes import Mesh, merged, shaded

STATES = ("", "reached", "near", "not")
"""of a waypoint: not known, and those of handrail.messages.WaypointReach"""
WAY = (0.75, 0.82, 0.9, 1.0)
_COLORS = {
    "": (0.62, 0.68, 0.74, 1.0),
    "reached": (0.27, 0.77, 0.53, 1.0),
    "near": (0.94, 0.71, 0.25, 1.0),
    "not": (1.0, 0.36, 0.32, 1.0),
}
_AXES = {"x": (1.0, 0.36, 0.32, 1.0), "y": (0.36, 0.83, 0.42, 1.0), "z": (0.35, 0.6, 1.0, 1.0)}
_BALL, _STEM = 0.011, 0.055  # m
_RING = 0.72  # of an arrow, as in models/handle.py


@lru_cache(maxsize=8)
def waypoint(state: str) -> Mesh:
    """A tool's tip with a stem that points back along the hand, and a short one along its x; in the waypoint's own frame."""
    color = _COLORS[state]
    ball = solids.solid("sphere", (_BALL,)).painted(color)
    back = solids.tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, _STEM]]), 0.0032, color)
    side = solids.tube(np.array([[0.0, 0.0, 0.0], [_STEM / 2.5, 0.0, 0.0]]), 0.0022, color)
    # A cross where a way does not go: colour alone says nothing to some eyes.
    cross = [solids.tube(np.array([[-s, -1.0, 0.6], [s, 1.0, 0.6]]) * 2.2 * _BALL, 0.0026, color) for s in (-1.0, 1.0)]
    return merged([ball, back, side, *(cross if state == "not" else [])])


def part(name: str) -> Mesh:
    """A part of a handle whose arrows are 1 m long: arrow `t`, ring `r`, along or about `x`, `y` or `z`."""
    axis, color = "xyz".index(name[1]), _AXES[name[1]]
    if name[0] == "r":
        angles = np.linspace(0, 2 * np.pi, 65)
        rim = np.zeros((65, 3))
        rim[:, (axis + 1) % 3], rim[:, (axis + 2) % 3] = _RING * np.cos(angles), _RING * np.sin(angles)
        return solids.tube(rim, 0.016, color)
    along = np.eye(3)[axis]
    shaft = solids.tube(np.array([0.08 * along, 0.86 * along]), 0.016, color)
    tip = shaded(trimesh.creation.cone(radius=0.055, height=0.18, sections=16)).painted(color)
    turn = np.eye(4)
    turn[:3, :3] = np.roll(np.eye(3), axis + 1, axis=0)  # z to the axis
    turn[:3, 3] = 0.84 * along
    return merged([shaft, tip.transformed(turn)])
