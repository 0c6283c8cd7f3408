"""A list of posed geometries for a QML Repeater3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import QAbstractListModel, QByteArray, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QQuaternion, QVector3D
from PySide6.QtQuick3D import QQuick3DGeometry

_Index = QModelIndex | QPersistentModelIndex
_ROLES = ("name", "geometry", "place", "turn", "shown")
_FIRST = Qt.ItemDataRole.UserRole.value


@dataclass
class Body:
    """One geometry and where it stands."""

    name: str
    geometry: QQuick3DGeometry
    place: QVector3D
    turn: QQuaternion
    shown: bool = True


class Bodies(QAbstractListModel):
    """Rows of name, geometry, position, rotation and visibility."""

    def __init__(self) -> None:
        super().__init__()
        self._rows: list[Body] = []

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self._rows)

    def roleNames(self) -> dict[int, QByteArray]:
        return {_FIRST + number: QByteArray(name.encode()) for number, name in enumerate(_ROLES)}

    def data(self, index: _Index, role: int = 0) -> Any:
        if not index.isValid() or not _FIRST <= role < _FIRST + len(_ROLES):
            return None
        return getattr(self._rows[index.row()], _ROLES[role - _FIRST])

    def replace(self, named: Sequence[tuple[str, QQuick3DGeometry]]) -> None:
        """Other bodies, all at the origin."""
        self.beginResetModel()
        self._rows = [Body(name, geometry, QVector3D(), QQuaternion()) for name, geometry in named]
        self.endResetModel()

    def names(self) -> list[str]:
        return [row.name for row in self._rows]

    def geometry(self, row: int) -> QQuick3DGeometry:
        return self._rows[row].geometry

    def pose(self, poses: np.ndarray, shown: np.ndarray | None = None) -> None:
        """Put all bodies at `poses` (rows, 4, 4); `shown` (rows,) hides those that it says False of."""
        if not self._rows:
            return
        for row, body in enumerate(self._rows):
            body.place, body.turn = placed(poses[row])
            body.shown = True if shown is None else bool(shown[row])
        self.dataChanged.emit(self.index(0), self.index(len(self._rows) - 1), [_FIRST + 2, _FIRST + 3, _FIRST + 4])

    def hide(self) -> None:
        """Hide all bodies."""
        if any(body.shown for body in self._rows):
            for body in self._rows:
                body.shown = False
            self.dataChanged.emit(self.index(0), self.index(len(self._rows) - 1), [_FIRST + 4])


def placed(pose: np.ndarray) -> tuple[QVector3D, QQuaternion]:
    """Position and rotation of a rigid transform (4, 4)."""
    x, y, z = (float(value) for value in pose[:3, 3])
    return QVector3D(x, y, z), quaternion(pose[:3, :3])


def quaternion(rotation: np.ndarray) -> QQuaternion:
    """A rotation matrix (3, 3) as a unit quaternion (Shepperd's method: divide by the largest of the four)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    largest = max(range(4), key=squares.__getitem__)
    s = 2 * squares[largest] ** 0.5
    values = (
        (s / 4, (h - f) / s, (c - g) / s, (d - b) / s),
        ((h - f) / s, s / 4, (b + d) / s, (c + g) / s),
        ((c - g) / s, (b + d) / s, s / 4, (f + h) / s),
        ((d - b) / s, (c + g) / s, (f + h) / s, s / 4),
    )[largest]
    return QQuaternion(*values)
