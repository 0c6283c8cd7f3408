"""Claims, whole switches, and what a switch does at the drives."""

import dataclasses

import numpy as np
import pytest

from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.controllers.manager import ClaimError
from daemon.exchange import CONTROLLERS, Answer, Kind, Outcome, TrajectoryMotion
from handrail.messages import CartesianImpedance, DivergenceEnd, Pose, TimeEnd

HOLD, TRAJECTORY = CONTROLLERS.index("hold"), CONTROLLERS.index("joint_trajectory")


def trajectory(bench, joints: list[int]) -> JointTrajectory:
    still = bench.loop.written.position[joints]
    motion = TrajectoryMotion(
        np.array(joints), np.array([0.0, 1.0]), np.array([still, still]), np.zeros((2, len(joints)))
    )
    return JointTrajectory(motion, bench.loop.manager.gains, 0.002)


def test_every_joint_of_an_enabled_robot_has_one_controller(bench) -> None:
    bench.enable()
    manager = bench.loop.manager
    assert set(manager.claims.flat) == {HOLD}
    first, second = trajectory(bench, [0, 1]), trajectory(bench, [5])
    manager.switch([], [first, second], bench.loop.written)
    assert list(np.flatnonzero(manager.claims[0] == TRAJECTORY)) == [0, 1, 5]
    assert sum(len(controller.joints) for controller in manager.active) == manager.claims.shape[1]
    manager.switch([first], [], bench.loop.written)
    assert list(np.flatnonzero(manager.claims[0] == TRAJECTORY)) == [5]
    assert sum(len(controller.joints) for controller in manager.active) == manager.claims.shape[1]


def test_a_switch_that_claims_a_joint_twice_changes_nothing(bench) -> None:
    bench.enable()
    manager = bench.loop.manager
    running = trajectory(bench, [3])
    manager.switch([], [running], bench.loop.written)
    claims, active = manager.claims.copy(), list(manager.active)
    with pytest.raises(ClaimError) as raised:
        manager.switch([], [trajectory(bench, [7]), trajectory(bench, [2, 3])], bench.loop.written)
    assert raised.value.joint == 3
    assert manager.active == active
    assert np.array_equal(manager.claims, claims)


def test_a_controller_may_take_over_the_joints_of_one_that_goes_in_the_same_cycle(bench) -> None:
    bench.enable()
    manager = bench.loop.manager
    old, new = trajectory(bench, [3]), trajectory(bench, [3, 4])
    manager.switch([], [old], bench.loop.written)
    manager.switch([old], [new], bench.loop.written)
    assert list(np.flatnonzero(manager.claims[0] == TRAJECTORY)) == [3, 4]


def rated_jump(bench) -> float:
    """The largest change of any drive's torque by the command of this cycle, as a share of its rated torque."""
    return float((np.abs(bench.drives.jumps[-1]) / bench.description.torque_limit).max())


@pytest.fixture
def free_bench(bench):
    """Enabled, with the torque rate limiter off, so that it can't hide a bump."""
    limits = bench.loop.last_word.limits
    bench.loop.last_word.limits = dataclasses.replace(limits, torque_step=np.full_like(limits.torque_step, np.inf))
    bench.enable()
    return bench


def test_switches_to_and_from_a_trajectory_are_bumpless_at_the_drives(free_bench) -> None:
    bench = free_bench
    # Something leans on the arm, so that springs are deflected when the switches come.
    bench.drives.external_torque[:7] = [8.0, -6.0, 5.0, 5.0, 1.5, 0.6, -0.6]
    bench.run(400)
    deflection = np.abs(bench.drives.state.position - bench.loop.written.position)
    assert (deflection[:7] > 0.005).all()
    assert bench.start(bench.move("arm_right_2_joint", 0.2, 0.4)) is Answer.ACCEPTED
    assert rated_jump(bench) < 0.01
    while bench.action()[1] is Outcome.NONE:
        bench.run()
    assert rated_jump(bench) < 0.01


