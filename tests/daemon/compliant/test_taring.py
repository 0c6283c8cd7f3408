"""A force-torque sensor that is far off forgets its offset, but only where the robot can know that it is one."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pytest

from daemon.exchange import Answer, Kind, Outcome
from daemon.replay.player import Replay
from daemon.replay.recorded_loop import cycles
from daemon.replay.tape import TapeReader, TapeWriter
from daemon.state.taring import LISTEN, SETTLE
from handrail.messages import ContactEnd
from handrail.robot.description import RobotDescription, SensorNoise
from tests.daemon.compliant.conftest import TIP, InPlant

NEVER = (ContactEnd(frame=TIP, threshold=900.0),)
OFF = SensorNoise(force=0.003, force_bias=4.0, torque=2e-5, torque_bias=0.1)


@pytest.fixture(scope="module")
def misled(talos: RobotDescription) -> RobotDescription:
    """TALOS, whose wrists' sensors are some N off."""
    worn = (dataclasses.replace(one, noise=OFF) if one.family == "force_torque" else one for one in talos.devices)
    return dataclasses.replace(talos, devices=tuple(worn))


def sensor(robot: InPlant) -> int:
    return next(row for row, device in enumerate(robot.description.devices) if device.name == "wrist_right_ft")


def tare(robot: InPlant, cycles: int = SETTLE + LISTEN + 5) -> tuple[Answer, int, float]:
    """What is answered in the end."""
    for _ in range(cycles):
        robot.post_device(sensor(robot), (), Kind.TARE)
        told = robot.run()
        if told["answer"] != Answer.TARING:
            return Answer(int(told["answer"])), int(told["answer_joint"]), float(told["answer_value"])
    raise AssertionError("it goes on for too long")


def felt(robot: InPlant) -> float:
    """N at the tip, while a motion turns the hand, in which the tool's weight comes from another side."""
    robot.start(robot.move("arm_right_6_joint", 0.4, 0.6), NEVER)
    forces = []
    robot.run_to_end(each=lambda: forces.append(robot.loop.robot.wrenches.get(TIP, np.zeros(6))[:3].copy()))
    return float(np.linalg.norm(forces[-50:], axis=1).max())


def test_a_tared_sensor_feels_nothing_where_nothing_is_in_any_posture_and_a_push_as_it_is(in_plant, misled) -> None:
    robot = in_plant(description=misled)
    told, _, offset = tare(robot)
    assert told is Answer.ACCEPTED
    assert offset > 2.0, "N: it was off"
    assert felt(robot) < 0.5
    robot.run(100)
    robot.start(robot.move("arm_right_4_joint", 0.01, 3.0), NEVER)
    robot.push((10.0, -6.0, 3.0))
    robot.run(300)
    assert robot.loop.robot.wrenches[TIP][:3] == pytest.approx([10.0, -6.0, 3.0], abs=0.5)
    robot.push((0.0, 0.0, 0.0))


def test_a_sensor_is_not_tared_while_the_robot_moves_is_touched_or_is_not_enabled_nor_one_that_is_silent(
    in_plant, misled
) -> None:
    robot = in_plant(description=misled)
    robot.start(robot.move("head_1_joint", 0.4, 0.5), NEVER)
    robot.run(60)
    told, joint, speed = tare(robot)
    assert (told, joint) == (Answer.MOVING, robot.index("head_1_joint"))
    assert speed > 0.05
    robot.run_to_end()
    robot.run(100)
    robot.push((0.0, 0.0, 12.0))
    robot.run(300)  # until it stands again
    told, row, force = tare(robot)
    assert (told, row) == (Answer.TOUCHED, sensor(robot))
    assert force == pytest.approx(12.0, abs=3.0)
    robot.push((0.0, 0.0, 0.0))
    robot.run(300)
    devices = robot.hardware.devices
    robot.post_device(sensor(robot), (), Kind.TARE)
    for _ in range(40):
        robot.run()
        devices.age[sensor(robot)] = 1000
        robot.loop.taring.update(enabled=True)
    assert tare(robot)[:2] == (Answer.DEVICE_SILENT, sensor(robot))
    assert robot.ask(Kind.DISABLE) is Answer.ACCEPTED
    assert tare(robot)[0] is Answer.NOT_ENABLED
    assert not robot.loop.robot.sensors[sensor(robot)].offset.any()


def test_what_is_no_force_torque_sensor_is_not_tared_and_two_are_not_at_a_time(in_plant, misled) -> None:
    robot = in_plant(description=misled)
    robot.post_device(0, (), Kind.TARE)
    assert robot.run()["answer"] == Answer.MALFORMED
    robot.post_device(sensor(robot), (), Kind.TARE)
    assert robot.run()["answer"] == Answer.TARING
    robot.post_device(sensor(robot) + 1, (), Kind.TARE)
    assert robot.run()["answer"] == Answer.TOO_MANY


def test_a_taring_and_what_is_felt_after_it_are_replayed_bit_for_bit(misled, tmp_path) -> None:
    """An end condition reads the tared sensor: that it trips in the same cycle rests on the offset."""
    with tempfile.TemporaryDirectory(prefix="hr", dir="/dev/shm") as name:
        folder = Path(name)
        robot = InPlant(folder, misled, tape=TapeWriter(folder / "loop.tape"))
        try:
            robot.enable()
            assert tare(robot)[0] is Answer.ACCEPTED
            robot.start(robot.move("arm_right_4_joint", 0.02, 2.0), (ContactEnd(frame=TIP, threshold=6.0),))
            robot.run(20)
            robot.push((8.0, 0.0, 0.0))
            assert robot.run_to_end() is Outcome.CONDITION
            robot.run(20)
            tape = TapeReader(folder / "loop.tape")
            assert tape.attach()
            _, *taped = tape.read()
            replayed = Replay(robot.kinematics, True, tmp_path)
            try:
                found = replayed.run(list(cycles(taped)))
                offset = replayed.loop.robot.sensors[sensor(robot)].offset.copy()
            finally:
                replayed.close()
            assert found is None, found
            assert replayed.compared == robot.loop.cycles
            assert offset.any()
            assert np.array_equal(offset, robot.loop.robot.sensors[sensor(robot)].offset)
        finally:
            robot.loop.close()
