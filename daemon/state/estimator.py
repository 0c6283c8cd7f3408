"""Where a free base is and how it moves, and which feet hold: from the inertial sensor, the legs' joints and what the feet feel.

The filter is a contact-aided invariant one (daemon.state.invariant_filter has source and equations); its body is the inertial
sensor, and encoders say where base and feet are from there. The world is where the base was when the estimate began: there its
position was zero, its heading zero, and up is away from gravity. Nothing measures position and heading but the feet, so both
creep with them.

A foot holds when what presses on its sole rises above a share of the robot's weight, until it falls below a smaller one. A
force-torque sensor that carries the foot tells it, freed of the foot's weight; where there is none, or it is silent, the leg's
joints do, while they are in operation: Jᵀ F = τ_spring − τ(q, q̇) over the leg, Newton-Euler's with the base moving as the
inertial sensor feels it, behind a low-pass (as daemon.state.observer's, whose base stands still). A foot is anchored at its
centre of pressure, which does not move where the sole tips over an edge, and the anchor goes where the pressure goes.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.state.base_state import BaseSource, BaseState, Trouble
from daemon.state.invariant_filter import (
    ACCELERATION,
    ANCHOR,
    BASE,
    BASE_PLACE,
    ED,
    EP,
    FEET,
    FOOT,
    GRAVITY,
    MOST_FEET,
    OMEGA,
    OMEGA_OFFSET,
    OTHERS,
    PLACE,
    WORK,
    P,
    R,
    V,
    anchor,
    begin,
    cross,
    hang_still,
    inner,
    predict,
    product,
    release,
    slipped,
    stand,
    turn,
    turn_back,
)
from daemon.state.observer import OBSERVER_HZ, SENSOR_AGE, WristSensor
from daemon.wbc.model import with_frames_of_one_name_each
from hal.device import DeviceState
from hal.drives.lifecycle import State, decode_statusword
from hal.joint import JointState
from handrail.compiled import compiled
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.robot.model_memory import motions, placements

Array = NDArray[np.float64]

HOLDS, LEAVES = 0.08, 0.05
"""shares of the robot's weight: a foot holds above the one, until it is below the other; one that swings fast feels half of that
by its own inertia, which is not taken away"""
IMU_AGE, JOINT_AGE = 10, 10
"""cycles since its last frame after which the inertial sensor counts as silent; after which a joint's position is not used"""
_SETTLES = 5
"""cycles for which a foot must hold before it is anchored: a landing one bounces"""
_PRESSURE_HZ = 20.0
_STILL_CYCLES, _STILL_RATE, _STILL_ACCELERATION = 100, 0.05, 0.5
"""how long, and below which rad/s and m/s² beyond gravity's, a robot whose feet hold nowhere hangs still"""
_RESTING = 1.0
"""m/s² that what the sensor feels may differ from gravity where an estimate begins"""
_DAMPING = 1e-4
"""m² added to J Jᵀ of a leg: a stretched knee pulls the force to zero"""
_LOST = 1.0
"""m, standard deviation of the position beyond which there is no estimate"""

# Places in the filter's array of what it does not know of itself.
_IMU_FRAME, _BODY, _BODY_PLACE = OTHERS, OTHERS + 12, OTHERS + 21
"""the sensor's frame on its joint, and in the base: rotation by rows, m"""
_SPEED, _SPIN, _RATE, _UP = OTHERS + 24, OTHERS + 27, OTHERS + 30, OTHERS + 33
"""base's axes: m/s, rad/s of the sensor seen from the base; rad/s of the base; upwards"""
# Of a foot: how far its pressure went on, in the sensor's axes; what presses on it, base's axes; its sole in the base; where in the
# sole it presses; frames on their joint, of sole and sensor; the sensor's in the base; kg and m that it carries; N, N, m, m:
# `_limits`; wrench by the joints, the sole's axes.
_SHIFT, _FORCE, _SOLE, _WHERE, _PRESSURE, _SOLE_FRAME, _FELT_FRAME = np.array([6, 9, 12, 21, 24, 27, 39])
_CARRIED, _LIMITS, _BY_JOINTS = np.array([51, 55, 59])
# Marks: the filter runs; cycles that the robot has hung still; row and joint of the inertial sensor; then of each foot: it holds;
# cycles for which it has; how often it slipped; row of its sensor (−1: none); its joint.
_RUNNING, _STILL, _IMU, _IMU_JOINT, _MARKS = np.array([0, 1, 2, 3, 4])
_HOLDS, _HELD, _SLIPS, _SENSOR, _JOINT, _MARKS_OF_FOOT = np.array([0, 1, 2, 3, 4, 5])
_CHAIN_OF_IMU = np.int64(0)


