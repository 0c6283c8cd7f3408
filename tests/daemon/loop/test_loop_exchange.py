"""Commands and snapshots survive the way through shared memory."""

import numpy as np
import pytest

from daemon import exchange
from daemon.exchange import CartesianMotion, Kind, TaskFrameMotion, TrajectoryMotion
from daemon.exchange.commands import COMPLIANCE_ROWS
from handrail.messages import (
    CartesianImpedance,
    Compliance,
    CompliantMotion,
    ContactEnd,
    Dither,
    DivergenceEnd,
    ForceEnd,
    JointLimitEnd,
    JointTrajectory,
    PathForce,
    Pose,
    PoseErrorEnd,
    StallEnd,
    StartAction,
    TimeEnd,
    TorqueLimitEnd,
    TravelEnd,
)

JOINTS = {"a": 0, "b": 1, "c": 2}
NAMES = ("base", "tip")
FRAMES = {name: index for index, name in enumerate(NAMES)}
ENDS = [
    TimeEnd(after=1.5),
    PoseErrorEnd(frame="tip", position=0.02, axis=(0.0, 0.0, 1.0)),
    PoseErrorEnd(frame="base", position=0.03),
    ForceEnd(frame="tip", axis=(1.0, 0.0, 0.0), limit=30.0),
    ContactEnd(frame="tip", threshold=4.0),
    JointLimitEnd(margin=0.0),
    DivergenceEnd(error=0.2),
    TorqueLimitEnd(share=0.75),
    StallEnd(frame="tip", distance=0.001, within=0.5),
    TravelEnd(frame="tip", distance=0.05),
    TravelEnd(frame="base", distance=0.04, axis=(0.0, 1.0, 0.0)),
]


def test_a_trajectory_comes_through_as_it_was_sent() -> None:
    motion = JointTrajectory(
        joints=["c", "a"],
        times=[0.0, 0.5, 1.0],
        positions=[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]],
        velocities=[[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]],
        path_force=PathForce(frame="tip", gain=100.0, limit=7.0),
    )
    message = StartAction(id="x", owner="y", motion=motion, ends=ENDS, expires_ns=12, hold_after_s=0.25)
    header, payload = exchange.encode_start(message, 41, 3, JOINTS, FRAMES)
    command = exchange.decode(header.reshape(1), payload, NAMES)
    payload[:] = np.nan  # the slot is given back: the command must own what it needs
    assert (command.serial, command.kind, command.owner) == (41, Kind.START, 3)
    assert (command.expires_ns, command.value) == (12, 0.25)
    assert isinstance(command.motion, TrajectoryMotion)
    assert list(command.motion.joints) == [2, 0]
    assert command.motion.times.tolist() == motion.times
    assert command.motion.positions.tolist() == motion.positions
    assert command.motion.velocities.tolist() == motion.velocities
    assert command.motion.path_force == motion.path_force
    assert list(command.ends) == ENDS


def test_a_cartesian_motion_comes_through_as_it_was_sent() -> None:
    goal = Pose(position=(1.0, 2.0, 3.0), orientation=(0.0, 0.6, 0.0, 0.8))
    motion = CartesianImpedance(frame="tip", joints=["b"], goal_in_world=goal, duration=2.0, stiffness=(9.0, 1.0))
    header, payload = exchange.encode_start(StartAction(id="x", owner="y", motion=motion), 1, 1, JOINTS, FRAMES)
    command = exchange.decode(header, payload, NAMES)
    assert isinstance(command.motion, CartesianMotion)
    assert (command.motion.frame, command.motion.goal_in_world) == ("tip", goal)
    assert (command.motion.duration, command.motion.stiffness) == (2.0, (9.0, 1.0))


