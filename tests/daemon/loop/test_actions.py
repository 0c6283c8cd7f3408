"""Actions: what is refused, what ends them, what their owners may do."""

import numpy as np
import pytest

from daemon.exchange import SLOTS, ActionState, Answer, Kind, Outcome
from daemon.safety.bounds import DIVERGED
from handrail.messages import (
    ContactEnd,
    DivergenceEnd,
    ForceEnd,
    JointLimitEnd,
    JointTrajectory,
    PoseErrorEnd,
    TimeEnd,
    TorqueLimitEnd,
)

TIP = "tool_right_tip"


@pytest.fixture
def enabled(bench):
    bench.enable()
    return bench


def run_to_end(bench, slot: int = 0, cycles: int = 2000) -> Outcome:
    for _ in range(cycles):
        state, outcome = bench.action(slot)
        if state is ActionState.ENDED:
            return outcome
        bench.run()
    raise AssertionError("the action did not end")


def test_a_trajectory_is_followed_to_its_end_and_held_there(enabled) -> None:
    bench, joint = enabled, enabled.index("arm_right_4_joint")
    start = bench.loop.written.position[joint]
    assert bench.start(bench.move("arm_right_4_joint", 0.4)) is Answer.ACCEPTED
    assert run_to_end(bench) is Outcome.DONE
    snapshot = bench.snapshot()
    assert snapshot["actions"][0]["cycle"] == snapshot["cycle"]
    assert snapshot["actions"][0]["command"][joint] == pytest.approx(start + 0.4)
    snapshot = bench.run(200)
    assert snapshot["position"][joint] == pytest.approx(start + 0.4, abs=2e-3)
    assert snapshot["limited"] == 0


def test_nothing_starts_before_the_robot_is_enabled(bench) -> None:
    bench.run(3)
    assert bench.start(bench.move("arm_right_1_joint", 0.1)) is Answer.NOT_ENABLED


def test_a_trajectory_that_starts_elsewhere_is_refused(enabled) -> None:
    motion = enabled.move("arm_right_1_joint", 0.1)
    for off, answer in ((0.021, Answer.START_OFF), (0.019, Answer.ACCEPTED)):
        shifted = [[position + off for position in knot] for knot in motion.positions]
        moved = JointTrajectory(
            joints=motion.joints, times=motion.times, positions=shifted, velocities=motion.velocities
        )
        assert enabled.start(moved) is answer
    snapshot = enabled.run(400)
    assert snapshot["limited"] == 0, "what lies between command and first knot is worked off smoothly"


def test_a_joint_of_a_running_action_is_refused_to_another(enabled) -> None:
    enabled.start(enabled.move("arm_right_1_joint", 0.1))
    assert enabled.start(enabled.move("arm_right_1_joint", 0.1), owner=2) is Answer.CLAIMED
    assert enabled.snapshot()["answer_joint"] == enabled.index("arm_right_1_joint")
    assert enabled.start(enabled.move("arm_left_1_joint", 0.1), owner=2) is Answer.ACCEPTED


def test_more_actions_than_slots_are_refused(enabled) -> None:
    for number in range(SLOTS):
        assert enabled.start(enabled.move(f"arm_right_{number + 1}_joint", 0.1)) is Answer.ACCEPTED
    assert enabled.start(enabled.move("arm_left_1_joint", 0.1)) is Answer.TOO_MANY


def test_an_expired_start_is_refused(enabled) -> None:
    past = max(1, enabled.loop.time_ns - 1)
    assert enabled.start(enabled.move("arm_right_1_joint", 0.1), expires_ns=past) is Answer.EXPIRED
    later = enabled.loop.time_ns + 10**9
    assert enabled.start(enabled.move("arm_right_1_joint", 0.1), expires_ns=later) is Answer.ACCEPTED


