"""What the planning tests share: one planner, and wheels at seeded poses about the nominal one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from engines.planning.ik.mechanism import Mechanism
from engines.planning.plan import Plan
from engines.planning.strokes.manipulation import ManipulationPlanner
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics

NOMINAL = np.array([0.55, -0.35, 0.30])
"""m, the wheel in the world, its hinge along +x"""
SEEDS = range(20)


def _wheel_at(position: np.ndarray, rpy: np.ndarray, **changes: object) -> Instance:
    quaternion = pin.Quaternion(pin.rpy.rpyToMatrix(*rpy)).coeffs()
    pose = Pose(position=tuple(map(float, position)), orientation=tuple(map(float, quaternion)))
    return dataclasses.replace(Instance("wheel_1", catalogue.load("wheel"), pose), **changes)  # type: ignore[arg-type]


def seeded_wheel(seed: int) -> Instance:
    """Uniform within ±10 cm and ±20° (yaw, pitch; roll as well: the spokes may stand anyhow)."""
    generator = np.random.default_rng(seed)
    offset = generator.uniform(-0.10, 0.10, 3)
    return _wheel_at(NOMINAL + offset, np.deg2rad(generator.uniform(-20.0, 20.0, 3)))


def _in_world(instance: Instance) -> pin.SE3:
    x, y, z, w = instance.pose_in_world.orientation
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(instance.pose_in_world.position))


@pytest.fixture(scope="session")
def in_world():
    """instance → its placement."""
    return _in_world


@pytest.fixture(scope="session")
def wheel_at():
    """(position, rpy, **changes) → a wheel instance there."""
    return _wheel_at


@pytest.fixture(scope="session")
def nominal_wheel() -> Instance:
    """It does not change: tests share what is planned for it."""
    return _wheel_at(NOMINAL, np.zeros(3))


@pytest.fixture(scope="session")
def nominal_plan(planner: ManipulationPlanner, nominal_wheel: Instance, description: RobotDescription) -> Plan:
    """The right arm's stroke at it, from the home posture."""
    return planner.plan(nominal_wheel, "turn", "right", description.home_position("ready"))


@pytest.fixture(scope="session")
def description() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture(scope="session")
def kinematics(description: RobotDescription) -> Kinematics:
    return Kinematics(description)


@pytest.fixture(scope="session")
def mechanism(kinematics: Kinematics) -> Mechanism:
    """TALOS' upper body on a fixed base."""
    return Mechanism.of(kinematics)


@pytest.fixture(scope="session")
def ready(mechanism: Mechanism, description: RobotDescription) -> np.ndarray:
    """(nq,) of the mechanism at home."""
    home = dict(zip(description.joints, description.home_position("ready"), strict=True))
    return mechanism.configuration(np.array([home[joint] for joint in mechanism.joints]))


@pytest.fixture(scope="session")
def planner(description: RobotDescription, kinematics: Kinematics) -> ManipulationPlanner:
    return ManipulationPlanner(description, kinematics)


@pytest.fixture(scope="session")
def seeded_plans(planner: ManipulationPlanner, description: RobotDescription) -> list[tuple[Instance, Plan]]:
    """One stroke for each of the seeded wheels, from the home posture."""
    home = description.home_position("ready")
    wheels = [seeded_wheel(seed) for seed in SEEDS]
    return [(wheel, planner.plan(wheel, "turn", "right", home)) for wheel in wheels]


@pytest.fixture(scope="session")
def whole(description: RobotDescription):
    """All joints' positions (k, n) for a plan's (k, m), the others at home."""

    def positions(plan: Plan, q: np.ndarray) -> np.ndarray:
        everything = np.repeat(description.home_position("ready")[None], len(q), axis=0)
        everything[:, description.index(plan.joints)] = q
        return everything

    return positions
