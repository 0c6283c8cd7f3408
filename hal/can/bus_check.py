"""Is a robot's network what its description says? Asked before anything moves; every refusal says what to do.

Without opening a channel: does python-can have the interface, can its hardware make the rates, is the SocketCAN interface up at
those rates and not in trouble. With a port: which drives answer, and are there errors on the wire.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hal.can import controller_state, frames, real_port
from hal.can.port import Port
from hal.device import DeviceState
from hal.drives.parameters import Parameter, ParameterResult
from hal.joint import JointState

_FD_MTU = 72
"""bytes, of a network interface that carries CAN FD (linux/can.h, CANFD_MTU)"""
_NEVER = 1 << 30
"""cycles: the age of what was never heard (hal.joint, hal.device)"""
_LISTEN_S = 0.3
"""first only listen: somebody may be talking to the drives already"""
_ASK_S = 0.8
"""devices send every so many Syncs only"""
_VERSIONS_S = 0.5
_REQUESTS_AT_ONCE = 4


def check_channels(channels: Sequence[Any], *, ip: controller_state.Ip | None = None) -> None:
    """Check the real ones among a robot's channels without opening them. Raises ValueError with what to do.

    `ip`: instead of asking the system.
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
            _check_link(name, channel, (ip or controller_state.ask_ip)(name))


def _check_link(name: str, channel: Any, said: str) -> None:
    """Raises ValueError when what `ip` says of a network interface is not what the robot needs."""
    link = controller_state.link(said)
    if not link:
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
    """joints whose drive was heard, and devices"""
    missing: list[str] = field(default_factory=list)
    """joints whose drive was not, and devices"""
    asked: bool = False
    """the drives were polled; False: somebody else did already, this only listened"""
    crc_errors: int = 0
    strangers: dict[str, tuple[int, int]] = field(default_factory=dict)
    """joint → (protocol version that its drive says, the one that its family has here), where they differ"""
    error_frames: dict[str, int] = field(default_factory=dict)
    """real channel → error frames that its controller reported, where there were any"""
    controllers: dict[str, controller_state.ControllerState] = field(default_factory=dict)
    """real channel → how its controller fares, where that can be told"""


class _Surveyor:
    """The survey's conversation with the drives."""

    def __init__(self, description: Any, port: Port, protocol: Any):
        n = len(description.joints)
        self.state, self.devices = JointState(n), DeviceState(len(description.devices))
        self.host_heard = False
        self.crc_errors = 0
        self.versions = np.full(n, np.nan)
        self._port, self._protocol, self._cycle = port, protocol, 0
        self._period_s = description.period_ns * 1e-9
        self._out = frames.empty(protocol.frames_a_cycle)
        self._off = np.zeros(n, np.uint8)  # controlword 0: disable voltage

    @property
    def complete(self) -> bool:
        """Everybody was heard."""
        return all(self.heard)

    @property
    def heard(self) -> list[bool]:
        """Who was heard at all, however late: drives, then devices."""
        return [age < _NEVER for age in (*self.state.age.tolist(), *self.devices.age.tolist())]

    def listen(self, for_s: float, done: Callable[[], bool]) -> None:
        """Take in what comes, until `done` or so long."""
        until = time.monotonic() + for_s
        while not done() and (left := until - time.monotonic()) > 0.0:
            records = self._port.receive(left)
            of_host = np.isin(records["can_id"], (_SYNC, _HOLD_TIME)) & (records["flags"] & frames.EXTENDED == 0)
            self.host_heard |= bool(np.count_nonzero(of_host))
            self.crc_errors += self._protocol.decode_status(records, len(records), self.state, self.devices)[1]
            for reply in self._protocol.replies():
                if reply.index == Parameter.PROTOCOL_VERSION and reply.result == ParameterResult.OK:
                    self.versions[reply.joint] = reply.value

    def ask(self, for_s: float, done: Callable[[], bool], *, versions_of: Sequence[int] = ()) -> None:
        """Poll the drives once a host's period, with controlwords that leave them off, until `done` or so long."""
        until = time.monotonic() + for_s
        while not done() and time.monotonic() < until:
            self._cycle += 1
            out, sequence = self._out, self._cycle & 0xFF
            count = self._protocol.encode_control(self._off, sequence, out)
            unknown = [row for row in versions_of if np.isnan(self.versions[row])]
            turn = self._cycle * _REQUESTS_AT_ONCE % max(1, len(unknown))
            for row in (unknown[turn:] + unknown[:turn])[:_REQUESTS_AT_ONCE]:
                count += self._protocol.encode_request(row, Parameter.PROTOCOL_VERSION, None, sequence, out[count:])
            count += self._protocol.encode_sync(self._cycle, out[count:])
            self._port.send(out[:count])
            self.listen(self._period_s, done)


