"""Signals are kept for plots: whatever is chosen shows the last half minute of the robot's time, live or held."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from handrail.messages import NodePort, Nodes, NodeState, PortValue, RobotState, WatchPort
from tablet_client.models.signals import MOST_CHOSEN, SPAN_S, Signals

JOINTS = ("elbow", "wrist")


@pytest.fixture
def signals() -> Signals:
    made = Signals()
    made.describe(JOINTS)
    return made


def state(seconds: float, elbow: float, *, command: float = 0.0) -> RobotState:
    return RobotState(
        time_ns=round(seconds * 1e9),
        cycle=0,
        position=[elbow, 0.0],
        velocity=[0.0, 0.5],
        torque=[3.0, 4.0],
        command=[command, 0.0],
        external_force=(1.0, 2.0, 3.0),
    )


def test_a_signal_chosen_late_shows_what_happened_before(signals):
    for k in range(5):
        signals.take(state(k * 0.1, 0.1 * k))
    assert signals.choose("elbow.position") == "" and signals.choose("force.y") == ""
    angle, force = signals.curves()
    assert (angle.unit, force.unit) == ("°", "N")
    assert angle.times == pytest.approx([-0.4, -0.3, -0.2, -0.1, 0.0])
    assert angle.values == pytest.approx(np.degrees([0.0, 0.1, 0.2, 0.3, 0.4]), rel=1e-5)
    assert force.values == pytest.approx([2.0] * 5)


def test_each_quantity_is_the_joints_own(signals):
    signals.take(state(1.0, 0.3, command=0.1))
    for name in ("wrist.velocity", "wrist.torque", "elbow.command", "elbow.error"):
        assert signals.choose(name) == ""
    last = [float(curve.values[-1]) for curve in signals.curves()]
    assert last == pytest.approx([np.degrees(0.5), 4.0, np.degrees(0.1), np.degrees(0.2)], rel=1e-5)


def test_no_more_than_can_be_told_apart_and_nothing_unknown_is_shown(signals):
    for name in signals.names[:MOST_CHOSEN]:
        assert signals.choose(name) == ""
    assert signals.choose(signals.names[MOST_CHOSEN]) == "too_many_signals"
    assert signals.choose(signals.names[0]) == "" and len(signals.chosen) == MOST_CHOSEN - 1
    assert signals.choose("knee.position") == "no_signal"


def test_what_is_held_stays_and_what_came_meanwhile_is_shown_after(signals):
    signals.choose("elbow.position")
    signals.take(state(1.0, 0.1))
    signals.pause(True)
    signals.take(state(2.0, 0.2))
    assert signals.paused and len(signals.curves()[0].values) == 1
    signals.choose("elbow.torque")  # chosen while held: of the same time
    assert [len(curve.values) for curve in signals.curves()] == [1, 1]
    signals.pause(False)
    assert [len(curve.values) for curve in signals.curves()] == [2, 2]


def test_only_the_last_half_minute_is_kept_however_long_it_goes_on(signals):
    signals.choose("elbow.position")
    for k in range(4000):
        signals.take(state(k * 0.05, k))
    times = signals.curves()[0].times
    assert times[0] == pytest.approx(-SPAN_S) and len(times) == SPAN_S / 0.05 + 1
    assert np.all(np.diff(times) > 0)


def test_a_clock_that_jumps_back_another_robot_and_states_that_do_not_fit_mix_nothing(signals):
    signals.choose("elbow.position")
    signals.take(state(5.0, 0.1))
    signals.take(state(5.0, 0.2))
    assert len(signals.curves()[0].values) == 1, "the same cycle twice is one sample"
    signals.take(state(1.0, 0.3))
    assert signals.curves()[0].values == pytest.approx(np.degrees([0.3]), rel=1e-5)
    signals.take(RobotState(time_ns=2, cycle=0, position=[1.0], velocity=[1.0], torque=[1.0], command=[1.0]))
    assert len(signals.curves()[0].values) == 1
    signals.describe(("knee", "wrist"))
    assert signals.chosen == [] and "knee.error" in signals.names


def test_the_table_has_a_line_a_sample_and_names_units(signals):
    signals.choose("elbow.position")
    signals.choose("force.z")
    for k in range(3):
        signals.take(state(1.0 + k, 0.1))
    rows = list(csv.reader(io.StringIO(signals.csv())))
    assert rows[0] == ["time [s]", "elbow.position [°]", "force.z [N]"]
    assert rows[3] == ["3.0000", "5.72958", "3"]
    assert len(rows) == 4


def test_before_anything_came_there_is_nothing_to_show(signals):
    signals.choose("elbow.position")
    assert len(signals.curves()[0].values) == 0
    assert signals.csv() == "time [s],elbow.position [°]\n"


SMOOTH = NodeState(
    name="smooth", node="low_pass", state="up", process=1, restarts=0, cpu_share=0.0, memory_mb=1.0, every=None,
    ports=[
        NodePort(name="force", way="output", kind="number", unit="N"),
        NodePort(name="wrench", way="input", kind="wrench"),
        NodePort(name="cutoff", way="parameter", kind="number", unit="Hz"),
    ],
)  # fmt: skip


def test_a_nodes_port_is_plotted_from_when_it_is_chosen_and_asked_for_as_long_as_it_is_shown(signals):
    signals.hear([SMOOTH])
    assert signals.ports == ("node:smooth.force", "node:smooth.cutoff"), "numbers only"
    signals.take(state(1.0, 0.0))
    signals.take_port(PortValue(name="smooth", port="force", data={"value": 1.0}))
    assert signals.choose("node:smooth.force") == ""
    (call,) = signals.want(0.0)
    assert (type(call), call.name, call.port) == (WatchPort, "smooth", "force")
    assert list(signals.want(1.0)) == []
    for k in range(4):
        signals.take(state(2.0 + 0.1 * k, 0.0))
        if k % 2:
            signals.take_port(PortValue(name="smooth", port="force", data={"value": 10.0 * k}))
    signals.take_port(PortValue(name="smooth", port="wrench", data={"value": [1.0]}))
    (curve,) = signals.curves()
    assert curve.unit == "N" and curve.values.tolist() == [10.0, 30.0]
    assert curve.times == pytest.approx([-0.2, 0.0])
    rows = list(csv.reader(io.StringIO(signals.csv())))
    assert rows[0] == ["time [s]", "node:smooth.force [N]"]
    assert [row[1] for row in rows[1:]] == ["", "", "10", "10", "30"]
    assert len(list(signals.want(5.0))) == 1
    signals.pause(True)
    signals.take(state(3.0, 0.0))
    signals.take_port(PortValue(name="smooth", port="force", data={"value": 99.0}))
    assert signals.curves()[0].values.tolist() == [10.0, 30.0], "held"
    signals.pause(False)
    assert signals.curves()[0].values.tolist() == [10.0, 30.0, 99.0]
    signals.choose("node:smooth.force")
    assert list(signals.want(50.0)) == [] and signals.curves() == []


@pytest.mark.window
def test_in_the_window_a_nodes_port_is_chosen_and_drawn(robot, show):
    robot.nodes = Nodes(nodes=[SMOOTH])
    shown = show()
    robot.publish(robot.state())
    shown.press("tab_signals")
    shown.press("chooseSignals")
    shown.until(lambda: shown.there("signalsOf_node:smooth"))
    shown.press("signalsOf_node:smooth")
    shown.press("signal_node:smooth.force")
    shown.press("chooseSignals")
    shown.until(lambda: robot.calls_of(WatchPort))
    robot.publish(PortValue(name="smooth", port="force", data={"value": 12.5}, count=1))
    shown.until(lambda: shown.item("signalNow_0").property("text").startswith("12.5"))
    assert shown.words("Words.signalName('node:smooth.force')") == "Node smooth, force"
