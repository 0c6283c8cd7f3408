"""`handrail can dump` shows, decodes and logs the bus."""

from __future__ import annotations

import re
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

from hal.can.capture import Decoder, line
from hal.can.port import HubPort
from hal.drives import DBC_FILES
from hal.drives.family import dbc_files
from hal.drives.protocol import LimbProtocol
from hal.joint import JointState

Make = Callable[..., np.ndarray]


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        (
            can.Message(timestamp=12.5, arbitration_id=0x123, data=b"\x01\xab", is_extended_id=False, channel="can0"),
            " (12.500000)  can0       123   [2]  01 AB",
        ),
        (
            can.Message(timestamp=1.0, arbitration_id=0x1ABCDEF0, data=bytes(8), is_fd=True, channel="can1"),
            " (1.000000)  can1  1ABCDEF0  [08]  00 00 00 00 00 00 00 00",
        ),
        (
            can.Message(timestamp=0.0, arbitration_id=1, is_remote_frame=True, is_extended_id=False, channel="can0"),
            " (0.000000)  can0       001   [0]  remote request",
        ),
    ],
)
def test_a_line_is_candumps(message: can.Message, shown: str) -> None:
    assert line(message) == shown


def test_a_message_is_said_in_signals_values_and_units() -> None:
    decoder = Decoder(DBC_FILES["limb_fd"])
    sync = can.Message(arbitration_id=0x80, data=b"\x07\0\0\0", is_fd=True, is_extended_id=False)
    assert decoder.text(sync) == "Sync(Cycle: 7)"
    status = can.Message(arbitration_id=0x203, data=b"\x40\x42\x0f\0" + bytes(16), is_fd=True, is_extended_id=False)
    assert decoder.text(status).startswith("DriveStatus_0_3(Position: 1 rad, Velocity: 0 rad/s, Torque: 0 N*m, ")
    assert "Mode: damping" in decoder.text(status)
    short = can.Message(arbitration_id=0x203, data=b"\x40", is_fd=True, is_extended_id=False)
    assert "can't be decoded" in decoder.text(short)
    for unknown in (can.Message(arbitration_id=0x7F0), can.Message(arbitration_id=0x80, is_extended_id=True)):
        assert decoder.text(unknown) == ""


def test_the_dbcs_of_all_families_are_found_and_a_users_own_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "drives" / "own"
    own.mkdir(parents=True)
    (own / "family.yaml").write_text("name: own\n")
    (own / "own.dbc").write_text('VERSION ""\n\nBU_: A\n\nBO_ 128 Mine: 1 A\n SG_ Speed : 0|8@1+ (1,0) [0|255] "" A\n')
    for identifiers, workspace in ((set(), ""), ({"own"}, str(tmp_path))):
        monkeypatch.setenv("HANDRAIL_WORKSPACE", workspace)
        assert set(dbc_files()) == set(DBC_FILES) | identifiers
    assert next(iter(dbc_files())) == "own"
    decoder = Decoder(*dbc_files().values())
    assert decoder.name(0x80, False) == "Mine"  # limb_fd's Sync
    for family in DBC_FILES:
        database = cantools.database.load_file(DBC_FILES[family])
        told = [decoder.name(message.frame_id, message.is_extended_frame) for message in database.messages]
        assert set(told) - {"Mine"} <= {message.name for message in database.messages}


def _dump(folder: Path, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "hal.can.cli", "dump", "--runtime", str(folder), *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _send_until(port: HubPort, records: np.ndarray, process: subprocess.Popen[str]) -> None:
    """Again and again until the process has ended: nothing tells when a listener has joined."""
    while True:
        port.send(records)
        try:
            process.wait(0.05)
            return
        except subprocess.TimeoutExpired:
            port.receive(0.0)


def test_dump_prints_decodes_and_logs_and_ends_after_its_count(running: Path, tmp_path: Path, robot: object) -> None:
    port, protocol, state = HubPort(running / "bus.sock"), LimbProtocol(robot), JointState(18)
    out = np.zeros(32, port.receive().dtype)
    state.position[:] = 0.25
    n = protocol.encode_status(state, np.zeros(18, np.uint8), np.ones(18, np.bool_), out)
    with _dump(running, "--decode", "--log", str(tmp_path / "bus.blf"), "--count", "36") as process:
        _send_until(port, out[:n], process)
        printed, said = process.communicate(timeout=30)
    assert process.returncode == 0 and said.startswith("36 frames in ")
    lines = printed.splitlines()
    assert len(lines) == 36
    # Both channels, merged in the order in which the frames ended.
    assert {re.split(r"\s+", text)[2] for text in lines} == {"can0", "can1"}
    times = [float(re.search(r"\((.*?)\)", text)[1]) for text in lines]  # type: ignore[index]
    assert times == sorted(times)
    assert all(":: DriveStatus_" in text and "Position: 0.25 rad" in text for text in lines)
    logged = list(can.LogReader(tmp_path / "bus.blf"))
    assert len(logged) == 36 and all(message.is_fd and message.dlc == 20 for message in logged)
    port.close()


def test_an_interrupted_dump_leaves_a_whole_log(running: Path, tmp_path: Path, make_frames: Make) -> None:
    port = HubPort(running / "bus.sock")
    with _dump(running, "can0", "--log", str(tmp_path / "bus.asc")) as process:
        assert process.stdout is not None
        while not select.select([process.stdout], [], [], 0.05)[0]:
            port.send(make_frames([0x10, 0x11]))
            port.send(make_frames([0x12], bus=1))
        process.send_signal(signal.SIGINT)
        printed, said = process.communicate(timeout=30)
    assert process.returncode == 0
    shown = len(printed.splitlines())
    assert said.startswith(f"{shown} frames in ")
    logged = list(can.LogReader(tmp_path / "bus.asc"))
    assert len(logged) == shown > 0 and {m.arbitration_id for m in logged} <= {0x10, 0x11}
    port.close()


def test_dump_says_when_the_bus_ends(folder: Path, hub_process: subprocess.Popen[str], make_frames: Make) -> None:
    port = HubPort(folder / "bus.sock")
    with _dump(folder, "--count", "1000000") as process:
        assert process.stdout is not None
        while not select.select([process.stdout], [], [], 0.05)[0]:
            port.send(make_frames([0x10]))
        hub_process.terminate()
        _, said = process.communicate(timeout=30)
    assert process.returncode == 1 and "the bus has ended" in said
    port.close()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ((), "no hub there"),
        (("--log", "capture.xyz"), "suffix .xyz; expected one of .blf"),
        (("--log", "no/such/folder/a.blf"), "is not there"),
        (("--dbc", "missing.dbc"), "missing.dbc: no CAN database"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(folder: Path, options: tuple[str, ...], says: str) -> None:
    with _dump(folder, *options) as process:
        _, said = process.communicate(timeout=20)
    assert process.returncode == 1 and says in said and len(said.splitlines()) == 1
