"""A frame along its own chain against pinocchio's passes over the whole robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.state.carried import CarriedFrame
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand, JointState
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.daemon.wbc.test_dynamics import branched

ROBOTS = ("talos_upper_grippers", "panda", "branched")


@pytest.mark.parametrize("robot", ROBOTS)
def test_where_a_frame_is_and_is_told_to_be_is_what_pinocchio_says(robot: str) -> None:
    model, rows, frames = _robot(robot)
    rng, n, data = np.random.default_rng(7), len(rows), model.createData()
    command, state = JointCommand(n), JointState(n)
    for number in frames:
        carried = CarriedFrame(model, rows, number)
        for _ in range(3):
            command.table[:2], state.table[:2] = rng.normal(0.0, 1.0, (2, 2, n))
            carried.follow(command.table, state.table)
            aim, velocity, _ = _pinocchio(model, data, rows, number, command.position, command.velocity)
            here, _, jacobian = _pinocchio(model, data, rows, number, state.position, state.velocity)
            assert carried.translation == pytest.approx(here, abs=1e-13)
            assert carried.lag == pytest.approx(aim - here, abs=1e-13)
            assert carried.velocity == pytest.approx(velocity, abs=1e-12)

            tangent, torque = np.zeros(3), rng.normal(0.0, 1.0, n)
            claimed = rng.random(n) > 0.3
            force = carried.pull(tangent, 3.0, 2.0, 100.0, claimed, torque)
            assert tangent == pytest.approx(velocity / np.linalg.norm(velocity), abs=1e-10)
            assert force == pytest.approx(max(3.0 + 2.0 * tangent @ (aim - here), 0.0), abs=1e-10)
            assert torque == pytest.approx(claimed * (force * tangent @ jacobian), abs=1e-11)


def test_a_cycle_looks_at_a_frame_once_and_the_next_one_looks_again() -> None:
    kinematics = Kinematics(robots.load("talos_upper"))
    n = len(kinematics.description.joints)
    state, command = JointState(n), JointCommand(n)
    robot = RobotState(kinematics, state, 0.002)
    robot.update(command)
    first = robot.carried("tool_right_tip").translation.copy()
    state.position[:] = 0.1
    assert (robot.carried("tool_right_tip").translation == first).all()
    robot.update(command)
    assert robot.carried("tool_right_tip").translation == pytest.approx(robot.frame("tool_right_tip").translation)
    assert robot.lag("tool_right_tip") == pytest.approx(first - robot.frame("tool_right_tip").translation)


def _robot(name: str) -> tuple[pin.Model, np.ndarray, list[int]]:
    if name == "branched":  # with a joint that slides
        model = branched(free=False)
        return model, np.arange(model.nv), list(range(1, model.nframes))
    kinematics = Kinematics(robots.load(name))
    return (
        kinematics.model,
        kinematics.index_v,
        [kinematics.frame_id(arm.tip) for arm in kinematics.description.arms.values()],
    )


def _pinocchio(model, data, rows, frame, position, velocity):  # type: ignore[no-untyped-def]
    """Where it is, how fast, and its linear Jacobian (3, n)."""
    q, v = np.zeros(model.nq), np.zeros(model.nv)
    q[rows], v[rows] = position, velocity
    pin.forwardKinematics(model, data, q, v)
    place = pin.updateFramePlacement(model, data, frame).translation.copy()
    jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3, rows]
    return place, pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear.copy(), jacobian
