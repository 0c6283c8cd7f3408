"""What becomes of the robot is told in lines, once, whatever happened in between."""

import numpy as np
import pytest

from daemon import exchange
from daemon.exchange import Flag, Rule
from daemon.serving.happenings import Happenings
from hal.drives.lifecycle import State, statusword
from handrail.robot import library as robots


@pytest.fixture
def happenings() -> Happenings:
    return Happenings(robots.load("talos_upper"))


@pytest.fixture
def snapshot() -> np.ndarray:
    made = np.zeros((), exchange.snapshot_dtype(robots.load("talos_upper")))
    made["status"] = statusword(State.OPERATION_ENABLED)
    made["flags"] = Flag.ENABLED
    return made


def trip(snapshot: np.ndarray, rule: Rule, joint: int = -1, holds: bool = True) -> None:
    row = snapshot["safety"][rule]
    row["holds"], row["times"], row["joint"] = holds, row["times"] + 1, joint


def test_a_rule_that_holds_the_robot_is_told_with_its_cause_once_each_time_and_so_is_its_end(happenings, snapshot):
    assert list(happenings.between(snapshot)) == [("info", "enabled: it holds where it is")]
    assert list(happenings.between(snapshot)) == []
    snapshot["status"][2] = statusword(State.FAULT)
    trip(snapshot, Rule.DRIVE_FAULT, 2)
    ((level, line),) = happenings.between(snapshot)
    assert level == "error"
    assert line.startswith("held by drive_fault (the drive of arm_right_3_joint: fault") and "safety explain" in line
    assert list(happenings.between(snapshot)) == []
    trip(snapshot, Rule.DRIVE_FAULT, 3)
    assert "arm_right_4_joint" in next(happenings.between(snapshot))[1], "another drive, before the first was mended"
    snapshot["safety"]["holds"] = 0
    assert list(happenings.between(snapshot)) == [("info", "no longer held by drive_fault")]


def test_a_stop_has_its_reason_and_what_cuts_a_set_point_is_no_news(happenings, snapshot):
    list(happenings.between(snapshot))
    trip(snapshot, Rule.VELOCITY, 1)
    assert list(happenings.between(snapshot)) == []
    trip(snapshot, Rule.OPERATOR_STOP)
    snapshot["flags"], snapshot["stop_reason"] = Flag.STOPPED, b"dinner"
    held, ended = happenings.between(snapshot)
    assert held[1].startswith("held by operator_stop (dinner)") and ended == ("info", "no longer enabled")


def test_a_loop_that_was_started_anew_counts_from_nothing(happenings, snapshot):
    trip(snapshot, Rule.OPERATOR_STOP)
    assert len(list(happenings.between(snapshot))) == 2
    happenings.begin_anew()
    assert len(list(happenings.between(snapshot))) == 2