class BaseEstimator:
    """The estimate of one robot, cycle by cycle; a function of what `joints` and `devices` held in each of them."""

    def __init__(self, kinematics: Kinematics, joints: JointState, devices: DeviceState, period: float):
        """Raises ValueError for a robot that `can_estimate` denies."""
        description = kinematics.description
        if not can_estimate(description):
            raise ValueError(f"{description.name}: expected a free base, an inertial sensor and 1 to {MOST_FEET} feet")
        feet, n = description.feet, len(description.feet)
        self.state = BaseState(n)
        self._joints, self._devices, self._period = joints, devices, period
        self._time_ns: int | None = None
        self._passed = 0.0
        """s since the cycle before"""
        imu = next(row for row, device in enumerate(description.devices) if device.family == "imu")
        links = [description.devices[imu].link, *(foot.link for foot in feet)]
        model = self._model = _reduced(kinematics, links)
        self._data, self._other = model.createData(), model.createData()
        self._rows = np.array([description.joints.index(name) for name in model.names[1:]], np.int64)
        self._q, self._v, self._zero = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        self._placement, self._motion = placements(self._data.oMi), motions(self._data.v)
        chains = [_chain(model, link) for link in links]
        self._chains = np.full((1 + n, max(map(len, chains))), -1, np.int64)
        for row, chain in enumerate(chains):
            self._chains[row, : len(chain)] = self._rows[chain]

        self._x, self._covariance = np.zeros(FEET + n * FOOT), np.zeros((ED + 3 * n) ** 2)
        self._anchored, self._marks = np.zeros(n, np.int64), np.zeros(_MARKS + n * _MARKS_OF_FOOT, np.int64)
        self._x[_IMU_FRAME : _IMU_FRAME + 12] = _flat(_placement(model, links[0]))
        self._marks[[_IMU, _IMU_JOINT]] = imu, _joint(model, links[0])
        of_foot = self._x[FEET:].reshape(n, FOOT)
        marks = self._marks[_MARKS:].reshape(n, _MARKS_OF_FOOT)
        self.slips = marks[:, _SLIPS]
        """(n,): how often each foot was anchored anew since it was not where it had been"""
        weight = GRAVITY * float(pin.computeTotalMass(model))
        for foot, x, mark in zip(feet, of_foot, marks, strict=True):
            x[_SOLE_FRAME : _SOLE_FRAME + 12] = _flat(_placement(model, foot.link))
            x[_LIMITS : _LIMITS + 4] = HOLDS * weight, LEAVES * weight, 0.5 * foot.size[0], 0.5 * foot.size[1]
            x[_BY_JOINTS] = np.nan
            mark[_JOINT], mark[_SENSOR] = _joint(model, foot.link), _sensor(model, description, foot.link)
            if (row := int(mark[_SENSOR])) >= 0:
                sensor = WristSensor(kinematics, description.devices[row].link, row, devices)
                on_joint = _placement(kinematics.model, description.devices[row].link)
                carried = on_joint.actInv(sensor.inertia)
                x[_FELT_FRAME : _FELT_FRAME + 12] = _flat(on_joint)
                x[_CARRIED : _CARRIED + 4] = carried.mass, *carried.lever
        self._sensors = marks[:, _SENSOR].tolist()
        self._by_joints = of_foot[:, _BY_JOINTS : _BY_JOINTS + 6]
        self._soles, self._legs = [_frame(model, foot.link) for foot in feet], chains[1:]
        # Where gravity is, in the base: by the joints between at zero, which is near enough for a force.
        self._upright = _placement(model, links[0]).rotation
        self._gains = [1.0 - math.exp(-2.0 * math.pi * hz * period) for hz in (_PRESSURE_HZ, OBSERVER_HZ)]
        self._out, self._codes = self.state.memory[: 15 + 3 * n].view(np.float64), self.state.memory[15 + 3 * n :]
        self.state.source[0], self.state.trouble[0] = BaseSource.NONE, Trouble.IMU_SILENT

    def update(self, time_ns: int) -> None:
        """Once a cycle, when the bus has been read. time_ns: the robot's clock, by which it goes on where periods were missed."""
        passed = 0.0 if self._time_ns is None else (time_ns - self._time_ns) * 1e-9
        self._passed, self._time_ns = min(max(passed, 0.0), IMU_AGE * self._period), time_ns
        joints, age = self._joints, self._devices.age
        joints.position.take(self._rows, out=self._q, mode="clip")
        joints.velocity.take(self._rows, out=self._v, mode="clip")
        pin.forwardKinematics(self._model, self._data, self._q, self._v)
        for foot, row in enumerate(self._sensors):
            if row < 0 or age[row] > SENSOR_AGE:
                self._feel_by_joints(foot)
            else:
                self._by_joints[foot, 0] = np.nan
        if (news := self._estimate()) == _BEGIN:
            self._begin()
            news = self._estimate()
        if news:
            self.state.since_ns[0] = time_ns

    def _estimate(self) -> int:
        return int(
            _estimate(
                self._passed,
                self._gains[0],
                self._devices.age[self._marks[_IMU]],
                self._x,
                self._covariance,
                self._out,
                self._codes,
                self._marks,
                self._anchored,
                self._chains,
                self._devices.values,
                self._joints.age,
                self._placement,
                self._motion,
            )
        )

    def _begin(self) -> None:
        """Where the base was last, with the heading that it had: in the world's origin at first."""
        x, y, z, w = self.state.pose[3:]
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        m = ED + 3 * len(self._anchored)
        begin(self._x, self._covariance.reshape(m, m), self.state.pose[:3], heading)
        self._marks[_RUNNING] = 1

    def _feel_by_joints(self, foot: int) -> None:
        """What presses on a foot, from the leg's springs: damped least squares of Jᵀ F = τ − τ_spring.

        Nothing does where a drive is not in operation, since its brake may bear what the spring does not.
        """
        model, data, leg, felt = self._model, self._other, self._legs[foot], self._by_joints[foot]
        rows = self._rows[leg]
        if (decode_statusword(self._joints.status[rows]) != State.OPERATION_ENABLED).any():
            felt[:] = 0.0
            return
        acceleration = self._devices.values[self._marks[_IMU], 7:10]
        known = np.isfinite(acceleration).all() and acceleration.any()
        model.gravity.linear = -(self._upright @ acceleration) if known else np.array([0.0, 0.0, -GRAVITY])
        missing = pin.rnea(model, data, self._q, self._v, self._zero)[leg] - self._joints.torque[rows]
        jacobian = pin.computeFrameJacobian(model, data, self._q, self._soles[foot], pin.LOCAL)[:, leg]
        force = np.linalg.solve(jacobian @ jacobian.T + _DAMPING * np.eye(6), jacobian @ missing)
        if np.isfinite(force).all():
            felt[:] = force if np.isnan(felt[0]) else felt + self._gains[1] * (force - felt)