def test_a_compliant_motion_comes_through_with_what_it_left_out_filled_in() -> None:
    motion = CompliantMotion(
        frame="tip",
        joints=["b", "c"],
        duration=1.5,
        shift=(0.0, 0.1, 0.0),
        axes=(0.0, 0.6, 0.0, 0.8),
        axes_in="frame",
        compliance=[Compliance(axis="z", force=20.0), Compliance(axis="rx", stiffness=3.0, damping=4.0, reach=0.2)],
        dither=[Dither(axis="y", amplitude=0.002, frequency=5.0)],
        stiffness=(700.0, 30.0),
    )
    header, payload = exchange.encode_start(StartAction(id="x", owner="y", motion=motion), 1, 1, JOINTS, FRAMES)
    command = exchange.decode(header, payload, NAMES)
    task = command.motion
    assert isinstance(task, TaskFrameMotion)
    assert (task.frame, task.goal_in_world, task.duration, task.stiffness) == ("tip", None, 1.5, (700.0, 30.0))
    assert (task.shift.tolist(), task.axes.tolist(), task.turns_with_frame) == ([0, 0.1, 0], [0, 0.6, 0, 0.8], True)
    compliance = {name: row.tolist() for name, row in zip(COMPLIANCE_ROWS, task.compliance, strict=True)}
    assert compliance == {
        "on": [0, 0, 1, 1, 0, 0],
        "force": [0, 0, 20.0, 0, 0, 0],
        "stiffness": [0, 0, 0, 3.0, 0, 0],
        "damping": [0, 0, 100.0, 4.0, 0, 0],
        "speed": [0, 0, 0.03, 0.2, 0, 0],
        "reach": [0, 0, 0.1, 0.2, 0, 0],
    }
    assert task.dither.tolist() == [[0, 0.002, 0, 0, 0, 0], [0, 5.0, 0, 0, 0, 0]]
    with pytest.raises(ValueError, match="56 numbers"):
        exchange.decode(header, payload[:-1], NAMES)


@pytest.mark.parametrize(
    "change", [{"knot_count": 9}, {"joint_count": 0}, {"joint_count": 900}, {"kind": 99}, {"frame": 7}]
)
def test_a_header_that_does_not_fit_its_payload_is_no_command(change: dict[str, int]) -> None:
    motion = JointTrajectory(joints=["a"], times=[0.0, 1.0], positions=[[0.0], [1.0]], velocities=[[0.0], [0.0]])
    header, payload = exchange.encode_start(StartAction(id="x", owner="y", motion=motion), 1, 1, JOINTS, FRAMES)
    for field, value in change.items():
        header[field] = value
    with pytest.raises((ValueError, IndexError)):
        exchange.decode(header, payload, NAMES)


def test_more_than_a_command_holds_is_refused_by_name() -> None:
    motion = JointTrajectory(joints=["a"], times=[0.0], positions=[[0.0]], velocities=[[0.0]])
    many = StartAction(id="x", owner="y", motion=motion, ends=[TimeEnd(after=1.0)] * 17)
    with pytest.raises(ValueError, match="ends: 17"):
        exchange.encode_start(many, 1, 1, JOINTS, FRAMES)


def test_every_answer_but_acceptance_can_be_explained_to_people() -> None:
    for answer in exchange.Answer:
        if answer not in (exchange.Answer.NONE, exchange.Answer.ACCEPTED):
            message, field, _, expected = exchange.explain(answer, "elbow", 0.03)
            assert message
            assert field
            assert expected


def test_loop_and_server_agree_on_frames_the_arms_tips_among_them(talos, talos_kinematics) -> None:
    names = exchange.frame_names(talos)
    assert {arm.tip for arm in talos.arms.values()} <= set(names)
    assert all(talos_kinematics.model.existFrame(name) for name in names)


def test_what_happened_to_an_action_is_told_by_its_outcome(bench) -> None:
    bench.enable()
    serial = bench.post_start(bench.move("arm_right_1_joint", 0.2), (TimeEnd(after=0.1),))
    snapshot = bench.run(100)
    event = exchange.action_event(snapshot["actions"][0], "mine", [TimeEnd(after=0.1)], bench.description.joints)
    assert snapshot["actions"][0]["serial"] == serial
    assert (event.id, event.state, event.outcome) == ("mine", "ended", "time")
    assert "ends[0]" in event.detail
    assert len(event.position) == len(event.command) == len(bench.description.joints)
    assert exchange.active_controllers(snapshot, bench.description.joints) == {"hold": list(bench.description.joints)}
    assert exchange.robot_state(snapshot).command == snapshot["command"][0].tolist()
