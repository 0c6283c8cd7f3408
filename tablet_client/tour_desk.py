"""The tour's side of the desk, and its memory: who has seen it is not asked again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, QSettings, Signal, Slot

from tablet_client.models.situation import Situation
from tablet_client.models.tour import STEPS, Tour

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_SEEN = "tour/seen"


def settings() -> QSettings:
    """What this user's window remembers."""
    return QSettings("handrail", "tablet")


def seen() -> bool:
    """Whether this user has ended a tour before."""
    return bool(settings().value(_SEEN, False, type=bool))


class TourDesk(QObject):
    """What QML reads of the tour, and calls."""

    changed = Signal()

    def __init__(self, situation: Situation, soon: Callable[[], None]):
        """`soon` has the models looked at anew."""
        super().__init__()
        self._situation, self._tour, self._soon = situation, Tour(), soon
        self._view: dict[str, Any] = {}
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Slot()
    def begin(self) -> None:
        self._tour.begin()
        self._now()

    @Slot()
    def next(self) -> None:
        self._tour.next()
        if not self._tour.step:
            self._remember()
        self._now()

    @Slot()
    def end(self) -> None:
        self._tour.end()
        self._remember()
        self._now()

    @staticmethod
    def _remember() -> None:
        settings().setValue(_SEEN, True)

    def _now(self) -> None:
        self.build()
        self._soon()

    def build(self) -> None:
        """Look at the models anew."""
        self._tour.take(self._situation)
        view = {"step": self._tour.step, "number": self._tour.number, "of": len(STEPS)}
        if view != self._view:
            self._view = view
            self.changed.emit()