def can_estimate(description: RobotDescription) -> bool:
    """The robot has a free base, and what it takes to tell where that is."""
    imu = any(device.family == "imu" and device.link for device in description.devices)
    return description.base == "free" and imu and 0 < len(description.feet) <= MOST_FEET


def _reduced(kinematics: Kinematics, links: list[str]) -> pin.Model:
    """The robot's model with the joints alone that carry `links`, the others as at home."""
    model = with_frames_of_one_name_each(kinematics.model)
    carriers = {j for link in links for j in model.supports[_joint(model, link)]}
    lock = [j for j in range(1, model.njoints) if j not in carriers]
    home = kinematics.configuration(kinematics.description.home_position())
    return pin.buildReducedModel(model, lock, home.copy())


def _frame(model: pin.Model, link: str) -> int:
    return int(model.getFrameId(link, pin.BODY))


def _joint(model: pin.Model, link: str) -> int:
    return int(model.frames[_frame(model, link)].parentJoint)


def _placement(model: pin.Model, link: str) -> pin.SE3:
    """A link's frame on the joint that carries it."""
    return pin.SE3(model.frames[_frame(model, link)].placement)


def _flat(placement: pin.SE3) -> Array:
    """(12,): rotation by rows, translation."""
    return np.concatenate((placement.rotation.ravel(), placement.translation))


