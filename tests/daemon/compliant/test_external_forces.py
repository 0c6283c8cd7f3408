"""What the robot feels, against what the plant knows: by its wrist's sensor, and by its joints alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from daemon.state import observer
from daemon.warm_up import warm_up
from handrail.messages import ContactEnd
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.daemon.compliant.conftest import TIP

NEVER = (ContactEnd(frame=TIP, threshold=900.0),)


@pytest.mark.parametrize(("by", "free", "pushed"), [("sensor", 1.0, 0.5), ("joints", 2.0, 1.0)])
def test_an_arm_that_moves_freely_feels_nothing_and_a_push_what_it_is(in_plant, talos, by: str, free, pushed) -> None:
    """N: while the elbow turns by 0.8 rad/s, and at rest under 12 N."""
    robot = in_plant(description=talos if by == "sensor" else dataclasses.replace(talos, devices=()))
    felt = []
    robot.start(robot.move("arm_right_4_joint", 0.25, 0.6), NEVER)
    robot.run_to_end(each=lambda: felt.append(robot.loop.robot.wrenches.get(TIP, np.zeros(6))[:3].copy()))
    assert np.abs(robot.world.velocity).max() < 0.1
    assert np.linalg.norm(felt[20:], axis=1).max() < free
    robot.start(robot.move("head_1_joint", 0.01, 3.0), NEVER)
    robot.start(robot.move("arm_right_4_joint", 0.01, 3.0), NEVER)
    robot.push((10.0, -6.0, 3.0))
    robot.run(300)
    assert robot.loop.robot.wrenches[TIP][:3] == pytest.approx([10.0, -6.0, 3.0], abs=pushed)
    assert np.abs(robot.loop.robot.wrenches[TIP][3:]).max() < 0.4, "N·m: it is a force at the tip, and no moment"
    robot.push((0.0, 0.0, 0.0))


def test_what_feels_is_compiled_before_the_loop_starts(monkeypatch, talos) -> None:
    called = []
    kernels = [(observer.kernels, name) for name in ("observe", "feel_beyond")] + [(observer, "_least_squares")]
    for module, name in kernels:
        monkeypatch.setattr(module, name, lambda *_, name=name: called.append(name))
    warm_up(Kinematics(talos))
    assert set(called) == {name for _, name in kernels}


def test_a_sensor_that_falls_silent_leaves_it_to_the_joints(in_plant) -> None:
    robot = in_plant()
    robot.start(robot.move("arm_right_4_joint", 0.01, 3.0), NEVER)
    robot.push((0.0, 0.0, 12.0))
    robot.run(200)
    row = next(row for row, device in enumerate(robot.description.devices) if device.name == "wrist_right_ft")
    ages = robot.hardware.devices.age
    values = robot.hardware.devices.values

    def silence() -> None:
        ages[row], values[row] = 1000, 500.0

    robot.run(100, silence)
    silence()
    for _ in range(60):
        robot.loop.robot.estimate_forces((TIP,))
    assert robot.loop.robot.wrenches[TIP][:3] == pytest.approx([0.0, 0.0, 12.0], abs=1.5)


def test_a_sensor_does_not_feel_its_grippers_weight_in_any_posture(in_plant) -> None:
    robot = in_plant(description=robots.load("talos_upper_grippers"))
    frame = robot.description.arms["right"].tip
    robot.start(robot.move("arm_right_7_joint", 0.6, 0.8), (ContactEnd(frame=frame, threshold=900.0),))
    for _ in range(2):
        robot.run(190)
        assert np.linalg.norm(robot.loop.robot.wrenches[frame][:3]) < 1.5
