"""How link and processes are, as QML sees it, and the buttons' way down."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from handrail.messages import Message
from tablet_client.models.link_quality import CLASSES, Figures, settled
from tablet_client.models.service import kind_of
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_LEAST_MS, _LEAST_KB_S = 5.0, 2.0
"""numbers that tremble by less are shown as before: a window in which nothing happens draws nothing"""
_LEAST_CPU, _LEAST_MB = 2.0, 4.0


class HealthDesk(QObject):
    """What QML reads of the link's quality and of the robot's processes, and calls. Costs nothing while nobody looks."""

    changed = Signal()
    linkChanged = Signal()

    def __init__(self, situation: Situation, send: Callable[[Message], None], soon: Callable[[], None]):
        """`send` sends what a button asked for, `soon` has the models looked at anew."""
        super().__init__()
        self._situation, self._send, self._soon = situation, send, soon
        self._view: dict[str, Any] = {}
        self._link: dict[str, Any] = {"latency": 0.0, "rate": 0.0}
        self._processes = Rows(("name", "depth", "state", "cpu", "memory", "deaths", "last", "chosen", "since"), "name")
        self._classes = Rows(("name", "rate"), "name")
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(_MAP, notify=linkChanged)
    def link(self) -> dict[str, Any]:
        return self._link

    @Property(QObject, constant=True)
    def processes(self) -> Rows:
        return self._processes

    @Property(QObject, constant=True)
    def classes(self) -> Rows:
        return self._classes

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks at the page, or no more."""
        self._situation.service.look(on)
        self._soon()

    @Slot(str)
    def choose(self, process: str) -> None:
        """Show what a process said last."""
        self._situation.service.choose(process)
        self._soon()

    @Slot(str)
    def restart(self, process: str) -> None:
        """Start a process anew; does nothing while the button says why it can't."""
        call = None if self.why() else self._situation.service.restart(process)
        if call is not None:
            self._send(call)

    def why(self) -> str:
        """Code of the reason why no process can be started anew now; empty when one can."""
        situation = self._situation
        if not situation.link.attached:
            return "no_robot"
        return situation.only_looks or ("sending" if "RestartProcess" in situation.pending else "")

    def build(self) -> None:
        """Look at the models anew."""
        service, figures = self._situation.service, self._situation.quality.figures()
        link = self._build_link(figures)
        if link != self._link:
            self._link = link
            self.linkChanged.emit()
        if service.open:
            before = {row["name"]: row["rate"] for row in self._classes.lines}
            rates = dict(figures.rates)
            self._classes.show(
                [
                    {"name": name, "rate": settled(before.get(name, 0.0), rates.get(name, 0.0) / 1e3, 0.2)}
                    for name in CLASSES
                ]
            )
            shown = {row["name"]: row for row in self._processes.lines}
            self._processes.show(self._build_processes(shown))
        view = {
            "why": self.why(),
            "problem": service.problem,
            "known": bool(service.processes),
            "chosen": service.chosen,
            "kind": kind_of(service.chosen),
            "troubled": service.troubled,
            "log": "\n".join(line.text for line in service.lines) if service.open else "",
            "me": self._situation.name,
            "role": self._situation.role,
        }
        if view != self._view:
            self._view = view
            self.changed.emit()

    def _build_link(self, figures: Figures) -> dict[str, Any]:
        attached = self._situation.link.attached
        return {
            "quality": figures.quality if attached else "unknown",
            "latency": settled(self._link["latency"], round(figures.latency_s * 1e3, 1), _LEAST_MS),
            "worst": settled(self._link.get("worst", 0.0), round(figures.worst_s * 1e3), 10.0 * _LEAST_MS),
            "loss": round(figures.loss * 100.0),
            "rate": settled(self._link["rate"], figures.rate / 1e3, _LEAST_KB_S),
        }

    def _build_processes(self, shown: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = []
        names: set[str] = set()
        for each in self._situation.service.processes:
            name = each.name if each.name not in names else f"{each.name} {each.process}"
            names.add(name)
            before = shown.get(name, {"cpu": 0.0, "memory": 0.0})
            rows.append(
                {
                    "name": name,
                    "depth": each.depth,
                    "state": each.state,
                    "cpu": settled(before["cpu"], round(each.cpu * 100.0), _LEAST_CPU),
                    "memory": settled(before["memory"], round(each.memory_mb), _LEAST_MB),
                    "deaths": each.deaths,
                    "last": each.last,
                    "chosen": each.depth == 0 and each.name == self._situation.service.chosen,
                    "since": int(each.for_s // 60),
                }
            )
        return rows
