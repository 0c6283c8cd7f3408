"""A loop's tape in an MCAP file: anybody can read it, `handrail replay` runs it, and what is wrong with a file is named."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import Result
from mcap.reader import make_reader
from typer import Typer
from typer.testing import CliRunner

from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.replay import recorded_loop, tape_file
from daemon.replay.cli import replay
from daemon.replay.tape import Kind as Taped
from daemon.replay.tape import TapeWriter, as_words
from daemon.replay.tape_file import COMMANDS, ORDER, RECEIVED, TapeRecorder, loops
from hal.joint import JointCommand
from handrail.messages import LogLine
from handrail.recorder import Recording
from handrail.robot import library as robots
from handrail.robot.keepsake import keepsake, restore
from handrail.runtime import Runtime

JOINT = "arm_right_1_joint"
CYCLES = 60
_APP = Typer()
_APP.command()(replay)


def run_replay(*words: object) -> Result:
    return CliRunner().invoke(_APP, [str(word) for word in words])


@pytest.fixture
def moved(talos: Any, make_bench: Callable[..., Any]) -> Any:
    """A taped loop that has moved a joint, and has ended."""
    bench = make_bench(talos, tape=True)
    bench.enable()
    bench.start(bench.move(JOINT, 0.2, 0.2))
    bench.run(CYCLES - bench.loop.cycles)
    return bench


def write(file: Path, *benches: Any) -> Path:
    """Record what is on their tapes into one file, one loop after the other."""
    with file.open("wb") as stream:
        recording = Recording(stream, time.time_ns())
        for bench in benches:
            TapeRecorder(bench.runtime)(recording)
            recording.take(LogLine(source="test", level="info", text="others talk, too"))
        recording.finish()
    return file


@pytest.fixture
def file(moved: Any, tmp_path: Path) -> Path:
    moved.loop.close()
    return write(tmp_path / "run.mcap", moved)


def test_a_recording_is_replayed_from_its_file_alone(file: Path) -> None:
    told = run_replay(file)
    assert told.exit_code == 0, told.output
    assert "talos_upper, lockstep clock" in told.stdout
    assert f"{CYCLES} cycles (0.1 s) compared: every command is the same, bit for bit" in told.stdout
    assert "incomplete" not in told.stdout
    assert "12 cycles" in run_replay(file, "--cycles", 12).stdout


def test_the_first_command_that_is_another_one_is_told_with_both_values(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    update = JointTrajectory.update

    def stiffer(self: Any, robot: Any, out: Any) -> None:
        update(self, robot, out)
        out.stiffness[self.joints] += 1e-9

    monkeypatch.setattr(JointTrajectory, "update", stiffer)
    told = run_replay(file)
    assert told.exit_code == 1, told.output
    where = rf"cycle (\d+), [\d.]+ s of the robot's clock: {JOINT}: (\w+)"
    found = re.search(rf"{where}\n +recorded +(\S+)\n +replayed +(\S+)", told.stdout)
    assert found, told.stdout
    assert float(found[3]) != float(found[4]) == pytest.approx(float(found[3]), abs=1e-6)
    assert f"{int(found[1]) - 1} cycles" in told.stdout
    assert "last digits" not in told.stdout, "it is the same machine"
    monkeypatch.setattr(recorded_loop, "made_with", lambda: {"numpy": "0.1"})
    elsewhere = run_replay(file)
    assert f"numpy: {np.__version__} recorded, 0.1 here: last digits may come from that" in elsewhere.stdout


def test_each_loop_of_a_file_is_replayed_and_one_without_an_end_is_told(
    moved: Any, talos: Any, make_bench: Callable[..., Any], tmp_path: Path
) -> None:
    other = make_bench(talos, tape=True)
    other.run(5)
    other.loop.close()
    told = run_replay(write(tmp_path / "two.mcap", moved, other))
    assert told.exit_code == 0, told.output
    first, second = told.stdout.split("loop 2 of the recording")
    assert "incomplete, the loop went on after that: the recording was ended" in first
    assert "5 cycles" in second and "incomplete" not in second


def test_a_loop_that_was_started_anew_follows_in_the_file_and_nothing_of_the_one_before_is_lost(tmp_path: Path) -> None:
    runtime, file = Runtime.at(tmp_path), tmp_path / "run.mcap"
    start = recorded_loop.LoopStart(robot="r", clock="wall", joints=["a"], files={})

    def begin() -> TapeWriter:
        tape = TapeWriter(runtime.tape, 1 << 12)
        tape.put(Taped.START, (), as_words(msgspec.json.encode(start)))
        return tape

    def run(tape: TapeWriter, cycles: int) -> None:
        for tape.cycle in range(1, cycles + 1):
            tape.put(Taped.COMMAND, (2 * tape.cycle, 0), JointCommand(1).memory)

    with file.open("wb") as stream:
        recording, recorder = Recording(stream, time.time_ns()), TapeRecorder(runtime)
        recorder(recording)
        first = begin()
        recorder(recording)
        run(first, 3)
        run(begin(), 2)
        recorder(recording)
        recording.finish()
    told = [[entry.cycle for entry in loop.entries()] for loop in loops(file)]
    assert told == [[1, 2, 3], [1, 2]]


def test_a_tape_that_broke_off_is_replayed_up_to_there_and_says_so(moved: Any, tmp_path: Path) -> None:
    moved.loop._tape.put(Taped.SENT, (), np.zeros(1 << 24, np.uint64))  # more than there is room for
    moved.run(20)
    told = run_replay(write(tmp_path / "run.mcap", moved))
    assert told.exit_code == 0, told.output
    assert f"{CYCLES} cycles" in told.stdout
    assert f"its tape broke off in cycle {CYCLES}" in told.stdout


def test_a_file_that_was_cut_is_replayed_as_far_as_it_goes(file: Path) -> None:
    whole = file.read_bytes()
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    file.write_bytes(whole[: summary.chunk_indexes[-1].chunk_start_offset + summary.chunk_indexes[-1].chunk_length])
    told = run_replay(file)
    assert told.exit_code == 0, told.output
    assert f"{CYCLES} cycles" in told.stdout and "the file breaks off" in told.stdout


def test_what_is_wrong_with_a_file_is_named(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(file: Path, *words: str) -> str:
        told = run_replay(file, *words)
        assert told.exit_code == 2, told.output
        assert str(file) in told.stderr or words
        return told.stderr

    assert "No such file" in refused(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text("no recording")
    assert "no MCAP file" in refused(tmp_path / "text.mcap")
    assert "no loop was recorded" in refused(write(tmp_path / "silent.mcap"))
    damaged = bytearray(file.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    assert "damaged" in refused(tmp_path / "damaged.mcap")
    assert "has the joints shoulder_joint" in refused(file, "--robot", "sea_bench")
    monkeypatch.setitem(tape_file._DEFINITIONS, ORDER, tape_file._DEFINITIONS[ORDER] + "uint8 more\n")
    assert "a version of Handrail whose /loop/order has other fields" in refused(file)


def test_a_recording_that_begins_late_is_refused(moved: Any, tmp_path: Path) -> None:
    """Another recorder has taken the tape's beginning away."""
    write(tmp_path / "first.mcap", moved)
    moved.run(5)
    told = run_replay(write(tmp_path / "second.mcap", moved))
    assert told.exit_code == 2
    assert "begins after the loop's start" in told.stderr


