"""Is a robot's network what its description says? Asked before anything moves; every refusal says what to do.

Without opening a channel: does python-can have the interface, can its hardware make the rates, is the SocketCAN interface up at
those rates and not in trouble. With a port: which drives answer, and are there errors on the wire.
"""

from __future__ import annotations

import copy
import json
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hal.can import frames, real_port
from hal.can.port import Port
from hal.joint import JointState

_FD_MTU = 72
"""bytes, of a network interface that carries CAN FD (linux/can.h, CANFD_MTU)"""
_LISTEN_S = 0.3
"""first only listen: somebody may be talking to the drives already"""
_ASK_S = 0.5
_ASK_PERIOD_S = 0.01


def check_channels(channels: Sequence[Any], *, ip: Callable[[str], str] | None = None) -> None:
    """Check the real ones among a robot's channels without opening them. Raises ValueError with what to do.

    `ip`: gives what `ip -json -details link show dev NAME` prints, "" where it can't.
    """
    for channel in channels:
        if channel.interface == "handrail":
            continue
        try:
            real_port.check_interface(channel.interface)
        except ValueError as error:
            raise ValueError(f"CAN channel {channel.name}: {error}") from error
        name = getattr(channel, "channel", "") or channel.name
        real_port.arguments(channel.interface, name, channel.bitrate, channel.data_bitrate)
        if channel.interface == "socketcan":
            _check_link(name, channel, (ip or _ask_ip)(name))


def _ask_ip(name: str) -> str:
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


def _check_link(name: str, channel: Any, said: str) -> None:
    """Raises ValueError when what `ip` says of a network interface is not what the robot needs."""
    try:
        link = json.loads(said)[0]
    except (ValueError, LookupError):
        return
    wanted = f"bitrate {channel.bitrate} dbitrate {channel.data_bitrate} fd on"
    restart = f"`ip link set {name} down`, then `ip link set {name} up type can {wanted}`"
    if "UP" not in link.get("flags", []):
        raise ValueError(
            f"CAN channel {name}: the network interface is down; `ip link set {name} up type can {wanted}`"
        )
    if link.get("mtu", _FD_MTU) < _FD_MTU:
        raise ValueError(f"CAN channel {name}: the network interface carries classic CAN only; {restart}")
    data = link.get("linkinfo", {}).get("info_data", {})  # a vcan has none
    for what, there, rate in (
        ("bit rate", data.get("bittiming"), channel.bitrate),
        ("data bit rate", data.get("data_bittiming"), channel.data_bitrate),
    ):
        if there and there.get("bitrate") != rate:
            raise ValueError(
                f"CAN channel {name}: {what} {there.get('bitrate')} bit/s; the robot's drives speak {rate}; {restart}"
            )
    if (state := data.get("state", "ERROR-ACTIVE")) in ("ERROR-PASSIVE", "BUS-OFF", "STOPPED"):
        raise ValueError(
            f"CAN channel {name}: the controller is {state.lower()}: nobody acknowledges its frames, or nodes differ in bit "
            f"rate. Check power, cable, both 120 ohm terminations and that every drive speaks {channel.bitrate} and "
            f"{channel.data_bitrate} bit/s; then {restart}"
        )


@dataclass
class Survey:
    """Who was heard on a robot's network."""

    answered: list[str] = field(default_factory=list)
    """joints whose drive was heard"""
    missing: list[str] = field(default_factory=list)
    """joints whose drive was not"""
    asked: bool = False
    """the drives were polled; False: somebody else did already, this only listened"""
    crc_errors: int = 0
    error_frames: dict[str, int] = field(default_factory=dict)
    """real channel → error frames that its controller reported, where there were any"""


