"""Time along a path under torque limits, judged by mass matrix and nonlinear effects, which planning does not use."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from engines.planning.plan import Infeasible
from engines.planning.timing.path_torque import PathTorque
from engines.planning.timing.timing import Knots, Limits, accelerations, jerks, parametrise
from handrail.robot.description import Actuator
from handrail.robot.kinematics import Kinematics

SHARE = 0.9


@pytest.fixture(scope="module")
def home(description):
    return description.home_position("ready")


@pytest.fixture(scope="module")
def rows(description):
    return description.index(description.arms["right"].joints)


@pytest.fixture(scope="module")
def path(home, rows):
    """The arm is lifted, stretched and turned, and the torso with it."""
    shift = np.array([0.3, 0.1, -0.6, -0.3, 0.4, 1.2, 0.5, -0.4, 0.3])
    share = np.linspace(0.0, 1.0, 30)[:, None]
    return home[rows] + share * shift + 0.1 * np.sin(3.0 * share)


@pytest.fixture(scope="module")
def weak(description, kinematics, home, rows, path):
    """The same robot with motors that carry its arm, and accelerate it a little."""
    carried = np.abs([kinematics.gravity(_whole(home, rows, q)) for q in path]).max(axis=0)
    limit = np.minimum(1.2 * carried + 0.8, description.torque_limit)
    return Kinematics(dataclasses.replace(description, torque_limit=limit))


def _whole(home, rows, q):
    whole = home.copy()
    whole[rows] = q
    return whole


def needed(kinematics, home, rows, knots: Knots):
    """(k, n) N·m at ten places between any two knots: M q̈ + C q̇ + g."""
    model, index = kinematics.model, kinematics.index_v
    data, found = model.createData(), []
    second = accelerations(knots)
    pieces = len(knots.times) - 1
    for k in range(pieces):
        h = knots.times[k + 1] - knots.times[k]
        for u in np.linspace(0.0, 1.0, 10):
            a = (1.0 - u) * second[k] + u * second[pieces + k]
            v = knots.velocities[k] + h * (u * second[k] + 0.5 * u * u * (second[pieces + k] - second[k]))
            q = knots.positions[k] + h * u * knots.velocities[k]
            q += h * h * (0.5 * u * u * second[k] + u**3 / 6.0 * (second[pieces + k] - second[k]))
            full = [np.zeros(model.nv) for _ in range(3)]
            full[0][:] = kinematics.configuration(_whole(home, rows, q))
            full[1][index[rows]], full[2][index[rows]] = v, a
            mass = pin.crba(model, data, full[0])
            mass = np.triu(mass) + np.triu(mass, 1).T
            found.append((mass @ full[2] + pin.nonLinearEffects(model, data, full[0], full[1]))[index])
    return np.array(found)


@pytest.fixture(scope="module")
def limits(description, rows):
    velocity = description.velocity_limit[rows]
    return Limits(velocity, 4.0 * velocity, 60.0 * velocity)


def test_torques_stay_within_their_share_and_are_used(weak, home, rows, path, limits):
    free = parametrise(path, limits, 0.0)
    torque = PathTorque(weak, rows, home, SHARE)
    knots = parametrise(path, dataclasses.replace(limits, torque=torque), 0.0)
    allowed = SHARE * weak.description.torque_limit
    assert (np.abs(needed(weak, home, rows, free)) / allowed).max() > 1.3, (
        "velocity and acceleration alone ask for too much"
    )
    used = np.abs(needed(weak, home, rows, knots)) / allowed
    assert 0.85 < used.max() <= 1.005
    assert knots.times[-1] > free.times[-1]


def test_acceleration_is_continuous_and_jerk_is_limited(rows, path, limits):
    knots = parametrise(path, limits, 0.0)
    pieces = len(knots.times) - 1
    first, last = accelerations(knots)[:pieces], accelerations(knots)[pieces:]
    assert last[:-1] == pytest.approx(first[1:], abs=1e-6)
    assert (np.abs(jerks(knots)) <= limits.jerk * 1.0001).all()


def test_known_friction_takes_its_part(weak, home, rows, path, limits):
    actuators = tuple(Actuator(friction=0.5) for _ in weak.description.actuators)
    rough = Kinematics(dataclasses.replace(weak.description, actuators=actuators))
    times = [
        parametrise(path, dataclasses.replace(limits, torque=PathTorque(robot, rows, home, SHARE)), 0.0).times[-1]
        for robot in (weak, rough)
    ]
    assert times[1] > 1.02 * times[0]
    velocity = np.where(np.arange(len(rows)) % 2, 0.3, -0.3)
    wholes = [
        PathTorque(robot, rows, home, SHARE).whole(path[:1], velocity[None], 0 * path[:1]) for robot in (weak, rough)
    ]
    assert wholes[1] - wholes[0] == pytest.approx(0.5 * np.sign(velocity)[None]), "plans tell it among their torques"


def test_a_joint_that_cannot_carry_its_load_is_named(weak, home, rows, path, limits):
    torque_limit = weak.description.torque_limit.copy()
    row = weak.description.index("arm_right_2_joint")
    torque_limit[row] = 3.0
    feeble = Kinematics(dataclasses.replace(weak.description, torque_limit=torque_limit))
    with pytest.raises(
        Infeasible, match=r"lift: torque of arm_right_2_joint against weight and friction missed by .* N·m"
    ):
        parametrise(path, dataclasses.replace(limits, torque=PathTorque(feeble, rows, home, SHARE)), 0.0, where="lift")
