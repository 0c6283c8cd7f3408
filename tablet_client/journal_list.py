"""The journal as a list for QML, which only grows at its end and loses at its beginning."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QAbstractListModel, QByteArray, QModelIndex, Qt

from tablet_client.models.situation import Situation

_ROLES = ("clock", "level", "code", "details")
_FIRST = Qt.ItemDataRole.UserRole.value


class JournalList(QAbstractListModel):
    """The journal's entries, oldest first."""

    def __init__(self, situation: Situation):
        super().__init__()
        self._journal = situation.journal
        self._shown = list(self._journal.entries)

    def rowCount(self, parent: Any = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self._shown)

    def roleNames(self) -> dict[int, QByteArray]:
        return {_FIRST + number: QByteArray(name.encode()) for number, name in enumerate(_ROLES)}

    def data(self, index: Any, role: int = 0) -> Any:
        if not index.isValid() or not _FIRST <= role < _FIRST + len(_ROLES):
            return None
        value = getattr(self._shown[index.row()], _ROLES[role - _FIRST])
        return list(value) if isinstance(value, tuple) else value

    def refresh(self) -> None:
        entries = self._journal.entries
        last = self._shown[-1].number if self._shown else 0
        new = [entry for entry in entries if entry.number > last]
        if not new:
            return
        self.beginInsertRows(QModelIndex(), len(self._shown), len(self._shown) + len(new) - 1)
        self._shown += new
        self.endInsertRows()
        surplus = len(self._shown) - len(entries)
        if surplus > 0:
            self.beginRemoveRows(QModelIndex(), 0, surplus - 1)
            del self._shown[:surplus]
            self.endRemoveRows()
