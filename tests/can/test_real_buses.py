"""Real buses by configuration: the right options for each interface, refusals that say what to do, real and virtual mixed.

No hardware here: python-can's own constructors run against stand-ins for the vendors' libraries, and slcan's against a pty.
"""

from __future__ import annotations

import json
import os
import pty
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import can
import numpy as np
import pytest

from hal.can import bus_check, frames, real_port
from hal.can.listening import ListenedBus
from hal.can.mixed_port import MixedPort
from hal.can.port import HubPort, open_port
from hal.can.wire import BusLost
from hal.drives.parameters import ParameterResult
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.joint import JointState
from handrail.robot.description import Device
from handrail.runtime import Runtime

Make = Callable[..., np.ndarray]


def _channel(interface: str, name: str = "can0", **other: Any) -> SimpleNamespace:
    return SimpleNamespace(
        **{"name": name, "interface": interface, "bitrate": 1_000_000, "data_bitrate": 5_000_000, **other}
    )


def test_pcan_gets_the_bit_timing_of_both_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    from can.interfaces.pcan import pcan

    driver = MagicMock()
    driver.return_value.InitializeFD.return_value = pcan.PCAN_ERROR_OK
    driver.return_value.SetValue.return_value = pcan.PCAN_ERROR_OK
    driver.return_value.GetValue.return_value = (pcan.PCAN_ERROR_OK, b"9.9.9.9")
    monkeypatch.setattr(pcan, "PCANBasic", driver)
    bus = real_port.open_bus("pcan", "PCAN_USBBUS1", 1_000_000, 5_000_000)
    handle, said = driver.return_value.InitializeFD.call_args[0]
    given = dict(pair.split("=") for pair in said.decode().split(", "))
    numbers = {key: int(value) for key, value in given.items()}
    assert handle == pcan.PCAN_USBBUS1 and bus.protocol is can.CanProtocol.CAN_FD
    nominal = numbers["f_clock"] / numbers["nom_brp"] / (1 + numbers["nom_tseg1"] + numbers["nom_tseg2"])
    data = numbers["f_clock"] / numbers["data_brp"] / (1 + numbers["data_tseg1"] + numbers["data_tseg2"])
    assert (nominal, data) == (1e6, 5e6)
    bus.shutdown()


def _recorder(called: dict[str, tuple[Any, ...]], name: str) -> Callable[..., int]:
    def record(*given: Any) -> int:
        called.setdefault(name, given)
        return 0

    return record


def test_kvaser_gets_timings_since_canlib_has_no_name_for_5_mbit(monkeypatch: pytest.MonkeyPatch) -> None:
    from can.interfaces.kvaser import canlib

    called: dict[str, tuple[Any, ...]] = {}
    # Without the vendor's library the module has none of these.
    for name in (
        "GetNumberOfChannels", "OpenChannel", "IoCtlInit", "IoCtl", "SetBusParams", "SetBusParamsFd", "SetBusOutputControl",
        "SetAcceptanceFilter", "BusOn", "FlushReceiveQueue", "GetBusOutputControl",
    ):  # fmt: skip
        monkeypatch.setattr(canlib, f"can{name}", _recorder(called, f"can{name}"), raising=False)
    monkeypatch.setattr(canlib, "get_channel_info", lambda number: {})
    bus = real_port.open_bus("kvaser", "1", 1_000_000, 5_000_000)
    assert called["canOpenChannel"][0] == 1
    rate, tseg1, tseg2 = called["canSetBusParams"][1:4]
    assert rate == 1_000_000 and 80_000_000 % (rate * (1 + tseg1 + tseg2)) == 0
    rate, tseg1, tseg2 = called["canSetBusParamsFd"][1:4]
    assert rate == 5_000_000 and 80_000_000 % (rate * (1 + tseg1 + tseg2)) == 0
    bus._is_shutdown = True  # its handles are no handles
    with pytest.raises(ValueError, match="got channel 'can0'; expected CANlib's number"):
        real_port.arguments("kvaser", "can0", 1_000_000, 5_000_000)


