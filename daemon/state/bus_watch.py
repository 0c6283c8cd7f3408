"""How the daemon's own node fares on its channels: error active, error passive, bus-off (ISO 11898-1's fault confinement)."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from hal.can.control import HubControl
from hal.can.controller_state import of_link
from hal.can.wire import BusLost
from handrail.robot.description import Channel
from handrail.runtime import Runtime

NODE = "daemon"
"""what the loop's node is called on the bus"""
_PERIOD_S = 0.5
_ROUNDS = 4
"""a network interface is asked every so many times: each is a process"""
_PATIENCE_S = 0.2
"""for a bus that is not there (yet)"""


class BusWatch:
    """Asks the bus twice a second, in a thread of its own: a bus that hangs must not keep a stop waiting."""

    def __init__(self, runtime: Runtime, channels: Sequence[Channel]):
        """`channels`: the robot's. Of real ones SocketCAN tells; the others' controllers only who has opened them could ask."""
        self._path = runtime.bus
        self._virtual = any(channel.interface == "handrail" for channel in channels)
        self._links = {c.name: c.channel or c.name for c in channels if c.interface == "socketcan"}
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
        rounds, real = 0, dict[str, str]()
        while not self._closing.wait(_PERIOD_S):
            if self._links and rounds % _ROUNDS == 0:
                told = {name: of_link(link) for name, link in self._links.items()}
                real = {name: state.state for name, state in told.items() if state is not None}
            rounds += 1
            if not self._virtual:
                self._states = real
                continue
            try:
                bus = bus or HubControl(self._path, timeout_s=_PATIENCE_S)
                self._states = {node.channel: node.state for node in bus.node(NODE)} | real
            except (
                BusLost,
                ValueError,
            ):  # the plant has ended, or speaks another version: its users are told by the loop
                self._states = real
                if bus is not None:
                    bus.close()
                bus = None
        if bus is not None:
            bus.close()
