"""Everything that a cycle calls, compiled ahead of it."""

from __future__ import annotations

import numpy as np

from daemon.controllers.base import Gains
from daemon.controllers.joint_stream import JointStream
from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.controllers.outer_integral import OuterIntegral
from daemon.exchange import StreamMotion, TrajectoryMotion
from daemon.safety.bodies import Bodies
from daemon.safety.braking import Braking
from daemon.safety.limits import Limits, enforce
from daemon.safety.rules import followed
from daemon.safety.separation import COMMANDED, judge
from daemon.state.observer import SENSOR_AGE
from daemon.state.robot_state import RobotState
from hal.device import DeviceState
from hal.joint import JointCommand, JointState
from handrail.robot.description import IntegralGains
from handrail.robot.kinematics import Kinematics


def warm_up(kinematics: Kinematics) -> None:
    """Compile all that the cycle ever calls, before the bus is joined: in mid-motion it would hold the robot up for a second."""
    n = len(kinematics.description.joints)
    limits, state, command = Limits.of(kinematics.description), JointState(n), JointCommand(n)
    devices = DeviceState(len(kinematics.description.devices))
    robot = RobotState(kinematics, state, limits.period, devices)
    robot.update(command)
    for age in (SENSOR_AGE + 1, 0):  # by the joints, and by the sensors where there are some
        devices.age[:] = age
        robot.estimate_base(0)
        robot.estimate_forces([arm.tip for arm in kinematics.description.arms.values()])
    for sensor in robot.sensors.values():
        sensor.excess(robot.moved)
    if robot.stance is not None:
        robot.stance.update(kinematics.configuration(state.position), np.zeros(kinematics.model.nv))
    for arm in kinematics.description.arms.values():
        robot.carried(arm.tip).pull(np.zeros(3), 0.0, 0.0, 0.0, np.zeros(n, bool), np.zeros(n))
    path = TrajectoryMotion(np.arange(n), np.array([0.0, 1.0]), np.zeros((2, n)), np.zeros((2, n)))
    for integral in (None, OuterIntegral(IntegralGains(*np.zeros((4, n))), limits.period)):
        motion = JointTrajectory(path, Gains(command.stiffness, command.damping, integral), limits.period)
        motion.activate(robot, command)
        motion.update(robot, command)
        motion.clock.hold()
    gains = Gains(command.stiffness, command.damping)
    stream = JointStream(StreamMotion(path.joints, 1.0, 1.0, 1.0), gains, limits.period)
    stream.activate(robot, command)
    stream.update(robot, command)
    bodies = Bodies.of(kinematics)
    braking, kept = Braking(kinematics, bodies.limits, limits.period), bodies.kept()
    braking.look(kept.moving, 0.0)
    judge(command.table, command.table, state.table, braking.limits, kept.table, limits.period, COMMANDED)
    followed(path.joints, command.position, state)
    enforce(JointCommand(n), command, JointCommand(n), state, limits)
