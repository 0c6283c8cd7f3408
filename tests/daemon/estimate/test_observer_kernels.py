"""The observer's and the wrist sensors' kernels against the same laws by pinocchio's own algorithms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.state.observer import OBSERVER_HZ, SENSOR_HZ, ExternalWrenches
from hal.device import DeviceState
from hal.joint import JointState
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

PERIOD = 0.002


def test_forces_are_those_of_pinocchios_newton_euler_whatever_way_gravity_points() -> None:
    description = robots.load("talos_upper")
    kinematics, n = Kinematics(description), len(description.joints)
    model, rows = kinematics.model, kinematics.index_v
    joints, devices, rng = JointState(n), DeviceState(len(description.devices)), np.random.default_rng(1)
    devices.age[:] = 0
    outside = ExternalWrenches(kinematics, joints, PERIOD, devices)
    tip, other = (description.arms[side].tip for side in ("right", "left"))
    data, q, v = model.createData(), pin.neutral(model), np.zeros(model.nv)
    first, residual, wrench = np.zeros(model.nv), np.zeros(model.nv), np.zeros(6)
    for cycle in range(4):
        before, torque = v.copy(), joints.torque.copy()
        q[:], v[:] = rng.normal(0.0, 0.5, model.nq), rng.normal(0.0, 0.5, model.nv)
        joints.torque[:] = rng.normal(0.0, 5.0, n)
        devices.values[:] = rng.normal(0.0, 20.0, devices.values.shape)
        model.gravity.linear = rng.normal(0.0, 5.0, 3)
        outside.update([tip, other], q, v)
        if cycle == 0:
            before, torque = v.copy(), joints.torque.copy()

        wanted = pin.rnea(model, data, q, v, (v - before) / PERIOD)
        gain = 1.0 if cycle == 0 else 1.0 - np.exp(-2.0 * np.pi * OBSERVER_HZ * PERIOD)
        first[rows] += gain * (wanted[rows] - 0.5 * (joints.torque + torque) - first[rows])
        residual[rows] += gain * (first - residual)[rows]
        row, sensor = next((row, sensor) for row, sensor in outside.sensors.items() if tip in sensor.frames)
        frame = model.frames[kinematics.frame_id(description.devices[row].link)]
        carrier = frame.parentJoint
        keeps = sensor.inertia * data.a_gf[carrier] + sensor.inertia.vxiv(data.v[carrier])
        felt = keeps + frame.placement.act(pin.Force(devices.values[row, :6].copy()))
        pin.framesForwardKinematics(model, data, q)
        at_tip = pin.SE3(np.eye(3), data.oMf[kinematics.frame_id(tip)].translation)
        seen = at_tip.actInv(data.oMi[carrier].act(felt)).vector
        wrench += (1.0 if cycle == 0 else 1.0 - np.exp(-2.0 * np.pi * SENSOR_HZ * PERIOD)) * (seen - wrench)
        assert outside.wrenches[tip] == pytest.approx(wrench, abs=1e-10)
        assert sensor.excess(outside.moved) == pytest.approx(frame.placement.actInv(felt).vector, abs=1e-10)
        assert outside._observer.residual == pytest.approx(residual, abs=1e-8 * np.abs(wanted).max())
