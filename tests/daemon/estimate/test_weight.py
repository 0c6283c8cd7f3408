"""The weight that joints carry against pinocchio's own."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.state.weight import Weight
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.daemon.wbc.test_dynamics import branched


@pytest.mark.parametrize("robot", ["talos_upper_grippers", "panda", "branched"])
def test_joints_carry_what_pinocchio_says_whatever_way_gravity_points(robot: str) -> None:
    if robot == "branched":
        model = branched(free=False)
        rows = np.arange(model.nv)
    else:
        kinematics = Kinematics(robots.load(robot))
        model, rows = kinematics.model, kinematics.index_v
    weight, data, torque, rng = Weight(model, rows), model.createData(), np.zeros(len(rows)), np.random.default_rng(4)
    for _ in range(5):
        model.gravity.linear = rng.normal(0.0, 6.0, 3)
        q = rng.normal(0.0, 1.0, model.nq)
        weight.carry(q, torque)
        expected = np.array(pin.computeGeneralizedGravity(model, data, q))[rows]
        assert torque == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