def test_a_pause_stops_on_the_path_and_a_resume_goes_on(enabled) -> None:
    bench, joint = enabled, enabled.index("arm_right_1_joint")
    start = bench.loop.written.position[joint]
    serial = bench.post_start(bench.move("arm_right_1_joint", 0.6, 1.0))
    bench.run(200)
    steps = []
    last = bench.loop.written.velocity[joint]

    def note() -> None:
        nonlocal last
        steps.append(abs(bench.loop.written.velocity[joint] - last))
        last = bench.loop.written.velocity[joint]

    assert bench.ask(Kind.PAUSE, action=serial) is Answer.ACCEPTED
    bench.run(250, note)
    assert bench.action()[0] is ActionState.PAUSED
    stood = bench.loop.written.position[joint]
    bench.run(100, note)
    assert bench.loop.written.position[joint] == stood
    assert 0.1 < stood - start < 0.5
    assert bench.ask(Kind.RESUME, action=serial) is Answer.ACCEPTED
    bench.run(5, note)
    assert bench.action()[0] is ActionState.RUNNING
    while bench.action()[0] is ActionState.RUNNING:
        bench.run(1, note)
    assert bench.action()[1] is Outcome.DONE
    assert max(steps) < 0.03, "no step of the commanded velocity: the rate is jerk-limited"
    assert bench.loop.written.position[joint] == pytest.approx(start + 0.6)


def test_a_cancelled_action_slows_down_and_holds_where_it_stands(enabled) -> None:
    bench, joint = enabled, enabled.index("arm_right_1_joint")
    serial = bench.post_start(bench.move("arm_right_1_joint", 0.6, 1.0))
    bench.run(200)
    assert bench.ask(Kind.CANCEL, action=serial) is Answer.ACCEPTED
    assert bench.ask(Kind.RESUME, action=serial) is Answer.NO_SUCH_ACTION, "a cancellation stands"
    assert run_to_end(bench) is Outcome.CANCELLED
    stood = bench.loop.written.position[joint]
    snapshot = bench.run(300)
    assert snapshot["command"][0][joint] == stood
    assert snapshot["position"][joint] == pytest.approx(stood, abs=2e-3)


def test_a_paused_action_can_be_cancelled(enabled) -> None:
    serial = enabled.post_start(enabled.move("arm_right_1_joint", 0.6, 1.0))
    enabled.run(100)
    enabled.ask(Kind.PAUSE, action=serial)
    enabled.run(250)
    enabled.ask(Kind.CANCEL, action=serial)
    assert run_to_end(enabled) is Outcome.CANCELLED


@pytest.mark.parametrize("kind", [Kind.PAUSE, Kind.RESUME, Kind.CANCEL])
def test_what_does_not_run_cannot_be_steered(enabled, kind: Kind) -> None:
    assert enabled.ask(kind, action=4711) is Answer.NO_SUCH_ACTION


def test_a_lost_owners_actions_end_safely_and_others_go_on(enabled) -> None:
    enabled.start(enabled.move("arm_right_1_joint", 0.3, 2.0), owner=1)
    enabled.start(enabled.move("arm_left_1_joint", 0.3, 2.0), owner=2)
    enabled.run(100)
    enabled.ask(Kind.LOSE_OWNER, owner=1)
    assert run_to_end(enabled, 0) is Outcome.OWNER_LOST
    assert enabled.action(1)[0] is ActionState.RUNNING


def test_a_time_end_trips_in_its_cycle_and_pauses_do_not_count(enabled) -> None:
    serial = enabled.post_start(enabled.move("arm_right_1_joint", 0.6, 3.0), (TimeEnd(after=0.5),))
    enabled.run(100)
    enabled.ask(Kind.PAUSE, action=serial)
    enabled.run(400)
    assert enabled.action()[0] is ActionState.PAUSED
    enabled.ask(Kind.RESUME, action=serial)
    assert run_to_end(enabled) is Outcome.CONDITION
    assert enabled.snapshot()["actions"][0]["value"] == pytest.approx(0.5, abs=0.003)


def test_the_guard_that_trips_ends_the_motion_in_that_cycle(enabled) -> None:
    bench, joint = enabled, enabled.index("arm_right_4_joint")
    ends = (TimeEnd(after=9.0), PoseErrorEnd(frame=TIP, position=0.02))
    bench.start(bench.move("arm_right_4_joint", 0.5, 1.0), ends)
    bench.drives.external_torque[joint] = -60.0
    assert run_to_end(bench) is Outcome.CONDITION
    row = bench.snapshot()["actions"][0]
    assert (row["condition"], row["cycle"]) == (1, bench.snapshot()["cycle"])
    assert 0.02 < row["value"] < 0.03
    assert (bench.snapshot()["claims"][:, joint] == 1).all(), "hold has taken over in the same cycle"
    stood = bench.loop.written.position[joint]
    assert bench.run(100)["command"][0][joint] == pytest.approx(stood)


