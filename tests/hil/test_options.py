"""What a test says of its robot, bus and clock is what it has; pushes and frames of its own arrive: on the smallest robot."""

import time
from pathlib import Path

import can
import numpy as np
import pytest

from hal.hil.bus import Bus
from handrail import messages as m
from handrail.robot import library as robots
from handrail.topics import RefusedError

pytestmark = [pytest.mark.timeout(300), pytest.mark.handrail(robot="sea_bench")]

SYNC, LOWEST, BURST, FIFO = 0x080, 0x7F0, 200, 128


def frame(can_id: int, data: bytes, **more: str) -> can.Message:
    return can.Message(arbitration_id=can_id, is_extended_id=False, is_fd=True, bitrate_switch=True, data=data, **more)


def times_ms(bus: Bus, since: int, can_id: int, count: int) -> np.ndarray:
    """When frames of an identifier were on the bus; waits for so many of them."""
    deadline = time.monotonic() + 20.0
    while True:
        records = bus.records(since)
        came = records["time_ns"][records["can_id"] == can_id].astype(np.int64) * 1e-6
        if len(came) >= count:
            return came
        assert time.monotonic() < deadline, f"{len(came)} of {count} frames"
        time.sleep(0.01)


@pytest.mark.handrail(bus_timing=True)
def test_a_burst_takes_its_time_on_a_bus_with_timing_and_the_drives_frames_go_before_it(robot):
    robot.plant.wait(0.1)
    mark = robot.bus.mark
    robot.bus.send(*[frame(LOWEST, bytes(64)) for _ in range(BURST)])
    came = times_ms(robot.bus, mark, LOWEST, FIFO)
    # 64 bytes at 1 and 5 Mbit/s are 0.16 ms; the robot's own frames take 15 % of the bus meanwhile.
    assert 20 < came[-1] - came[0] < 32
    assert next(node.overflows for node in robot.bus.report().nodes if node.name == "test") == BURST - len(came)
    for joint in robot.description.joints:
        answers = robot.bus.traffic(mark).replies(joint)["time_ns"]
        during = answers[(answers > came[0] * 1e6) & (answers < came[-1] * 1e6)]
        # Without timing the burst would be on the bus at once, and everybody after it.
        assert len(during) >= 8
        assert np.diff(during).max() < 6e6
    assert robot.move("elbow_joint", 0.2, 0.3) == "done"
    assert robot.daemon.call(m.GetStatus()).enabled


@pytest.mark.handrail(clock="wall")
def test_on_the_wall_clock_the_robots_time_is_everybodys(robot):
    began, wall = robot.plant.time_ns, time.monotonic()
    assert robot.move("elbow_joint", 0.2, 0.3) == "done"
    time.sleep(0.3)
    passed = (robot.plant.time_ns - began) * 1e-9
    # A machine that is too busy may skip steps; in lock-step it would be several times as fast.
    assert 0.05 < passed / (time.monotonic() - wall) < 1.1
    assert robot.position("elbow_joint") == pytest.approx(robot.description.home_position()[1] + 0.2, abs=0.01)


def test_a_push_bends_the_arm_by_force_over_stiffness_and_only_while_it_lasts(robot):
    before = robot.plant.truth().joints
    began = robot.plant.push("lower_arm", (20.0, 0.0, 0.0), duration=2.0)
    under = robot.plant.joints_at(began + 500_000_000)
    # Both links hang 0.6 rad off the vertical, the lower one's middle is 0.15 m from the elbow.
    arms = np.cos(0.6) * np.array([0.3 + 0.151, 0.151])
    expected = -20.0 * arms / robot.description.stiffness
    bent = [under[joint] - before[joint] for joint in robot.description.joints]
    assert bent == pytest.approx(expected.tolist(), rel=0.2)
    assert robot.plant.joints_at(began + 2_500_000_000) == pytest.approx(before, abs=1e-3)
    with pytest.raises(Exception, match=r"time_ns -1: not remembered; expected 0 to \d+"):
        robot.plant.joints_at(-1)
    with pytest.raises(Exception, match=r"'lower_leg': not of sea_bench; it has .*lower_arm"):
        robot.plant.push("lower_leg", (1.0, 0.0, 0.0), duration=0.1)


def test_frames_of_the_tests_own_are_on_the_bus_and_in_its_captures_and_a_sync_moves_time(bus, plant):
    mark, deadline = bus.mark, time.monotonic() + 20.0
    bus.holding = True  # between two Syncs time stands, however long this process waits for its turn
    for cycle in range(1, 6):
        bus.send(frame(SYNC, cycle.to_bytes(4, "little")))
        while plant.time_ns < (due := cycle * robots.load("sea_bench").period_ns) and time.monotonic() < deadline:
            time.sleep(0.001)
        assert plant.time_ns == due
    assert len(times_ms(bus, mark, SYNC, 5)) == 5
    assert {message.arbitration_id for message in bus.messages(mark)} >= {SYNC}
    with pytest.raises(ValueError, match="channel 'can7': expected one of can0"):
        bus.send(frame(SYNC, bytes(4), channel="can7"))


@pytest.mark.handrail(faults=str(Path(__file__).with_name("elbow_cut.yaml")))
def test_a_file_of_faults_begins_with_the_hosts_first_sync(daemon, bus, plant):
    status = daemon.wait_status(lambda status: any(drive.problem for drive in status.drives), "the elbow is lost")
    assert {drive.joint: drive.problem for drive in status.drives} == {
        "shoulder_joint": "",
        "elbow_joint": "no answer on channel can0 (handrail)",
    }
    traffic = bus.traffic()
    answered = traffic.replies("elbow_joint")["time_ns"][-1] - traffic.sync_times()[0]
    assert 0.49e9 < answered < 0.51e9
    plant.wait(0.2)
    with pytest.raises(RefusedError, match="the drive of elbow_joint does not enable: no answer"):
        daemon.call(m.Enable())


@pytest.mark.handrail(bus_timing=True, clock="wall")
def test_on_the_wall_clock_drives_answer_when_they_hear_and_not_a_cycle_late_on_a_bus_with_timing(robot):
    mark = robot.bus.mark
    assert robot.move("elbow_joint", 0.2, 0.6) == "done"
    traffic = robot.bus.traffic(mark)
    for joint in robot.description.joints:
        answers, commands = traffic.replies(joint)["time_ns"], np.unique(traffic.command_times(joint))
        answers = answers[answers > commands[0]]
        took = answers - commands[np.searchsorted(commands, answers) - 1]
        # 0.6 ms; where they wait for the plant's next step 1.2 ms. The bus's clock stands while a busy machine lets the plant wait.
        assert np.median(took) < 0.9e6


@pytest.mark.handrail(robot="talos_upper", bus_timing=True)
def test_a_bus_with_timing_carries_the_whole_of_a_robot_every_cycle(robot):
    mark, before = robot.bus.mark, robot.daemon.call(m.GetStatus()).loop
    assert robot.move("arm_right_4_joint", -0.3, 0.5) == "done"
    traffic, after = robot.bus.traffic(mark), robot.daemon.call(m.GetStatus()).loop
    traffic.assert_commanded_every_cycle("*")
    traffic.assert_answered("*")
    assert (after.stale_replies, after.crc_errors) == (before.stale_replies, before.crc_errors)
    assert 0.6 < max(bus.load for bus in robot.daemon.call(m.GetStatus()).buses) < 0.75
