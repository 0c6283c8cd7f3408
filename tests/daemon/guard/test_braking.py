"""How long the guard lets braking take, against the torques that it then needs."""

from __future__ import annotations

import numpy as np

from daemon.safety.bodies import Bodies
from daemon.safety.braking import Braking
from daemon.safety.separation import COMMANDED, judge
from hal.joint import JointCommand, JointState
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics


def test_braking_by_the_present_inertia_is_shorter_and_its_torques_are_those_that_the_joints_have() -> None:
    kinematics = Kinematics(robots.load("talos_upper"))
    description, bodies = kinematics.description, Bodies.of(kinematics)
    n, period = len(description.joints), description.period_ns * 1e-9
    command, last, state = JointCommand(n), JointCommand(n), JointState(n)
    command.stiffness[:] = description.stiffness
    random, shares = np.random.default_rng(5), []
    u = np.linspace(0.0, 1.0, 21)
    for _ in range(30):
        position = random.uniform(description.lower, description.upper)
        velocity = random.uniform(-0.5, 0.5, n) * description.velocity_limit
        command.position[:], state.position[:] = position, position
        last.position[:] = position - velocity * period
        braking, kept = Braking(kinematics, bodies.limits, period), bodies.kept()

        def duration(braking: Braking = braking, kept=kept) -> float:
            told = (command.table, last.table, state.table, braking.limits)
            return judge(*told, kept.table, period, COMMANDED)[1]

        worst = duration()
        assert braking.look(kept.moving, worst)
        assert not braking.look(kept.moving, worst), "it has just been done"
        takes = duration()
        shares.append(takes / worst)
        way, rate, slope = takes * (u - u**3 + 0.5 * u**4), 1.0 - u * u * (3.0 - 2.0 * u), -6.0 * u * (1.0 - u) / takes
        torque = kinematics.inverse_dynamics(
            position + way[:, None] * velocity, rate[:, None] * velocity, slope[:, None] * velocity
        )
        assert (np.abs(torque) / description.torque_limit).max() < 1.0
    assert max(shares) <= 1.0
    assert np.median(shares) < 0.8
