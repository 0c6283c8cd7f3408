"""The canvas page's side of the desk: a program's states as boxes, the ways between them as lines, and what is done with them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, QPointF, QRectF, Qt, Signal, Slot
from PySide6.QtGui import QColor, QFont, QPainter, QPainterPath, QPen, QPolygonF
from PySide6.QtQuick import QQuickItem, QQuickPaintedItem

from tablet_client.code_desk import CodeDesk
from tablet_client.drawing_desk import DrawingDesk
from tablet_client.models.canvas.canvas import TEXTS, WAY
from tablet_client.models.canvas.chart import State
from tablet_client.models.canvas.picture import Curve
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_OVER = ("succeeded", "failed", "stopped")
_NEAR = 14.0
"""px about a line's words that a finger may miss them by"""


class CanvasDesk(DrawingDesk):
    """What QML reads of a program's picture, and calls."""

    def __init__(self, situation: Situation, code: CodeDesk, soon: Callable[[], None]):
        """`soon` has the models looked at anew."""
        super().__init__(situation.canvas, code, soon)
        self._situation, self._canvas = situation, situation.canvas
        self._boxes = Rows(
            (
                "name",
                "boxX",
                "boxY",
                "boxWidth",
                "boxHeight",
                "title",
                "does",
                "kind",
                "initial",
                "holds",
                "active",
                "selected",
            ),
            "name",
        )
        self._seen: tuple[Any, ...] = ()
        self.build()

    @Property(QObject, constant=True)
    def boxes(self) -> Rows:
        return self._boxes

    def curves(self) -> list[tuple[Curve, bool]]:
        """Each line, and whether it is selected."""
        picture, selected, way = self._canvas.picture, self._canvas.selected, self._canvas.way
        if picture is None:
            return []
        return [(curve, curve.source == selected and way in curve.places) for curve in picture.curves]

    # --------------------------------------------------------------------------------------------------------- buttons

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self._canvas.watched = on
        self._now()

    @Slot(str)
    def touch(self, state: str) -> None:
        """A state was touched; empty: the ground."""
        self._canvas.touch(state)
        self._now()

    @Slot(float, float)
    def touchAt(self, x: float, y: float) -> None:
        """A place was touched, in the picture's pixels: the words of a line that lie there, else the innermost state."""
        picture = self._canvas.picture
        if picture is None:
            return
        near = [
            (math.dist((x, y), curve.at), curve)
            for curve in picture.curves
            if abs(x - curve.at[0]) < max(4.0 * len(curve.words), _NEAR) and abs(y - curve.at[1]) < _NEAR
        ]
        if near and not self._canvas.joining:
            curve = min(near, key=lambda each: each[0])[1]
            self._canvas.select(curve.source, curve.places[0])
        else:
            self._canvas.touch(picture.state_at((x, y)))
        self._now()

    @Slot(str, float, float)
    def join(self, source: str, x: float, y: float) -> None:
        """A line was drawn from a state to a place in the picture."""
        picture = self._canvas.picture
        if picture is not None and (target := picture.state_at((x, y))):
            self._canvas.connect(source, target)
            self._now()

    @Slot(int)
    def selectWay(self, place: int) -> None:
        self._canvas.select(self._canvas.selected, place)
        self._now()

    @Slot(bool)
    def joining(self, on: bool) -> None:
        """The next state that is touched is where a new way leads."""
        self._canvas.joining = on
        self._now()

    @Slot(bool)
    def add(self, within: bool) -> None:
        self._canvas.add(within=within)
        self._now()

    @Slot(str)
    def nest(self, into: str) -> None:
        self._canvas.nest(into.strip())
        self._now()

    @Slot(str)
    def move(self, within: str) -> None:
        self._canvas.move(within)
        self._now()

    @Slot(str, bool)
    def mark(self, field: str, on: bool) -> None:
        self._canvas.mark(field, on)
        self._now()

    # --------------------------------------------------------------------------------------------------------- looking

    def build(self) -> None:
        """Look at the model anew."""
        if not self._canvas.watched and self._view:
            return
        canvas, chart, picture = self._canvas, self._canvas.chart, self._canvas.picture
        active = self._active()
        seen = (picture, canvas.selected, canvas.way, tuple(sorted(active)))
        if chart is not None and picture is not None and seen != self._seen:
            self._boxes.show(
                [
                    {
                        "name": name,
                        "boxX": box.x,
                        "boxY": box.y,
                        "boxWidth": box.width,
                        "boxHeight": box.height,
                        "title": chart.states[name].title,
                        "does": chart.states[name].does,
                        "kind": chart.states[name].kind,
                        "initial": chart.states[name].initial,
                        "holds": bool(chart.within(name)),
                        "active": name in active,
                        "selected": name == canvas.selected,
                    }
                    for name, box in picture.boxes.items()
                ]
            )
            self._seen = seen
            self.drawn.emit()
        elif picture is None and self._boxes.lines:
            self._boxes.show([])
            self._seen = ()
            self.drawn.emit()
        state = canvas.state
        view = {
            **self._common(),
            "start": self._start(),
            "running": bool(active),
            "state": self._state(state) if state is not None else {},
            "way": canvas.way,
            "programs": self._programs(),
            "others": [name for name in chart.states if name != canvas.selected] if chart else [],
        }
        self._show(view)

    def _programs(self) -> list[str]:
        """Those of the engine whose code is shown, and those that only this window knows yet."""
        launch, code = self._situation.launch, self._situation.code
        known = [each.name for each in launch.programs] if launch.engine == code.engine else []
        begun = [each.name for each in code.documents.values() if each.kind == "program" and each.engine == code.engine]
        return list(dict.fromkeys([*known, *begun]))

    def _start(self) -> dict[str, float]:
        """The middle of what one looks for first: the state that runs, else the one that is entered first."""
        chart, picture, active = self._canvas.chart, self._canvas.picture, self._active()
        if chart is None or picture is None or not picture.boxes:
            return {"x": 0.0, "y": 0.0}
        inner = [name for name in picture.boxes if name in active and not chart.within(name)]
        first = [state.name for state in chart.states.values() if state.initial and not state.parent]
        x, y = picture.boxes[(inner or first or list(picture.boxes))[0]].middle
        return {"x": x, "y": y}

    def _active(self) -> set[str]:
        """States of this program that a run is in."""
        run, document = self._situation.task.run, self._canvas.document
        if run is None or document is None or run.program != document.name or run.status in _OVER:
            return set()
        return set(run.active)

    def _state(self, state: State) -> dict[str, Any]:
        way = state.ways[self._canvas.way] if self._canvas.way >= 0 else None
        fields = {field: _text(state.fields.get(field)) for field in TEXTS}
        if way is not None:
            fields |= {field: _text(way.fields.get(field)) for field in WAY}
            fields["set"] = self._canvas.set_text()
        return {
            **fields,
            "name": state.name,
            "title": _text(state.fields.get("title")),
            "with": self._canvas.with_text(),
            "initial": state.initial,
            "final": bool(state.fields.get("final")),
            "parallel": bool(state.fields.get("parallel")),
            "parent": state.parent,
            "ways": [f"{each.label or '–'} → {' '.join(each.targets) or state.name}" for each in state.ways],
        }


