"""The plots' side of the desk: which signals are shown, what they are now, and the lines themselves, drawn where QML puts them."""

from __future__ import annotations

from typing import Any

import numpy as np
from PySide6.QtCore import Property, QObject, QPointF, Signal, Slot
from PySide6.QtGui import QColor, QPainter, QPen, QPolygonF
from PySide6.QtQuick import QQuickItem, QQuickPaintedItem

from tablet_client import documents
from tablet_client.models.signals import QUANTITIES, SPAN_S, Curve, Signals
from tablet_client.models.situation import Situation

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_LEAST_RANGE = {"°": 0.2, "°/s": 1.0, "N·m": 1.0, "N": 2.0}
"""unit → the smallest height of a plot: what trembles less looks still"""
_LEAST = 0.1
"""of other units"""


class SignalsDesk(QObject):
    """What QML reads of the signals, and calls. Costs nothing while nobody looks (`watched`)."""

    changed = Signal()
    drawn = Signal()

    def __init__(self, situation: Situation):
        super().__init__()
        self._signals: Signals = situation.signals
        self._watched, self._said = False, {"code": "", "text": ""}
        self._curves: dict[str, Curve] = {}
        self._view: dict[str, Any] = {}
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self._watched = self._signals.watched = on
        self.build()

    @Slot(str)
    def choose(self, name: str) -> None:
        """Show a signal, or no more."""
        self._say(self._signals.choose(name))

    @Slot(bool)
    def pause(self, on: bool) -> None:
        """Hold what is shown, or go on."""
        self._signals.pause(on)
        self._say("")

    @Slot()
    def save(self) -> None:
        """Write what is shown to a CSV file in the user's documents; where to, or why not, is said."""
        self._say(*documents.save("signals", "csv", self._signals.csv()))

    def curve(self, name: str) -> Curve | None:
        return self._curves.get(name)

    def build(self) -> None:
        """Look at the model anew, if anybody looks at it here."""
        if self._watched:
            self._curves = {curve.name: curve for curve in self._signals.curves()}
        view = {
            "paused": self._signals.paused,
            "span": SPAN_S,
            "joints": list(self._signals.joints),
            "quantities": list(QUANTITIES),
            "ports": self._ports(),
            "chosen": list(self._signals.chosen),
            "shown": [_shown(curve) for curve in self._curves.values()] if self._watched else [],
            "said": self._said,
        }
        if view != self._view:
            self._view = view
            self.changed.emit()
        if self._watched:
            self.drawn.emit()

    def _ports(self) -> dict[str, list[str]]:
        """Node, as `node:NAME` → the ports of it that can be plotted."""
        found: dict[str, list[str]] = {}
        for name in self._signals.ports:
            node, _, port = name.rpartition(".")
            found.setdefault(node, []).append(port)
        return found

    def _say(self, code: str, text: str = "") -> None:
        self._said = {"code": code, "text": text}
        self.build()


def _shown(curve: Curve) -> dict[str, Any]:
    low, high = bounds(curve)
    now = f"{curve.values[-1]:.{_decimals(high - low)}f}" if len(curve.values) else "–"
    return {
        "name": curve.name,
        "unit": curve.unit,
        "now": now,
        "low": f"{low:.{_decimals(high - low)}f}",
        "high": f"{high:.{_decimals(high - low)}f}",
    }


def bounds(curve: Curve) -> tuple[float, float]:
    """Lowest and highest value of a plot, in the curve's unit: its own, with a little room, and never too close together."""
    known = curve.values[np.isfinite(curve.values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    lacking = max(_LEAST_RANGE.get(curve.unit, _LEAST) - (high - low), 0.1 * (high - low))
    return low - lacking / 2, high + lacking / 2


def _decimals(extent: float) -> int:
    return max(0, min(3, 2 - int(np.floor(np.log10(max(extent, 1e-9))))))


class Trace(QQuickPaintedItem):
    """One signal's line over the last seconds, newest at the right edge."""

    sourceChanged = Signal()
    nameChanged = Signal()
    colorChanged = Signal()

    def __init__(self, parent: QQuickItem | None = None):
        super().__init__(parent)
        self._source: SignalsDesk | None = None
        self._name, self._color = "", QColor("white")

    def _get_source(self) -> QObject | None:
        return self._source

    def _set_source(self, source: SignalsDesk) -> None:
        if source is not self._source:
            self._source = source
            source.drawn.connect(self.update)
            self.sourceChanged.emit()

    def _get_name(self) -> str:
        return self._name

    def _set_name(self, name: str) -> None:
        if name != self._name:
            self._name = name
            self.nameChanged.emit()
            self.update()

    def _get_color(self) -> QColor:
        return self._color

    def _set_color(self, color: QColor) -> None:
        if color != self._color:
            self._color = color
            self.colorChanged.emit()
            self.update()

    source = Property(QObject, _get_source, _set_source, notify=sourceChanged)  # type: ignore[arg-type]
    name = Property(str, _get_name, _set_name, notify=nameChanged)
    color = Property(QColor, _get_color, _set_color, notify=colorChanged)

    def paint(self, painter: QPainter) -> None:
        """Draw the line; a value that is no number leaves a gap."""
        curve = self._source.curve(self._name) if self._source is not None else None
        if curve is None or not len(curve.values):
            return
        low, high = bounds(curve)
        x = (1.0 + curve.times / SPAN_S) * (self.width() - 1)
        y = (high - curve.values) / (high - low) * (self.height() - 2) + 1
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(self._color, max(1.5, self.height() / 60)))
        known = np.isfinite(y)
        for run in np.split(np.arange(len(x)), np.flatnonzero(np.diff(known)) + 1):
            if known[run[0]]:
                painter.drawPolyline(QPolygonF([QPointF(*point) for point in zip(x[run], y[run], strict=True)]))