def test_a_guard_that_trips_in_full_motion_is_bumpless_at_the_drives(free_bench) -> None:
    bench = free_bench
    assert bench.start(bench.move("arm_right_1_joint", 0.6, 0.8), (TimeEnd(after=0.4),)) is Answer.ACCEPTED
    while bench.action()[1] is Outcome.NONE:
        bench.run()
    moving = abs(bench.drives.state.velocity[bench.index("arm_right_1_joint")])
    assert moving > 1.0
    assert rated_jump(bench) < 0.01
    jumps = []
    bench.run(250, lambda: jumps.append(rated_jump(bench)))
    assert max(jumps) < 0.05, "the offset is let go smoothly"
    assert abs(bench.drives.state.velocity[bench.index("arm_right_1_joint")]) < 0.05


def test_switches_to_and_from_cartesian_impedance_are_bumpless_at_the_drives(free_bench, talos_kinematics) -> None:
    bench = free_bench
    bench.drives.external_torque[:7] = [8.0, -6.0, 5.0, 5.0, 1.5, 0.6, -0.6]
    bench.run(400)
    arm = bench.description.arms["right"]
    tip = talos_kinematics.frame(bench.loop.written.position, arm.tip)
    goal = tip.translation + np.array([0.05, 0.0, 0.05])
    x, y, z, w = (float(value) for value in _quaternion(tip.rotation))
    motion = CartesianImpedance(
        frame=arm.tip,
        joints=list(arm.joints),
        goal_in_world=Pose(position=tuple(goal.tolist()), orientation=(x, y, z, w)),
        duration=0.5,
    )
    assert bench.start(motion) is Answer.ACCEPTED
    assert rated_jump(bench) < 0.01
    while bench.action()[1] is Outcome.NONE:
        bench.run()
    assert rated_jump(bench) < 0.01


def test_a_joint_that_stays_held_notices_nothing_of_a_switch(free_bench) -> None:
    bench = free_bench
    bench.drives.external_torque[:] = 0.5
    bench.run(400)
    head = bench.index("head_1_joint")
    before = bench.drives.seen[-1]
    bench.start(bench.move("arm_left_4_joint", 0.2))
    after = bench.drives.seen[-1]
    assert after.position[head] == before.position[head]
    assert after.torque[head] == pytest.approx(before.torque[head], abs=0.03)
    assert after.stiffness[head] == before.stiffness[head]


def test_without_the_offset_the_same_switch_is_seen_to_jump(free_bench, monkeypatch) -> None:
    bench = free_bench
    monkeypatch.setattr("daemon.controllers.manager.FADE", 0.0)
    assert bench.start(bench.move("arm_right_1_joint", 0.6, 0.8), (TimeEnd(after=0.4),)) is Answer.ACCEPTED
    while bench.action()[1] is Outcome.NONE:
        bench.run()
    assert rated_jump(bench) > 0.2


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    import pinocchio as pin

    return pin.Quaternion(rotation).coeffs()


def test_a_switch_begun_in_the_cycle_of_a_stop_leaves_no_mark_on_the_next_enabling(bench) -> None:
    bench.enable()
    gravity = bench.drives.seen[0].torque.copy()
    assert np.abs(gravity).max() > 1.0
    manager = bench.loop.manager
    manager.switch([], [trajectory(bench, list(range(manager.claims.shape[1])))], bench.loop.written)
    bench.loop.life.stop("in the same cycle")
    bench.run(5)
    bench.loop.life.clear_stop()
    before = len(bench.drives.seen)
    bench.enable()
    assert np.abs(bench.drives.seen[before].torque - gravity).max() < 0.1, (
        "the arm is carried from the first command on"
    )


def test_disabling_takes_every_claim_away(bench) -> None:
    bench.enable()
    bench.start(bench.move("arm_right_1_joint", 0.1), (DivergenceEnd(error=0.3),))
    assert bench.ask(Kind.DISABLE) is Answer.ACCEPTED
    snapshot = bench.run(5)
    assert not snapshot["claims"].any()
    assert bench.action()[1] is Outcome.CANCELLED
