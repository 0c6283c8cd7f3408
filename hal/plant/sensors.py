"""What sensors on the robot feel: an inertial measurement unit, and a force-torque sensor between two links."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import RobotBody, Vector
from hal.plant.scene import quaternion

GRAVITY = 9.81
"""m/s², along the world's −z"""

# Vectors of three, several times a cycle: PyBullet's own functions on tuples cost a tenth of numpy's.


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _inverse(orientation: Vector) -> Vector:
    x, y, z, w = orientation
    return (-x, -y, -z, w)


class Imu:
    """Orientation, angular velocity and proper acceleration (at rest +9.81 m/s² upwards, as REP 145 says), in its link's axes.

    The acceleration is the mean over the time since the measurement before, as a sampling accelerometer's filter gives it.
    """

    def __init__(self, body: RobotBody, link: str):
        self._body = body
        self._carrier, offset, turn = body.frame(link)
        self._frame = tuple(offset.tolist()), quaternion(turn)
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._acceleration: Vector = (0.0, 0.0, 0.0)
        self._time_ns = -1

    def measure(self, time_ns: int, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's imu columns."""
        centre, position, orientation, velocity, spin = self._body.link_motion(self._carrier)
        (x, y, z), here = p.multiplyTransforms(position, orientation, *self._frame)
        lever = _cross(spin, (x - centre[0], y - centre[1], z - centre[2]))
        velocity = (velocity[0] + lever[0], velocity[1] + lever[1], velocity[2] + lever[2])
        passed = (time_ns - self._time_ns) * 1e-9
        if self._time_ns >= 0 and passed > 0.0:
            vx, vy, vz = self._velocity
            self._acceleration = ((velocity[0] - vx) / passed, (velocity[1] - vy) / passed, (velocity[2] - vz) / passed)
        self._velocity, self._time_ns = velocity, time_ns
        ax, ay, az = self._acceleration
        into_sensor = _inverse(here)
        values[0:4] = here if here[3] >= 0.0 else tuple(-component for component in here)
        values[4:7] = p.rotateVector(into_sensor, spin)
        values[7:10] = p.rotateVector(into_sensor, (ax, ay, az + GRAVITY))


class ForceTorque:
    """The wrench that what is mounted on the sensor exerts on the arm, in the sensor's link's frame and axes.

    A tool that hangs from it reads its weight, downwards; nothing is tared. It is what the joint that carries the link really
    transmits, contacts included. Gyroscopic torque is left out, as PyBullet does (under 0.01 N·m at the wrist's speeds).
    """

    def __init__(self, body: RobotBody, link: str):
        carrier, at, axes = body.frame(link)
        if carrier < 0 or not (np.allclose(at, 0.0) and np.allclose(axes, np.eye(3))):
            raise ValueError(f"force-torque sensor on {link}: expected a link that a joint carries")
        self._body, self._link = body, carrier
        # PyBullet answers in the inertial frame of the link beyond the cut: what carries it exerts on it.
        centre, turn = body.inertial(carrier)
        self._centre, self._turn = tuple(centre.tolist()), quaternion(turn)
        p.enableJointForceTorqueSensor(body.number, carrier, True, physicsClientId=body.client)

    def measure(self, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's force_torque columns."""
        wrench = p.getJointState(self._body.number, self._link, physicsClientId=self._body.client)[2]
        fx, fy, fz = p.rotateVector(self._turn, wrench[:3])
        tx, ty, tz = p.rotateVector(self._turn, wrench[3:])
        mx, my, mz = _cross(self._centre, (fx, fy, fz))
        values[0:6] = -fx, -fy, -fz, -tx - mx, -ty - my, -tz - mz
