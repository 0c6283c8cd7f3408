"""Lists for QML: what a line of either kind has is its roles, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractListModel, QByteArray, QModelIndex, Qt

_FIRST = Qt.ItemDataRole.UserRole.value


class RoleList(QAbstractListModel):
    """Lines with the same roles each; `_shown` are the lines, `_value` says what a line has for a role."""

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
        return self._value(self._shown[index.row()], self._roles[role - _FIRST])

    def _value(self, line: Any, role: str) -> Any:
        raise NotImplementedError
