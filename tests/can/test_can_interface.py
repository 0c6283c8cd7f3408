"""The virtual bus is a python-can interface, and python-can's own tools work on it."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given
from hypothesis import strategies as st

from hal.can import frames
from hal.can.convert import to_message, to_record
from hal.can.interface import HandrailBus
from hal.can.port import HubPort, open_port
from hal.can.real_port import CanPort
from hal.drives import DBC_FILES
from hal.drives.protocol import LimbProtocol
from hal.joint import JointState
from handrail.runtime import Runtime

Make = Callable[..., np.ndarray]


@pytest.fixture
def bus(running: Path) -> Iterator[can.BusABC]:
    with can.Bus(interface="handrail", channel="can0", runtime=running) as opened:
        yield opened


@pytest.fixture
def port(running: Path) -> Iterator[HubPort]:
    opened = HubPort(running / "bus.sock", ["can0", "can1"])
    yield opened
    opened.close()


def test_can_bus_finds_the_interface_by_name(bus: can.BusABC, port: HubPort, make_frames: Make) -> None:
    assert isinstance(bus, HandrailBus)
    port.send(make_frames([0x123], bus=1))
    port.send(make_frames([0x124], length=64))
    message = bus.recv(2.0)
    assert message is not None
    assert (message.arbitration_id, message.dlc, message.channel) == (0x124, 64, "can0")
    assert message.is_fd and message.bitrate_switch and message.is_rx and not message.is_extended_id
    assert message.timestamp > 0
    assert bus.recv(0.0) is None


@pytest.mark.parametrize(
    "sent",
    [
        can.Message(arbitration_id=0x7FF, data=b"\x01\x02", is_extended_id=False),
        can.Message(arbitration_id=0x1FFFFFFF, data=b"", is_extended_id=True),
        can.Message(arbitration_id=0x10, data=bytes(range(64)), is_extended_id=False, is_fd=True, bitrate_switch=True),
        can.Message(arbitration_id=0x11, data=bytes(12), is_extended_id=True, is_fd=True, error_state_indicator=True),
        can.Message(arbitration_id=0x12, dlc=4, is_remote_frame=True, is_extended_id=False),
    ],
)
def test_every_kind_of_message_arrives_as_it_was_sent(bus: can.BusABC, running: Path, sent: can.Message) -> None:
    with can.Bus(interface="handrail", channel="can0", runtime=running) as other:
        other.send(sent)
        got = bus.recv(2.0)
    assert got is not None and got.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_fd_data_of_an_odd_length_is_padded(bus: can.BusABC, running: Path) -> None:
    with can.Bus(interface="handrail", channel="can0", runtime=running) as other:
        other.send(can.Message(arbitration_id=1, data=b"123456789", is_extended_id=False, is_fd=True))
        got = bus.recv(2.0)
    assert got is not None and bytes(got.data) == b"123456789\0\0\0"


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (can.Message(is_error_frame=True), "error frame"),
        (can.Message(arbitration_id=0x800, is_extended_id=False), "0x800; expected 0 to 0x7ff"),
        (can.Message(arbitration_id=1, data=bytes(9), dlc=9), "9 bytes of data; expected at most 8"),
        (can.Message(arbitration_id=1, data=bytes(65), dlc=65, is_fd=True), "65 bytes of data; expected at most 64"),
    ],
)
def test_what_is_no_frame_is_not_sent(bus: can.BusABC, message: can.Message, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        bus.send(message)


def test_own_messages_come_back_only_on_request(bus: can.BusABC, running: Path) -> None:
    message = can.Message(arbitration_id=5, is_extended_id=False)
    with can.Bus(interface="handrail", channel="can0", runtime=running, receive_own_messages=True) as echoing:
        echoing.send(message)
        bus.send(can.Message(arbitration_id=6, is_extended_id=False))
        assert {echoing.recv(2.0).arbitration_id, echoing.recv(2.0).arbitration_id} == {5, 6}  # type: ignore[union-attr]
    got = bus.recv(2.0)
    assert got is not None and got.arbitration_id == 5 and bus.recv(0.05) is None


def test_filters_and_several_channels(running: Path, port: HubPort, make_frames: Make) -> None:
    wanted = [{"can_id": 0x200, "can_mask": 0x700, "extended": False}]
    with can.Bus(interface="handrail", channel="can1,can0", runtime=running, can_filters=wanted) as filtered:
        port.send(np.concatenate([make_frames([0x100, 0x210]), make_frames([0x220, 0x300], bus=1)]))
        got = {(m.arbitration_id, m.channel) for m in (filtered.recv(2.0), filtered.recv(2.0)) if m}
        assert got == {(0x210, "can0"), (0x220, "can1")}
        filtered.send(can.Message(arbitration_id=9, channel="can0", is_extended_id=False))
        assert port.receive(2.0)["bus"].tolist() == [0]


def test_errors_say_what_is_wrong(running: Path, bus: can.BusABC) -> None:
    with pytest.raises(can.CanInitializationError, match="can9"):
        can.Bus(interface="handrail", channel="can9", runtime=running)
    with pytest.raises(can.CanInitializationError, match="no hub there"):
        can.Bus(interface="handrail", channel="can0", runtime=running / "elsewhere", timeout=0.0)


def test_the_end_of_the_bus_is_an_error_not_silence(folder: Path, hub_process: subprocess.Popen[str]) -> None:
    with can.Bus(interface="handrail", channel="can0", runtime=folder) as bus:
        hub_process.terminate()
        with pytest.raises(can.CanOperationError, match="ended"):
            bus.recv(5.0)


def test_channels_are_detected(running: Path, bus: can.BusABC, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HANDRAIL_RUNTIME", str(running))
    found = can.detect_available_configs("handrail")
    assert [(c["interface"], c["channel"]) for c in found] == [("handrail", "can0"), ("handrail", "can1")]


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log"])
def test_python_cans_logger_captures_what_stock_cantools_decodes(
    suffix: str, tmp_path: Path, robot: object, port: HubPort, bus: can.BusABC
) -> None:
    protocol, state, out = LimbProtocol(robot), JointState(18), np.zeros(32, port.receive().dtype)
    file, cycles, counted = tmp_path / f"capture{suffix}", 20, can.BufferedReader()
    with can.Notifier(bus, [can.Logger(file), counted], timeout=0.1):
        for cycle in range(cycles):
            state.position[:], state.sequence[:] = 0.01 * cycle, cycle
            n = protocol.encode_status(state, np.full(18, 2, np.uint8), np.ones(18, np.bool_), out)
            port.send(out[:n])
        got = 0
        while got < 7 * cycles and counted.get_message(2.0) is not None:
            got += 1
    database = cantools.database.load_file(DBC_FILES["limb_fd"])
    assert isinstance(database, Database)
    read = list(can.LogReader(file))
    assert len(read) == 7 * cycles  # channel can0 carries limb 0
    for place, message in enumerate(read):
        values = database.decode_message(message.arbitration_id, message.data)
        assert message.is_fd and message.arbitration_id == 0x200 + place % 7
        assert values["Position"] == pytest.approx(0.01 * (place // 7), abs=1e-9)
        assert values["Sequence"] == place // 7 and values["Mode"] == "impedance"


def test_an_asyncio_notifier_gets_every_message_of_a_batch(bus: can.BusABC, port: HubPort, make_frames: Make) -> None:
    async def collect() -> list[int]:
        reader = can.AsyncBufferedReader()
        with can.Notifier(bus, [reader], loop=asyncio.get_running_loop()):
            port.send(make_frames(np.arange(50)))
            first = [(await asyncio.wait_for(reader.get_message(), 2.0)).arbitration_id for _ in range(50)]
            port.send(make_frames([99]))
            return [*first, (await asyncio.wait_for(reader.get_message(), 2.0)).arbitration_id]

    assert asyncio.run(collect()) == [*range(50), 99]


_ANOTHER_PROCESS = """
import sys, can
with can.Bus(interface="handrail", channel="can0", runtime=sys.argv[1]) as bus:
    bus.send(can.Message(arbitration_id=0x42, data=b"hello", is_extended_id=False))
    for message in bus:
        print(message.arbitration_id, flush=True)
        break
