"""Triangle meshes that a slow graphics processor can draw: read, thinned out, shaded smooth, and kept in the user's cache."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np
import trimesh
from numpy.typing import NDArray

# A mesh keeps this share of its triangles, and at least so many: TALOS then has 48,000 instead of 190,000 and looks the same.
_SHARE, _LEAST = 0.2, 1200
_CREASE = np.radians(32.0)  # edges sharper than this stay edges
_RECIPE = "1"  # in the cache's key: change it when this file makes other meshes from the same input


@dataclass(frozen=True)
class Mesh:
    """Vertices (k, 3) m and their unit normals (k, 3), colours (k, 4) 0..1, all float32; triangles (f, 3) uint32."""

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    colors: NDArray[np.float32]
    faces: NDArray[np.uint32]

    def transformed(self, pose: NDArray[np.float64]) -> Mesh:
        """The mesh under a rigid transform (4, 4)."""
        rotation = pose[:3, :3].astype(np.float32)
        return Mesh(
            self.vertices @ rotation.T + pose[:3, 3].astype(np.float32),
            self.normals @ rotation.T,
            self.colors,
            self.faces,
        )

    def painted(self, color: Iterable[float]) -> Mesh:
        """The mesh in one colour, red, green, blue, opacity."""
        colors = np.broadcast_to(np.asarray(tuple(color), np.float32), (len(self.vertices), 4))
        return Mesh(self.vertices, self.normals, np.ascontiguousarray(colors), self.faces)


EMPTY = Mesh(
    np.zeros((0, 3), np.float32),
    np.zeros((0, 3), np.float32),
    np.zeros((0, 4), np.float32),
    np.zeros((0, 3), np.uint32),
)


def merged(meshes: Iterable[Mesh]) -> Mesh:
    """Several meshes as one, so that they are drawn in one call."""
    parts = [mesh for mesh in meshes if len(mesh.faces)]
    if not parts:
        return EMPTY
    first = np.cumsum([0] + [len(mesh.vertices) for mesh in parts[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in parts]),
        np.concatenate([mesh.normals for mesh in parts]),
        np.concatenate([mesh.colors for mesh in parts]),
        np.concatenate([mesh.faces + np.uint32(start) for mesh, start in zip(parts, first, strict=True)]),
    )


def shaded(solid: trimesh.Trimesh, *, faces: int | None = None, crease: float = _CREASE) -> Mesh:
    """A trimesh as a Mesh in light grey, with at most `faces` triangles, smooth across edges up to `crease` rad."""
    solid = solid.copy()
    solid.merge_vertices()
    if faces is not None and len(solid.faces) > faces:
        points, triangles = fast_simplification.simplify(
            np.asarray(solid.vertices, np.float32), np.asarray(solid.faces, np.int32), target_count=faces, agg=3
        )
        solid = trimesh.Trimesh(points, triangles)
    solid = trimesh.graph.smooth_shade(solid, angle=crease, facet_minarea=None)
    vertices = np.ascontiguousarray(solid.vertices, np.float32)
    normals = np.ascontiguousarray(solid.vertex_normals, np.float32)
    return Mesh(
        vertices, normals, np.full((len(vertices), 4), 0.8, np.float32), np.ascontiguousarray(solid.faces, np.uint32)
    )


def from_file(path: Path, scale: tuple[float, float, float], cache: Path) -> Mesh:
    """A mesh file, scaled, ready to draw; from `cache` when it was prepared before. Raises OSError, ValueError."""
    content = path.read_bytes()
    name = hashlib.sha256(b"|".join((_RECIPE.encode(), repr((scale, _SHARE, _LEAST)).encode(), content))).hexdigest()[
        :24
    ]

    def make() -> Mesh:
        solid = _read(path, scale)
        return shaded(solid, faces=max(_LEAST, round(_SHARE * len(solid.faces))))

    return _cached(cache / f"{name}.npz", make)


def _read(path: Path, scale: tuple[float, float, float]) -> trimesh.Trimesh:
    solid = trimesh.load(path, force="mesh", process=False)
    if not isinstance(solid, trimesh.Trimesh) or not len(solid.faces):
        raise ValueError(f"{path}: has no triangles")
    solid.apply_transform(np.diag([*scale, 1.0]))  # a mirroring scale turns the triangles round too
    return solid


def _cached(file: Path, make: Callable[[], Mesh]) -> Mesh:
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return Mesh(arrays["vertices"], arrays["normals"], arrays["colors"], arrays["faces"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        pass  # not there yet, or cut short by a full disk: made anew below
    mesh = make()
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".part", delete=False) as part:
        np.savez(part, vertices=mesh.vertices, normals=mesh.normals, colors=mesh.colors, faces=mesh.faces)
    os.replace(part.name, file)
    return mesh
