"""A list for QML that grows at its end and loses at its beginning: what a finger scrolls through is not made anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractListModel, QByteArray, QModelIndex, Qt

_FIRST = Qt.ItemDataRole.UserRole.value


class GrowingList(QAbstractListModel):
    """Entries with a `number` that rises from one to the next; roles are their other attributes."""

    def __init__(self, roles: Sequence[str]):
        super().__init__()
        self._roles = tuple(roles)
        self._shown: list[Any] = []

    def rowCount(self, parent: Any = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self._shown)

    def roleNames(self) -> dict[int, QByteArray]:
        return {_FIRST + number: QByteArray(name.encode()) for number, name in enumerate(self._roles)}

    def data(self, index: Any, role: int = 0) -> Any:
        if not index.isValid() or not _FIRST <= role < _FIRST + len(self._roles):
            return None
        value = getattr(self._shown[index.row()], self._roles[role - _FIRST])
        return list(value) if isinstance(value, tuple) else value

    @property
    def last(self) -> int:
        """Number of the newest entry that is shown, 0: there is none."""
        return self._shown[-1].number if self._shown else 0

    def grow(self, entries: Sequence[Any], most: int) -> None:
        """Take those that are newer than the last one; of more than `most` the oldest go."""
        last = self.last
        new = [entry for entry in entries if entry.number > last][-most:]
        if not new:
            return
        surplus = len(self._shown) + len(new) - most
        if surplus > 0:
            self.beginRemoveRows(QModelIndex(), 0, surplus - 1)
            del self._shown[:surplus]
            self.endRemoveRows()
        self.beginInsertRows(QModelIndex(), len(self._shown), len(self._shown) + len(new) - 1)
        self._shown += new
        self.endInsertRows()

    def show(self, entries: Sequence[Any]) -> None:
        """Take these in place of all."""
        self.beginResetModel()
        self._shown = list(entries)
        self.endResetModel()