def _chain(model: pin.Model, link: str) -> NDArray[np.int64]:
    """The velocities that carry a link."""
    return np.array([model.idx_vs[j] for j in model.supports[_joint(model, link)] if j], np.int64)


def _sensor(model: pin.Model, description: RobotDescription, link: str) -> int:
    """Row of the force-torque sensor on the joint that carries a foot; −1: none."""
    joint = _joint(model, link)
    for row, device in enumerate(description.devices):
        if device.family == "force_torque" and _joint(model, device.link) == joint:
            return row
    return -1


# ---------------------------------------------------------------------------------------------------------- compiled


@inner
def _place(x, to, frame, placement, joint):  # type: ignore[no-untyped-def]
    """A frame on a joint, seen from the base: rotation by rows, position."""
    for i in range(3):
        for j in range(3):
            x[WORK + 3 * i + j] = placement[joint, 3 * j + i]
    product(x, to, WORK, frame)
    turn(x, to + 9, WORK, frame + 9)
    for i in range(3):
        x[to + 9 + i] += placement[joint, 9 + i]


@inner
def _quaternion(x, r, out):  # type: ignore[no-untyped-def]
    """out[3:7] ← x y z w, w ≥ 0, of a rotation by rows (Shepperd: from the largest of the four)."""
    xx, yy, zz = x[r], x[r + 4], x[r + 8]
    across = (x[r + 7] - x[r + 5], x[r + 2] - x[r + 6], x[r + 3] - x[r + 1])
    a, b, c, w = 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz
    xy, xz, yz = x[r + 1] + x[r + 3], x[r + 2] + x[r + 6], x[r + 5] + x[r + 7]
    if w >= a and w >= b and w >= c:
        a, b, c = across
    elif a >= b and a >= c:
        b, c, w = xy, xz, across[0]
    elif b >= c:
        a, c, w = xy, yz, across[1]
    else:
        a, b, w = xz, yz, across[2]
    s = math.copysign(1.0 / math.sqrt(a * a + b * b + c * c + w * w), w)
    out[3], out[4], out[5], out[6] = s * a, s * b, s * c, s * w


@inner
def _old(chains, row, age):  # type: ignore[no-untyped-def]
    """A joint of a chain has not been measured lately."""
    oldest = 0
    for j in range(chains.shape[1]):
        if chains[row, j] >= 0:
            oldest = max(oldest, age[chains[row, j]])
    return oldest > JOINT_AGE