def survey(description: Any, port: Port, protocol: Any) -> Survey:
    """Find out which drives and devices answer, and of which protocol version. `protocol`: the robot's frames.

    Listens first. Where no host is on the bus it polls the drives with controlwords that keep them switched off, closing with
    Sync as a host does. Raises BusLost.
    """
    who, found = _Surveyor(description, port, protocol), Survey()
    who.listen(_LISTEN_S, lambda: who.complete)
    expected = protocol.protocol_version
    if not who.host_heard:
        found.asked = True
        who.ask(_ASK_S, lambda: who.complete)
        rows = np.flatnonzero((expected > 0) & who.heard[: len(expected)]).tolist()
        who.ask(_VERSIONS_S, lambda: not np.isnan(who.versions[rows]).any(), versions_of=rows)
    names = [*description.joints, *(device.name for device in description.devices)]
    found.answered = [name for name, yes in zip(names, who.heard, strict=True) if yes]
    found.missing = [name for name, yes in zip(names, who.heard, strict=True) if not yes]
    found.crc_errors = who.crc_errors
    for row in np.flatnonzero(~np.isnan(who.versions) & (who.versions != expected)).tolist():
        found.strangers[description.joints[row]] = (int(who.versions[row]), int(expected[row]))
    errors = getattr(port, "error_frames", ())
    found.error_frames = {c.name: int(n) for c, n in zip(description.channels, errors, strict=False) if n}
    told = getattr(port, "states", {})
    found.controllers = {channel: state for channel, state in told.items() if state is not None}
    return found


_SYNC, _HOLD_TIME = 0x080, 0x081


def check_real_drives(description: Any, protocol: Callable[[Any], Any]) -> None:
    """Look for the drives on a robot's real channels, before its service starts. `protocol`: makes a robot's frames of its
    description. Raises ValueError with what `refusal` says, BusLost.
    """
    real = [channel for channel in description.channels if channel.interface != "handrail"]
    limbs = [limb for limb in description.limbs if limb.channel in {channel.name for channel in real}]
    if not real:
        return
    part = copy.copy(description)
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    devices = tuple(device for device in description.devices if device.channel in {channel.name for channel in real})
    for name, value in (("channels", tuple(real)), ("limbs", tuple(limbs)), ("joints", joints), ("devices", devices)):
        object.__setattr__(part, name, value)  # frozen, but a copy that nobody else has
    port = real_port.CanPort(real)
    try:
        found = survey(part, port, protocol(part))
    finally:
        port.close()
    if said := refusal(part, found):
        raise ValueError(said)


def refusal(description: Any, found: Survey, states: Mapping[tuple[str, str], str] | None = None) -> str:
    """What is wrong by a survey and what to do about it; "" when nothing is.

    `states`: of nodes of the virtual bus, (name, channel) → state, where somebody asked the hub.
    """
    lines = []
    segments = [(f"limb {limb.name}", limb.channel, list(limb.joints), "drives") for limb in description.limbs]
    segments += [
        (f"{device.family} device", device.channel, [device.name], "devices") for device in description.devices
    ]
    for what, on, members, kind in segments:
        channel = next(c for c in description.channels if c.name == on)
        missing = [name for name in members if name in found.missing]
        if not missing:
            continue
        who = f"all {len(missing)} {kind}" if len(missing) == len(members) > 1 else ", ".join(missing)
        off = {(states or {}).get((name, on), "") for name in missing} - {"", "error_active"}
        if count := found.error_frames.get(on):
            todo = (
                f"the controller reports {count} error frames: a wrong bit rate somewhere (the robot says {channel.bitrate} and "
                f"{channel.data_bitrate} bit/s), a broken cable or a missing termination"
            )
        elif (state := found.controllers.get(on)) and state.state != "error_active":
            todo = (
                f"this computer's controller is {state}: nobody acknowledges its frames, or nodes differ in bit rate; check "
                f"power, cable and both 120 ohm terminations, and that every drive speaks {channel.bitrate} and "
                f"{channel.data_bitrate} bit/s"
            )
        elif off:
            todo = (
                f"{' and '.join(sorted(off)).replace('_', ' ')} on the virtual bus; `handrail can fault list` shows why"
            )
        elif channel.interface == "handrail":
            todo = "is its process (plant, or firmware of your own) on the bus? `handrail can stats` lists the nodes"
        else:
            todo = "are they powered, on this channel, and numbered as `network` in the robot's robot.yaml has them?"
        lines.append(f"no answer from {who} of {what} on channel {on} ({channel.interface}): {todo}")
    for joint, (theirs, ours) in found.strangers.items():
        lines.append(
            f"the drive of {joint} speaks protocol version {theirs}, its family here {ours}: bring the drive's firmware up to "
            f"date, or use the Handrail that it was made for"
        )
    if found.crc_errors:
        lines.append(
            f"{found.crc_errors} answers had a wrong CRC: drives of another protocol version, or two drives with one number"
        )
    return "\n".join(lines)
