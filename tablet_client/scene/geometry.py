"""Meshes and lines as Qt Quick 3D geometries. Keep a Python reference to each, or it vanishes."""

from __future__ import annotations

import sys

import numpy as np
from PySide6.QtCore import QByteArray
from PySide6.QtGui import QVector3D
from PySide6.QtQuick3D import QQuick3DGeometry

from tablet_client.scene import solids
from tablet_client.scene.meshes import Mesh

_Attribute = QQuick3DGeometry.Attribute
_Semantic = _Attribute.Semantic
_FLOAT = _Attribute.ComponentType.F32Type
_POINT = 0.005  # m, as cameras thin their clouds out; qml/Scene.qml has it, too
_MOST_GRAINS = 15_000
_GAMMA = 2.2  # colours are written as screens show them; the renderer computes in linear light


class MeshGeometry(QQuick3DGeometry):
    """Triangles with normals and a colour a vertex."""

    def __init__(self, mesh: Mesh | None = None):
        super().__init__()
        if mesh is not None:
            self.show(mesh)

    def show(self, mesh: Mesh) -> None:
        """Take another mesh."""
        self.clear()
        self.setStride(40)
        self.setPrimitiveType(QQuick3DGeometry.PrimitiveType.Triangles)
        self.addAttribute(_Semantic.PositionSemantic, 0, _FLOAT)
        self.addAttribute(_Semantic.NormalSemantic, 12, _FLOAT)
        self.addAttribute(_Semantic.ColorSemantic, 24, _FLOAT)
        self.addAttribute(_Semantic.IndexSemantic, 0, _Attribute.ComponentType.U32Type)
        columns = np.hstack([mesh.vertices, mesh.normals, _linear(mesh.colors)]).astype(np.float32)
        self.setVertexData(QByteArray(columns.tobytes()))
        self.setIndexData(QByteArray(np.ascontiguousarray(mesh.faces, np.uint32).tobytes()))
        _bound(self, mesh.vertices)
        self.update()


class LineGeometry(QQuick3DGeometry):
    """Line segments, two vertices (2k, 3) m each, with a colour a vertex (2k, 4)."""

    def __init__(self, vertices: np.ndarray, colors: np.ndarray):
        super().__init__()
        self.setStride(28)
        self.setPrimitiveType(QQuick3DGeometry.PrimitiveType.Lines)
        self.addAttribute(_Semantic.PositionSemantic, 0, _FLOAT)
        self.addAttribute(_Semantic.ColorSemantic, 12, _FLOAT)
        self.setVertexData(QByteArray(np.hstack([vertices, _linear(colors)]).astype(np.float32).tobytes()))
        _bound(self, vertices)
        self.update()


class Points(QQuick3DGeometry):
    """A cloud as points; the material says how large they are."""

    def __init__(self) -> None:
        super().__init__()
        self.setStride(28)
        self.setPrimitiveType(QQuick3DGeometry.PrimitiveType.Points)
        self.addAttribute(_Semantic.PositionSemantic, 0, _FLOAT)
        self.addAttribute(_Semantic.ColorSemantic, 12, _FLOAT)

    def show(self, positions: np.ndarray, colors: np.ndarray | None) -> None:
        """Take other points (n, 3) m with colours uint8 (n, 3), or all of them grey."""
        painted = np.full((len(positions), 4), (0.8, 0.8, 0.8, 1.0), np.float32)
        if colors is not None:
            painted[:, :3] = colors / np.float32(255)
        self.setVertexData(QByteArray(np.hstack([positions, _linear(painted)]).astype(np.float32).tobytes()))
        _bound(self, positions)
        self.update()


class Grains(QQuick3DGeometry):
    """A cloud as small solids, thinned out: Direct3D draws points of one pixel only."""

    def __init__(self) -> None:
        super().__init__()
        self.setStride(28)
        self.setPrimitiveType(QQuick3DGeometry.PrimitiveType.Triangles)
        self.addAttribute(_Semantic.PositionSemantic, 0, _FLOAT)
        self.addAttribute(_Semantic.ColorSemantic, 12, _FLOAT)
        self.addAttribute(_Semantic.IndexSemantic, 0, _Attribute.ComponentType.U32Type)

    def show(self, positions: np.ndarray, colors: np.ndarray | None) -> None:
        """Take other points (n, 3) m with colours uint8 (n, 3), or all of them grey."""
        mesh = solids.cloud(positions, colors, _POINT, _MOST_GRAINS)
        self.setVertexData(QByteArray(np.hstack([mesh.vertices, _linear(mesh.colors)]).astype(np.float32).tobytes()))
        self.setIndexData(QByteArray(np.ascontiguousarray(mesh.faces, np.uint32).tobytes()))
        _bound(self, mesh.vertices)
        self.update()


Cloud = Grains if sys.platform == "win32" else Points
"""what this system's graphics draw clouds as"""


def _linear(colors: np.ndarray) -> np.ndarray:
    return np.hstack([np.power(colors[:, :3], _GAMMA), colors[:, 3:]])


def _bound(geometry: QQuick3DGeometry, vertices: np.ndarray) -> None:
    if len(vertices):
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        geometry.setBounds(QVector3D(*map(float, low)), QVector3D(*map(float, high)))
