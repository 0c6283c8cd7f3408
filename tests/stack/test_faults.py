"""Pulling cables: what the robot really does when a process dies in mid-turn. Judged by the plant's ground truth."""

import queue
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from hal.drives.lifecycle import DriveError
from handrail import enable, messages
from handrail.messages import ActionEvent, DaemonStatus, RunState
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from handrail.topics import Caller, RefusedError, Subscriber

pytestmark = [pytest.mark.stack, pytest.mark.timeout(700)]

WATCHDOG = int(DriveError.WATCHDOG)


def moved(before: messages.GroundTruth, after: messages.GroundTruth) -> float:
    """rad, the largest change of any joint between two samples"""
    return max(abs(after.joints[joint] - before.joints[joint]) for joint in before.joints)


def statuses(stack):
    return Subscriber(stack.runtime.endpoint("daemon.events"), DaemonStatus)


def status_until(subscriber, wanted, what, timeout_s=60.0):
    status = None
    deadline = time.monotonic() + timeout_s
    while (left := deadline - time.monotonic()) > 0:
        status = subscriber.receive(left) or status
        if status is not None and wanted(status):
            return status
    pytest.fail(f"{what}: the last status was {status}")


def test_drives_quick_stop_when_the_daemon_dies_and_stay_until_enabled_anew(running_stack):
    stack = running_stack()
    truth = stack.truth()
    listener = statuses(stack)
    stack.kill("daemon.loop")
    dead = truth.now()
    settled = truth.after(2.5)
    assert moved(dead, settled) < 0.5, "damping lets a limp arm sink slowly, never fall"

    status = status_until(
        listener,
        lambda status: all(drive.error == WATCHDOG for drive in status.drives),
        "every drive tells the restarted loop that its watchdog tripped",
    )
    assert not status.enabled
    assert {drive.state for drive in status.drives} <= {"quick_stop_active", "switch_on_disabled"}

    still = truth.now()
    assert moved(settled, still) < 2e-3
    assert moved(still, truth.after(1.0)) < 1e-3, "nothing moves before it is enabled"
    caller = Caller(stack.runtime.endpoint("daemon.call"))
    joint = "head_1_joint"
    here = still.joints[joint]
    trajectory = messages.JointTrajectory(
        joints=[joint], times=[0.0, 1.0], positions=[[here], [here + 0.2]], velocities=[[0.0], [0.0]]
    )
    with pytest.raises(RefusedError, match=r"(?i)enable"):
        caller.call(messages.StartAction(id="early", owner="test", motion=trajectory))
    assert moved(still, truth.after(0.5)) < 1e-3

    caller.call(messages.Enable(), timeout_s=30)
    status_until(listener, lambda status: status.enabled, "enabled anew")
    assert moved(still, truth.after(1.0)) < 0.05, "enabled, it holds where it is"


def test_the_daemon_ends_the_action_safely_when_the_engine_dies(start_stack):
    stack = start_stack()
    stack.wait_up()
    stack.connect().enable(60.0)
    truth = stack.truth()
    events = Subscriber(stack.runtime.endpoint("daemon.events"), ActionEvent)
    listener = statuses(stack)
    # A motion of the engine's that lasts far longer than its silence is suffered, a second of wall time: simulated time would have
    # to run sixty times as fast as the wall's for it to end by being done.
    joint, here = "arm_left_2_joint", truth.now().joints["arm_left_2_joint"]
    motion = messages.JointTrajectory(
        joints=[joint], times=[0.0, 100.0], positions=[[here], [here + 1.0]], velocities=[[0.0], [0.0]]
    )
    caller = Caller(stack.runtime.endpoint("daemon.call"))
    caller.call(messages.StartAction(id="long", owner="engine", motion=motion))
    truth.until(lambda sample: sample.joints[joint] > here + 0.02, "the motion")
    stack.kill("engines.engine")
    event = None
    while event is None or event.state != "ended":
        event = events.receive(60.0)
        assert event is not None, "the action never ended"
    assert event.outcome == "owner_lost"
    status = status_until(listener, lambda status: not status.action, "no action is left")
    assert status.enabled, "the robot holds"
    stands = truth.after(1.0)
    assert stands.joints[joint] < here + 0.9, "it stopped on the way"
    assert moved(stands, truth.after(1.0)) < 5e-3


