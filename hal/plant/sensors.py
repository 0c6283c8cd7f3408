"""What sensors on the robot feel: an inertial measurement unit, and a force-torque sensor between two links."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.drives.borrowing import borrowed
from hal.drives.rows import device_state
from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import RobotBody, Vector
from hal.plant.scene import quaternion
from handrail.compiled import compiled

GRAVITY = 9.81
"""m/s², along the world's −z"""

IMU, FORCE_TORQUE = range(2)
MEMORY = 14
"""Numbers that a sensor remembers."""

Moved = dict[int, npt.NDArray[np.float64]]
"""PyBullet's link → its row of JointPort.moved"""

# Vectors of three, several times a cycle: plain numbers, since numpy costs ten times as much, and compiled code where it is
# done in every cycle.


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
        self.carrier, offset, turn = body.frame(link)
        """PyBullet's link that carries it"""
        centre, axes = body.inertial(self.carrier)
        self.memory = np.zeros(MEMORY)
        """for `feel`"""
        self.memory[:3], self.memory[3:7] = axes.T @ (offset - centre), quaternion(axes.T @ turn)
        self.memory[13] = -1.0

    def measure(self, moved: npt.NDArray[np.float64], time_ns: int, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's imu columns, for the carrier's row of JointPort.moved."""
        _feel(moved, float(time_ns), self.memory, values)


@compiled
def _turned(q, v):  # type: ignore[no-untyped-def]
    """A vector after the rotation q (x, y, z, w): v + 2 (w t + u × t), with u the rotation's vector and t = u × v."""
    x, y, z, w = q
    a, b, c = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    return (
        v[0] + 2.0 * (w * a + y * c - z * b),
        v[1] + 2.0 * (w * b + z * a - x * c),
        v[2] + 2.0 * (w * c + x * b - y * a),
    )


@compiled
def _feel(moved, time_ns, memory, values):  # type: ignore[no-untyped-def]
    """An IMU's columns. memory (MEMORY,): place and orientation in the carrier's inertial frame, last velocity and acceleration,
    when that was (ns; −1: never)."""
    moved, memory, values = borrowed(moved), borrowed(memory), borrowed(values)
    passed = (time_ns - memory[13]) * 1e-9 if memory[13] >= 0.0 else 0.0
    memory[13] = time_ns
    x, y, z, w = moved[3], moved[4], moved[5], moved[6]
    lx, ly, lz = _turned((x, y, z, w), (memory[0], memory[1], memory[2]))
    i, j, k, m = memory[3], memory[4], memory[5], memory[6]
    qx, qy, qz = w * i + x * m + y * k - z * j, w * j + y * m + z * i - x * k, w * k + z * m + x * j - y * i
    qw = w * m - x * i - y * j - z * k
    spin = (moved[10], moved[11], moved[12])
    vx = moved[7] + spin[1] * lz - spin[2] * ly
    vy = moved[8] + spin[2] * lx - spin[0] * lz
    vz = moved[9] + spin[0] * ly - spin[1] * lx
    if passed > 0.0:
        memory[10], memory[11], memory[12] = (
            (vx - memory[7]) / passed,
            (vy - memory[8]) / passed,
            (vz - memory[9]) / passed,
        )
    memory[7], memory[8], memory[9] = vx, vy, vz
    sign = 1.0 if qw >= 0.0 else -1.0
    values[0], values[1], values[2], values[3] = sign * qx, sign * qy, sign * qz, sign * qw
    into_sensor = (-qx, -qy, -qz, qw)
    values[4], values[5], values[6] = _turned(into_sensor, spin)
    values[7], values[8], values[9] = _turned(into_sensor, (memory[10], memory[11], memory[12] + GRAVITY))


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
        self._body = body
        self.carrier = carrier
        """PyBullet's number of the link, and of the joint"""
        beyond = body.beyond(carrier)
        gripped = {body.joints[joint] for joint in body.description.device_limits}
        self._mechanism = Mechanism(body, beyond) if gripped & set(beyond) else None
        self.links = self._mechanism.links if self._mechanism else []
        """PyBullet's links whose states it wants to know"""
        # PyBullet answers in the inertial frame of the link beyond the cut: what carries it exerts on it.
        centre, turn = body.inertial(carrier)
        self.memory = np.array([*centre, *quaternion(turn), *[0.0] * (MEMORY - 7)])
        """for `feel`, where the joint tells all"""
        self._frame_in_centre = p.invertTransform(centre.tolist(), quaternion(turn))
        self.sense(True)

    def sense(self, on: bool) -> None:
        """Let PyBullet work out what the joint transmits in the steps to come, or not: it makes them a fifth longer."""
        if self._mechanism is None:
            p.enableJointForceTorqueSensor(self._body.number, self.carrier, on, physicsClientId=self._body.client)

    @property
    def simple(self) -> bool:
        """The link's joint tells all: `feel` measures it."""
        return self._mechanism is None

    def measure(self, moved: Moved, time_ns: int, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's force_torque columns, for the rows of JointPort.moved of `links`: of one that is not `simple`."""
        assert self._mechanism is not None, "a simple one is measured by `feel`"
        force, torque = self._mechanism.wrench(moved, time_ns)
        centre = moved[self.carrier].tolist()
        here, orientation = p.multiplyTransforms(centre[:3], centre[3:7], *self._frame_in_centre)
        mx, my, mz = _cross(here, force)
        into_sensor = _inverse(orientation)
        values[0:3] = p.rotateVector(into_sensor, force)
        values[3:6] = p.rotateVector(into_sensor, (torque[0] - mx, torque[1] - my, torque[2] - mz))


@compiled
def _carry(joint, place, values):  # type: ignore[no-untyped-def]
    """What a joint's reaction on a link, in the link's inertial frame at `place` (7, ...), means in the link's frame: its
    opposite."""
    joint, place, values = borrowed(joint), borrowed(place), borrowed(values)
    turn = (place[3], place[4], place[5], place[6])
    fx, fy, fz = _turned(turn, (joint[2], joint[3], joint[4]))
    tx, ty, tz = _turned(turn, (joint[5], joint[6], joint[7]))
    values[0], values[1], values[2] = -fx, -fy, -fz
    values[3] = -tx - (place[1] * fz - place[2] * fy)
    values[4] = -ty - (place[2] * fx - place[0] * fz)
    values[5] = -tz - (place[0] * fy - place[1] * fx)


@compiled
def feel(plan, memories, moved, felt, noise, devices, time_ns):  # type: ignore[no-untyped-def]
    """Measure all at once; a DeviceState's memory `devices` gets it, with `noise` (d, MEASURED) on top.

    plan (k, 3): `IMU` or `FORCE_TORQUE`, the device's row, its row in JointPort.moved or .felt; memories (k, MEMORY): theirs.
    """
    values, times = device_state(devices, noise.shape[0])
    for k in range(plan.shape[0]):
        kind, row, at = plan[k]
        if kind == IMU:
            _feel(moved[at], time_ns, memories[k], values[row])
        else:
            _carry(felt[at], memories[k], values[row])
    for row in range(noise.shape[0]):
        for column in range(noise.shape[1]):
            values[row, column] += noise[row, column]
        times[0, row], times[1, row] = 0, np.int64(time_ns)


class Mechanism:
    """Some links of the robot, whose only neighbour is the arm that carries them: momentum and contacts tell what it bears."""

    def __init__(self, body: RobotBody, links: list[int]):
        self._body, self.links = body, links
        infos = [p.getDynamicsInfo(body.number, link, physicsClientId=body.client) for link in links]
        self._inertials = [(info[0], info[2]) for info in infos]  # mass, principal moments
        self._weight = GRAVITY * sum(mass for mass, _ in self._inertials)
        self._momentum = np.zeros(6)
        self._rate = np.zeros(6)
        self._time_ns = -1

    def wrench(self, moved: Moved, time_ns: int) -> tuple[Vector, Vector]:
        """Force N and torque N·m about the world's origin, world axes, that the links exert on what carries them.

        Acceleration is the mean since the call before.
        """
        px = py = pz = lx = ly = lz = lever_x = lever_y = 0.0
        for link, (mass, moments) in zip(self.links, self._inertials, strict=True):
            row = moved[link].tolist()
            centre, orientation, linear, angular = row[:3], row[3:7], row[7:10], row[10:]
            x, y, z = p.rotateVector(_inverse(orientation), angular)
            spin = p.rotateVector(orientation, (x * moments[0], y * moments[1], z * moments[2]))
            orbit = _cross(centre, linear)
            px, py, pz = px + mass * linear[0], py + mass * linear[1], pz + mass * linear[2]
            lx, ly, lz = lx + mass * orbit[0] + spin[0], ly + mass * orbit[1] + spin[1], lz + mass * orbit[2] + spin[2]
            lever_x += GRAVITY * mass * centre[0]
            lever_y += GRAVITY * mass * centre[1]
        momentum = np.array((px, py, pz, lx, ly, lz))
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
        mine = set(self.links)
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
