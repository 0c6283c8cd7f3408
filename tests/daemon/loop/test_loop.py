"""The loop as a whole: life, operator stop, lost drives, held time."""

import select
import socket
import threading
import time

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Flag, Kind, Outcome
from daemon.exchange.doorbell import BELL_PERIOD_NS
from daemon.safety.stop_socket import StopSocket
from hal.drives.lifecycle import State
from hal.hardware import LOST_AFTER
from handrail.stop import clear_stop, stop_now


def tell_stop_socket(bench, text: bytes) -> None:
    sender = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sender.sendto(text, str(bench.runtime.stop))
    sender.close()


def test_a_daemon_that_starts_commands_nothing(bench) -> None:
    snapshot = bench.run(50)
    assert snapshot["flags"] == 0
    assert not snapshot["claims"].any()
    assert bench.drives.command_frames == 0
    assert bench.drives.control_frames == 50
    assert (bench.drives.life == State.SWITCH_ON_DISABLED).all()


def test_enabling_holds_the_robot_where_it_is(bench) -> None:
    bench.drives.state.position[:] += 0.05
    before = bench.drives.state.position.copy()
    bench.enable()
    snapshot = bench.run(500)
    assert snapshot["flags"] == Flag.ENABLED
    assert (bench.drives.life == State.OPERATION_ENABLED).all()
    assert np.abs(snapshot["position"] - before).max() < 1e-3


def test_set_points_are_written_only_to_drives_in_operation(bench) -> None:
    bench.run(3)
    bench.post(Kind.ENABLE)
    for _ in range(20):
        operational = (bench.drives.life == State.OPERATION_ENABLED).all()
        written = bench.drives.command_frames
        bench.run()
        if not operational:
            assert bench.drives.command_frames == written


def test_no_brake_opens_before_every_drive_is_ready(bench) -> None:
    bench.run(3)
    bench.drives.life[4] = State.FAULT  # needs one transition more than the others
    bench.post(Kind.ENABLE)
    for _ in range(20):
        bench.run()
        operational = bench.drives.life == State.OPERATION_ENABLED
        assert operational.all() or not operational.any()
    assert operational.all()


def test_a_drive_that_does_not_answer_is_named_when_enabling(bench) -> None:
    bench.drives.silent[9] = True
    bench.run(3)
    assert bench.ask(Kind.ENABLE) is Answer.DRIVE_FAULT
    assert bench.snapshot()["answer_joint"] == 9


def test_the_operator_stop_reaches_the_drives_within_two_cycles_and_latches(bench) -> None:
    bench.enable()
    bench.start(bench.move("arm_right_1_joint", 0.3))
    bench.run(30)
    tell_stop_socket(bench, b"STOP too close")
    snapshot = bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    assert snapshot["flags"] == Flag.STOPPED
    assert snapshot["stop_reason"] == b"too close"
    assert bench.action() == (ActionState.ENDED, Outcome.STOPPED)
    assert not snapshot["claims"].any()
    bench.run(10)
    assert bench.ask(Kind.ENABLE) is Answer.STOP_LATCHED
    assert bench.start(bench.move("arm_right_1_joint", 0.1)) is Answer.STOP_LATCHED
    written = bench.drives.command_frames
    bench.run(20)
    assert bench.drives.command_frames == written
    tell_stop_socket(bench, b"CLEAR")
    bench.run(20)
    assert bench.drives.command_frames == written, "clearing the stop moves nothing"
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    assert bench.start(bench.move("arm_right_1_joint", 0.1)) is Answer.NOT_ENABLED
    bench.enable()
    assert bench.snapshot()["flags"] == Flag.ENABLED


@pytest.mark.parametrize("cycles", range(6))
def test_a_stop_while_the_robot_is_being_enabled_leaves_no_drive_in_operation(bench, cycles: int) -> None:
    bench.run(3)
    bench.post(Kind.ENABLE)
    bench.run(cycles)
    tell_stop_socket(bench, b"STOP")
    bench.run(2)
    for _ in range(50):
        assert not (bench.drives.life == State.OPERATION_ENABLED).any()
        assert bench.run()["flags"] == Flag.STOPPED


