"""Where tool tips are, for the engine and for rehearsals on paper."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from handrail.robot.description import RobotDescription

TipPose = Callable[[np.ndarray, str], tuple[np.ndarray, np.ndarray]]
"""(n,) rad of all joints, an arm → where its tool tip is in the world: (3,) m, quaternion (4,) x y z w"""


def tip_poses(description: RobotDescription) -> TipPose:
    """Of one robot; may be asked from any thread."""
    import pinocchio as pin

    from handrail.robot.kinematics import Kinematics

    kinematics, lock = Kinematics(description), threading.Lock()

    def tip_pose(position: np.ndarray, arm: str) -> tuple[np.ndarray, np.ndarray]:
        with lock:
            pose = kinematics.frame(position, description.arms[arm].tip)
        return np.array(pose.translation), np.array(pin.Quaternion(pose.rotation).coeffs())

    return tip_pose
