"""A list for QML that grows at its end and loses at its beginning: what a finger scrolls through is not made anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QModelIndex

from tablet_client.role_list import RoleList


class GrowingList(RoleList):
    """Entries with a `number` that rises from one to the next; roles are their other attributes."""

    def _value(self, line: Any, role: str) -> Any:
        value = getattr(line, role)
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
