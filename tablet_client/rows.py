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
        if [row[self._key] for row in rows] != [row[self._key] for row in self._rows]:
            self.beginResetModel()
            self._rows = rows
            self.endResetModel()
            return
        for number, (before, after) in enumerate(zip(self._rows, rows, strict=True)):
            if before != after:
                self._rows[number] = after
                self.dataChanged.emit(self.index(number, 0), self.index(number, 0))

    @property
    def lines(self) -> list[dict[str, Any]]:
        """As they are shown."""
        return self._rows