@inner
def _feel(x, at, values, sensor, placement, joint):  # type: ignore[no-untyped-def]
    """FORCE ← what presses on a foot; WORK[:6] ← the same and its moment about the sole's middle, the sole's axes."""
    if math.isfinite(x[at + _BY_JOINTS]):
        for i in range(6):
            x[WORK + i] = x[at + _BY_JOINTS + i]
        turn(x, at + _FORCE, at + _SOLE, WORK)
        return
    for i in range(6):
        x[WORK + 21 + i] = values[sensor, i] if sensor >= 0 else 0.0
        if not math.isfinite(x[WORK + 21 + i]):
            x[WORK + 21] = x[WORK + 22] = x[WORK + 23] = 0.0
            break
    frame = WORK + 9
    _place(x, WORK + 9, at + _FELT_FRAME, placement, joint)
    for i in range(3):  # the weight that it carries, and its moment, are the foot's own
        x[WORK + i] = x[at + _CARRIED] * GRAVITY * x[_UP + i]
    turn_back(x, WORK + 3, frame, WORK)
    cross(x, WORK + 6, at + _CARRIED + 1, WORK + 3)
    for i in range(3):
        x[WORK + 21 + i] += x[WORK + 3 + i]
        x[WORK + 24 + i] += x[WORK + 6 + i]
        x[WORK + 6 + i] = x[frame + 9 + i] - x[at + _WHERE + i]
    turn(x, at + _FORCE, frame, WORK + 21)
    turn(x, WORK + 3, frame, WORK + 24)
    cross(x, WORK, WORK + 6, at + _FORCE)
    for i in range(3):
        x[WORK + 3 + i] += x[WORK + i]
    turn_back(x, WORK, at + _SOLE, at + _FORCE)
    turn_back(x, WORK + 3, at + _SOLE, WORK + 3)


@inner
def _touch(x, at, marks, mark, gain):  # type: ignore[no-untyped-def]
    """Whether the foot holds, and where it presses, by WORK[:6]; SHIFT ← by how much that went on."""
    holds = x[WORK + 2] > x[at + _LIMITS + marks[mark + _HOLDS]]
    for i in range(3):
        x[at + _SHIFT + i] = 0.0
    for i in range(2 if holds else 0):
        most = x[at + _LIMITS + 2 + i]
        wanted = -x[WORK + 4] / x[WORK + 2] if i == 0 else x[WORK + 3] / x[WORK + 2]
        step = min(max(wanted, -most), most) - x[at + _PRESSURE + i]
        x[at + _SHIFT + i] = gain * step if marks[mark + _HOLDS] else step
        x[at + _PRESSURE + i] += x[at + _SHIFT + i]
    marks[mark + _HOLDS] = holds
    turn(x, at + _SHIFT, at + _SOLE, at + _SHIFT)
    turn(x, at + _SHIFT, BASE, at + _SHIFT)
    turn(x, at + PLACE, at + _SOLE, at + _PRESSURE)
    for i in range(3):
        x[at + PLACE + i] += x[at + _WHERE + i]
    turn(x, at + PLACE, BASE, at + PLACE)
    for i in range(3):
        x[at + PLACE + i] += x[BASE_PLACE + i]


@inner
def _press(x, n, out):  # type: ignore[no-untyped-def]
    """Tell the feet's forces in the world's axes."""
    a, b, c, w = out[3], out[4], out[5], out[6]
    x[WORK], x[WORK + 1], x[WORK + 2] = a, b, c
    for foot in range(n):
        force = FEET + FOOT * foot + _FORCE
        cross(x, WORK + 3, WORK, force)
        cross(x, WORK + 6, WORK, WORK + 3)
        for i in range(3):
            out[15 + 3 * foot + i] = x[force + i] + 2.0 * (w * x[WORK + 3 + i] + x[WORK + 6 + i])


