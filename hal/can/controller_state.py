"""How a real channel's own controller fares: error active, error passive, bus-off (ISO 11898-1's fault confinement), as far as
anybody can tell.

SocketCAN tells it of every network interface, whoever has opened it. python-can's `bus.state` means different things by interface
(of PCAN it is only whether it was opened to listen), so it is believed where it is known to be the controller's.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import can

_BELIEVED = {
    "etas": {"ACTIVE": "error_active", "PASSIVE": "error_passive"},
    "ixxat": {"ERROR": "bus_off"},  # ACTIVE is all else, PASSIVE: opened to listen
    "systec": {"ERROR": "bus_off"},
}
"""interface → name of python-can's BusState → ours"""
_OF_LINK = {"error_warning": "error_active"}  # ISO 11898-1 knows no state of warning


@dataclass(frozen=True)
class ControllerState:
    """What is known of one controller."""

    state: str
    """error_active, error_passive, bus_off, or what SocketCAN calls it (stopped, sleeping)"""
    transmit_errors: int | None = None
    receive_errors: int | None = None
    """TEC and REC; None: not told"""

    def __str__(self) -> str:
        counters = "" if self.transmit_errors is None else f" (TEC {self.transmit_errors}, REC {self.receive_errors})"
        return f"{self.state.replace('_', ' ')}{counters}"


Ip = Callable[[str], str]
"""Gives what `ip -json -details link show dev NAME` prints, "" where it can't; ValueError where there is no such interface."""


def ask_ip(name: str) -> str:
    """The one that asks. Raises ValueError naming the interface that is not there."""
    try:
        done = subprocess.run(
            ["ip", "-json", "-details", "link", "show", "dev", name],
            capture_output=True, text=True, timeout=5.0, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""  # no iproute2: what the socket says must do
    if done.returncode and "does not exist" in done.stderr:
        raise ValueError(
            f"CAN channel {name}: no network interface of that name; expected one that `ip link show type can` lists "
            f"(is the adapter plugged in, its driver loaded?)"
        )
    return done.stdout if done.returncode == 0 else ""


def link(said: str) -> dict[str, Any]:
    """What `ip` said of one network interface; empty where it said nothing."""
    try:
        return dict(json.loads(said)[0])
    except (ValueError, LookupError, TypeError):
        return {}


def of_link(name: str, ip: Ip = ask_ip) -> ControllerState | None:
    """The controller behind a SocketCAN interface; None: not told (a vcan has none, or there is no such interface)."""
    try:
        data = link(ip(name)).get("linkinfo", {}).get("info_data", {})
    except ValueError:
        return None
    if not data.get("state"):
        return None
    state, counters = data["state"].lower().replace("-", "_"), data.get("berr_counter", {})
    return ControllerState(_OF_LINK.get(state, state), counters.get("tx"), counters.get("rx"))


def of_bus(bus: can.BusABC, interface: str, channel: str, ip: Ip = ask_ip) -> ControllerState | None:
    """The controller of a python-can bus that is open; None: its interface can't tell."""
    if interface == "socketcan":
        return of_link(channel, ip)
    if interface not in _BELIEVED:
        return None
    try:
        state = _BELIEVED[interface].get(getattr(bus.state, "name", ""))
    except Exception:  # noqa: BLE001  whatever a vendor's library raises: it can't tell
        return None
    return ControllerState(state) if state else None
