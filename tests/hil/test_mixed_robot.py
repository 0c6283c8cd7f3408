"""One robot on two buses: one emulated in its own plant, one that the daemon knows as a real interface of python-can.

The real one is UDP multicast between processes. What answers there is another plant on another hub, behind `handrail can bridge`:
its drives know nothing of the robot's daemon but frames.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import can
import pytest

from daemon.host import UsageError, check_network
from hal.hil.door import Door, Look, Seen
from hal.hil.nursery import Nursery, Process
from hal.hil.rig import PLANT_MODULE, Options, Rig
from handrail import messages as m
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime, memory_folder
from handrail.topics import RefusedError

pytestmark = pytest.mark.timeout(300)

ADDRESS, PORT = "239.74.163.7", 20_000 + os.getpid() % 20_000
NEAR, FAR = "shoulder_joint", "elbow_joint"
SILENT = "no answer on channel can1 (udp_multicast), nor from any other drive there: is the bus connected and powered?"
ROBOT = f"""
extends: sea_bench
name: %s
model: {{file: {robots.find("sea_bench").parent / "bench.urdf"}}}
network:
  channels:
    - {{name: can0, interface: handrail, bitrate: 1000000, data_bitrate: 5000000}}
    - {{name: can1, %s, bitrate: 1000000, data_bitrate: 5000000}}
  limbs:
    - {{name: near, channel: can0, joints: [{NEAR}]}}
    - {{name: far, channel: can1, joints: [{FAR}]}}
"""


def write_robot(folder: Path, name: str, far: str) -> RobotDescription:
    (folder / name).mkdir()
    (folder / name / "robot.yaml").write_text(ROBOT % (name, far))
    return robots.load(folder / name)


class Mixed(NamedTuple):
    rig: Rig
    bench: Door
    """the truth about the drive behind the real interface"""
    bridge: Process

    def elbow(self) -> Seen:
        seen = self.bench.ask(Look())
        assert isinstance(seen, Seen)
        return seen


@pytest.fixture
def mixed(tmp_path: Path, handrail_nursery: Nursery) -> Iterator[Mixed]:
    """The robot, enabled: its shoulder emulated, its elbow on the other side of a network interface."""
    try:
        can.Bus(interface="udp_multicast", channel=ADDRESS, port=PORT).shutdown()
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast here: {error}")
    robot = write_robot(tmp_path, "mixed", f"interface: udp_multicast, channel: {ADDRESS}, options: {{port: {PORT}}}")
    other = write_robot(tmp_path, "bench", "interface: handrail")
    folder = Path(tempfile.mkdtemp(prefix="hil", dir=memory_folder()))
    empty = folder / "empty.yaml"
    empty.write_text("objects: {}\n")
    with ExitStack() as ends:
        ends.callback(shutil.rmtree, folder, ignore_errors=True)
        with pytest.raises(UsageError, match=rf"no answer from {FAR} of limb far on channel can1 \(udp_multicast\)"):
            check_network(robot)
        place = ("--runtime", str(folder))
        handrail_nursery.warm([PLANT_MODULE, "hal.can.cli"])
        plant = handrail_nursery.start(
            "bench", PLANT_MODULE, ["--robot", str(other.folder), "--scene", str(empty), "--clock", "wall", *place]
        )
        ends.callback(plant.end)
        plant.wait_for("plant ready")
        to = ("--interface", "udp_multicast", "--to", ADDRESS, "--option", f"port={PORT}")
        bridge = handrail_nursery.start("bridge", "handrail.cli", ["can", "bridge", "can1", *to, *place])
        ends.callback(bridge.end)
        bridge.wait_for("bridge ready")
        check_network(robot)  # as `handrail up` does
        rig = Rig(Options(robot=str(robot.folder), clock="wall"), handrail_nursery)
        ends.callback(rig.close)
        door = Door(Runtime.at(folder))
        ends.callback(door.close)
        rig.robot.enable()
        yield Mixed(rig, door, bridge)


def moved(mixed: Mixed, joint: str, where: Callable[[], float], by: float) -> bool:
    """The joint goes there. A busy machine may hear of it too late and end a motion: then from where it is."""
    target, outcome = where() + by, "stale_state"
    for _ in range(20):
        if outcome != "stale_state":
            break
        path = m.JointTrajectory(
            joints=[joint], times=[0.0, 0.4], positions=[[where()], [target]], velocities=[[0.0], [0.0]]
        )
        outcome = mixed.rig.daemon.wait_end(mixed.rig.daemon.start(path)).outcome
    mixed.rig.plant.wait(0.1)
    return outcome == "done" and where() == pytest.approx(target, abs=0.02)


def test_a_robot_on_an_emulated_and_a_real_bus_holds_and_moves_and_a_pulled_cable_stops_its_limb(mixed: Mixed) -> None:
    robot, daemon, plant = mixed.rig.robot, mixed.rig.daemon, mixed.rig.plant
    elbow = mixed.elbow().joints.index(FAR)
    assert mixed.elbow().states[elbow] == "operation_enabled"
    assert not mixed.elbow().braked[elbow], "the drive on the bench holds by itself"
    assert moved(mixed, NEAR, lambda: robot.position(NEAR), 0.3)
    assert moved(mixed, FAR, lambda: mixed.elbow().truth.joints[FAR], 0.4)

    swing = robot.begin(NEAR, -0.3, 3.0)
    plant.wait(0.2)
    mixed.bridge.kill()
    ended = daemon.wait_end(swing)
    assert ended.outcome == "drive_fault"
    assert ended.detail == f"at {FAR}: {SILENT}"
    status = daemon.wait_status(lambda status: status.isolated, "a limb is isolated")
    assert status.isolated == ["far"]
    plant.wait_state(NEAR, "operation_enabled")
    assert {drive.joint: drive.problem for drive in status.drives} == {NEAR: "", FAR: SILENT}
    plant.wait(0.4)  # a quick stop damps for a quarter of a second, then the brakes close
    plant.assert_still()
    plant.wait_state(NEAR, "operation_enabled")  # the limb that is left holds
    there = mixed.elbow()
    assert (there.states[elbow], there.braked[elbow]) == ("quick_stop_active", True)
    with pytest.raises(RefusedError, match=rf"the drive of {FAR} does not enable: no answer on channel can1"):
        daemon.call(m.Enable())
