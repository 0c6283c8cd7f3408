"""`handrail can` starts, feeds, measures and disturbs a bus; python-can's own programs work on it unchanged."""

from __future__ import annotations

import io
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from hal.can import bus_table
from hal.can.cli import app
from hal.can.control import BusReport, ChannelState, HubControl, IdentifierLoad, NodeState
from hal.can.faults import Fault
from hal.can.port import HubPort
from hal.can.replay import Replayed, channel_of, read_log, replay
from hal.can.sending import encode_message, parse_frame
from hal.drives import DBC_FILES

Make = Callable[..., np.ndarray]


@pytest.fixture
def port(running: Path) -> Iterator[HubPort]:
    opened = HubPort(running / "bus.sock", ["can0", "can1"])
    yield opened
    opened.close()


@pytest.fixture
def run(running: Path) -> Iterator[Callable[..., Result]]:
    """run("send", "123#11"): the command in this process, on the bus that all tests share."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield lambda *words: CliRunner().invoke(app, [*words, "--runtime", str(running)])
    for number, handler in kept.items():
        signal.signal(number, handler)


def _take(port: HubPort, count: int) -> np.ndarray:
    """The next `count` frames at least, or what came within 20 s."""
    parts, until = [port.receive(20.0).copy()], time.monotonic() + 20.0
    while sum(map(len, parts)) < count and time.monotonic() < until:
        parts.append(port.receive(0.1).copy())
    return np.concatenate(parts)


# -------------------------------------------------------------------------------------------------------------------------- send


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("123#DEADBEEF", can.Message(arbitration_id=0x123, is_extended_id=False, data=b"\xde\xad\xbe\xef")),
        ("7FF#", can.Message(arbitration_id=0x7FF, is_extended_id=False)),
        ("00000123#11.22", can.Message(arbitration_id=0x123, is_extended_id=True, data=b"\x11\x22")),
        ("123#R4", can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=4)),
        ("123##0", can.Message(arbitration_id=0x123, is_extended_id=False, is_fd=True)),
        (
            "123##1" + "AA" * 9,
            can.Message(
                arbitration_id=0x123, is_extended_id=False, is_fd=True, bitrate_switch=True, data=b"\xaa" * 9 + bytes(3)
            ),
        ),
    ],
)
def test_frames_are_written_as_cansend_has_them(text: str, message: can.Message) -> None:
    assert parse_frame(text).equals(message, timestamp_delta=None)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("123", "expected ID#DATA"),
        ("xyz#11", "expected ID#DATA"),
        ("123#1", "1 hex digits of data; expected two a byte"),
        ("800#11", "identifier 800; expected at most 7FF"),
        ("FFFFFFFF#11", "identifier FFFFFFFF; expected at most 7FF, or 1FFFFFFF"),
        ("123#" + "00" * 9, "9 bytes; expected at most 8"),
        ("123##1" + "00" * 65, "65 bytes of data; expected at most 64"),
    ],
)
def test_what_is_no_frame_is_refused_with_what_was_expected(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(says)):
        parse_frame(text)


@given(st.text(alphabet="0123456789abcdefR#.x", max_size=40))
def test_any_text_is_a_frame_or_a_refusal(text: str) -> None:
    try:
        message = parse_frame(text)
    except ValueError as error:
        assert "expected" in str(error)
    else:
        assert message.arbitration_id <= 0x1FFFFFFF and len(message.data) <= 64


def test_a_message_is_sent_by_its_name_and_signals(run: Callable[..., Result], port: HubPort) -> None:
    assert run("send", "Sync", "Cycle=1027", "--channel", "can1").exit_code == 0
    got = port.receive(2.0)
    assert (got["can_id"].tolist(), got["bus"].tolist()) == ([0x080], [1])
    assert got["data"][0, :4].tolist() == [3, 4, 0, 0]
    files = list(DBC_FILES.values())
    with pytest.raises(ValueError, match=r"'Cykle=2'; expected SIGNAL=VALUE with one of Cycle"):
        encode_message("Sync", ["Cykle=2"], files)
    with pytest.raises(ValueError, match=r"Sync.Cycle: 'two'; expected a number"):
        encode_message("Sync", ["Cycle=two"], files)
    with pytest.raises(ValueError, match=r"message 'Synk' is in no DBC.*did you mean Sync"):
        encode_message("Synk", [], files)


def test_a_frame_is_sent_again_and_again(run: Callable[..., Result], port: HubPort) -> None:
    assert run("send", "321#01", "--count", "3", "--period", "0.01").exit_code == 0
    assert len(_take(port, 3)) == 3


# -------------------------------------------------------------------------------------------------------------- record and replay


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_what_was_recorded_is_replayed_frame_by_frame_and_in_time(
    suffix: str, tmp_path: Path, running: Path, run: Callable[..., Result], port: HubPort
) -> None:
    file, start = tmp_path / f"bus{suffix}", 1000.0
    times = [0.0, 0.1, 0.2, 0.3]
    with can.Logger(file) as log:
        for index, after in enumerate(times):
            log(
                can.Message(
                    timestamp=start + after,
                    arbitration_id=0x100 + index,
                    is_extended_id=False,
                    data=bytes([index] * 12),
                    is_fd=True,
                    bitrate_switch=True,
                    channel=f"can{index % 2}",
                )
            )
    began = time.monotonic()
    assert run("replay", str(file)).exit_code == 0
    assert 0.3 <= time.monotonic() - began < 30.0
    got = _take(port, 4)
    got = got[np.argsort(got["can_id"])]  # two channels: no order between them
    assert got["can_id"].tolist() == [0x100, 0x101, 0x102, 0x103]
    assert got["bus"].tolist() == [0, 1, 0, 1]
    assert (got["data"][:, :12] == np.arange(4)[:, None]).all() and (got["length"] == 12).all()
    # As fast as the bus takes them, and all on one channel.
    assert run("replay", str(file), "--speed", "0", "--channel", "can1").exit_code == 0
    assert _take(port, 4)["bus"].tolist() == [1] * 4


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_a_replay_keeps_the_distances_in_time_divided_by_its_speed(speed: float) -> None:
    now, sent = 50.0, []

    class Bus:
        def send(self, message: can.Message, timeout: float | None = None) -> None:
            sent.append((message.arbitration_id, now))

    def wait(seconds: float) -> bool:
        nonlocal now
        now += seconds
        return message_limit is not None and len(sent) >= message_limit

    message_limit = None
    messages = [can.Message(timestamp=1e9 + after, arbitration_id=n) for n, after in enumerate((0.0, 0.5, 0.5, 2.0))]
    done = replay(messages, Bus(), lambda message: "can0", speed=speed, ended=wait, clock=lambda: now)  # type: ignore[arg-type]
    assert sent == [(n, pytest.approx(50.0 + after / speed)) for n, after in enumerate((0.0, 0.5, 0.5, 2.0))]
    assert done.sent == 4 and done.latest_ns == 0
    sent.clear()
    message_limit = 2
    done = replay(messages, Bus(), lambda message: "can0", speed=speed, ended=wait, clock=lambda: now)  # type: ignore[arg-type]
    assert done.sent == 3, "asked to end while it waits for the fourth"


def test_record_writes_only_what_its_filter_lets_through_and_a_whole_file(
    tmp_path: Path, running: Path, make_frames: Make
) -> None:
    file, port = tmp_path / "some.blf", HubPort(running / "bus.sock", ["can0"])
    words = ["record", str(file), "can0", "--count", "4", "-f", "200:700", "--runtime", str(running)]
    with subprocess.Popen([sys.executable, "-m", "hal.can.cli", *words], stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            port.send(make_frames([0x100, 0x210, 0x300]))
            time.sleep(0.05)
        assert process.stderr is not None and process.stderr.read() == f"4 frames in {file}\n"
    assert process.returncode == 0
    assert [m.arbitration_id for m in can.LogReader(file)] == [0x210] * 4
    port.close()


def test_replay_refuses_what_it_cannot_do(tmp_path: Path, run: Callable[..., Result]) -> None:
    broken = tmp_path / "broken.blf"
    broken.write_bytes(b"LOGG" + bytes(200))
    three = tmp_path / "third.asc"
    with can.Logger(three) as log:
        log(can.Message(timestamp=1.0, arbitration_id=1, channel=7))
    for words, says in (
        (("no.blf",), "no.blf: there is none"),
        ((str(broken),), "broken.blf: can't be read"),
        ((str(three),), "a frame of channel 7; the bus has can0, can1 (--channel sends all on one)"),
        ((str(three), "--channel", "can9"), "can9"),
        ((str(three), "-f", "12"), "--filter '12'; expected ID:MASK in hex"),
    ):
        result = run("replay", *words)
        assert result.exit_code == 1 and says in result.output, words


@settings(max_examples=30, deadline=None)
@given(st.binary(max_size=300), st.sampled_from([".blf", ".asc", ".log", ".csv"]))
def test_any_bytes_in_a_log_file_are_messages_or_one_clear_refusal(content: bytes, suffix: str) -> None:
    file = Path(f"/dev/shm/handrail-fuzz-{os.getpid()}{suffix}")
    file.write_bytes((b"LOGG" if suffix == ".blf" else b"") + content)
    try:
        for message in read_log(file):
            assert isinstance(message, can.Message)
    except ValueError as error:
        assert str(file) in str(error)
    finally:
        file.unlink()


def test_a_logs_channels_are_found_by_name_then_number_then_place() -> None:
    assert channel_of("can1", ["can0", "can1"]) == "can1"
    assert channel_of(1, ["can1", "can2"]) == "can1"
    assert channel_of("0", ["right", "left"]) == "right"
    assert channel_of(None, ["only"]) == "only"
    assert channel_of(5, ["can0", "can1"]) is None


def test_error_frames_of_a_log_are_left_out_and_counted() -> None:
    messages = [can.Message(is_error_frame=True), can.Message(arbitration_id=1), can.Message(is_error_frame=True)]
    with can.Bus(interface="virtual", channel="replay") as bus, can.Bus(interface="virtual", channel="replay") as other:
        assert replay(messages, bus, lambda message: "replay", speed=0.0) == Replayed(sent=1, skipped=2)
        assert other.recv(0) is not None and other.recv(0) is None


# -------------------------------------------------------------------------------------------------------------- stats and faults


def _report(time_ns: int, frames: int, busy_ns: int) -> BusReport:
    identifiers = [
        IdentifierLoad(can_id=0x80, extended=False, frames=frames, busy_ns=busy_ns // 4),
        IdentifierLoad(can_id=0x200, extended=False, frames=2 * frames, busy_ns=busy_ns * 3 // 4),
    ]
    channel = ChannelState(
        name="can0", bitrate=1_000_000, data_bitrate=5_000_000, frames=3 * frames, busy_ns=busy_ns, error_frames=0,
        load=0.5, identifiers=identifiers,
    )  # fmt: skip
    node = NodeState(
        name="arm", channel="can0", state="error_passive", transmit_errors=136, receive_errors=0, waiting=2, overflows=1
    )
    fault = Fault(kind="drop", node="arm_*", can_id=0x203)
    return BusReport(time_ns=time_ns, timing=True, channels=[channel], nodes=[node], faults={3: fault}, hits={3: 7})


def test_loads_and_rates_are_those_between_two_reports() -> None:
    before, now = _report(1_000_000_000, 100, 10_000_000), _report(1_500_000_000, 600, 210_000_000)
    assert bus_table.channel_load(now, before, now.channels[0]) == pytest.approx(0.4)
    first, second = bus_table.rates(now, before)["can0"]
    assert (first.can_id, first.per_s, first.load) == (0x200, pytest.approx(2000), pytest.approx(0.3))
    assert (second.can_id, second.per_s, second.load) == (0x80, pytest.approx(1000), pytest.approx(0.1))
    # A simulation that stands still has no rates.
    assert [(r.per_s, r.load) for r in bus_table.rates(now, now)["can0"]] == [(None, None)] * 2


def test_the_table_shows_load_names_error_states_and_faults() -> None:
    from rich.console import Console

    console = Console(width=120, record=True, file=io.StringIO())
    names = {0x80: "Sync", 0x200: "DriveStatus_0_0"}
    before, now = _report(1_000_000_000, 100, 10_000_000), _report(1_500_000_000, 600, 210_000_000)
    console.print(bus_table.tables(now, before, lambda can_id, extended: names[can_id]))
    text = console.export_text()
    assert re.search(r"can0 +1,000,000 +5,000,000 +40.0 %", text)
    assert re.search(r"can0 +200 +DriveStatus_0_0 +2,000 +30.0 %", text)
    assert re.search(r"arm +can0 +error passive +136 +0 +2 +1", text)
    assert re.search(r"3 +drop, node arm_\*, can_id 0x203 +7", text)


def test_stats_measures_the_load_that_is_there(run: Callable[..., Result], port: HubPort, make_frames: Make) -> None:
    port.send(make_frames([0x155] * 50, length=64))
    result = run("stats", "--json", "--period", "0.1")
    document = json.loads(result.stdout)
    channel = document["channels"][0]
    seen = next(of for of in channel["identifiers"] if of["can_id"] == 0x155)
    assert channel["name"] == "can0" and seen["frames"] >= 50 and seen["frames_per_s"] is not None
    assert {"test", "pytest"} & {re.split(r"[-_]", node["name"])[0] for node in document["nodes"]} or document["nodes"]
    assert "identifiers, by load" in run("stats", "--once").stdout


def test_faults_are_laid_listed_and_taken_back(run: Callable[..., Result], running: Path, tmp_path: Path) -> None:
    words = ("fault", "add", "drop", "--node", "arm_*", "--id", "203", "--probability", "0.3", "--duration", "2")
    added = run(*words, "--even-if-absent")
    number = int(added.stdout)
    control = HubControl(running / "bus.sock")
    assert control.report().faults[number] == Fault(
        kind="drop", node="arm_*", can_id=0x203, probability=0.3, duration=2.0
    )
    assert "node arm_*, can_id 0x203" in run("fault", "list").stdout
    script = tmp_path / "faults.yaml"
    script.write_text("faults:\n- {kind: delay, can_id: 0x80, delay: 0.01}\n- {kind: corrupt, count: 3, after: 100}\n")
    assert run("fault", "add", "--file", str(script)).exit_code == 0
    listed = json.loads(run("fault", "list", "--json").stdout)
    assert [row["fault"]["kind"] for row in listed] == ["drop", "delay", "corrupt"]
    assert run("fault", "clear", str(number)).stdout == "1 cleared\n"
    assert run("fault", "clear").stdout == "2 cleared\n" and not control.report().faults
    assert run("fault", "list").stdout == "no faults\n"
    control.close()


def test_a_fault_of_a_node_that_is_not_on_the_bus_is_refused_whole(
    run: Callable[..., Result], running: Path, tmp_path: Path
) -> None:
    node, control = HubPort(running / "bus.sock", ["can0"], name="arm_right_3_joint"), HubControl(running / "bus.sock")
    refused = run("fault", "add", "drop", "--node", "arm_rigth_3_joint")
    assert refused.exit_code == 1
    assert "--node arm_rigth_3_joint: not on the bus now; expected one of arm_right_3_joint" in refused.output
    script = tmp_path / "faults.yaml"
    script.write_text("faults:\n- {kind: delay, node: arm_right_3_joint}\n- {kind: cut, node: nobody}\n")
    refused = run("fault", "add", "--file", str(script))
    assert refused.exit_code == 1 and "--node nobody" in refused.output
    assert not control.report().faults
    assert run("fault", "add", "drop", "--node", "arm_right_?_joint").exit_code == 0
    run("fault", "clear")
    control.close()
    node.close()


def test_a_fault_acts_until_its_count_and_its_hits_are_shown(
    run: Callable[..., Result], port: HubPort, running: Path, make_frames: Make
) -> None:
    listener = HubPort(running / "bus.sock", ["can0"])
    number = int(run("fault", "add", "drop", "--id", "2B3", "--count", "2").stdout)
    port.send(make_frames([0x2B3, 0x2B3, 0x2B4, 0x2B3]))
    assert _take(listener, 2)["can_id"].tolist() == [0x2B4, 0x2B3]
    assert [row["hits"] for row in json.loads(run("fault", "list", "--json").stdout) if row["number"] == number] in (
        [2],
        [],
    )
    run("fault", "clear")
    listener.close()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("add",), "a kind or --file FILE is needed, and not both; kinds are drop,"),
        (("add", "nope"), "kind 'nope'; expected one of drop, delay,"),
        (("add", "drop", "--probability", "2"), "--probability: Expected `float` <= 1.0"),
        (("add", "drop", "--id", "20G"), "--id '20G'; expected a hexadecimal number"),
        (("add", "drop", "--channel", "can7"), "'can7'; expected one of"),
        (("add", "--file", "no.yaml"), "no.yaml"),
        (("clear", "99"), "99"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_in_one_line(
    run: Callable[..., Result], words: tuple[str, ...], says: str
) -> None:
    result = run("fault", *words)
    assert result.exit_code == 1
    assert result.output.startswith("handrail can fault") and says in result.output and result.output.count("\n") == 1


@pytest.mark.parametrize("words", [("send", "123#11"), ("stats",), ("fault", "list"), ("check", "talos_upper")])
def test_without_a_bus_every_verb_says_how_to_get_one(words: tuple[str, ...], tmp_path: Path) -> None:
    result = CliRunner().invoke(app, [*words, "--runtime", str(tmp_path)])
    assert result.exit_code == 1 and "no hub there after 1 s; start the robot's service (handrail up)" in result.output


def test_up_runs_a_bus_of_the_rates_asked_for_until_ctrl_c(folder: Path) -> None:
    words = ["up", "can4,can5", "--bitrate", "500000", "--data-bitrate", "2000000", "--runtime", str(folder)]
    with subprocess.Popen([sys.executable, "-m", "hal.can.cli", *words], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "hub ready\n"
        control = HubControl(folder / "bus.sock")
        rates = [(c.name, c.bitrate, c.data_bitrate) for c in control.report().channels]
        control.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(5) == 0
    assert rates == [("can4", 500_000, 2_000_000), ("can5", 500_000, 2_000_000)]


# --------------------------------------------------------------------------------------------------------- python-can's programs


def test_python_cans_logger_and_player_work_unchanged(running: Path, tmp_path: Path, make_frames: Make) -> None:
    played, logged = tmp_path / "played.asc", tmp_path / "logged.blf"
    with can.Logger(played) as log:
        for index in range(200):
            log(
                can.Message(
                    timestamp=1.0, arbitration_id=0x300 + index, is_extended_id=False, data=bytes(24), is_fd=True
                )
            )
    environment = {**os.environ, "HANDRAIL_RUNTIME": str(running)}
    bus = ["-i", "handrail", "-c", "can0"]
    control = HubControl(running / "bus.sock")
    there = {node.name for node in control.report().nodes}
    logger = subprocess.Popen(
        [sys.executable, "-m", "can.logger", *bus, "-f", str(logged)], env=environment, stdout=subprocess.DEVNULL
    )
    while not {node.name for node in control.report().nodes} - there:
        assert logger.poll() is None
        time.sleep(0.02)
    player = [sys.executable, "-m", "can.player", *bus, str(played)]
    subprocess.run(player, env=environment, check=True, timeout=30, stdout=subprocess.DEVNULL)
    # The hub has passed on all that the player sent before it left; the logger has taken it all once it sleeps.
    asleep = 0
    while asleep < 10:
        asleep = asleep + 1 if psutil.Process(logger.pid).status() == psutil.STATUS_SLEEPING else 0
        time.sleep(0.02)
    logger.send_signal(signal.SIGINT)
    logger.wait(30)
    control.close()
    assert [m.arbitration_id for m in can.LogReader(logged)] == [0x300 + index for index in range(200)]


def test_python_cans_viewer_shows_the_bus_unchanged(running: Path, make_frames: Make) -> None:
    terminal, theirs = pty.openpty()
    environment = {**os.environ, "HANDRAIL_RUNTIME": str(running), "TERM": "xterm", "LINES": "30", "COLUMNS": "120"}
    command = [sys.executable, "-m", "can.viewer", "-i", "handrail", "-c", "can0"]
    port = HubPort(running / "bus.sock", ["can0"])
    frames = make_frames([0x2A5], length=8)
    frames["data"][0, :8] = [0xDE, 0xAD, 0xBE, 0xEF, 0x12, 0x34, 0x56, 0x78]
    shown, quits_by = b"", time.monotonic() + 60
    with subprocess.Popen(command, env=environment, stdin=theirs, stdout=theirs, stderr=theirs) as viewer:
        while b"0x2A5" not in shown or b"DE AD BE EF 12 34 56 78" not in shown:
            assert viewer.poll() is None and time.monotonic() < quits_by, shown[-2000:]
            port.send(frames)
            if select.select([terminal], [], [], 0.05)[0]:
                shown += os.read(terminal, 65536)
        os.write(terminal, b"q")
        while viewer.poll() is None and time.monotonic() < quits_by:
            if select.select([terminal], [], [], 0.05)[0]:
                os.read(terminal, 65536)
        assert viewer.wait(1) == 0
    port.close()
    os.close(terminal)
    os.close(theirs)
