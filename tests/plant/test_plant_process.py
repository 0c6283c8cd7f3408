"""The plant as a process: one line when it is ready, lock-step, free run, wall clock, a clean end."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hal.can import frames
from hal.can.port import HubPort
from hal.drives.lifecycle import CONTROLWORD, Command, State, decode_statusword
from hal.drives.protocol import LimbProtocol
from hal.joint import JointState
from handrail.messages import GroundTruth
from handrail.runtime import Runtime
from handrail.topics import Subscriber

PERIOD_NS = 2_000_000
PLANT = (sys.executable, "-m", "hal.plant.world")


class PlantProcess:
    """A plant and a host on its bus."""

    def __init__(self, robot, clock: str, folder: Path, *options: str):
        self.runtime = Runtime.at(folder)
        what = ["--robot", "talos_upper", "--scene", "valve", "--clock", clock, "--runtime", str(folder), *options]
        self.process = subprocess.Popen([*PLANT, *what], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "plant ready\n"
        self.truth = Subscriber(self.runtime.endpoint("plant.truth"), GroundTruth)
        self.port = HubPort(self.runtime.bus, name="daemon", ticks=True)
        self.protocol = LimbProtocol(robot)
        self.state = JointState(len(robot.joints))
        self.cycle = 0
        self._out = frames.empty(self.protocol.frames_a_cycle)

    def send_cycle(self, command: Command = Command.DISABLE_VOLTAGE) -> None:
        words = np.full(len(self.state), CONTROLWORD[command], np.uint8)
        count = self.protocol.encode_control(words, self.cycle, self._out)
        count += self.protocol.encode_sync(self.cycle, self._out[count:])
        self.port.send(self._out[:count])
        self.cycle += 1

    def send_hold(self) -> None:
        self.port.send(self._out[: self.protocol.encode_hold_time(self.cycle, self._out)])

    def receive(self, timeout_s: float = 30.0) -> int:
        """Wait until every drive has answered the last cycle; returns the answers' time stamp of the robot's clock."""
        self.state.age += 1
        stamp = 0
        deadline = time.monotonic() + timeout_s
        while self.state.age.max() > 0:
            records = self.port.receive(max(0.0, deadline - time.monotonic()))
            # The end of the cycle before may come by itself.
            assert len(records) or time.monotonic() < deadline, "drives did not answer"
            stamp = max(stamp, int(records["time_ns"].max(initial=0)))
            self.protocol.decode_status(records, len(records), self.state)
        return stamp

    def silent(self) -> list[int]:
        """Send a cycle and wait until the plant says that it is over; rows of the drives that did not answer it."""
        over = self.port.ticks
        self.send_cycle()
        self.state.age += 1
        while self.port.ticks == over:
            records = self.port.receive(30.0)
            assert len(records) or self.port.ticks > over
            self.protocol.decode_status(records, len(records), self.state)
        return np.flatnonzero(self.state.age > 0).tolist()

    def close(self) -> int:
        self.port.close()
        self.truth.close()
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(30)


@contextlib.contextmanager
def _plant(robot, clock: str, *options: str) -> Iterator[PlantProcess]:
    with tempfile.TemporaryDirectory(prefix="hr") as folder:
        plant = PlantProcess(robot, clock, Path(folder), *options)
        try:
            yield plant
        finally:
            if plant.process.poll() is None:
                plant.process.kill()
                plant.process.wait()


def test_in_lock_step_time_goes_on_by_one_period_a_sync_and_runs_free_when_the_host_falls_silent(robot):
    with _plant(robot, "lockstep") as plant:
        time.sleep(0.8)  # longer than the silence that lets a plant run free: not before a host was there
        stamps = []
        for _ in range(40):
            plant.send_cycle()
            stamps.append(plant.receive())
        # A frame ends on its bus a little after the step that it tells of.
        steps = np.array(stamps) // PERIOD_NS
        np.testing.assert_array_equal(steps, np.arange(1, 41))
        assert (decode_statusword(plant.state.status) == State.SWITCH_ON_DISABLED).all()
        truth = plant.truth.receive(30.0)
        assert truth.time_ns % 20_000_000 == 0
        for _ in range(40):  # held for 0.8 s: time stands
            plant.send_hold()
            time.sleep(0.02)
        plant.send_cycle()
        assert plant.receive() // PERIOD_NS == 41
        for last in plant.truth.drain():
            truth = last
        after = plant.truth.receive(30.0)  # nobody speaks: within 0.5 s it runs free, and tells
        assert after.time_ns > truth.time_ns
        plant.send_cycle()
        restarted = plant.receive() // PERIOD_NS
        plant.send_cycle()
        assert plant.receive() // PERIOD_NS == restarted + 1
        assert plant.close() == 0
        assert plant.process.stdout.read() == ""  # one line, and nothing else


def test_under_the_wall_clock_time_goes_on_by_itself_and_drives_answer(robot):
    with _plant(robot, "wall") as plant:
        first = plant.truth.receive(30.0)
        second = plant.truth.receive(30.0)
        assert second.time_ns - first.time_ns == 20_000_000
        plant.send_cycle(Command.SHUTDOWN)
        plant.receive()
        assert (decode_statusword(plant.state.status) == State.READY_TO_SWITCH_ON).all()
        assert plant.close() == 0


def test_a_cut_cable_silences_its_drive_for_as_long_and_lost_commands_all_of_them_while_time_goes_on(robot, tmp_path):
    drive = robot.joints.index("arm_left_3_joint")
    file = tmp_path / "faults.yaml"
    file.write_text(
        "faults:\n"
        "- {kind: cut, node: arm_left_3_joint, after: 0.02, duration: 0.02}\n"
        "- {kind: drop, node: daemon, after: 0.06, duration: 0.01}\n"
    )
    with _plant(robot, "lockstep", "--bus-timing", "--faults", str(file)) as plant:
        silent = [plant.silent() for _ in range(50)]
        assert plant.close() == 0
    everybody = list(range(len(robot.joints)))
    # A fault of 20 ms is ten cycles of 2 ms; the first of them is asked before it begins and answered after. What the drive had
    # left to send comes in the cycle after the last: an answer to an old command, which is none.
    assert [cycle for cycle, rows in enumerate(silent) if rows == [drive]] == list(range(9, 20))
    assert [cycle for cycle, rows in enumerate(silent) if rows == everybody] == list(range(30, 35))
    assert sum(map(bool, silent)) == 16


@pytest.mark.parametrize(
    ("robot_name", "text", "expected"),
    [
        ("talos_upper", "objects:\n  valve: {kind: wheel, radius: 0.15}\n", ":2: objects.valve.pose_in_world: "),
        ("talos_lower", "objects: {}\n", "no such robot; expected one of"),
    ],
)
def test_a_bad_robot_or_scene_ends_it_with_one_plain_line(tmp_path, robot_name, text, expected):
    file = tmp_path / "scene.yaml"
    file.write_text(text)
    what = ["--robot", robot_name, "--scene", str(file), "--clock", "lockstep", "--runtime", str(tmp_path)]
    run = subprocess.run([*PLANT, *what], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode != 0
    assert run.stdout == ""
    assert expected in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
