"""The output page's side of the desk: lines as they come, what of them is shown, copied, saved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot
from PySide6.QtGui import QGuiApplication

from handrail.client import Selection
from tablet_client import documents
from tablet_client.growing_list import GrowingList
from tablet_client.models.output import LEVELS, SHOWN
from tablet_client.models.situation import Situation

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


class OutputDesk(QObject):
    """What QML reads of the output, and calls. Lines are put into the list once a frame, and only while somebody looks."""

    changed = Signal()

    def __init__(self, situation: Situation, soon: Callable[[], None]):
        """`soon` has the models looked at anew."""
        super().__init__()
        self._output, self._soon = situation.output, soon
        self._lines = GrowingList(("clock", "level", "source", "text"))
        self._hear: Callable[[Sequence[Selection]], None] | None = None
        self._heard: tuple[Selection, ...] = ()
        self.watched, self._filtered = False, -1
        self._said = {"code": "", "text": ""}
        self._view: dict[str, Any] = {}
        self.build()

    def serve(self, hear: Callable[[Sequence[Selection]], None]) -> None:
        """Have what is chosen sent by this session from now on."""
        self._hear, self._heard = hear, ()
        self._listen()

    def _listen(self) -> None:
        wanted = self._output.wanted()
        if self._hear is not None and wanted != self._heard:
            self._heard = wanted
            self._hear(wanted)

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(QObject, constant=True)
    def lines(self) -> GrowingList:
        return self._lines

    # --------------------------------------------------------------------------------------------------------- buttons

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self.watched = on
        self._soon()

    @Slot(str)
    def switch(self, level: str) -> None:
        self._output.switch(level)
        self._filter()

    @Slot(str)
    def choose(self, source: str) -> None:
        """Show a source among those chosen, or no more; empty: all."""
        self._output.choose(source)
        self._filter()

    @Slot(str)
    def find(self, text: str) -> None:
        self._output.find(text)
        self._filter()

    @Slot(bool)
    def hold(self, on: bool) -> None:
        self._output.hold(on)
        self._filter()

    @Slot()
    def clear(self) -> None:
        self._output.clear()
        self._filter()

    @Slot()
    def copy(self) -> None:
        """What is shown, into the clipboard."""
        QGuiApplication.clipboard().setText(self._output.written())
        self._say("copied", str(self._lines.rowCount()))

    @Slot()
    def save(self) -> None:
        """Write what is shown to a file in the user's documents; where to, or why not, is said."""
        self._say(*documents.save("output", "txt", self._output.written()))

    def _filter(self) -> None:
        self._said = {"code": "", "text": ""}
        self._listen()
        self.build()

    def _say(self, code: str, text: str) -> None:
        self._said = {"code": code, "text": text}
        self.build()

    # --------------------------------------------------------------------------------------------------------- looking

    def build(self) -> None:
        """Look at the model anew, if anybody looks at it here."""
        if self.watched:
            if self._filtered != self._output.filtered:
                self._filtered = self._output.filtered
                self._lines.show(self._output.shown())
            else:
                self._lines.grow(self._output.shown(self._lines.last), SHOWN)
        view = {
            "levels": [{"name": level, "on": level in self._output.levels} for level in LEVELS],
            "sources": [
                {"name": name, "chosen": name in self._output.sources, "lines": lines}
                for name, lines in sorted(self._output.known.items())
            ],
            "all": not self._output.sources,
            "held": self._output.held,
            "waiting": self._output.waiting,
            "kept": len(self._output.kept),
            "said": self._said,
        }
        if view != self._view and (self.watched or not self._view):
            self._view = view
            self.changed.emit()
