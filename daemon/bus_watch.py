"""How the daemon's own node fares on the virtual bus: error active, error passive, bus-off (ISO 11898-1's fault confinement)."""

from __future__ import annotations

import threading

from hal.can.control import HubControl
from hal.can.wire import BusLost
from handrail.runtime import Runtime

NODE = "daemon"
"""what the loop's node is called on the bus"""
_PERIOD_S = 0.5
_PATIENCE_S = 0.2
"""for a bus that is not there (yet)"""


class BusWatch:
    """Asks the bus twice a second, in a thread of its own: a bus that hangs must not keep a stop waiting."""

    def __init__(self, runtime: Runtime):
        self._path = runtime.bus
        self._states: dict[str, str] = {}
        self._closing = threading.Event()
        threading.Thread(target=self._watch, name="bus watch", daemon=True).start()

    def states(self) -> dict[str, str]:
        """Channel → state, as last heard; a channel of which nothing is known is not there."""
        return self._states

    def close(self) -> None:
        """Stop asking."""
        self._closing.set()

    def _watch(self) -> None:
        bus: HubControl | None = None
        while not self._closing.wait(_PERIOD_S):
            try:
                bus = bus or HubControl(self._path, timeout_s=_PATIENCE_S)
                self._states = {node.channel: node.state for node in bus.node(NODE)}
            except (
                BusLost,
                ValueError,
            ):  # the plant has ended, or speaks another version: its users are told by the loop
                self._states = {}
                if bus is not None:
                    bus.close()
                bus = None
        if bus is not None:
            bus.close()
