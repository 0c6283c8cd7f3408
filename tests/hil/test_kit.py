"""The kit's fixtures on a real rig: what they start, what they hear, what they do to bus and plant."""

import numpy as np
import pytest

from handrail import messages as m
from handrail.topics import RefusedError

pytestmark = pytest.mark.timeout(300)  # the first test compiles, where nothing is compiled yet


def test_a_motion_is_seen_on_the_bus_in_the_plant_and_by_the_daemon_alike(robot):
    start = robot.position("head_1_joint")
    mark = robot.bus.mark
    with robot.plant.window() as window:
        assert robot.move("head_1_joint", -0.3, 0.6) == "done"
        robot.plant.wait(0.1)
    assert robot.position("head_1_joint") == pytest.approx(start - 0.3, abs=0.01)
    row = window.seen.joints.index("head_1_joint")
    assert 0.8 < window.seen.fastest[row] < 1.1  # minimum jerk: 15/8 of the mean speed
    robot.plant.assert_within_limits(window.seen)
    traffic = robot.bus.traffic(mark)
    traffic.assert_commanded_every_cycle(["torso_head", "arm_left", "arm_right"])
    traffic.assert_answered("*")
    reply = traffic.replies("head_1_joint")[-1]
    assert reply["position"] == pytest.approx(start - 0.3, abs=0.01)
    assert set(np.diff(traffic.sync_times() // 2_000_000)) == {1}


def test_every_drive_of_a_limb_quick_stops_within_20_cycles_of_the_last_command(robot):
    robot.daemon.loop.kill()
    robot.plant.wait(0.3)
    robot.assert_quick_stops("arm_left", within_cycles=20)
    with pytest.raises(AssertionError, match=r"arm_left_\d_joint quick-stopped .* allowed 15"):
        robot.assert_quick_stops("arm_left", within_cycles=15)
    robot.plant.assert_still()


def test_a_loop_that_hangs_is_stopped_by_the_drives_and_does_not_move_them_when_it_wakes(robot):
    action = robot.begin("arm_right_2_joint", -0.4, 1.0)
    with robot.daemon.frozen():
        robot.plant.wait_state("*", "quick_stop_active")
        robot.plant.wait(0.4)
    assert robot.daemon.wait_end(action).outcome == "drive_fault"
    robot.plant.assert_still()


def test_a_drive_that_faults_stops_its_limb_is_named_and_the_rest_holds_and_may_move(robot):
    robot.plant.drive_error("arm_left_4_joint", "encoder")
    status = robot.daemon.wait_status(lambda status: status.isolated, "a limb is isolated")
    assert status.isolated == ["arm_left"]
    assert {drive.joint: drive.error for drive in status.drives}["arm_left_4_joint"] != 0
    rest = [*robot.joints("arm_right"), *robot.joints("torso_head")]
    arm = [joint for joint in robot.joints("arm_left") if joint != "arm_left_4_joint"]
    robot.plant.wait_state(arm, "quick_stop_active")
    robot.plant.wait_state(rest, "operation_enabled")
    robot.plant.wait(0.3)  # a quick stop damps for a quarter of a second, then the brakes close
    robot.plant.assert_still()
    with pytest.raises(RefusedError, match="arm_left_2_joint is out of the robot"):
        robot.begin("arm_left_2_joint", 0.1)
    assert robot.move("head_1_joint", 0.1, 0.3) == "done"
    robot.enable()
    assert not robot.daemon.call(m.GetStatus()).isolated
    robot.plant.wait_state("*", "operation_enabled")
    robot.plant.assert_still()


def test_what_is_no_drive_error_no_joint_or_no_fault_is_refused_in_words(plant, bus):
    with pytest.raises(Exception, match="expected one of watchdog"):
        plant.drive_error("arm_left_4_joint", "tired")
    with pytest.raises(ValueError, match="'arm_middle' is none of talos_upper"):
        plant.drive_error("arm_middle", "encoder")
    with pytest.raises(ValueError, match="kind"):
        bus.lay("explode")
    with pytest.raises(ValueError, match=r"'arm_middle': not on the bus; expected .*arm_left_4_joint"):
        bus.lay("cut", node="arm_middle")


def test_a_daemon_alone_moves_nothing_and_holds_time_where_it_is_told(daemon, plant):
    with plant.window() as window:
        daemon.call(m.GetStatus())
        plant.wait(0.2)
    assert not any(window.seen.transitions)
    assert set(window.seen.states) == {"switch_on_disabled"}
    assert all(window.seen.braked)
    plant.assert_still(tolerance=1e-4, seconds=0.2)


def test_a_robot_whose_host_is_cut_off_stops_by_itself_and_stays_when_the_cable_is_back(robot):
    action = robot.begin("arm_left_2_joint", 0.3, 2.0)
    robot.plant.wait(0.5)
    with robot.bus.cut("daemon"):
        robot.plant.wait_state("*", "quick_stop_active")
        robot.assert_quick_stops("*", within_cycles=20)
        assert robot.daemon.wait_end(action).outcome == "stale_state", "before the drives count as lost"
        robot.plant.wait(0.3)
    robot.plant.assert_still()
    assert not robot.daemon.call(m.GetStatus()).enabled
    robot.enable()
    robot.plant.assert_still()


def test_a_drive_that_answers_the_same_for_ever_is_not_believed(robot):
    with robot.bus.fault("stuck", node="arm_right_4_joint"):
        status = robot.daemon.wait_status(lambda status: status.isolated, "the stuck drive is found out")
    assert status.isolated == ["arm_right"]
    robot.plant.wait_state("arm_right", "quick_stop_active")
    robot.plant.wait_state(robot.joints("arm_left"), "operation_enabled")


def test_what_the_bus_corrupts_is_refused_by_its_crc_counted_and_moves_nothing(robot):
    before = robot.daemon.call(m.GetStatus()).loop.crc_errors
    with robot.bus.fault("corrupt", node="head_1_joint"):
        counted = robot.daemon.wait_status(lambda status: status.loop.crc_errors > before + 3, "wrong CRCs are counted")
    assert counted.loop.crc_errors > before + 3
    robot.plant.assert_still()


@pytest.mark.handrail(robot="z1")
def test_traffic_of_a_robot_with_a_gripper_is_told_apart(robot):
    mark = robot.bus.mark
    robot.plant.wait(0.1)
    traffic = robot.bus.traffic(mark)
    traffic.assert_commanded_every_cycle(["arm"])
    traffic.assert_answered("*")
    with pytest.raises(ValueError, match=r"kinds are drop.*fields channel"):
        robot.bus.lay("dorp")
    with pytest.raises(ValueError, match=r"asleep.*operation_enabled"):
        robot.plant.wait_state("*", "asleep")
    with pytest.raises(ValueError, match=r"jonit.*expected a joint"):
        robot.begin("jonit", 0.1)
