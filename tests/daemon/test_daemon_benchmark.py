"""The benchmark of the whole cycle: its motion, its rows, and what it is compared with."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import daemon, wake_ups
from benchmarks.daemon import Cycles
from benchmarks.wake_ups import WakeUps
from daemon.serving.whole_body_door import WholeBodyDoor
from handrail.robot import library as robots

GOALS = {"wall clock, p50": "≤ 150", "wall clock, p99": "≤ 350", "lock-step, p50": "≤ 100"}


def cycles(work: float, late: float, misses: int) -> Cycles:
    return Cycles(np.full(1000, work), np.full(1000, late), misses)


def test_the_robot_of_the_benchmark_takes_its_motion_of_five_tasks() -> None:
    robot = robots.load(daemon.ROBOT)
    assert robot.period_ns == 1_000_000
    door = WholeBodyDoor(robot)
    assert door.open(120.0)
    checked = door.checked(daemon.motion(robot), (), robot.home_position(), 1 << 18)
    assert len(json.loads(checked.compound)["levels"]) == 5


def test_every_figure_has_a_row_with_its_goal_and_the_peers_are_beside_it() -> None:
    idle, peer = WakeUps(np.full(1000, 1.0), 2), WakeUps(np.full(1000, 20.0), 0)
    rows = daemon.compared([cycles(140.0, 1.5, 3)], cycles(110.0, 0.0, 0), [idle], [peer])
    assert [row.holds for row in rows[:3]] == [True, True, False]
    for row, (name, goal) in zip(rows, GOALS.items(), strict=False):
        assert row.name.endswith(name)
        assert row.goal == goal
    missed = next(row for row in rows if row.name.startswith("periods missed"))
    assert (missed.value, missed.peer_value, missed.holds) == (3, 2, True)
    assert [row.ratio for row in rows if row.peer == "cyclictest"] == [0.075, 0.075]
    assert len(rows) == 9


def test_where_cyclictest_is_missing_the_row_says_how_to_install_it_and_does_not_hold(monkeypatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    missing = wake_ups.cyclictest(0.01, 1000)
    assert isinstance(missing, str)
    rows = daemon.compared([cycles(140.0, 1.5, 3)], cycles(90.0, 0.0, 0), [WakeUps(np.ones(1000), 0)], [], missing)
    told = [row for row in rows if row.peer.startswith("cyclictest")]
    assert len(told) == 2
    assert all("apt-get install rt-tests" in row.peer and not row.holds for row in told)


def test_misses_beyond_those_of_an_idle_loop_do_not_hold() -> None:
    rows = daemon.compared([cycles(1.0, 1.0, 30)], cycles(1.0, 0.0, 0), [WakeUps(np.ones(1000), 5)], [], "none")
    assert not next(row for row in rows if row.name.startswith("periods missed")).holds


def test_a_report_of_cyclictest_is_read_and_what_its_histogram_has_no_room_for_counts_as_its_longest() -> None:
    thread = {"histogram": {"18": 6, "19": 3}, "cycles": 10, "min": 18, "max": 25_000}
    read = wake_ups.of_cyclictest(json.dumps({"thread": {"0": thread}}))
    assert read.late.tolist() == pytest.approx([18.0] * 6 + [19.0] * 3 + [25_000.0])


def test_an_idle_loop_tells_how_late_each_of_its_cycles_was() -> None:
    told = wake_ups.idle_loop(0.05, 1000)
    assert len(told.late) == 50
    assert (told.late >= 0.0).all()
