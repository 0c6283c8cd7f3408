"""What the canvas page's two desks have in common: of a program, and of a node that is made of nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from tablet_client.code_desk import CodeDesk
from tablet_client.models.canvas.canvas import Canvas
from tablet_client.models.canvas.picture import Curve
from tablet_client.models.canvas.wiring import Wiring

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


class DrawingDesk(QObject):
    """What QML reads of a picture that is edited, and calls. The document is the code page's, and is saved there."""

    changed = Signal()
    drawn = Signal()

    def __init__(self, drawing: Canvas | Wiring, code: CodeDesk, soon: Callable[[], None]):
        """`soon` has the models looked at anew."""
        super().__init__()
        self._drawing, self._code, self._soon = drawing, code, soon
        self._view: dict[str, Any] = {}

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    def curves(self) -> list[tuple[Curve, bool]]:
        """Each line, and whether it is selected."""
        raise NotImplementedError

    def build(self) -> None:
        """Look at the model anew."""
        raise NotImplementedError

    @Slot(int)
    def beside(self, step: int) -> None:
        self._drawing.beside(step)
        self._now()

    @Slot(str)
    def rename(self, to: str) -> None:
        self._drawing.rename(to.strip())
        self._now()

    @Slot()
    def remove(self) -> None:
        self._drawing.remove()
        self._now()

    @Slot(str, str)
    def put(self, field: str, typed: str) -> None:
        self._drawing.put(field, typed)
        self._now()

    @Slot()
    def undo(self) -> None:
        self._drawing.undo()
        self._now()

    @Slot()
    def redo(self) -> None:
        self._drawing.redo()
        self._now()

    def _now(self) -> None:
        self._code.refresh()
        self.build()
        self._soon()

    def _common(self) -> dict[str, Any]:
        """What the page shows of either."""
        drawing, picture = self._drawing, self._drawing.picture
        return {
            "there": picture is not None,
            "width": picture.width if picture else 0.0,
            "height": picture.height if picture else 0.0,
            "problem": drawing.problem,
            "said": drawing.said,
            "whyEdit": drawing.why_not_edit(),
            "undo": drawing.can_undo,
            "redo": drawing.can_redo,
            "joining": drawing.joining,
        }

    def _show(self, view: dict[str, Any]) -> None:
        if view != self._view:
            self._view = view
            self.changed.emit()
