"""Template shapes and other plain solids as meshes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

from affordance_templates.template import Shape
from tablet_client.scene.meshes import Mesh, merged, shaded

_ROUND = 20  # segments around a circle: round at arm's length, cheap to draw


@lru_cache(maxsize=256)
def solid(kind: str, size: tuple[float, ...], file: Path | None = None) -> Mesh:
    """A shape about its own origin, as in `affordance_templates.template.Shape`. Raises ValueError for another kind."""
    if kind == "capsule":
        body = trimesh.creation.capsule(radius=size[0], height=size[1], count=[_ROUND, 8])
        body.apply_translation(-body.bounds.mean(axis=0))
    elif kind == "cylinder":
        body = trimesh.creation.cylinder(radius=size[0], height=size[1], sections=_ROUND + 4)
    elif kind == "box":
        body = trimesh.creation.box(extents=size)
    elif kind == "sphere":
        body = trimesh.creation.icosphere(subdivisions=2, radius=size[0])
    elif kind == "torus":
        body = trimesh.creation.torus(major_radius=size[0], minor_radius=size[1], major_sections=48, minor_sections=12)
    elif kind == "mesh":
        body = trimesh.load_mesh(file)
        body.apply_scale(size)
    else:
        raise ValueError(f"shape.kind: got {kind!r}; expected capsule, cylinder, box, sphere, torus or mesh")
    return shaded(body)


def shapes(parts: Iterable[Shape]) -> Mesh:
    """A template's shapes as one mesh in the template's frame."""
    return merged(
        solid(part.kind, tuple(part.size), part.file).painted(part.color).transformed(part.pose_in_template)
        for part in parts
    )


def tube(points: np.ndarray, radius: float, color: Sequence[float]) -> Mesh:
    """A line through `points` (k, 3), m, thick enough to see. Consecutive points that coincide count once."""
    points = np.asarray(points, float)
    if len(points):
        apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > radius * 0.2
        points = points[np.concatenate([[True], apart])]
    if len(points) < 2:
        return merged([])
    sides = 6
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-12
    helper = np.where(np.abs(tangent[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(tangent, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-12
    up = np.cross(tangent, across)
    angles = np.arange(sides) / sides * 2 * np.pi
    normals = np.cos(angles)[:, None] * across[:, None] + np.sin(angles)[:, None] * up[:, None]
    vertices = (points[:, None] + radius * normals).reshape(-1, 3)
    ring = np.arange(len(points) - 1)[:, None] * sides
    here, there = ring + np.arange(sides), ring + (np.arange(sides) + 1) % sides
    faces = np.concatenate(
        [
            np.stack([here, there, here + sides], -1).reshape(-1, 3),
            np.stack([there, there + sides, here + sides], -1).reshape(-1, 3),
        ]
    )
    return Mesh(
        vertices.astype(np.float32),
        normals.reshape(-1, 3).astype(np.float32),
        np.zeros((len(vertices), 4), np.float32),
        faces.astype(np.uint32),
    ).painted(color)


def cloud(positions: np.ndarray, colours: np.ndarray | None, size: float, most: int) -> Mesh:
    """Points (n, 3) m with colours uint8 (n, 3) as octahedra of `size` m, at most about `most` of them, evenly left out."""
    few = max(1, -(-len(positions) // most))
    positions = np.asarray(positions, np.float32)[::few]
    corners = np.float32(size / 2) * np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    vertices = (positions[:, None] + corners).reshape(-1, 3).astype(np.float32)
    colors = np.ones((len(vertices), 4), np.float32)
    colors[:, :3] = 0.8 if colours is None else np.repeat(colours[::few] / np.float32(255), 6, axis=0)
    faces = np.array(list(itertools.product((0, 3), (1, 4), (2, 5))), np.uint32)
    faces = (np.arange(len(positions), dtype=np.uint32)[:, None, None] * np.uint32(6) + faces).reshape(-1, 3)
    return Mesh(vertices, np.zeros((0, 3), np.float32), colors, faces)


def floor_grid(size: float, step: float, color: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Line segments of a square grid in the xy plane that fades out: vertices (2k, 3) m, colours (2k, 4)."""
    count = round(size / step)
    ticks = np.linspace(-size, size, 2 * count + 1)
    # Cut each line into cells, so that its opacity can fade with distance from the centre.
    a, b = np.meshgrid(ticks, ticks[:-1], indexing="ij")
    start = np.stack([b, a, 0 * a], -1).reshape(-1, 3)
    end = start + np.array([step, 0.0, 0.0])
    along_x = np.stack([start, end], 1).reshape(-1, 3)
    vertices = np.concatenate([along_x, along_x[:, [1, 0, 2]]])
    fade = np.clip(1.0 - np.linalg.norm(vertices, axis=1) / size, 0.0, 1.0) ** 1.5
    colors = np.tile(np.asarray(color, np.float32), (len(vertices), 1))
    colors[:, 3] *= fade
    return vertices.astype(np.float32), colors.astype(np.float32)
