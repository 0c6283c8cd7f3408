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
    transmits, contacts included, as PyBullet tells it (without gyroscopic torque: under 0.01 N·m at a wrist's speeds). Where a
    gripper hangs from it PyBullet tells wrong, since it takes the forces inside a linkage for outer ones: there it follows from
    momentum and contacts of all that is beyond the sensor.
    """

    def __init__(self, body: RobotBody, link: str):
        carrier, at, axes = body.frame(link)
        if carrier < 0 or not (np.allclose(at, 0.0) and np.allclose(axes, np.eye(3))):
            raise ValueError(f"force-torque sensor on {link}: expected a link that a joint carries")
        self._body, self._link = body, carrier
        beyond = body.beyond(carrier)
        gripped = {body.joints[joint] for joint in body.description.device_limits}
        self._mechanism = Mechanism(body, beyond) if gripped & set(beyond) else None
        # PyBullet answers in the inertial frame of the link beyond the cut: what carries it exerts on it.
        centre, turn = body.inertial(carrier)
        self._centre, self._turn = tuple(centre.tolist()), quaternion(turn)
        if self._mechanism is None:
            p.enableJointForceTorqueSensor(body.number, carrier, True, physicsClientId=body.client)

    def measure(self, time_ns: int, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's force_torque columns."""
        if self._mechanism is not None:
            force, torque = self._mechanism.wrench(time_ns)
            _, here, orientation, _, _ = self._body.link_motion(self._link)
            mx, my, mz = _cross(here, force)
            into_sensor = _inverse(orientation)
            values[0:3] = p.rotateVector(into_sensor, force)
            values[3:6] = p.rotateVector(into_sensor, (torque[0] - mx, torque[1] - my, torque[2] - mz))
            return
        wrench = p.getJointState(self._body.number, self._link, physicsClientId=self._body.client)[2]
        fx, fy, fz = p.rotateVector(self._turn, wrench[:3])
        tx, ty, tz = p.rotateVector(self._turn, wrench[3:])
        mx, my, mz = _cross(self._centre, (fx, fy, fz))
        values[0:6] = -fx, -fy, -fz, -tx - mx, -ty - my, -tz - mz


class Mechanism:
    """Some links of the robot, whose only neighbour is the arm that carries them: momentum and contacts tell what it bears."""

    def __init__(self, body: RobotBody, links: list[int]):
        self._body, self._links = body, links
        infos = [p.getDynamicsInfo(body.number, link, physicsClientId=body.client) for link in links]
        self._inertials = [(info[0], info[2]) for info in infos]  # mass, principal moments
        self._weight = GRAVITY * sum(mass for mass, _ in self._inertials)
        self._momentum = np.zeros(6)
        self._rate = np.zeros(6)
        self._time_ns = -1

    def wrench(self, time_ns: int) -> tuple[Vector, Vector]:
        """Force N and torque N·m about the world's origin, world axes, that the links exert on what carries them.

        Acceleration is the mean since the call before.
        """
        states = p.getLinkStates(
            self._body.number, self._links, computeLinkVelocity=1, computeForwardKinematics=1,
            physicsClientId=self._body.client,
        )  # fmt: skip
        momentum = np.zeros(6)
        lever_x = lever_y = 0.0
        for state, (mass, moments) in zip(states, self._inertials, strict=True):
            centre, orientation, linear, angular = state[0], state[1], state[6], state[7]
            x, y, z = p.rotateVector(_inverse(orientation), angular)
            spin = p.rotateVector(orientation, (x * moments[0], y * moments[1], z * moments[2]))
            orbit = _cross(centre, linear)
            momentum[:3] += (mass * linear[0], mass * linear[1], mass * linear[2])
            momentum[3:] += (mass * orbit[0] + spin[0], mass * orbit[1] + spin[1], mass * orbit[2] + spin[2])
            lever_x += GRAVITY * mass * centre[0]
            lever_y += GRAVITY * mass * centre[1]
        passed = (time_ns - self._time_ns) * 1e-9
        if self._time_ns >= 0 and passed > 0.0:
            self._rate = (momentum - self._momentum) / passed
        self._momentum, self._time_ns = momentum, time_ns
        outer = self._contacts() - self._rate
        fx, fy, fz, tx, ty, tz = outer.tolist()
        # Weight (0, 0, −m g) at a centre c has the moment (−m g c_y, m g c_x, 0).
        return (fx, fy, fz - self._weight), (tx - lever_y, ty + lever_x, tz)

    def _contacts(self) -> npt.NDArray[np.float64]:
        """What others exert on the links, force and torque about the world's origin."""
        total = np.zeros(6)
        mine = set(self._links)
        for contact in p.getContactPoints(self._body.number, physicsClientId=self._body.client):
            if contact[3] not in mine:
                continue
            # Normal on the other body, pointing at ours; friction along two directions.
            force = tuple(
                contact[9] * normal + contact[10] * one + contact[12] * two
                for normal, one, two in zip(contact[7], contact[11], contact[13], strict=True)
            )
            total[:3] += force
            total[3:] += _cross(contact[5], force)
        return total
