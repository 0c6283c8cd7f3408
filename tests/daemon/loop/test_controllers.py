"""Paths, the path clock, the path force, Cartesian impedance."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicHermiteSpline

from daemon.controllers.joint_trajectory import PathForceIntegrator
from daemon.controllers.references import HermitePath, LinePath, PathClock
from daemon.exchange import ActionState, Answer, Outcome
from hal.joint import JointCommand
from handrail.messages import CartesianImpedance, PathForce, Pose

TIP = "tool_right_tip"


def test_knots_are_joined_by_cubic_hermite_polynomials() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.05, 0.4, 12)) - 0.05
    times -= times[0]
    positions, velocities = rng.normal(size=(12, 3)), rng.normal(size=(12, 3))
    path, exact = HermitePath(times, positions, velocities), CubicHermiteSpline(times, positions, velocities)
    position, velocity = np.zeros(3), np.zeros(3)
    for s in np.linspace(0.0, times[-1] - 1e-9, 200):
        path.evaluate(s, position, velocity)
        assert position == pytest.approx(exact(s))
        assert velocity == pytest.approx(exact(s, 1))
    path.evaluate(times[-1] + 1.0, position, velocity)
    assert position == pytest.approx(positions[-1])


def test_the_path_clock_keeps_the_plans_time_to_the_end() -> None:
    clock = PathClock(1.0, 0.002)
    for _ in range(499):
        clock.advance()
    assert not clock.at_end
    assert clock.s == pytest.approx(0.998)
    clock.advance()
    clock.advance()
    assert clock.at_end
    assert clock.s == 1.0


def test_the_path_clock_slows_and_speeds_up_within_its_limits() -> None:
    clock, rates = PathClock(100.0, 0.002), []
    for cycle in range(1500):
        if cycle == 100:
            clock.hold()
        if cycle == 700:
            clock.go()
        clock.advance()
        rates.append(clock.rate)
    rates_array = np.array(rates)
    acceleration = np.diff(rates_array) / 0.002
    assert rates_array[600] == 0.0
    assert rates_array[-1] == 1.0
    assert np.abs(acceleration).max() < 5.0 + 1e-6
    assert np.abs(np.diff(acceleration)).max() / 0.002 < 60.0 + 1e-3
    assert rates_array.min() >= 0.0


def test_the_path_clock_takes_a_change_of_mind_while_it_slows_down() -> None:
    clock = PathClock(100.0, 0.002)
    clock.hold()
    for _ in range(40):
        clock.advance()
    before = clock.rate
    assert 0.0 < before < 1.0
    clock.go()
    clock.advance()
    assert abs(clock.rate - before) < 0.02
    for _ in range(400):
        clock.advance()
    assert clock.rate == 1.0


def test_a_line_goes_straight_and_turns_the_short_way() -> None:
    start = pin.SE3(pin.exp3(np.array([0.1, -0.2, 0.3])), np.array([0.3, 0.1, 0.2]))
    goal = pin.SE3(pin.exp3(np.array([0.5, 0.4, -0.3])), np.array([0.5, -0.1, 0.4]))
    line = LinePath(start.rotation, start.translation, goal, 2.0)
    rotation, translation, linear, angular = line.evaluate(0.0)
    assert (rotation, translation) == (pytest.approx(start.rotation), pytest.approx(start.translation))
    assert (linear, angular) == (pytest.approx(np.zeros(3)), pytest.approx(np.zeros(3)))
    rotation, translation, linear, angular = line.evaluate(0.7)
    later = line.evaluate(0.7 + 1e-6)
    assert np.cross(translation - start.translation, goal.translation - start.translation) == pytest.approx(np.zeros(3))
    assert (later[1] - translation) / 1e-6 == pytest.approx(linear, abs=1e-5)
    assert pin.log3(later[0] @ rotation.T) / 1e-6 == pytest.approx(angular, abs=1e-5)
    rotation, translation, *_ = line.evaluate(2.0)
    assert (rotation, translation) == (pytest.approx(goal.rotation), pytest.approx(goal.translation))


def test_the_path_force_grows_with_the_lag_up_to_its_limit_and_never_pulls_back(bench) -> None:
    bench.enable()
    robot = bench.loop.robot
    commanded = JointCommand(len(robot.joints))
    commanded.position[:] = robot.joints.position
    joint = bench.index("arm_right_1_joint")
    commanded.velocity[joint] = 0.4
    commanded.position[joint] += 0.02
    robot.update(commanded)
    force = PathForceIntegrator(PathForce(frame=TIP, gain=1500.0, limit=20.0), np.ones(len(robot.joints), bool))
    force.torque(robot)
    velocity = robot.carried(TIP).velocity
    direction = velocity / np.linalg.norm(velocity)
    assert force.force == pytest.approx(1500.0 * float(direction @ robot.lag(TIP)) * 0.002)
    assert force.force > 0.0
    torque = force.torque(robot)
    assert torque == pytest.approx(robot.jacobian(TIP)[:3].T @ (force.force * direction))
    commanded.velocity[joint] = 0.0
    robot.update(commanded)
    for _ in range(2000):
        force.torque(robot)
    assert force.force == 20.0, "where the path stands, its last direction counts"
    commanded.position[joint] -= 0.04
    commanded.velocity[joint] = 0.4
    robot.update(commanded)
    for _ in range(2000):
        force.torque(robot)
    assert force.force == 0.0


def test_a_path_force_overcomes_a_friction_that_impedance_alone_does_not(bench) -> None:
    """A joint that takes 14 N·m to move, at 250 N·m/rad: without help the tool stays behind."""
    bench.enable()
    joint = bench.index("arm_right_4_joint")
    lag = {}
    for help_it in (False, True):
        force = PathForce(frame=TIP, gain=3000.0, limit=60.0) if help_it else None
        start = bench.loop.written.position[joint]
        assert bench.start(bench.move("arm_right_4_joint", 0.3, 1.5, path_force=force)) is Answer.ACCEPTED

        def resist() -> None:
            moving = bench.drives.state.velocity[joint] > 1e-3
            bench.drives.external_torque[joint] = -14.0 if moving else 0.0

        while bench.action(int(help_it))[0] is not ActionState.ENDED:
            bench.run(1, resist)
        lag[help_it] = bench.loop.written.position[joint] - bench.drives.state.position[joint]
        assert bench.loop.written.position[joint] == pytest.approx(start + 0.3)
        bench.drives.external_torque[joint] = 0.0
        bench.run(300)
    assert lag[True] < 0.6 * lag[False]


def tool_goal(bench, kinematics, shift: list[float], turn: list[float]) -> tuple[CartesianImpedance, pin.SE3]:
    arm = bench.description.arms["right"]
    tip = kinematics.frame(bench.loop.written.position, arm.tip)
    goal = pin.SE3(pin.exp3(np.array(turn)) @ tip.rotation, tip.translation + np.array(shift))
    x, y, z, w = (float(value) for value in pin.Quaternion(goal.rotation).coeffs())
    px, py, pz = (float(value) for value in goal.translation)
    pose = Pose(position=(px, py, pz), orientation=(x, y, z, w))
    return CartesianImpedance(frame=arm.tip, joints=list(arm.joints), goal_in_world=pose, duration=0.8), goal


def test_cartesian_impedance_brings_the_tool_to_its_goal_and_holds_it(bench, talos_kinematics) -> None:
    bench.enable()
    motion, goal = tool_goal(bench, talos_kinematics, [0.05, -0.04, 0.06], [0.0, 0.2, -0.1])
    assert bench.start(motion) is Answer.ACCEPTED
    while bench.action()[0] is not ActionState.ENDED:
        bench.run()
    assert bench.action()[1] is Outcome.DONE
    bench.run(400)
    tip = talos_kinematics.frame(bench.drives.state.position, TIP)
    assert tip.translation == pytest.approx(goal.translation, abs=4e-3)
    assert np.linalg.norm(pin.log3(tip.rotation.T @ goal.rotation)) < 0.02
    assert bench.loop.last_word.limited == 0


def test_cartesian_impedance_gives_way_like_its_spring(bench, talos_kinematics) -> None:
    bench.enable()
    motion, _ = tool_goal(bench, talos_kinematics, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    motion.duration = 3.0
    motion.stiffness = (600.0, 20.0)
    bench.start(motion)
    jacobian = talos_kinematics.jacobian(bench.drives.state.position, TIP)[:3]
    bench.drives.external_torque[:] = jacobian.T @ [0.0, 12.0, 0.0]
    before = talos_kinematics.frame(bench.drives.state.position, TIP).translation
    bench.run(1200)
    assert bench.action()[0] is ActionState.RUNNING
    moved = talos_kinematics.frame(bench.drives.state.position, TIP).translation - before
    assert 0.5 * 0.02 < moved[1] < 1.5 * 0.02


def test_cartesian_impedance_stops_at_a_joint_limit_instead_of_being_refused(bench, talos_kinematics) -> None:
    bench.enable()
    motion, _ = tool_goal(bench, talos_kinematics, [0.35, 0.0, 0.3], [0.0, 0.0, 0.0])
    motion.duration = 1.5
    bench.start(motion)
    while bench.action()[0] is not ActionState.ENDED:
        bench.run()
    assert bench.action()[1] is not Outcome.REFUSED_BY_LIMITS
    assert (bench.loop.written.position <= bench.description.upper + 1e-9).all()
    assert (bench.loop.written.position >= bench.description.lower - 1e-9).all()