def _text(value: Any) -> str:
    return "" if value is None else str(value)


class Lines(QQuickPaintedItem):
    """The lines of a picture, with their words; `zoom` is how many pixels one of the picture's takes."""

    sourceChanged = Signal()
    lookChanged = Signal()

    def __init__(self, parent: QQuickItem | None = None):
        super().__init__(parent)
        self._source: CanvasDesk | None = None
        self._zoom = 1.0
        self._colors = {name: QColor("white") for name in ("line", "words", "chosen", "ground")}

    def _get_source(self) -> QObject | None:
        return self._source

    def _set_source(self, source: CanvasDesk) -> None:
        if source is not self._source:
            self._source = source
            source.drawn.connect(self.update)
            self.sourceChanged.emit()

    def _get_zoom(self) -> float:
        return self._zoom

    def _set_zoom(self, zoom: float) -> None:
        if zoom != self._zoom:
            self._zoom = zoom
            self.lookChanged.emit()
            self.update()

    def _get_colors(self) -> dict[str, Any]:
        return dict(self._colors)

    def _set_colors(self, colors: dict[str, Any]) -> None:
        self._colors = {name: QColor(color) for name, color in colors.items()}
        self.lookChanged.emit()
        self.update()

    source = Property(QObject, _get_source, _set_source, notify=sourceChanged)  # type: ignore[arg-type]
    zoom = Property(float, _get_zoom, _set_zoom, notify=lookChanged)
    colors = Property(_MAP, _get_colors, _set_colors, notify=lookChanged)

    def paint(self, painter: QPainter) -> None:
        """Draw all lines, then all words over them."""
        if self._source is None:
            return
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.scale(self._zoom, self._zoom)
        font = QFont(painter.font())
        font.setPixelSize(12)
        painter.setFont(font)
        curves = self._source.curves()
        for curve, chosen in curves:
            self._draw(painter, curve, self._colors["chosen" if chosen else "line"], 2.4 if chosen else 1.4)
        for curve, chosen in curves:
            if curve.words:
                self._write(painter, curve, self._colors["chosen" if chosen else "words"])

    def _draw(self, painter: QPainter, curve: Curve, color: QColor, width: float) -> None:
        path = QPainterPath(QPointF(*curve.start))
        for first, second, end in curve.pieces:
            path.cubicTo(QPointF(*first), QPointF(*second), QPointF(*end))
        painter.setPen(QPen(color, width))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawPath(path)
        _, before, tip = curve.pieces[-1]
        length = math.hypot(tip[0] - before[0], tip[1] - before[1]) or 1.0
        x, y = (tip[0] - before[0]) / length, (tip[1] - before[1]) / length
        head = [tip, (tip[0] - 9 * x - 4 * y, tip[1] - 9 * y + 4 * x), (tip[0] - 9 * x + 4 * y, tip[1] - 9 * y - 4 * x)]
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(color)
        painter.drawPolygon(QPolygonF([QPointF(*point) for point in head]))

    def _write(self, painter: QPainter, curve: Curve, color: QColor) -> None:
        room = painter.fontMetrics().boundingRect(curve.words)
        place = QRectF(curve.at[0] - room.width() / 2 - 4, curve.at[1] - 8, room.width() + 8, 16)
        painter.fillRect(place, self._colors["ground"])
        painter.setPen(color)
        painter.drawText(place, Qt.AlignmentFlag.AlignCenter, curve.words)