def test_the_motion_goes_on_without_the_link_and_stop_works_over_the_local_socket(running_stack):
    stack = running_stack()
    truth = stack.truth()
    listener = statuses(stack)
    before = truth.now()
    stack.kill("handrail.link.gate")
    truth.until(
        lambda sample: sample.hinges["valve"] > before.hinges["valve"] + 0.3, "the valve turns on without the link"
    )
    with stack.held():  # it is stopped on its way, however long the command takes to start
        stopped = subprocess.run(
            [sys.executable, "-m", "handrail.cli", "stop", "--runtime", str(stack.runtime.folder)],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert stopped.returncode == 0, stopped.stderr
    status = status_until(listener, lambda status: status.stopped, "stopped")
    assert not status.enabled
    truth.after(2.0)
    assert moved(truth.now(), truth.after(1.0)) < 1e-3


def test_stop_latches_until_it_is_cleared_deliberately(running_stack):
    stack = running_stack()
    robot = stack.robot
    truth = stack.truth()
    runs, listener = Subscriber(stack.runtime.endpoint("engine.events"), RunState), statuses(stack)
    robot.stop("test")
    status = status_until(listener, lambda status: status.stopped, "stopped")
    assert status.stop_reason == "test"
    with pytest.raises(RefusedError, match=r"(?i)stop"):
        robot.enable()
    told = _typed(stack, "enable")
    assert told.exit_code == 1 and "handrail stop --clear" in told.stderr
    truth.after(2.0)
    hinge = truth.now().hinges["valve"]
    assert truth.after(1.0).hinges["valve"] == pytest.approx(hinge, abs=1e-3)
    run = None
    while run is None or run.status != "failed":
        run = runs.receive(60.0)
        assert run is not None, f"the run did not fail: {robot.snapshot().run}"
    assert "stop" in run.detail
    runs.close()
    robot.clear_stop()
    assert not robot.status().enabled, "clearing the stop moves nothing"
    assert _typed(stack, "enable").output == "enabled: it holds where it is\n"
    assert robot.status().enabled
    assert _typed(stack, "disable").exit_code == 0
    status_until(listener, lambda status: not status.enabled, "disabled")


def _typed(stack: Any, verb: str) -> Result:
    """`handrail enable`, `handrail disable`."""
    app = typer.Typer()
    app.command("enable")(enable.enable)
    app.command("disable")(enable.disable)
    return CliRunner().invoke(app, [verb, "--connect", f"tcp://127.0.0.1:{stack.port}"])


def test_the_run_goes_on_when_its_client_goes_away(running_stack):
    stack = running_stack()
    truth = stack.truth()
    before = truth.now().hinges["valve"]
    stack.robot.close()
    truth.until(lambda sample: sample.hinges["valve"] > before + 1.0, "the valve turns on without any client")


def test_pausing_stops_the_motion_and_resuming_goes_on(running_stack):
    stack = running_stack()
    robot, truth = stack.robot, stack.truth()
    robot.pause_run()
    assert robot.snapshot().run.status == "paused"
    truth.after(1.0)
    still = truth.now()
    assert moved(still, truth.after(1.0)) < 5e-3
    robot.resume_run()
    truth.until(lambda sample: sample.hinges["valve"] > still.hinges["valve"] + 0.3, "turning on after the pause")


def test_a_second_process_on_the_bus_sees_every_frame_and_stock_cantools_decodes_them(calm_stack, tmp_path):
    import can
    import cantools

    stack = calm_stack
    log = tmp_path / "capture.asc"
    dump = subprocess.run(
        [
            *(sys.executable, "-m", "handrail.cli", "can", "dump", "can0", "--count", "4000"),
            *("--log", str(log), "--runtime", str(stack.runtime.folder)),
        ],
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert dump.returncode == 0, dump.stderr
    from hal.drives.family import dbc_files

    database = cantools.database.Database()
    for family in ("limb_fd", "imu", "force_torque"):  # what is on can0
        database.add_dbc_file(str(dbc_files()[family]))
    counters: list[int] = []
    commands = answers = 0
    with can.LogReader(log) as reader:
        for frame in reader:
            message = database.get_message_by_frame_id(frame.arbitration_id)
            signals = message.decode(bytes(frame.data), decode_choices=False)
            if message.name == "Sync":
                counters.append(int(next(iter(signals.values()))))
            commands += message.name.startswith("LimbCommand_0")
            answers += message.name.startswith("DriveStatus_0_")
    assert len(counters) > 50
    assert set(np.diff(counters)) == {1}, "no cycle is missing"
    assert abs(commands - len(counters)) <= 1
    assert abs(answers - 7 * commands) <= 14, "every drive answered every command"


def test_a_moved_template_makes_its_plan_stale_and_the_plan_is_refused(calm_stack):
    robot = calm_stack.robot
    robot.place_instance("wheel_1", "wheel", messages.Pose(position=(0.55, -0.35, 0.30)))
    seen = threading.Event()
    plan = robot.plan("wheel_1", "turn", timeout_s=120)
    assert plan.fresh
    robot.on(messages.PlanPreview, lambda preview: seen.set() if not preview.fresh else None)
    robot.move_instance("wheel_1", messages.Pose(position=(0.56, -0.35, 0.30)))
    assert seen.wait(60), "every client hears that the plan went stale"
    assert "wheel_1" in robot.get_plan(plan.id).stale_because
    with pytest.raises(RefusedError, match="wheel_1"):
        robot.execute_plan(plan.id)


def test_a_tool_goes_along_with_a_template_that_is_moved_until_the_operator_has_seen_enough(calm_stack):
    """rtc_programs/follow.yaml with the left arm: whole-body control by a program, judged by the plant."""
    robot, truth = calm_stack.robot, calm_stack.truth()
    description = robots.load("talos_upper")
    kinematics = Kinematics(description)

    def tip(sample):
        return kinematics.frame(np.array([sample.joints[joint] for joint in description.joints]), "tool_left_tip")

    told = queue.SimpleQueue()
    robot.on(messages.Prompt, told.put)
    robot.on(messages.RunState, lambda run: told.put(run) if run.status in ("succeeded", "failed") else None)
    start = tip(truth.now())
    first, then = np.array([0.0, -0.02, 0.04]), np.array([0.04, -0.04, 0.06])

    def place(by):
        return messages.Pose(position=tuple((start.translation + by + [0.1, 0.0, 0.0]).tolist()))

    def arrived(by):
        return lambda sample: np.linalg.norm(tip(sample).translation - start.translation - by) < 3e-3

    robot.place_instance("guide_1", "wheel", place(first))
    robot.run(robot.deploy("follow", {"arm": "left", "guide": "guide_1"}))
    prompt = told.get(timeout=120)
    assert isinstance(prompt, messages.Prompt), prompt
    truth.until(arrived(first), "the tool before the template")
    robot.move_instance("guide_1", place(then))
    there = truth.until(arrived(then), "the tool before the template where it was moved to")
    assert np.linalg.norm(pin.log3(start.rotation.T @ tip(there).rotation)) < 0.05, "rad: and upright"
    robot.answer(prompt.id, "enough")
    run = told.get(timeout=60)
    assert run.status == "succeeded", run.detail
    down = then - np.array([0.0, 0.0, 0.03])
    truth.until(arrived(down), "the tool down by as much as it rose")