@inner
def _spread(covariance, m, out):  # type: ignore[no-untyped-def]
    """out[13:15] ← deviations of the position, whose error is ξ_p + ξ_R × p, and of the orientation."""
    total, turned = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3  # the error along i: ξ_p,i + ξ_R,j p_k − ξ_R,k p_j
        pj, pk, e = out[j], out[k], (EP + i) * m
        total += covariance[e + EP + i] + 2.0 * (pk * covariance[e + j] - pj * covariance[e + k])
        total += (
            pk * pk * covariance[j * m + j] + pj * pj * covariance[k * m + k] - 2.0 * pj * pk * covariance[j * m + k]
        )
        turned += covariance[i * m + i]
    out[13], out[14] = math.sqrt(max(total, 0.0)), math.sqrt(max(turned, 0.0))


@inner
def _tell(x, covariance, n, out):  # type: ignore[no-untyped-def]
    """The base, from the sensor: pose, twist, deviations."""
    product(x, WORK, R, BASE)
    turn(x, WORK + 9, R, BASE_PLACE)
    for i in range(3):
        out[i] = x[P + i] + x[WORK + 9 + i]
    _quaternion(x, WORK, out)
    turn_back(x, WORK + 9, WORK, V)
    cross(x, WORK + 12, _RATE, _BODY_PLACE)
    for i in range(3):
        out[7 + i], out[10 + i] = x[WORK + 9 + i] - x[WORK + 12 + i] - x[_SPEED + i], x[_RATE + i]
    _spread(covariance, ED + 3 * n, out)


_OF_FEET, _OF_STILL, _OF_IMU, _OF_NOTHING = (
    int(source) for source in (BaseSource.FEET, BaseSource.STILL, BaseSource.INERTIAL, BaseSource.NONE)
)
_FINE, _IMU_SILENT, _IMU_WRONG = int(Trouble.NONE), int(Trouble.IMU_SILENT), int(Trouble.IMU_NOT_FINITE)
_JOINT_SILENT, _JOINT_WRONG = int(Trouble.JOINT_SILENT), int(Trouble.JOINT_NOT_FINITE)
_NOT_AT_REST, _IS_LOST = int(Trouble.NOT_AT_REST), int(Trouble.LOST)


_BEGIN = np.int64(2)


