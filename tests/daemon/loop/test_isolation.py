"""A drive is lost: its limb stops and stays so, the rest of the robot holds and may move, and Enable takes the limb back."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Flag, Kind, Outcome, Rule, isolated_limbs
from daemon.serving.drive_reports import drive_problems
from hal.drives.fields import ENTITY, HEAD, Role
from hal.drives.lifecycle import State
from hal.hardware import LOST_AFTER
from handrail.robot.description import RobotDescription
from tests.drives import float_family

LOST, MOVING = "arm_left_4_joint", "arm_right_1_joint"


@pytest.fixture
def arm(bench: Any) -> np.ndarray:
    """(n,) the joints of the limb that is lost; the robot is enabled."""
    bench.enable()
    limb = bench.description.limb_of_joint
    return limb == limb[bench.index(LOST)]


def lose(bench: Any, how: str = "fault") -> None:
    row = bench.index(LOST)
    if how == "silence":
        bench.drives.silent[row] = True
        bench.run(LOST_AFTER + 5)
    else:
        bench.drives.life[row] = State.FAULT if how == "fault" else State.QUICK_STOP_ACTIVE
        bench.run(3)


@pytest.mark.parametrize("how", ["fault", "quick stop", "silence"])
def test_losing_one_drive_ends_all_actions_stops_its_limb_and_holds_the_rest(
    bench: Any, arm: np.ndarray, how: str
) -> None:
    bench.start(bench.move(MOVING, 0.3, 2.0))
    bench.run(30)
    before = bench.loop.written.position.copy()
    if how == "silence":
        bench.drives.silent[bench.index(LOST)] = True
        assert bench.run(LOST_AFTER - 1)["flags"] == Flag.ENABLED, "a few lost replies are no lost drive"
        before = bench.loop.written.position.copy()
    lose(bench, how)
    assert bench.snapshot()["flags"] == Flag.ENABLED | Flag.ISOLATED
    assert isolated_limbs(bench.snapshot(), bench.description) == ["arm_left"]
    assert bench.action() == (ActionState.ENDED, Outcome.DRIVE_FAULT)
    assert bench.snapshot()["actions"][0]["joint"] == bench.index(LOST)
    others = np.arange(len(arm)) != bench.index(LOST)
    assert (bench.drives.life[arm & others] == State.QUICK_STOP_ACTIVE).all()
    assert (bench.drives.life[~arm] == State.OPERATION_ENABLED).all()
    assert (bench.drives.commanded == ~arm).all(), "nothing more is commanded to the limb"
    bench.run(200)
    assert np.abs(bench.loop.written.position - before)[~arm].max() < 0.01
    assert np.abs(np.array(bench.drives.jumps)[1:, ~arm]).max() < 4.1, "N·m in a cycle: nothing jumps"
    assert not bench.snapshot()["safety"]["times"][Rule.TORQUE_RATE], "what is not commanded is not limited either"


def test_the_rest_may_move_and_the_limb_may_not(bench: Any, arm: np.ndarray) -> None:
    lose(bench)
    assert bench.start(bench.move(LOST, 0.1)) is Answer.ISOLATED
    assert bench.snapshot()["answer_joint"] == bench.index(LOST)
    other = bench.index(MOVING)
    before = bench.drives.state.position.copy()
    assert bench.start(bench.move(MOVING, 0.3, 0.5)) is Answer.ACCEPTED
    bench.run(500)
    assert bench.action(0) == (ActionState.ENDED, Outcome.DONE)
    assert bench.drives.state.position[other] - before[other] == pytest.approx(0.3, abs=0.02)
    assert np.abs(bench.drives.state.position - before)[arm].max() == 0.0


def test_nothing_comes_back_by_itself_and_enable_takes_the_limb_back_where_it_is_without_a_jump(
    bench: Any, arm: np.ndarray
) -> None:
    lose(bench)
    bench.drives.life[bench.index(LOST)] = State.SWITCH_ON_DISABLED  # the fault is gone
    bench.drives.state.position[arm] += 0.2  # and somebody has bent the arm meanwhile
    bench.run(300)
    assert not (bench.drives.life[arm] == State.OPERATION_ENABLED).any()
    bent, held = bench.drives.state.position.copy(), bench.loop.written.position[~arm].copy()
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
    jumps = len(bench.drives.jumps)
    for _ in range(50):
        assert bench.snapshot()["flags"] & Flag.ENABLED, "the rest holds all the while"
        ready = bench.drives.life[arm] == State.OPERATION_ENABLED
        assert ready.all() or not ready.any(), "no brake of the limb opens before all of it is ready"
        if bench.run()["flags"] == Flag.ENABLED:
            break
    assert bench.snapshot()["flags"] == Flag.ENABLED
    bench.run(300)
    assert (bench.drives.life == State.OPERATION_ENABLED).all()
    assert np.abs(bench.drives.state.position - bent).max() < 0.01
    assert (bench.loop.written.position[~arm] == held).all(), "the rest noticed nothing"
    assert np.abs(np.array(bench.drives.jumps)[jumps:, ~arm]).max() < 0.5
    assert bench.start(bench.move(LOST, 0.1, 0.2)) is Answer.ACCEPTED
    bench.run(200)
    assert bench.action() == (ActionState.ENDED, Outcome.DONE)


def test_the_rest_may_be_in_motion_while_the_limb_comes_back(bench: Any, arm: np.ndarray) -> None:
    lose(bench)
    assert bench.start(bench.move(MOVING, 0.3, 1.0)) is Answer.ACCEPTED
    bench.run(100)
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
    bench.run(30)
    assert bench.snapshot()["flags"] == Flag.ENABLED
    assert bench.action()[0] is ActionState.RUNNING
    bench.run(700)
    assert bench.action() == (ActionState.ENDED, Outcome.DONE)


def test_a_drive_that_does_not_come_back_leaves_its_limb_out_and_the_rest_held(bench: Any, arm: np.ndarray) -> None:
    lose(bench)
    row = bench.index(LOST)

    def fault() -> None:
        bench.drives.life[row] = State.FAULT

    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
    bench.run(1100, fault)
    assert bench.snapshot()["flags"] == Flag.ENABLED | Flag.ISOLATED
    assert bench.snapshot()["safety"]["times"][Rule.DRIVE_FAULT] == 2
    others = np.arange(len(arm)) != row
    assert not (bench.drives.life[arm & others] == State.OPERATION_ENABLED).any()
    bench.drives.silent[row] = True
    bench.run(LOST_AFTER + 5)
    assert bench.ask(Kind.ENABLE) is Answer.DRIVE_FAULT
    assert bench.snapshot()["answer_joint"] == row


@pytest.mark.parametrize("how", ["stop", "disable", "the other limbs fail"])
def test_what_stops_a_robot_stops_what_is_left_of_it(bench: Any, arm: np.ndarray, how: str) -> None:
    lose(bench)
    if how == "stop":
        bench.loop.life.stop("test")
    elif how == "disable":
        bench.ask(Kind.DISABLE)
    else:
        bench.drives.life[~arm] = State.FAULT
    bench.run(5)
    assert not bench.snapshot()["flags"] & (Flag.ENABLED | Flag.ISOLATED)
    assert not (bench.drives.life == State.OPERATION_ENABLED).any()
    assert not bench.snapshot()["claims"].any()
    bench.loop.life.clear_stop()
    bench.enable()
    assert (bench.drives.life == State.OPERATION_ENABLED).all()
    assert bench.snapshot()["flags"] == Flag.ENABLED


def test_a_second_limb_may_fail_while_the_first_is_on_its_way_back(bench: Any, arm: np.ndarray) -> None:
    lose(bench)
    bench.post(Kind.ENABLE)
    bench.run(2)
    bench.drives.life[bench.index("head_1_joint")] = State.FAULT
    bench.run(5)
    assert isolated_limbs(bench.snapshot(), bench.description) == ["arm_left", "torso_head"]
    bench.run(50)
    right = np.array([name.startswith("arm_right") for name in bench.description.joints])
    assert (bench.drives.life[right] == State.OPERATION_ENABLED).all()
    assert not (bench.drives.life[~right] == State.OPERATION_ENABLED).any()
    bench.enable()
    assert (bench.drives.life == State.OPERATION_ENABLED).all()


def test_a_drive_that_measures_no_number_is_lost_with_its_limb_alone_and_people_are_told_why(
    make_bench: Any, talos: RobotDescription, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    float_family.make(tmp_path)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    limbs = tuple(
        dataclasses.replace(limb, family=float_family.NAME) if LOST in limb.joints else limb for limb in talos.limbs
    )
    bench = make_bench(dataclasses.replace(talos, limbs=limbs))
    bench.enable()
    row, limb = bench.index(LOST), bench.description.limb_of_joint
    stiffness, arm = bench.hardware.representable_gains(talos.stiffness, talos.stiffness)[0], limb == limb[row]
    assert stiffness[arm] == pytest.approx(np.minimum(talos.stiffness, 500.0)[arm], rel=0.02), (
        "in the one law that it has"
    )
    program = bench.hardware._protocol.program
    (frame,) = (f for f in range(*program.span(Role.STATUS)) if program.frames[f, ENTITY] == row)
    identifier, receive = program.frames[frame, HEAD] & 0xFFFFFFFF, bench.drives.receive

    def poisoned(timeout_s: float = 0.0) -> np.ndarray:
        records = receive(timeout_s)
        records["data"][records["can_id"] == identifier, float_family.POSITION] = [0, 0, 0xC0, 0x7F]  # NaN
        return records

    monkeypatch.setattr(bench.drives, "receive", poisoned)
    bench.start(bench.move(MOVING, 0.3, 2.0))
    bench.run(LOST_AFTER - 5)
    assert bench.snapshot()["flags"] == Flag.ENABLED and bench.action()[0] is ActionState.RUNNING
    assert np.isfinite(bench.loop.written.table).all() and np.isfinite(bench.drives.state.table).all()
    bench.run(10)
    snapshot = bench.snapshot()
    assert snapshot["flags"] == Flag.ENABLED | Flag.ISOLATED
    assert isolated_limbs(snapshot, bench.description) == ["arm_left"]
    assert bench.action() == (ActionState.ENDED, Outcome.DRIVE_FAULT)
    assert (bench.drives.life[limb != limb[row]] == State.OPERATION_ENABLED).all()
    assert snapshot["crc_errors"] > LOST_AFTER and not snapshot["safety"]["times"][Rule.NOT_FINITE]
    problems = drive_problems(snapshot, bench.description)
    assert problems == {LOST: "what it measures is no finite number: its answers are refused"}
