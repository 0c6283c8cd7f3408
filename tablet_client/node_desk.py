"""The desk of the nodes that run: their parameters, set while they do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from tablet_client.models.given import ROLES
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows


class NodeDesk(QObject):
    """What QML reads of the nodes that run of the document that is open, and calls."""

    changed = Signal()

    def __init__(self, situation: Situation, soon: Callable[[], None]):
        """`soon` has the models looked at anew."""
        super().__init__()
        self._situation, self._soon = situation, soon
        self._rows = Rows(("key", "node", "first", "doc", *ROLES), "key")
        self._problem = ""
        self._count = 0
        self.build()

    @Property(QObject, constant=True)
    def parameters(self) -> Rows:
        return self._rows

    @Property(int, notify=changed)
    def count(self) -> int:
        """How many parameters there are to set."""
        return self._count

    @Property(str, notify=changed)
    def problem(self) -> str:
        """Why the last value was declined."""
        return self._problem

    @Slot(str, str, float)
    def turn(self, node: str, parameter: str, value: float) -> None:
        self._put(node, parameter, value)

    @Slot(str, str, str)
    def write(self, node: str, parameter: str, text: str) -> None:
        self._put(node, parameter, text)

    @Slot(str, str, bool)
    def switch(self, node: str, parameter: str, on: bool) -> None:
        self._put(node, parameter, on)

    def _put(self, node: str, parameter: str, value: Any) -> None:
        if not self._situation.only_looks:
            self._situation.node_parameters.put(node, parameter, value)
            self.build()
            self._soon()

    def build(self) -> None:
        """Look at the model anew."""
        model, before, rows = self._situation.node_parameters, "", []
        for each in model.all():
            shown = each.given.shown()
            rows.append(
                {
                    **shown,
                    "key": f"{each.node}.{shown['name']}",
                    "node": each.node,
                    "first": each.node != before,
                    "doc": each.doc,
                }
            )
            before = each.node
        self._rows.show(rows)
        if (len(rows), model.problem) != (self._count, self._problem):
            self._count, self._problem = len(rows), model.problem
            self.changed.emit()
