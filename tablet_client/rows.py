"""A list for QML whose lines change in place: a line that lies under a finger is not made anew because a number in it changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QModelIndex

from tablet_client.role_list import RoleList


class Rows(RoleList):
    """Lines as dictionaries, each a role a key. `key` tells which line is which."""

    def __init__(self, roles: Sequence[str], key: str):
        super().__init__(roles)
        self._key = key

    def _value(self, line: Any, role: str) -> Any:
        return line.get(role)

    def show(self, rows: list[dict[str, Any]]) -> None:
        """Take these lines."""
        self._replace(rows)
        for number, (before, after) in enumerate(zip(self._shown, rows, strict=True)):
            if before != after:
                self._shown[number] = after
                self.dataChanged.emit(self.index(number, 0), self.index(number, 0))

    def _replace(self, rows: list[dict[str, Any]]) -> None:
        """Take lines out and in so that there are the same as in `rows`; those that stay are not made anew."""
        before, after = [row[self._key] for row in self._shown], [row[self._key] for row in rows]
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
            del self._shown[same : len(before) - tail]
            self.endRemoveRows()
        if len(after) - tail > same:
            self.beginInsertRows(QModelIndex(), same, len(after) - tail - 1)
            self._shown[same:same] = rows[same : len(after) - tail]
            self.endInsertRows()

    @property
    def lines(self) -> list[dict[str, Any]]:
        """As they are shown."""
        return self._shown
