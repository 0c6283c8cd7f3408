"""A list for QML whose lines change in place: a line that lies under a finger is not made anew because a number in it changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractListModel, QByteArray, QModelIndex, Qt

_FIRST = Qt.ItemDataRole.UserRole.value


class Rows(QAbstractListModel):
    """Lines as dictionaries, each a role a key. `key` tells which line is which."""

    def __init__(self, roles: Sequence[str], key: str):
        super().__init__()
        self._roles, self._key = tuple(roles), key
        self._rows: list[dict[str, Any]] = []

    def rowCount(self, parent: Any = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self._rows)

    def roleNames(self) -> dict[int, QByteArray]:
        return {_FIRST + number: QByteArray(name.encode()) for number, name in enumerate(self._roles)}

    def data(self, index: Any, role: int = 0) -> Any:
        if not index.isValid() or not _FIRST <= role < _FIRST + len(self._roles):
            return None
        return self._rows[index.row()].get(self._roles[role - _FIRST])

    def show(self, rows: list[dict[str, Any]]) -> None:
        """Take these lines."""
        self._replace(rows)
        for number, (before, after) in enumerate(zip(self._rows, rows, strict=True)):
            if before != after:
                self._rows[number] = after
                self.dataChanged.emit(self.index(number, 0), self.index(number, 0))

    def _replace(self, rows: list[dict[str, Any]]) -> None:
        """Take lines out and in so that there are the same as in `rows`; those that stay are not made anew."""
        before, after = [row[self._key] for row in self._rows], [row[self._key] for row in rows]
        if before == after:
            return
        same = 0
        while same < min(len(before), len(after)) and before[same] == after[same]:
            same += 1
        tail = 0
        while tail < min(len(before), len(after)) - same and before[-1 - tail] == after[-1 - tail]:
            tail += 1
        if len(before) - tail > same:
            self.beginRemoveRows(QModelIndex(), same, len(before) - tail - 1)
            del self._rows[same : len(before) - tail]
            self.endRemoveRows()
        if len(after) - tail > same:
            self.beginInsertRows(QModelIndex(), same, len(after) - tail - 1)
            self._rows[same:same] = rows[same : len(after) - tail]
            self.endInsertRows()

    @property
    def lines(self) -> list[dict[str, Any]]:
        """As they are shown."""
        return self._rows