def test_a_pose_error_across_its_axis_does_not_count(enabled, talos_kinematics) -> None:
    bench, joint = enabled, enabled.index("arm_right_4_joint")
    lever = talos_kinematics.jacobian(bench.loop.written.position, TIP)[:3, joint]
    across = np.cross(lever, [0.3, 0.5, 0.8])
    ends = (PoseErrorEnd(frame=TIP, position=0.01, axis=tuple(across.tolist())),)
    bench.start(bench.move("arm_left_4_joint", 0.2, 1.0), ends)
    bench.drives.external_torque[joint] = -15.0
    bench.run(200)
    assert bench.action()[0] is ActionState.RUNNING


@pytest.mark.parametrize("by_axis", [True, False])
def test_a_touch_is_felt_through_the_joints(enabled, talos_kinematics, by_axis: bool) -> None:
    bench = enabled
    end = ForceEnd(frame=TIP, axis=(1.0, 0.0, 0.0), limit=12.0) if by_axis else ContactEnd(frame=TIP, threshold=12.0)
    bench.start(bench.move("arm_right_1_joint", 0.01, 4.0), (end,))
    bench.run(300)
    assert bench.action()[0] is ActionState.RUNNING
    assert np.abs(bench.snapshot()["external_force"]).max() < 2.0
    jacobian = talos_kinematics.jacobian(bench.drives.state.position, TIP)[:3]
    bench.drives.external_torque[:] = jacobian.T @ [-20.0, 0.0, 0.0]
    assert run_to_end(bench, cycles=400) is Outcome.CONDITION


def test_the_force_estimate_agrees_with_the_force_once_all_is_still(enabled, talos_kinematics) -> None:
    bench = enabled
    bench.start(bench.move("head_1_joint", 0.01, 20.0), (ContactEnd(frame=TIP, threshold=900.0),))
    jacobian = talos_kinematics.jacobian(bench.drives.state.position, TIP)[:3]
    force = np.array([10.0, -6.0, 4.0])
    bench.drives.external_torque[:] = jacobian.T @ force
    snapshot = bench.run(800)
    assert snapshot["external_force"] == pytest.approx(force, abs=1.0)


def test_a_joint_near_its_limit_ends_an_action_that_asks_for_it(enabled) -> None:
    joint = enabled.index("arm_right_4_joint")
    room = enabled.drives.state.position[joint] - enabled.description.lower[joint]
    enabled.start(enabled.move("arm_right_4_joint", -(room - 0.05), 1.0), (JointLimitEnd(margin=0.1),))
    assert run_to_end(enabled) is Outcome.CONDITION
    assert enabled.snapshot()["actions"][0]["joint"] == joint


def test_a_spring_that_bears_more_than_its_share_ends_the_action(enabled) -> None:
    joint = enabled.index("arm_right_4_joint")
    enabled.start(enabled.move("arm_right_4_joint", 0.01, 4.0), (TorqueLimitEnd(share=0.5),))
    enabled.run(100)
    assert enabled.action()[0] is ActionState.RUNNING
    enabled.drives.external_torque[joint] = -0.55 * enabled.description.torque_limit[joint]
    assert run_to_end(enabled) is Outcome.CONDITION
    row = enabled.snapshot()["actions"][0]
    assert (row["joint"], row["value"]) == (joint, pytest.approx(0.5, abs=0.05))
    enabled.drives.external_torque[joint] = 0.0


@pytest.mark.parametrize(
    ("ends", "outcome"), [((DivergenceEnd(error=0.1),), Outcome.CONDITION), ((), Outcome.DIVERGED)]
)
def test_a_joint_pushed_away_from_its_command_ends_the_action(enabled, ends, outcome: Outcome) -> None:
    joint = enabled.index("arm_right_7_joint")
    enabled.start(enabled.move("arm_right_7_joint", 0.05, 5.0), ends)
    enabled.drives.external_torque[joint] = 30.0  # more than its drive can hold
    assert run_to_end(enabled) is outcome
    row = enabled.snapshot()["actions"][0]
    assert row["joint"] == joint
    assert row["value"] >= (0.1 if ends else DIVERGED)


def test_a_trajectory_beyond_the_limits_is_refused_while_it_runs(enabled) -> None:
    joint = enabled.index("arm_right_4_joint")
    room = enabled.drives.state.position[joint] - enabled.description.lower[joint]
    enabled.start(enabled.move("arm_right_4_joint", -(room + 0.2), 1.5))
    assert run_to_end(enabled) is Outcome.REFUSED_BY_LIMITS
    assert (enabled.loop.written.position >= enabled.description.lower - 1e-9).all()