def test_a_stop_in_the_cycle_in_which_an_action_would_end_is_a_stop_and_holds_no_time(bench) -> None:
    bench.enable()
    bench.start(bench.move("arm_right_1_joint", 0.1, 0.1), owner=7, hold_after_s=20.0)
    action = bench.loop.actions.slots[0]
    while not action.controller.done:
        bench.run()
    tell_stop_socket(bench, b"STOP")
    bench.run()
    assert bench.action() == (ActionState.ENDED, Outcome.STOPPED)
    assert bench.loop.holds.active() == []
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_a_stop_reaches_the_drives_that_listen_while_others_are_silent(bench) -> None:
    bench.enable()
    bench.drives.silent[3] = True
    bench.run(LOST_AFTER // 2)
    tell_stop_socket(bench, b"STOP")
    bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_whoever_stops_is_told_so(bench) -> None:
    bench.enable()
    ending = threading.Event()

    def run() -> None:
        while not ending.is_set():
            bench.loop.cycle()
            select.select([bench.loop.stop_socket.fileno()], [], [], 1e-3)

    runner = threading.Thread(target=run)
    runner.start()
    try:
        assert stop_now(bench.runtime, "test", 5.0) == "stopped"
        assert bench.loop.life.stopped
        assert clear_stop(bench.runtime, 5.0) == "cleared"
        assert not bench.loop.life.stopped
    finally:
        ending.set()
        runner.join()


@pytest.mark.parametrize("datagram", [b"", b"\xff\xfe", b"CLEAR everything", b"clear", b"S" * 5000])
def test_a_datagram_that_says_nothing_changes_nothing(bench, datagram: bytes) -> None:
    bench.enable()
    tell_stop_socket(bench, datagram)
    assert bench.run(3)["flags"] == Flag.ENABLED


def test_a_command_that_is_no_number_ends_its_action_in_a_hold(bench, monkeypatch) -> None:
    bench.enable()
    bench.start(bench.move("arm_right_1_joint", 0.3))
    bench.run(50)
    controller = bench.loop.actions.running()[0].controller
    monkeypatch.setattr(controller, "update", lambda robot, out: out.torque.__setitem__(controller.joints, np.nan))
    before = bench.loop.written.position.copy()
    snapshot = bench.run(1)
    assert bench.action() == (ActionState.ENDED, Outcome.REFUSED_BY_LIMITS)
    assert snapshot["flags"] == Flag.ENABLED
    assert np.abs(snapshot["command"][0] - before).max() < 0.01
    assert np.isfinite(snapshot["command"]).all()


def test_holding_what_is_no_number_quick_stops(bench, monkeypatch) -> None:
    bench.enable()
    hold = bench.loop.manager.active[0]
    monkeypatch.setattr(hold, "update", lambda robot, out: out.position.__setitem__(hold.joints, np.inf))
    bench.run(3)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_a_malformed_command_is_refused_and_changes_nothing(bench) -> None:
    bench.enable()
    from daemon import exchange

    header = exchange.encode_command(Kind.START, 77)
    header["joint_count"], header["knot_count"], header["motion"] = 3, 5, exchange.MOTION_TRAJECTORY
    bench._mailbox.post(header, np.zeros(4))
    snapshot = bench.run()
    assert (snapshot["answered"], snapshot["answer"]) == (77, Answer.MALFORMED)
    header["kind"], header["serial"] = 250, 78
    bench._mailbox.post(header, np.zeros(4))
    snapshot = bench.run()
    assert (snapshot["answered"], snapshot["answer"]) == (78, Answer.MALFORMED)
    assert snapshot["flags"] == Flag.ENABLED


def test_an_action_may_begin_a_hold_of_time_in_the_cycle_that_ends_it(bench) -> None:
    bench.enable()
    bench.start(bench.move("arm_right_1_joint", 0.1, 0.1), owner=7, hold_after_s=20.0)
    for _ in range(100):
        assert not bench.snapshot()["flags"] & Flag.HELD
        if bench.run()["flags"] & Flag.HELD:
            break
    assert bench.action() == (ActionState.ENDED, Outcome.DONE)
    assert list(bench.snapshot()["holds"][:2]) == [7, 0]
    waiting = threading.Thread(target=bench.loop.wait_while_held)
    waiting.start()
    deadline = time.monotonic() + 30
    while bench.drives.beats < 2 and time.monotonic() < deadline:
        waiting.join(0.02)
    assert waiting.is_alive()
    assert bench.drives.beats >= 2, "the plant is told that time is held"
    cycle = int(bench.snapshot()["cycle"])
    serial = bench.post_start(bench.move("arm_right_1_joint", -0.1, 0.1), owner=7)
    bench.ring_loop()
    waiting.join(30)
    assert not waiting.is_alive(), "the owner's next action lets time go on"
    snapshot = bench.snapshot()
    assert (snapshot["answered"], snapshot["answer"], snapshot["cycle"]) == (serial, Answer.ACCEPTED, cycle)


def test_a_hold_ends_by_itself_and_by_a_stop(bench) -> None:
    bench.enable()
    began = time.monotonic()  # before it is asked for: a busy machine may take the rest of the hold in between
    assert bench.ask(Kind.HOLD_TIME, owner=3, value=0.05) is Answer.ACCEPTED
    bench.loop.wait_while_held()
    assert time.monotonic() - began >= 0.05
    assert bench.ask(Kind.HOLD_TIME, owner=3, value=60.0) is Answer.ACCEPTED
    tell_stop_socket(bench, b"STOP")
    bench.loop.wait_while_held()
    bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_a_hold_asked_for_in_the_moment_of_a_stop_does_not_come_between_it_and_the_drives(bench) -> None:
    bench.enable()
    assert bench.ask(Kind.HOLD_TIME, owner=3, value=60.0) is Answer.ACCEPTED
    bench.post(Kind.HOLD_TIME, owner=4, value=60.0)
    tell_stop_socket(bench, b"STOP")
    began = time.monotonic()
    bench.loop.wait_while_held()
    assert time.monotonic() - began < 30
    bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_a_second_loop_in_the_same_folder_is_refused_and_the_first_still_stops(bench) -> None:
    bench.enable()
    with pytest.raises(ValueError, match="another loop listens"):
        StopSocket(bench.runtime.stop)
    tell_stop_socket(bench, b"STOP")
    bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_each_owner_holds_time_for_itself(bench) -> None:
    bench.ask(Kind.HOLD_TIME, owner=3, value=60.0)
    bench.ask(Kind.HOLD_TIME, owner=4, value=60.0)
    assert bench.ask(Kind.RELEASE_TIME, owner=3) is Answer.ACCEPTED
    assert bench.loop.holds.active() == [4]
    bench.ask(Kind.RELEASE_TIME, owner=4)
    assert bench.loop.holds.active() == []


def test_the_same_commands_give_the_same_run_twice(
    bench, talos, talos_kinematics, talos_protocol, tmp_path_factory
) -> None:
    import tempfile
    from pathlib import Path

    def run(made) -> np.ndarray:
        made.enable()
        made.start(made.move("arm_right_4_joint", 0.4, 0.3))
        rows = []
        made.run(200, lambda: rows.append(made.snapshot()["position"].copy()))
        return np.array(rows)

    other = type(bench)(Path(tempfile.mkdtemp(prefix="hr")), talos, talos_kinematics, talos_protocol)
    try:
        assert np.array_equal(run(bench), run(other))
    finally:
        other.loop.close()


def test_a_loop_that_ends_quick_stops_the_drives(bench) -> None:
    bench.enable()
    bench.loop.close()
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def test_the_server_is_woken_at_once_by_news_and_else_now_and_then_however_fast_simulated_time_goes(
    bench, monkeypatch
) -> None:
    bench.enable()
    rings: list[int] = []

    monkeypatch.setattr(bench.loop.server, "ring", lambda: rings.append(bench.loop.cycles))
    began = time.monotonic()
    bench.run(100)
    assert len(rings) <= (time.monotonic() - began) * 1e9 / BELL_PERIOD_NS + 1
    bench.loop.server._rang_ns -= BELL_PERIOD_NS  # so long ago
    bench.run()
    assert rings[-1] == bench.loop.cycles
    bench.ask(Kind.HOLD_TIME, owner=1, value=5.0)
    assert rings[-1] == bench.loop.cycles