def test_slcan_tells_its_adapter_both_rates_and_carries_fd_frames() -> None:
    adapter, port = pty.openpty()
    tty.setraw(adapter)
    try:
        options = {"sleep_after_open": 0.0}
        bus = real_port.open_bus("slcan", os.ttyname(port), 1_000_000, 5_000_000, options)
        bus.send(
            can.Message(arbitration_id=0x123, data=bytes(12), is_fd=True, bitrate_switch=True, is_extended_id=False)
        )
        said = b""
        while said.count(b"\r") < 6:
            said += os.read(adapter, 1000)
        lines = said.decode().split("\r")
        assert "S8" in lines and "Y5" in lines and lines.index("S8") < len(lines) - 1 - lines[::-1].index("O")
        assert f"b1239{'00' * 12}" in lines
        os.write(adapter, b"t20121122\r")
        got = bus.recv(2.0)
        assert got is not None and (got.arbitration_id, bytes(got.data)) == (0x201, b"\x11\x22")
        bus.shutdown()
        with pytest.raises(
            ValueError, match=r"4000000 bit/s\): slcan has no such data rate; expected 2000000 or 5000000"
        ):
            real_port.open_bus("slcan", os.ttyname(port), 1_000_000, 4_000_000, options)
    finally:
        os.close(adapter)
        os.close(port)


def test_socketcan_is_opened_for_fd_and_has_its_rates_from_the_system() -> None:
    assert real_port.arguments("socketcan", "can0", 1_000_000, 5_000_000) == {
        "interface": "socketcan", "channel": "can0", "fd": True,
    }  # fmt: skip


def test_a_channels_own_name_and_options_reach_python_can() -> None:
    channel = _channel("virtual", "right_arm", channel="bench", options={"receive_own_messages": True})
    port = real_port.CanPort([channel])
    record = frames.empty(1)
    port.send(record)
    with can.Bus(interface="virtual", channel="bench"):
        assert len(port.receive(1.0)) == 1  # its own, as asked
    port.close()


@pytest.mark.parametrize(
    ("interface", "channel", "says"),
    [
        (
            "socketcan",
            "can77",
            "No such device.*expected a CAN network interface that is up|this kernel has no SocketCAN",
        ),
        ("pcan", "PCAN_USBBUS1", "library not found.*`handrail can interfaces` lists"),
        ("slcan", "/dev/no_such_port", "expected the adapter's serial port"),
    ],
)
def test_hardware_that_is_not_there_is_a_refusal_that_says_what_to_do(interface: str, channel: str, says: str) -> None:
    with pytest.raises(BusLost, match=rf"CAN channel {channel} \(interface {interface}\): .*({says})"):
        real_port.open_bus(interface, channel, 1_000_000, 5_000_000)


def test_rates_that_no_hardware_makes_are_refused() -> None:
    with pytest.raises(ValueError, match="1000000 and 12345 bit/s"):
        bus_check.check_channels([_channel("pcan", data_bitrate=12_345)])


def _link(**other: Any) -> str:
    """As iproute2 6.1 prints a CAN FD interface."""
    data = {
        "state": other.pop("state", "ERROR-ACTIVE"),
        "restart_ms": 0,
        "bittiming": {"bitrate": other.pop("bitrate", 1_000_000), "sample_point": "0.750"},
        "data_bittiming": {"bitrate": other.pop("data_bitrate", 5_000_000)},
    }
    link = {"ifname": "can0", "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"], "mtu": 72, **other}
    return json.dumps([{**link, "linkinfo": {"info_kind": "can", "info_data": data}}])


