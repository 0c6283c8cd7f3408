"""First contact: the code that the robot shows is typed here, and the two know each other from then on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, Qt, Signal, Slot

from handrail.link import pairing
from handrail.link.keys import KeysError

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


class PairingDesk(QObject):
    """What QML reads of a pairing, and calls. `pair(endpoint, code)` does it, on a thread of its own."""

    changed = Signal()
    paired = Signal(str)
    """with the robot whose link has this address"""
    _done = Signal(str, str, str)

    def __init__(self, pair: Callable[[str, str], pairing.Accepted] | None = None):
        super().__init__()
        self.pair_with = pair
        self._view = {"state": "", "why": "", "role": ""}
        self._done.connect(self._finish, Qt.ConnectionType.QueuedConnection)

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, str]:
        """`state`: empty, `pairing`, `paired` or `failed`."""
        return self._view

    @Slot(str, str)
    def pair(self, address: str, code: str) -> None:
        """Pair with the robot at an address (its link's, or its host) that shows this code."""
        pair = self.pair_with
        if pair is None or self._view["state"] == "pairing":
            return
        try:
            endpoint, link = pairing.endpoint_of(address), pairing.link_of(address)
            pairing.read_code(code)
        except pairing.PairingError as problem:
            self._show("failed", str(problem))
            return
        self._show("pairing")

        def work() -> None:
            try:
                self._done.emit(link, pair(endpoint, code).role, "")
            except (pairing.PairingError, KeysError, OSError) as problem:
                self._done.emit(link, "", str(problem))

        threading.Thread(target=work, name="tablet-pairing", daemon=True).start()

    def _finish(self, link: str, role: str, why: str) -> None:
        self._show("failed" if why else "paired", why, role)
        if not why:
            self.paired.emit(link)

    def _show(self, state: str, why: str = "", role: str = "") -> None:
        self._view = {"state": state, "why": why, "role": role}
        self.changed.emit()
