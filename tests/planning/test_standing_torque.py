"""Torques of a robot on its feet: judged on a free base, whose six rows must come out as nothing but what the feet bear."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from engines.planning.motion_planner import MotionPlanner
from engines.planning.plan import Infeasible
from engines.planning.timing.path_torque import PathTorque
from engines.planning.timing.timing import Limits, accelerations, parametrise
from handrail.messages import JointsGoal, PlanMotion
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

SHARE = 0.9
KNEE = "leg_right_4_joint"


@pytest.fixture(scope="module")
def description():
    return robots.load("talos")


@pytest.fixture(scope="module")
def home(description):
    return description.home_position("ready")


def _planner(description, torque_limit=None) -> MotionPlanner:
    if torque_limit is not None:
        description = dataclasses.replace(description, torque_limit=torque_limit)
    limits = Limits(0.7 * description.velocity_limit, 0.5 * description.acceleration_limit)
    return MotionPlanner(description, Kinematics(description), limits, standing=True)


@pytest.fixture(scope="module")
def planner(description):
    return _planner(description)


class Free:
    """pinocchio on a free base, whose right sole is held: where its base is, and how it moves."""

    def __init__(self, description):
        self.description = description
        self.model = pin.buildModelFromUrdf(str(description.urdf), pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        self.index = np.array([self.model.joints[self.model.getJointId(j)].idx_v for j in description.joints])
        self.soles = [self.model.getFrameId(foot.link) for foot in description.feet]

    def jacobians(self, position):
        """q, and the soles' (12, nv), with the first sole at the origin."""
        q = pin.neutral(self.model)
        q[self.index + 1] = position
        pin.framesForwardKinematics(self.model, self.data, q)
        q[:7] = pin.SE3ToXYZQUAT(self.data.oMf[self.soles[0]].inverse())
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        rows = [pin.getFrameJacobian(self.model, self.data, sole, pin.LOCAL) for sole in self.soles]
        return q, np.vstack(rows)

    def torques(self, position, velocity, acceleration):
        """(n,) N·m by the Lagrangian of the free base: the base follows from the first sole, contact forces from its six rows."""
        q, jacobian = self.jacobians(position)
        first = jacobian[:6]
        v, a = np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[self.index], a[self.index] = velocity, acceleration
        v[:6] = -np.linalg.solve(first[:, :6], first @ v)
        pin.forwardKinematics(self.model, self.data, q, v, np.zeros(self.model.nv))
        drift = pin.getFrameAcceleration(self.model, self.data, self.soles[0], pin.LOCAL).vector
        a[:6] = -np.linalg.solve(first[:, :6], first @ a + drift)
        mass = pin.crba(self.model, self.data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        needed = mass @ a + pin.nonLinearEffects(self.model, self.data, q, v)
        scale = np.concatenate(
            [[1, 1, 1, foot.size[1] / 2, foot.size[0] / 2, foot.size[0] / 2] for foot in self.description.feet]
        )
        forces = scale * (np.linalg.pinv(jacobian[:, :6].T * scale) @ needed[:6])
        left = needed - jacobian.T @ forces
        assert np.abs(left[:6]).max() < 1e-6, "nobody pushes the base"
        return left[self.index], forces.reshape(-1, 6)


def test_they_are_those_of_the_free_base_with_the_least_forces_of_its_feet(planner, description, home):
    free, dynamics = Free(description), planner.dynamics
    generator = np.random.default_rng(3)
    for _ in range(5):
        q = home + generator.uniform(-0.1, 0.1, 30)
        v, a = generator.uniform(-0.5, 0.5, (2, 30))
        wanted, _ = free.torques(q, v, a)
        assert dynamics.inverse_dynamics(q[None], v[None], a[None])[0] == pytest.approx(wanted, abs=1e-6)


def test_the_check_reckons_the_same_by_momentum(planner, description, home):
    question = planner.read(
        PlanMotion(goals=[JointsGoal(positions={KNEE: 0.0})], joints=list(description.joints)), [], home
    )
    verifier, dynamics = planner.scene(question).verifier, planner.dynamics
    generator = np.random.default_rng(4)
    q = home + generator.uniform(-0.1, 0.1, 30)
    v, a = generator.uniform(-0.5, 0.5, (2, 30))
    whole, rates, changes = (planner.configuration("q", each) for each in (q, v, a))
    found = planner.positions(verifier._inverse_dynamics(whole, rates, changes, planner.feet)[0])
    assert found == pytest.approx(dynamics.inverse_dynamics(q[None], v[None], a[None])[0], abs=1e-6)


def test_both_feet_bear_half_where_the_mass_is_in_the_middle(description, home):
    _, forces = Free(description).torques(home, 0 * home, 0 * home)
    up = forces[:, 2]
    assert up.sum() == pytest.approx(9.81 * 90, rel=0.1)
    assert up == pytest.approx(up[::-1], rel=0.1)


def _crouch(planner, description, home):
    """Knots' path of a crouch: hips, knees and ankles of both legs, so that soles stay flat."""
    rows = description.index([f"leg_{side}_{n}_joint" for side in ("left", "right") for n in (3, 4, 5)])
    bend = 0.4 * np.linspace(0.0, 1.0, 30)[:, None] * np.array([-1.0, 2.0, -1.0] * 2)
    return rows, home[rows] + bend


def test_a_crouch_is_slower_where_knees_are_weaker_and_stays_within_their_torque(description, home):
    strong = _planner(description)
    rows, path = _crouch(strong, description, home)
    free, limit = Free(description), description.torque_limit.copy()
    speed = Limits(description.velocity_limit[rows], 4.0 * description.velocity_limit[rows])
    fast = parametrise(path, speed, 0.0)

    def most(knots):
        first = accelerations(knots)[: len(knots.times) - 1]
        found = []
        for k, bend in enumerate(first):
            whole, v, a = home.copy(), 0 * home, 0 * home
            whole[rows], v[rows], a[rows] = knots.positions[k], knots.velocities[k], bend
            found.append(free.torques(whole, v, a)[0])
        return np.abs(found).max(axis=0)

    knees = description.index(["leg_left_4_joint", "leg_right_4_joint"])
    held = np.abs([strong.dynamics.gravity(_at(home, rows, q)) for q in path]).max(axis=0)
    limit[knees] = 1.25 * held[knees] / SHARE
    weak = _planner(description, limit)
    torque = PathTorque(weak.dynamics, rows, home, SHARE)
    slow = parametrise(path, dataclasses.replace(speed, torque=torque), 0.0)
    assert (most(fast)[knees] > 1.05 * SHARE * limit[knees]).any(), "velocity and acceleration alone ask for too much"
    assert (most(slow) <= 1.005 * SHARE * limit).all()
    assert slow.times[-1] > fast.times[-1]


def _at(home, rows, q):
    whole = home.copy()
    whole[rows] = q
    return whole


def test_a_leg_that_cannot_carry_the_robot_is_named(description, home):
    limit = description.torque_limit.copy()
    limit[description.index(KNEE)] = 5.0
    weak = _planner(description, limit)
    rows, path = _crouch(weak, description, home)
    speed = Limits(description.velocity_limit[rows], 4.0 * description.velocity_limit[rows])
    torque = PathTorque(weak.dynamics, rows, home, SHARE)
    with pytest.raises(Infeasible, match=f"down: torque of {KNEE} against weight and friction"):
        parametrise(path, dataclasses.replace(speed, torque=torque), 0.0, where="down")
