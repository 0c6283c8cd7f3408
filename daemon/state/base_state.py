"""What is known of a robot's base and feet in one cycle, as the loop holds it and the snapshot tells it."""

from __future__ import annotations

import enum

import numpy as np


class BaseSource(enum.IntEnum):
    """What tells where the base is. The lower-case name is messages.Base.source."""

    FIXED = 0
    """nothing has to: the base is bolted to the world"""
    FEET = 1
    """feet that hold, with the inertial sensor"""
    STILL = 2
    """no foot holds; the inertial sensor says that the robot hangs still"""
    INERTIAL = 3
    """no foot holds, the robot moves: the inertial sensor alone, and errors grow with time squared"""
    NONE = 4
    """nothing: what is told is the last that was known (see Trouble)"""


class Trouble(enum.IntEnum):
    """Why there is no estimate."""

    NONE = 0
    NO_SENSORS = 1
    """the robot has no inertial sensor, or no feet are described"""
    IMU_SILENT = 2
    IMU_NOT_FINITE = 3
    JOINT_SILENT = 4
    """one between base and inertial sensor"""
    JOINT_NOT_FINITE = 5
    NOT_AT_REST = 6
    """an estimate begins where the inertial sensor feels gravity alone"""
    LOST = 7
    """nothing but the inertial sensor for so long that the position is anyone's guess: it begins anew"""


class BaseState:
    """What is known of the base and of `n` feet. Arrays are views of `memory`: never rebind them."""

    def __init__(self, n: int = 0):
        self.memory = np.zeros(18 + 4 * n, np.int64)
        values = self.memory[: 15 + 3 * n].view(np.float64)
        self.pose = values[:7]
        """position m, unit quaternion x y z w: of the base's frame in the world"""
        self.twist = values[7:13]
        """velocity m/s of the base's origin, angular velocity rad/s, both in the base's own axes (as pinocchio's)"""
        self.sigma = values[13:15]
        """standard deviations of the position m and the orientation rad, of all three axes together"""
        self.force = values[15:].reshape(n, 3)
        """N, world axes, that presses on each foot"""
        codes = self.memory[15 + 3 * n :]
        self.since_ns, self.source, self.trouble = codes[:1], codes[1:2], codes[2:3]
        """(1,): robot's clock, since when source and trouble are as they are; BaseSource; Trouble"""
        self.contact = codes[3:]
        """(n,) 1: the foot holds"""
        self.pose[6] = 1.0


PROBLEMS = {
    Trouble.NONE: "",
    Trouble.NO_SENSORS: "the robot has no inertial sensor, or robot.yaml describes no feet",
    Trouble.IMU_SILENT: "the inertial sensor does not answer",
    Trouble.IMU_NOT_FINITE: "the inertial sensor measures no finite numbers",
    Trouble.JOINT_SILENT: "a joint between base and inertial sensor is not measured",
    Trouble.JOINT_NOT_FINITE: "a joint between base and inertial sensor has no finite position",
    Trouble.NOT_AT_REST: "it begins where the robot is at rest: the inertial sensor feels more than gravity",
    Trouble.LOST: "nothing but the inertial sensor told of it for too long",
}
"""for people"""