@pytest.mark.parametrize(
    ("said", "says"),
    [
        (_link(flags=["NOARP"]), "is down; `ip link set can0 up type can bitrate 1000000 dbitrate 5000000 fd on`"),
        (_link(mtu=16), "carries classic CAN only; `ip link set can0 down`, then"),
        (_link(bitrate=500_000), "bit rate 500000 bit/s; the robot's drives speak 1000000"),
        (_link(data_bitrate=2_000_000), "data bit rate 2000000 bit/s; the robot's drives speak 5000000"),
        (_link(state="BUS-OFF"), "the controller is bus-off: .*120 ohm"),
    ],
)
def test_a_network_interface_that_is_not_as_the_robot_needs_it_is_refused(said: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        bus_check.check_channels([_channel("socketcan")], ip=lambda name: said)


def test_a_network_interface_as_the_robot_needs_it_is_accepted() -> None:
    for said in (_link(), "", '[{"ifname": "vcan0", "flags": ["UP"], "mtu": 72, "linkinfo": {"info_kind": "vcan"}}]'):
        bus_check.check_channels([_channel("socketcan"), _channel("handrail")], ip=lambda name, said=said: said)


# ------------------------------------------------------------------------------------------------------- real and virtual mixed


@pytest.fixture
def mixed_robot(robot: SimpleNamespace) -> SimpleNamespace:
    """can0 virtual, can1 on python-can's in-process interface, which stands in for hardware."""
    robot.channels[1].interface = "virtual"
    robot.channels[1].channel, robot.channels[1].options = "bench", {}
    return robot


def test_real_and_virtual_channels_are_one_port(running: Path, mixed_robot: SimpleNamespace, make_frames: Make) -> None:
    port = open_port(mixed_robot, Runtime.at(running))
    assert isinstance(port, MixedPort) and [c.name for c in port.channels] == ["can0", "can1"]
    virtual = HubPort(running / "bus.sock", ["can1", "can0"])
    with can.Bus(interface="virtual", channel="bench", protocol=can.CanProtocol.CAN_FD) as real:
        port.send(
            np.concatenate([make_frames([0x101], bus=1), make_frames([0x100], bus=0), make_frames([0x102], bus=1)])
        )
        got = virtual.receive(2.0)
        assert (got["can_id"].tolist(), got["bus"].tolist()) == ([0x100], [1])
        heard = [real.recv(1.0), real.recv(1.0)]
        assert [m.arbitration_id for m in heard if m] == [0x101, 0x102]
        real.send(can.Message(arbitration_id=0x208, data=bytes(16), is_extended_id=False, is_fd=True))
        virtual.send(make_frames([0x200], bus=1))
        virtual.send(make_frames([0x999 & 0x7FF], bus=0))  # the hub's can1 is not the robot's
        seen: list[tuple[int, int]] = []
        while len(seen) < 2 and len(got := port.receive(2.0)):
            seen += zip(got["can_id"].tolist(), got["bus"].tolist(), strict=True)
        assert sorted(seen) == [(0x200, 0), (0x208, 1)]
        assert port.counters[:, :2].tolist() == [[1, 1], [2, 1]] and (port.counters[:, 2] > 0).all()
        assert len(port.receive(0.01)) == 0
    virtual.close()
    port.close()


def test_a_hub_at_other_rates_than_the_robots_is_refused(running: Path, robot: SimpleNamespace) -> None:
    robot.channels[1].bitrate = 500_000
    with pytest.raises(
        ValueError,
        match=r"channel can1: test_robot has 500000 and 5000000 bit/s, the hub .* start the hub with --bitrate 500000",
    ):
        open_port(robot, Runtime.at(running))


# --------------------------------------------------------------------------------------------------------------- who answers


class _Drives:
    """Drives on python-can's in-process interface that answer as real ones do, some of them missing or of another version."""

    def __init__(self, robot: SimpleNamespace, missing: tuple[str, ...], versions: dict[str, int] | None = None):
        self._protocol, self._robot, self._versions = LimbProtocol(robot), robot, versions or {}
        self._present = np.array([joint not in missing for joint in robot.joints])
        self._port = real_port.CanPort([c for c in robot.channels if c.interface != "handrail"])
        self._ending = False
        self._thread = threading.Thread(target=self._run)
        self.asked = 0

    def __enter__(self) -> _Drives:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending = True
        self._thread.join()
        self._port.close()

    def _run(self) -> None:
        n = len(self._robot.joints)
        state, targets, out = JointState(n), DriveTargets(n), frames.empty(4 * n)
        expected = self._protocol.protocol_version
        while not self._ending:
            got = self._port.receive(0.02)
            self._protocol.decode(got, len(got), targets)
            count = 0
            if targets.controlled.any():
                self.asked += 1
                state.sequence[:] = targets.sequence
                count = self._protocol.encode_status(state, np.zeros(n, np.uint8), self._present, out)
            for request in self._protocol.requests(targets):
                if self._present[request.joint]:
                    version = self._versions.get(self._robot.joints[request.joint], int(expected[request.joint]))
                    count += self._protocol.encode_reply(request, ParameterResult.OK, version, out[count:])
            self._port.send(out[:count][out["bus"][:count] < len(self._port.channels)])


@pytest.fixture
def bench_robot(robot: SimpleNamespace) -> Iterator[SimpleNamespace]:
    for channel in robot.channels:
        channel.interface = "virtual"
    robot.period_ns = 2_000_000
    yield robot


def test_drives_that_do_not_answer_are_named_with_their_channel(bench_robot: SimpleNamespace) -> None:
    with _Drives(bench_robot, missing=("right_3", "torso_1", "torso_2", "head_1", "head_2")):
        port = real_port.CanPort(bench_robot.channels)
        found = bus_check.survey(bench_robot, port, LimbProtocol(bench_robot))
        port.close()
    assert found.missing == ["right_3", "torso_1", "torso_2", "head_1", "head_2"] and found.asked
    first, second = bus_check.refusal(bench_robot, found).splitlines()
    assert first.startswith("no answer from right_3 of limb right on channel can0 (virtual): are they powered")
    assert second.startswith("no answer from all 4 drives of limb torso on channel can1")


def test_up_refuses_a_robot_whose_real_drives_do_not_answer(bench_robot: SimpleNamespace) -> None:
    bench_robot.channels[1].interface = "handrail"  # that one is the plant's affair
    with (
        _Drives(bench_robot, missing=("right_0", "left_2")),
        pytest.raises(ValueError, match=r"^no answer from right_0 of limb right on channel can0 \(virtual\): [^\n]*$"),
    ):
        bus_check.check_real_drives(bench_robot, LimbProtocol)


def test_a_complete_network_gives_no_refusal(bench_robot: SimpleNamespace) -> None:
    with _Drives(bench_robot, missing=()) as drives:
        port = real_port.CanPort(bench_robot.channels)
        found = bus_check.survey(bench_robot, port, LimbProtocol(bench_robot))
        port.close()
    assert bus_check.refusal(bench_robot, found) == "" and len(found.answered) == 18 and drives.asked


def test_drives_of_another_protocol_version_are_named(bench_robot: SimpleNamespace) -> None:
    with _Drives(bench_robot, missing=(), versions={"left_4": 99}):
        port = real_port.CanPort(bench_robot.channels)
        found = bus_check.survey(bench_robot, port, LimbProtocol(bench_robot))
        port.close()
    assert not found.missing and set(found.strangers) == {"left_4"} and found.strangers["left_4"][0] == 99
    assert "the drive of left_4 speaks protocol version 99, its family here" in bus_check.refusal(bench_robot, found)


def test_a_device_that_does_not_answer_is_named(bench_robot: SimpleNamespace) -> None:
    bench_robot.devices = (Device("pelvis_imu", "imu", 0, "can1", "", ""),)
    with _Drives(bench_robot, missing=()):
        port = real_port.CanPort(bench_robot.channels)
        found = bus_check.survey(bench_robot, port, LimbProtocol(bench_robot))
        port.close()
    assert found.missing == ["pelvis_imu"]
    said = bus_check.refusal(bench_robot, found)
    assert (
        said.startswith("no answer from pelvis_imu of imu device on channel can1 (virtual)") and said.count("\n") == 0
    )
    said = bus_check.refusal(bench_robot, found, {("pelvis_imu", "can1"): "bus_off"})
    assert "bus off on the virtual bus; `handrail can fault list` shows why" in said


def test_a_survey_never_talks_into_another_hosts_conversation(bench_robot: SimpleNamespace) -> None:
    # A controlword 0 from a second host would switch drives off that somebody is using.
    with _Drives(bench_robot, missing=()) as drives:
        port, other = real_port.CanPort(bench_robot.channels), real_port.CanPort(bench_robot.channels)
        record = frames.empty(1)
        record["can_id"], record["length"], record["flags"] = 0x080, 4, frames.FD
        other.send(record)
        found = bus_check.survey(bench_robot, port, LimbProtocol(bench_robot))
        port.close()
        other.close()
    assert not found.asked and drives.asked == 0 and len(found.missing) == 18


def test_the_load_of_a_real_bus_is_found_out_by_listening() -> None:
    with can.Bus(interface="virtual", channel="heard", protocol=can.CanProtocol.CAN_FD) as device:
        heard = ListenedBus(real_port.open_bus("virtual", "heard", 1_000_000, 5_000_000), "heard", 1_000_000, 5_000_000)
        for _ in range(10):
            device.send(can.Message(arbitration_id=0x155, is_extended_id=False, data=bytes(8)))
            device.send(can.Message(arbitration_id=0x155, is_extended_id=True, is_fd=True, data=bytes(64)))
        device.send(can.Message(is_error_frame=True))
        until = time.monotonic() + 30
        while (channel := heard.report().channels[0]).error_frames < 1 and time.monotonic() < until:
            time.sleep(0.01)
        heard.close()
    assert {(of.can_id, of.extended, of.frames) for of in channel.identifiers} == {
        (0x155, False, 10),
        (0x155, True, 10),
    }
    classic = next(of for of in channel.identifiers if not of.extended)
    assert 10 * 111_000 <= classic.busy_ns <= 10 * 135_000  # 8 bytes: 111 bits and stuffing, at 1 Mbit/s
    assert channel.frames == 20 and channel.busy_ns == sum(of.busy_ns for of in channel.identifiers)