def survey(description: Any, port: Port, protocol: Any, *, only: Sequence[str] | None = None) -> Survey:
    """Find out which drives answer. `protocol`: the robot's frames; `only`: joints to look for (default: all).

    Listens first. Where no host is on the bus it polls the drives with controlwords that keep them switched off, closing with
    Sync as a host does. Raises BusLost.
    """
    joints = list(description.joints)
    wanted = np.array([only is None or joint in only for joint in joints])
    state, found = JointState(len(joints)), Survey()
    out = frames.empty(protocol.frames_a_cycle)
    off = np.zeros(len(joints), np.uint8)  # controlword 0: disable voltage
    cycle = heard_host = 0

    def listen(for_s: float) -> None:
        nonlocal heard_host
        until = time.monotonic() + for_s
        while (left := until - time.monotonic()) > 0.0 and (state.age[wanted] > 0).any():
            records = port.receive(left)
            heard_host += int(np.count_nonzero(records["can_id"] == _SYNC))
            found.crc_errors += protocol.decode_status(records, len(records), state)[1]

    listen(_LISTEN_S)
    if not heard_host:
        found.asked = True
        until = time.monotonic() + _ASK_S
        while (state.age[wanted] > 0).any() and time.monotonic() < until:
            cycle += 1
            count = protocol.encode_control(off, cycle & 0xFF, out)
            count += protocol.encode_sync(cycle, out[count:])
            port.send(out[:count])
            listen(_ASK_PERIOD_S)
    heard = state.age == 0
    found.answered = [joint for joint, yes in zip(joints, heard, strict=True) if yes]
    found.missing = [joint for joint, yes, asked in zip(joints, heard, wanted, strict=True) if asked and not yes]
    errors = getattr(port, "error_frames", ())
    found.error_frames = {c.name: int(n) for c, n in zip(description.channels, errors, strict=False) if n}
    return found


_SYNC = 0x080


def check_real_drives(description: Any, protocol: Callable[[Any], Any]) -> None:
    """Look for the drives on a robot's real channels, before its service starts. `protocol`: makes a robot's frames of its
    description. Raises ValueError with what `refusal` says, BusLost.
    """
    real = [channel for channel in description.channels if channel.interface != "handrail"]
    limbs = [limb for limb in description.limbs if limb.channel in {channel.name for channel in real}]
    if not limbs:
        return
    part = copy.copy(description)
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    fields = (("channels", tuple(real)), ("limbs", tuple(limbs)), ("joints", joints), ("devices", ()))
    for name, value in fields:
        object.__setattr__(part, name, value)  # frozen, but a copy that nobody else has
    port = real_port.CanPort(real)
    try:
        found = survey(part, port, protocol(part))
    finally:
        port.close()
    if said := refusal(part, found):
        raise ValueError(said)


def refusal(description: Any, found: Survey) -> str:
    """What is wrong by a survey and what to do about it; "" when nothing is."""
    lines = []
    for limb in description.limbs:
        channel = next(c for c in description.channels if c.name == limb.channel)
        missing = [joint for joint in limb.joints if joint in found.missing]
        if not missing:
            continue
        who = f"all {len(missing)} drives" if len(missing) == len(limb.joints) else ", ".join(missing)
        where = f"limb {limb.name} on channel {limb.channel} ({channel.interface})"
        if count := found.error_frames.get(limb.channel):
            todo = (
                f"the controller reports {count} error frames: a wrong bit rate somewhere (the robot says {channel.bitrate} and "
                f"{channel.data_bitrate} bit/s), a broken cable or a missing termination"
            )
        elif channel.interface == "handrail":
            todo = "is its process (plant, or firmware of your own) on the bus? `handrail can stats` lists the nodes"
        else:
            todo = (
                "are they powered, on this channel, and numbered as network.limbs in the robot's robot.yaml has them?"
            )
        lines.append(f"no answer from {who} of {where}: {todo}")
    if found.crc_errors:
        lines.append(
            f"{found.crc_errors} answers had a wrong CRC: drives of another protocol version, or two drives with one number"
        )
    return "\n".join(lines)