"""


def test_another_process_sends_and_receives(running: Path, port: HubPort, make_frames: Make) -> None:
    command = [sys.executable, "-c", _ANOTHER_PROCESS, str(running)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        got = port.receive(30.0)
        assert got["can_id"].tolist() == [0x42] and got["data"][0, :5].tobytes() == b"hello"
        port.send(make_frames([0x77]))
        assert other.communicate(timeout=30)[0] == "119\n"


def test_a_robot_on_a_real_interface_uses_python_can(
    running: Path, robot: object, bus: can.BusABC, make_frames: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    # python-can's own in-process interface stands in for hardware.
    channels = robot.channels  # type: ignore[attr-defined]
    for channel in channels:
        channel.interface = "virtual"
    port = open_port(robot, Runtime.at(running))
    assert isinstance(port, CanPort)
    with can.Bus(interface="virtual", channel="can1") as device:
        port.send(np.concatenate([make_frames([0x101], bus=1, length=64), make_frames([0x100], bus=0, length=64)]))
        message = device.recv(1.0)
        assert message is not None and (message.arbitration_id, message.dlc, message.is_fd) == (0x101, 64, True)
        device.send(can.Message(arbitration_id=0x208, data=bytes(16), is_extended_id=False, is_fd=True))
        got = port.receive(1.0)
        assert (got["can_id"].tolist(), got["bus"].tolist(), got["length"].tolist()) == ([0x208], [1], [16])
    assert port.counters[:, :2].tolist() == [[1, 0], [1, 1]] and (port.counters[:, 2] > 0).all()
    assert len(port.receive(0.01)) == 0
    port.close()
    # Any python-can interface: ours too.
    monkeypatch.setenv("HANDRAIL_RUNTIME", str(running))
    channels[0].interface = channels[1].interface = "handrail"
    through = CanPort(channels)
    bus.send(can.Message(arbitration_id=3, is_extended_id=False))
    assert through.receive(2.0)["can_id"].tolist() == [3]
    through.close()


def test_a_robots_virtual_channels_are_the_hubs(running: Path, robot: object, port: HubPort, make_frames: Make) -> None:
    opened = open_port(robot, Runtime.at(running))
    assert isinstance(opened, HubPort) and [c.name for c in opened.channels] == ["can0", "can1"]
    port.send(make_frames([1], bus=1))
    assert opened.receive(2.0)["bus"].tolist() == [1]
    opened.close()


def test_channels_that_cannot_be_opened_are_named(running: Path, robot: object) -> None:
    channels = robot.channels  # type: ignore[attr-defined]
    channels[0].interface = channels[1].interface = "no_such_interface"
    with pytest.raises(
        ValueError, match=r"'no_such_interface' is none that python-can has; expected handrail .* socketcan"
    ):
        open_port(robot, Runtime.at(running))


@st.composite
def _records(draw: st.DrawFn) -> np.ndarray:
    """Any frame that the hub lets onto the bus."""
    flags = draw(st.integers(0, 31))
    if flags & frames.FD:
        flags &= ~frames.REMOTE
        length = draw(st.sampled_from(frames.FD_LENGTHS))
    else:
        flags &= ~(frames.BRS | frames.ESI)
        length = draw(st.integers(0, 8))
    record = frames.empty(1)
    record["can_id"] = draw(st.integers(0, 0x1FFFFFFF if flags & frames.EXTENDED else 0x7FF))
    record["length"], record["flags"], record["bus"] = length, flags, draw(st.integers(0, 1))
    if not flags & frames.REMOTE:
        record["data"][0, :length] = list(draw(st.binary(min_size=length, max_size=length)))
    return record


@given(_records())
def test_records_and_messages_say_the_same(record: np.ndarray) -> None:
    message = to_message(record.tobytes(), ["can0", "can1"])
    again = np.frombuffer(to_record(message, int(record["bus"][0])), frames.RECORD)
    assert again.tobytes() == record.tobytes()