def test_messages_of_the_tape_can_be_read_by_their_schemas_alone(file: Path, moved: Any) -> None:
    with file.open("rb") as stream:
        found = [(s.encoding, s.data.decode(), c, m.data) for s, c, m in make_reader(stream).iter_messages() if s]
    told = {
        topic: [
            read_ros1(text, data) for encoding, text, c, data in found if c.topic == topic and encoding == "ros1msg"
        ]
        for topic in (COMMANDS, RECEIVED, ORDER)
    }
    assert [message["cycle"] for message in told[COMMANDS]] == list(range(1, CYCLES + 1))
    last = told[COMMANDS][-1]
    assert last["position"] == moved.loop.written.position.tolist()
    assert last["mode"] == moved.loop.written.mode.tolist()
    frames = told[RECEIVED][-1]["frames"]
    assert {frame["length"] for frame in frames} and all(len(frame["data"]) == 64 for frame in frames)
    start = told[ORDER][-1]
    assert len(start["payload"]) == start["command"]["payload_length"] > 0
    assert start["command"]["joints"][0] == moved.index(JOINT)


def read_ros1(definition: str, data: bytes) -> dict[str, Any]:
    """A ROS 1 message, read by what its definition says and nothing else (https://wiki.ros.org/msg)."""
    main, *others = re.split(r"=+\nMSG: ", definition)
    kinds = {None: main} | {text.split("\n", 1)[0]: text.split("\n", 1)[1] for text in others}
    numbers = {f"uint{8 * size}": f"<u{size}" for size in (1, 2, 4, 8)} | {"float32": "<f4", "float64": "<f8"}
    numbers |= {f"int{8 * size}": f"<i{size}" for size in (1, 2, 4, 8)}
    at = 0

    def one(kind: str) -> Any:
        nonlocal at
        if kind not in numbers:
            return message(kind)
        value = np.frombuffer(data, numbers[kind], 1, at)[0].item()
        at += np.dtype(numbers[kind]).itemsize
        return value

    def message(kind: str | None) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for line in kinds[kind].splitlines():
            field = re.fullmatch(r"([\w/]+)(\[(\d*)\])? (\w+)", line)
            assert field, line
            count = 1 if not field[2] else int(field[3]) if field[3] else one("uint32")
            listed = [one(field[1]) for _ in range(count)]
            values[field[4]] = listed if field[2] else listed[0]
        return values

    told = message(None)
    assert at == len(data)
    return told


@pytest.mark.parametrize("name", sorted(robots.files()))
def test_a_robot_is_kept_whole(name: str, tmp_path: Path) -> None:
    kept = robots.load(name)
    again = restore(keepsake(kept), tmp_path)
    for field in vars(kept):
        if field not in ("folder", "urdf"):
            np.testing.assert_equal(getattr(again, field), getattr(kept, field), field)
