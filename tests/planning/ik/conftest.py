"""What the tests of inverse kinematics share: mechanisms that are only read, their solvers, and forward kinematics by yourdfpy."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from yourdfpy import URDF

from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.solver import Solver
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

SHARE = Path(sys.prefix) / "lib" / f"python3.{sys.version_info.minor}" / "site-packages" / "cmeel.prefix" / "share"
ROBOTS = SHARE / "example-robot-data" / "robots"
TIAGO_ARM = ("torso_lift_joint", *(f"arm_right_{number}_joint" for number in range(1, 8)))
FEET = ("left_sole_link", "right_sole_link")


def pose_of(placement: pin.SE3) -> Pose:
    x, y, z = placement.translation
    a, b, c, d = pin.Quaternion(placement.rotation).coeffs()
    return Pose(position=(float(x), float(y), float(z)), orientation=(float(a), float(b), float(c), float(d)))


@pytest.fixture(scope="session")
def message():
    """pinocchio's placement → the message's pose."""
    return pose_of


@pytest.fixture(scope="session")
def placed():
    """(mechanism, q, frame) → its placement in the world, by pinocchio."""

    def placement(mechanism: Mechanism, q: np.ndarray, frame: str) -> pin.SE3:
        data = mechanism.model.createData()
        pin.framesForwardKinematics(mechanism.model, data, q)
        return pin.SE3(data.oMf[mechanism.frame_id(frame)])

    return placement


@pytest.fixture(scope="session")
def upper(mechanism: Mechanism) -> Mechanism:
    """TALOS' upper body on a fixed base, beside the whole one."""
    return mechanism


@pytest.fixture(scope="session")
def humanoid() -> Mechanism:
    """All of TALOS on a free base."""
    return Mechanism.of(Kinematics(robots.load("talos")), free_base=True)


@pytest.fixture(scope="session")
def standing(humanoid, placed) -> np.ndarray:
    """Half sitting, both soles on the ground at z = 0."""
    bent = {"leg_{}_3_joint": -0.41, "leg_{}_4_joint": 0.86, "leg_{}_5_joint": -0.45, "arm_{}_4_joint": -0.53}
    angles = {name.format(side): value for name, value in bent.items() for side in ("left", "right")}
    angles |= {"arm_left_2_joint": 0.17, "arm_right_2_joint": -0.17}
    q = humanoid.configuration(np.array([angles.get(joint, 0.0) for joint in humanoid.joints]))
    q[2] -= placed(humanoid, q, FEET[0]).translation[2]
    return q


@pytest.fixture(scope="session")
def solver(upper) -> Solver:
    return Solver(upper)


@pytest.fixture(scope="session")
def whole_body(humanoid) -> Solver:
    return Solver(humanoid)


class Arm:
    """A robot, its tool's frame, and where that is by a library that the engine does not use."""

    def __init__(self, urdf: Path, tool: str, joints: tuple[str, ...] = ()):
        self.mechanism = Mechanism.from_urdf(str(urdf), joints, packages=[str(SHARE)])
        self.solver, self.tool = Solver(self.mechanism), tool
        self._other = URDF.load(str(urdf), load_meshes=False, build_scene_graph=True)

    def tool_at(self, q: np.ndarray) -> np.ndarray:
        """(4, 4) the tool in the base, by yourdfpy."""
        self._other.update_cfg(dict(zip(self.mechanism.joints, q[self.mechanism.q_rows], strict=True)))
        return np.asarray(self._other.get_transform(self.tool, self._other.base_link))

    def random(self, generator: np.random.Generator) -> np.ndarray:
        """A configuration well within limits."""
        rows = self.mechanism.v_rows
        low, high = np.maximum(self.mechanism.lower[rows], -np.pi), np.minimum(self.mechanism.upper[rows], np.pi)
        return self.mechanism.configuration(generator.uniform(low + 0.05 * (high - low), high - 0.05 * (high - low)))


@pytest.fixture(scope="session")
def arms() -> dict[str, Arm]:
    return {
        "talos_upper": Arm(robots.load("talos_upper").urdf, "tool_right_tip"),
        "panda": Arm(ROBOTS / "panda_description" / "urdf" / "panda.urdf", "panda_link8"),
        "ur5": Arm(ROBOTS / "ur_description" / "urdf" / "ur5_robot.urdf", "tool0"),
        "tiago_pro": Arm(
            ROBOTS / "tiago_pro_description" / "robots" / "tiago_pro.urdf", "arm_right_tool_link", TIAGO_ARM
        ),
    }