@compiled(error_model="numpy")
def _estimate(  # type: ignore[no-untyped-def]
    h, gain, imu_age, x, covariance, out, codes, marks, anchored, chains, values, joint_age, placement, motion
):
    """One cycle. 1 when source or trouble are others than before; _BEGIN, having done nothing, where the filter has to begin."""
    n, imu = anchored.shape[0], marks[_IMU]
    was, source, trouble = (codes[1], codes[2]), _OF_NOTHING, _FINE
    _place(x, _BODY, _IMU_FRAME, placement, marks[_IMU_JOINT])
    for i in range(3):
        for j in range(3):
            x[BASE + 3 * i + j] = x[_BODY + 3 * j + i]
    turn(x, BASE_PLACE, BASE, _BODY_PLACE)
    seen = 0.0
    for i in range(12):
        seen += x[_BODY + i]
    felt = 0.0
    for i in range(3):
        x[BASE_PLACE + i] = -x[BASE_PLACE + i]
        x[OMEGA + i], x[ACCELERATION + i] = values[imu, 4 + i], values[imu, 7 + i]
        felt += x[ACCELERATION + i] ** 2
    felt = abs(math.sqrt(felt) - GRAVITY)
    if imu_age > IMU_AGE:
        trouble = _IMU_SILENT
    elif not math.isfinite(felt + x[OMEGA] + x[OMEGA + 1] + x[OMEGA + 2]):
        trouble = _IMU_WRONG
    elif _old(chains, _CHAIN_OF_IMU, joint_age):
        trouble = _JOINT_SILENT
    elif not math.isfinite(seen):
        trouble = _JOINT_WRONG
    elif not marks[_RUNNING] and felt > _RESTING:
        trouble = _NOT_AT_REST
    if trouble == _FINE and not marks[_RUNNING]:
        return _BEGIN

    x[_UP], x[_UP + 1], x[_UP + 2] = 0.0, 0.0, 1.0
    if marks[_RUNNING] and trouble == _FINE:
        turn(x, _UP, _BODY, R + 6)
    touching = False
    for foot in range(n):
        at, mark = FEET + FOOT * foot, _MARKS + _MARKS_OF_FOOT * foot
        joint = marks[mark + _JOINT]
        _place(x, at + _SOLE, at + _SOLE_FRAME, placement, joint)
        _feel(x, at, values, marks[mark + _SENSOR], placement, joint)
        _touch(x, at, marks, mark, gain)
        codes[3 + foot] = marks[mark + _HOLDS]
        touching |= marks[mark + _HOLDS] == 1
        known = math.isfinite(x[at + PLACE] + x[at + PLACE + 1] + x[at + PLACE + 2]) and trouble == _FINE
        held = known and marks[mark + _HOLDS] and not _old(chains, 1 + foot, joint_age)
        marks[mark + _HELD] = marks[mark + _HELD] + 1 if held else 0
        if anchored[foot] and not held:
            release(covariance, foot, n)
        anchored[foot] = anchored[foot] and held

    if trouble == _FINE:
        predict(x, covariance, anchored, n, h)
        some = False
        for foot in range(n):
            at, mark = FEET + FOOT * foot, _MARKS + _MARKS_OF_FOOT * foot
            if anchored[foot]:
                turn(x, WORK, R, at + _SHIFT)
                for i in range(3):
                    x[at + ANCHOR + i] += x[WORK + i]
            if anchored[foot] and slipped(x, covariance, foot, n):
                marks[mark + _SLIPS] += 1
                anchored[foot] = 0
            if not anchored[foot] and marks[mark + _HELD] > _SETTLES:
                anchored[foot] = 1
                anchor(x, covariance, foot, n)
            some |= anchored[foot] == 1
        # How the sensor moves seen from the base, and how the base turns.
        joint = marks[_IMU_JOINT]
        for i in range(3):
            x[WORK + 15 + i], x[_SPIN + i] = motion[joint, i], motion[joint, 3 + i]
            x[_RATE + i] = x[OMEGA + i] - x[OMEGA_OFFSET + i]
        cross(x, WORK + 18, _SPIN, _IMU_FRAME + 9)
        for i in range(3):
            x[WORK + 18 + i] += x[WORK + 15 + i]
            for j in range(3):
                x[WORK + 3 * i + j] = placement[joint, 3 * j + i]
        turn(x, _SPEED, WORK, WORK + 18)
        turn(x, _SPIN, WORK, _SPIN)
        turn(x, _RATE, _BODY, _RATE)
        turning = 0.0
        for i in range(3):
            x[_RATE + i] -= x[_SPIN + i]
            turning += x[_RATE + i] ** 2
        if some:
            source, marks[_STILL] = _OF_FEET, 0
            stand(x, covariance, anchored, n)
        else:
            still = turning < _STILL_RATE**2 and felt < _STILL_ACCELERATION and not touching
            marks[_STILL] = marks[_STILL] + 1 if still else 0
            source = _OF_IMU
            if marks[_STILL] >= _STILL_CYCLES:
                source = _OF_STILL
                turn(x, WORK + 40, BASE, _SPEED)
                hang_still(x, covariance, WORK + 40, n)
        _tell(x, covariance, n, out)
        if not (out[13] < _LOST and math.isfinite(out[0] + out[1] + out[2] + out[3])):
            source, trouble = _OF_NOTHING, _IS_LOST
    marks[_RUNNING] = trouble == _FINE
    if trouble != _FINE:
        marks[_STILL] = 0
        for foot in range(n):
            anchored[foot] = 0
    codes[1], codes[2] = source, trouble
    _press(x, n, out)
    return np.int64(was != (codes[1], codes[2]))
