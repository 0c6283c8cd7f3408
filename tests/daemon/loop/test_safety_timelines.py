"""Each row of docs/safety.md as a timeline: what happens to a robot in the loop, what the rule does, how the robot recovers."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import cli
from daemon.exchange import ActionState, Answer, Flag, Outcome, Rule
from daemon.safety import rules
from daemon.safety.balance import PATIENCE
from daemon.safety.bounds import DIVERGED, STALE
from daemon.safety.report import safety_report
from daemon.safety.rules import Followed, followed, isolated_with, unsafe
from daemon.safety.separation import PUSHED_BY
from daemon.safety.stop_socket import StopRequest
from daemon.safety.table import TABLE, markdown
from daemon.serving.drive_reports import drive_problems
from hal.drives.lifecycle import State
from hal.hardware import LOST_AFTER
from hal.joint import JointState, Mode
from handrail.messages import SafetyRule
from handrail.robot.description import RobotDescription
from handrail.robot.guarding import Guarding, HalfSpace

WALL = HalfSpace(name="wall", frame="base_link", point=(0.0, -0.6, 0.0), normal=(0.0, 2.0, 0.0), links=("tool_right",))
JOINT, OTHER = "arm_right_1_joint", "arm_left_2_joint"


def tripped(bench: Any, rule: Rule) -> np.void:
    return bench.snapshot()["safety"][rule]


def others(bench: Any, row: int) -> np.ndarray:
    return np.arange(len(bench.drives.life)) != row


def tell_stop_socket(bench: Any, text: bytes) -> None:
    sender = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sender.sendto(text, str(bench.runtime.stop))
    sender.close()


def held(bench: Any) -> np.ndarray:
    """The robot is held at what was written last; that."""
    assert bench.snapshot()["flags"] == Flag.ENABLED
    where = bench.snapshot()["command"][0].copy()
    bench.run(20)
    assert np.abs(bench.snapshot()["command"][0] - where).max() < 1e-9
    return where


def run_to_end(bench: Any) -> None:
    """Until no action runs."""
    while bench.loop.actions.running():
        bench.run()


def operator_stop(bench: Any) -> None:
    bench.start(bench.move(JOINT, 0.3))
    bench.run(30)
    tell_stop_socket(bench, b"STOP too close")
    bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    assert tripped(bench, Rule.OPERATOR_STOP)["holds"]
    tell_stop_socket(bench, b"CLEAR")
    bench.run(2)
    assert not tripped(bench, Rule.OPERATOR_STOP)["holds"]
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all(), "clearing moves nothing"
    bench.enable()


def keepalive(bench: Any) -> None:
    from daemon.exchange import Kind

    bench.ask(Kind.BIND_KEEPALIVE, owner=7, value=0.1)
    bench.start(bench.move(JOINT, 0.3, 3.0), owner=7)
    bench.run(75)
    assert tripped(bench, Rule.KEEPALIVE)["holds"]
    bench.run(200)
    assert bench.action() == (ActionState.ENDED, Outcome.OWNER_LOST)
    held(bench)
    bench.run(1500)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    bench.enable()
    assert not tripped(bench, Rule.KEEPALIVE)["holds"]


def no_command(bench: Any) -> None:
    hold = bench.loop.manager.active[0]
    hold.update = lambda robot, out: out.position.__setitem__(hold.joints, np.nan)
    bench.run(2)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    assert tripped(bench, Rule.NO_COMMAND)["holds"]
    bench.enable()
    assert not tripped(bench, Rule.NO_COMMAND)["holds"]


def protocol(bench: Any) -> None:
    bench.drives.silent[4] = True  # a drive is exchanged for one that speaks another version
    bench.run(LOST_AFTER + 5)
    bench.drives.silent[4], bench.drives.protocol_version[4] = False, 99
    bench.run(100)
    from daemon.exchange import Kind

    assert bench.ask(Kind.ENABLE) is Answer.PROTOCOL_MISMATCH
    bench.loop.hardware.protocol_version[4] = bench.loop.hardware.expected_protocol_version(4)
    bench.drives.protocol_version[4] = bench.loop.hardware.expected_protocol_version(4)
    bench.loop.hardware._look_at_identities()
    bench.enable()
    bench.loop.hardware.protocol_version[4] = 99.0  # and says so while it is in operation
    bench.loop.hardware._look_at_identities()
    bench.run(2)
    assert tripped(bench, Rule.PROTOCOL)["holds"]
    assert tripped(bench, Rule.PROTOCOL)["joint"] == 4
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()


def drive_fault(bench: Any) -> None:
    row, limb = bench.index(OTHER), bench.description.limb_of_joint
    arm = limb == limb[row]
    bench.start(bench.move(JOINT, 0.3))
    bench.run(10)
    bench.drives.life[row] = State.FAULT
    bench.run(3)
    assert bench.drives.life[row] == State.FAULT
    assert (bench.drives.life[arm & others(bench, row)] == State.QUICK_STOP_ACTIVE).all()
    assert (bench.drives.life[~arm] == State.OPERATION_ENABLED).all()
    assert bench.snapshot()["flags"] == Flag.ENABLED | Flag.ISOLATED
    assert bench.action() == (ActionState.ENDED, Outcome.DRIVE_FAULT)
    assert tripped(bench, Rule.DRIVE_FAULT)["holds"]
    assert tripped(bench, Rule.DRIVE_FAULT)["joint"] == row
    bench.enable()
    assert not tripped(bench, Rule.DRIVE_FAULT)["holds"]
    held(bench)


def brakes_and_latches(bench: Any, rule: Rule, joint: str, by: float, bodies: str) -> None:
    """A motion of one joint is stopped before it brings bodies together; another joint's goes on."""
    from daemon.exchange import Kind

    row, other = bench.index(joint), bench.index("head_2_joint")
    assert bench.start(bench.move(joint, by, 1.0)) is Answer.ACCEPTED
    assert bench.start(bench.move("head_2_joint", 0.4, 5.0)) is Answer.ACCEPTED
    commands = []
    for _ in range(700):
        commands.append(bench.run()["command"][0].copy())
        if bench.action() == (ActionState.ENDED, Outcome.TOO_CLOSE) and len(bench.loop.manager.active) == 2:
            break  # it has braked, and is held again
    assert bytes(bench.snapshot()["actions"][0]["detail"]).decode().startswith(bodies.split(" and ", maxsplit=1)[0])
    assert bench.action(1)[0] is ActionState.RUNNING
    speed = np.diff(np.array(commands), axis=0) / 0.002
    assert abs(speed[-1, row]) < 5e-3, "in the last step of braking"
    assert abs(speed[-1, other]) > 0.01
    assert np.abs(np.diff(speed[:, row])).max() < 0.5, "no jump: rad/s from cycle to cycle"
    held = tripped(bench, rule)
    assert held["holds"]
    assert held["value"] > held["limit"] == 0.01
    (told, *_), text = explained(bench)
    assert all(body in told.detail for body in bodies.split(" and ")), told.detail
    assert f"held by {rule.name.lower()}" in text
    assert bench.start(bench.move(joint, -0.4 * by)) is Answer.TOO_CLOSE, "it is latched"
    for share, outcome in ((0.2, Outcome.TOO_CLOSE), (-0.4, Outcome.DONE)):
        assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
        assert not tripped(bench, rule)["holds"]
        where = bench.loop.written.position[row]
        assert bench.start(bench.move(joint, share * by)) is Answer.ACCEPTED
        slot = int(np.argmax(bench.snapshot()["actions"]["serial"]))
        while bench.action(slot)[0] is not ActionState.ENDED:
            bench.run()
        assert bench.action(slot)[1] is outcome
        bench.run(60)
        if outcome is Outcome.TOO_CLOSE:
            assert abs(bench.loop.written.position[row] - where) < 0.05


def self_collision(bench: Any) -> None:
    brakes_and_latches(bench, Rule.SELF_COLLISION, "arm_left_3_joint", -1.6, "leg_left_3_link and arm_left_7_link")


def workspace(bench: Any) -> None:
    brakes_and_latches(bench, Rule.WORKSPACE, "arm_right_4_joint", 1.2, "tool_right and wall")


def test_the_operator_stop_latches_with_its_first_reason_until_it_is_cleared() -> None:
    stop, again, clear = StopRequest(True, "fire"), StopRequest(True, ""), StopRequest(False, "")
    timeline = [(clear, None), (stop, "fire"), (again, "fire"), (clear, None), (again, ""), (stop, ""), (clear, None)]
    held = None
    for asked, then in timeline:
        held = rules.latched(held, asked)
        assert held == then


@pytest.mark.parametrize(
    ("in_a_row", "most", "enabled", "stops"),
    [(3, 3, True, True), (2, 3, True, False), (9, 0, True, False), (9, 3, False, False)],
)
def test_missed_periods_stop_a_robot_that_is_enabled_and_does_not_allow_them(
    in_a_row: int, most: int, enabled: bool, stops: bool
) -> None:
    asked = rules.overrun(in_a_row, most, enabled)
    assert (asked is not None) is stops
    assert asked is None or (asked.stop and f"missed {in_a_row} periods" in asked.reason)


def test_a_drive_of_another_protocol_stops_all_but_where_it_is_isolated_already() -> None:
    expected, nobody, first = np.array([2, 2, 0, 2]), np.zeros(4, bool), np.array([True, False, False, False])
    timeline = [
        ([2.0, np.nan, 7.0, 2.0], nobody, None),
        ([3.0, 2.0, 7.0, 2.0], nobody, (0, 3.0)),
        ([3.0, 2.0, 7.0, 2.0], first, None),
        ([3.0, 2.0, 7.0, 1.0], first, (3, 1.0)),
    ]
    for spoken, isolated, then in timeline:
        no = rules.stranger(np.array(spoken), expected, isolated)
        assert (no and (no.joint, no.value)) == then
        assert no is None or (no.rule is Rule.PROTOCOL and no.limit == 2.0)


def test_an_arm_that_is_pushed_off_its_command_is_guarded_where_it_is(
    make_bench: Callable[..., Any], talos: Any
) -> None:
    bench, joint = make_bench(talos), "arm_left_3_joint"
    row = bench.index(joint)
    bench.enable()
    bench.drives.external_torque[row] = -60.0  # towards the leg
    bench.run(100)
    pushed = bench.drives.state.position[row] - bench.loop.written.position[row]
    assert pushed < -2 * PUSHED_BY
    assert not tripped(bench, Rule.SELF_COLLISION)["times"], "whoever stands is left alone, whatever is done to him"
    bench.start(bench.move(joint, -0.95, 1.0))
    run_to_end(bench)
    assert bench.action()[1] is Outcome.TOO_CLOSE
    assert tripped(bench, Rule.SELF_COLLISION)["holds"]
    assert bench.drives.state.position[row] < bench.loop.written.position[row] + 0.8 * pushed
    bench.run(100)  # braking ends
    bench.enable()
    bench.start(bench.move(joint, 0.2, 0.5))
    run_to_end(bench)
    assert bench.action(1)[1] is Outcome.DONE, "away is free"
    bench.drives.external_torque[row] = 0.0
    bench.run(100)
    bench.start(bench.move(joint, -0.95 - bench.loop.written.position[row], 0.6))
    run_to_end(bench)
    assert bench.action(2)[1] is Outcome.DONE, "where nobody pushes, there is room"


def not_finite(bench: Any) -> None:
    bench.start(bench.move(JOINT, 0.3))
    bench.run(50)
    controller = bench.loop.actions.running()[0].controller
    controller.update = lambda robot, out: out.torque.__setitem__(controller.joints, np.nan)
    before = bench.loop.written.position.copy()
    bench.run()
    assert bench.action() == (ActionState.ENDED, Outcome.REFUSED_BY_LIMITS)
    assert tripped(bench, Rule.NOT_FINITE)["joint"] == bench.index(JOINT)
    assert np.abs(held(bench) - before).max() < 0.01
    assert bench.start(bench.move(JOINT, 0.1)) is Answer.ACCEPTED


def held_back(bench: Any) -> None:
    bench.start(bench.move(JOINT, 0.3))
    bench.run(20)
    controller = bench.loop.actions.running()[0].controller
    controller.update = lambda robot, out: out.position.__setitem__(controller.joints, 0.5)
    before = bench.loop.written.position.copy()
    bench.run()
    assert bench.action() == (ActionState.ENDED, Outcome.REFUSED_BY_LIMITS)
    row = tripped(bench, Rule.HELD_BACK)
    assert row["value"] > row["limit"] > 0
    assert tripped(bench, Rule.VELOCITY)["times"] == 1
    bench.run(2)
    assert not tripped(bench, Rule.VELOCITY)["holds"]
    assert np.abs(held(bench) - before).max() < 0.02


def stale(bench: Any) -> None:
    row = bench.index(JOINT)
    bench.start(bench.move(JOINT, 0.5, 2.0))
    bench.run(30)
    bench.drives.silent[row] = True
    bench.run(STALE - 1)
    assert bench.action()[0] is ActionState.RUNNING, "a few lost replies are none"
    bench.run(4)
    assert bench.action() == (ActionState.ENDED, Outcome.STALE_STATE)
    assert tripped(bench, Rule.STALE)["joint"] == row
    held(bench)
    bench.drives.silent[row] = False
    bench.run(3)
    assert bench.start(bench.move(JOINT, 0.1)) is Answer.ACCEPTED


def diverged(bench: Any) -> None:
    row = bench.index(JOINT)
    bench.start(bench.move(JOINT, 0.1, 2.0))
    bench.drives.external_torque[row] = -200.0
    for _ in range(200):
        if bench.run()["actions"][0]["state"] == ActionState.ENDED:
            break
    assert bench.action() == (ActionState.ENDED, Outcome.DIVERGED)
    assert tripped(bench, Rule.DIVERGED)["joint"] == row
    assert tripped(bench, Rule.DIVERGED)["value"] > DIVERGED
    bench.drives.external_torque[row] = 0.0


def owner_lost(bench: Any) -> None:
    from daemon.exchange import Kind

    bench.start(bench.move(JOINT, 0.5, 5.0), owner=7)
    bench.run(100)
    bench.ask(Kind.LOSE_OWNER, owner=7)
    bench.run(300)
    assert bench.action() == (ActionState.ENDED, Outcome.OWNER_LOST)
    assert tripped(bench, Rule.OWNER_LOST)["times"] == 1
    held(bench)


def expired(bench: Any) -> None:
    now = int(bench.snapshot()["time_ns"])
    late = bench.start(bench.move(JOINT, 0.1), expires_ns=now - 40_000_000)
    assert late is Answer.EXPIRED
    assert tripped(bench, Rule.EXPIRED)["value"] == pytest.approx(0.04, abs=0.01)
    held(bench)
    in_time = bench.start(bench.move(JOINT, 0.1), expires_ns=int(bench.snapshot()["time_ns"]) + 40_000_000)
    assert in_time is Answer.ACCEPTED


def cut_by(rule: Rule, change: Callable[[Any, Any, int], None]) -> Callable[[Any], None]:
    """A controller's set-points of one joint are changed for a few cycles, and then no more."""

    def timeline(bench: Any) -> None:
        row = bench.index(JOINT)
        hold = bench.loop.manager.active[0]
        right = hold.update

        def wrong(robot: Any, out: Any) -> None:
            right(robot, out)
            change(bench, out, row)

        hold.update = wrong
        bench.run(4)
        cut = tripped(bench, rule)
        assert cut["times"] >= 1
        assert cut["joint"] == row
        assert bench.snapshot()["flags"] == Flag.ENABLED
        _, upper, velocity, _, step = bench.loop.last_word.limits.table[:5, row]
        for seen in bench.drives.seen[-4:]:
            assert seen.position[row] <= upper + 1e-4
            assert abs(seen.velocity[row]) <= velocity + 2e-3
        assert np.abs(np.array(bench.drives.jumps[-3:])[:, row]).max() <= step + 0.2
        hold.update = right
        bench.run(60)
        assert not tripped(bench, rule)["holds"]
        held(bench)

    return timeline


def beyond_the_end(bench: Any, out: Any, row: int) -> None:
    """Its end is right before it."""
    limits = bench.loop.last_word.limits
    limits.table[1, row] = bench.loop.written.position[row]
    out.position[row] += 1e-3


def too_fast(bench: Any, out: Any, row: int) -> None:
    out.velocity[row] = 10.0


def too_strong(bench: Any, out: Any, row: int) -> None:
    bench.loop.last_word.limits.table[4, row] = 1e3  # or the rate would come first
    out.torque[row] = 1e3


def too_sudden(bench: Any, out: Any, row: int) -> None:
    out.torque[row] += 15.0


def too_stiff(bench: Any, out: Any, row: int) -> None:
    out.stiffness[row] = 1e6


def balance(bench: Any) -> None:
    """As if it stood on feet, and its capture point went out of them: for a moment, and for long."""
    stance = SimpleNamespace(bearing=1.0, outside=-0.08)
    bench.loop.robot.stance = stance
    bench.start(bench.move("arm_right_1_joint", 0.3, 2.0))
    bench.run(120)
    stance.outside = 0.06
    bench.run(round(PATIENCE / bench.loop.robot.period))
    stance.outside = 0.04
    bench.run(20)
    assert bench.action()[0] is ActionState.RUNNING
    assert not tripped(bench, Rule.BALANCE)["times"]
    stance.outside = 0.06
    bench.run(round(PATIENCE / bench.loop.robot.period) + 1)
    assert bench.action() == (ActionState.ENDED, Outcome.BALANCE_LOST)
    assert tripped(bench, Rule.BALANCE)["holds"]
    damped = bench.drives.seen[-1]
    assert (damped.mode == Mode.DAMPING).any()
    assert not damped.stiffness.any(), "no joint is held"
    assert bench.start(bench.move("arm_right_1_joint", 0.1)) is Answer.CLAIMED
    for _ in range(round(3.0 / bench.loop.robot.period) + 2):
        if not bench.run()["flags"] & Flag.ENABLED:
            break
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).any(), "and then every drive stops"
    assert tripped(bench, Rule.BALANCE)["holds"]
    bench.loop.robot.stance = None
    bench.enable()
    assert not tripped(bench, Rule.BALANCE)["holds"]


TIMELINES: dict[Rule, Callable[[Any], None]] = {
    Rule.OPERATOR_STOP: operator_stop,
    Rule.KEEPALIVE: keepalive,
    Rule.NO_COMMAND: no_command,
    Rule.PROTOCOL: protocol,
    Rule.DRIVE_FAULT: drive_fault,
    Rule.BALANCE: balance,
    Rule.SELF_COLLISION: self_collision,
    Rule.WORKSPACE: workspace,
    Rule.NOT_FINITE: not_finite,
    Rule.HELD_BACK: held_back,
    Rule.STALE: stale,
    Rule.DIVERGED: diverged,
    Rule.OWNER_LOST: owner_lost,
    Rule.EXPIRED: expired,
    Rule.POSITION: cut_by(Rule.POSITION, beyond_the_end),
    Rule.VELOCITY: cut_by(Rule.VELOCITY, too_fast),
    Rule.TORQUE: cut_by(Rule.TORQUE, too_strong),
    Rule.TORQUE_RATE: cut_by(Rule.TORQUE_RATE, too_sudden),
    Rule.GAIN: cut_by(Rule.GAIN, too_stiff),
}


@pytest.mark.parametrize("rule", list(Rule), ids=lambda rule: rule.name.lower())
def test_each_rule_does_what_its_row_says(talos: RobotDescription, make_bench: Callable[..., Any], rule: Rule) -> None:
    bench = make_bench(replace(talos, guard=Guarding(regions=(WALL,))))
    bench.enable()
    assert not bench.snapshot()["safety"]["times"].any(), "nothing has tripped on a robot that is only held"
    TIMELINES[rule](bench)
    assert tripped(bench, rule)["times"] >= 1
    assert 0 < tripped(bench, rule)["time_ns"] <= bench.snapshot()["time_ns"]


def test_the_page_has_the_table_that_the_daemon_tells() -> None:
    page = (Path(__file__).parents[3] / "docs" / "safety.md").read_text()
    assert page.split("<!-- rules -->\n")[1].split("\n<!-- /rules -->")[0] == markdown()
    assert set(TABLE) == set(Rule)


def explained(bench: Any) -> tuple[list[SafetyRule], str]:
    snapshot = bench.snapshot()
    told = safety_report(snapshot, bench.description, drive_problems(snapshot, bench.description))
    return told.rules, "\n".join(cli._explained(told))


def test_the_explanation_names_the_rule_that_holds_the_robot_and_how_to_recover(bench: Any) -> None:
    bench.run(3)
    assert explained(bench)[1].startswith("talos_upper is inactive: no safety rule holds it")
    bench.enable()
    assert explained(bench) == ([], "talos_upper is enabled: no safety rule holds it")
    bench.drives.life[bench.index(OTHER)] = State.FAULT
    bench.run(500)
    (rule,), text = explained(bench)
    assert (rule.rule, rule.holds, rule.joint) == ("drive_fault", True, OTHER)
    assert f"held by drive_fault (the drive of {OTHER}: fault: " in text
    assert "1.0 s ago" in text
    assert "recover  remove the cause" in text
    bench.enable()
    tell_stop_socket(bench, b"STOP too close")
    bench.run(2)
    rules, text = explained(bench)
    assert [rule.rule for rule in rules] == ["operator_stop", "drive_fault"]
    assert "talos_upper is stopped, held by operator_stop (too close)" in text
    assert "tripped before" in text


@pytest.mark.parametrize(
    ("expires", "now", "late"), [(0, 5, 0.0), (10, 10, 0.0), (10, 2_000_000_010, 2.0), (-5, 0, 5e-9)]
)
def test_a_command_is_late_by_the_robots_clock_and_only_if_it_says_until_when(
    expires: int, now: int, late: float
) -> None:
    trip = rules.expired(expires, now)
    assert (trip.value if trip else 0.0) == pytest.approx(late)
    assert trip is None or trip.rule is Rule.EXPIRED


def test_limbs_are_isolated_whole_and_those_that_are_stay_out() -> None:
    limb = np.array([0, 0, 1, 1, 2, 2])
    nobody, lost = np.zeros(6, bool), np.array([0, 0, 0, 1, 0, 0], bool)
    assert not isolated_with(nobody, limb, nobody).any()
    one = isolated_with(lost, limb, nobody)
    assert one.tolist() == [False, False, True, True, False, False]
    assert isolated_with(nobody, limb, one).tolist() == one.tolist()
    assert isolated_with(limb == 0, limb, one).tolist() == [True, True, True, True, False, False]


def state_at(position: float, age: int) -> JointState:
    state = JointState(3)
    state.position[:], state.age[:] = [0.0, position, 9.0], [0, age, 99]
    return state


@pytest.mark.parametrize(
    ("position", "age", "rule"),
    [
        (0.0, 0, None),
        (DIVERGED - 1e-6, STALE, None),
        (DIVERGED + 1e-6, 0, Rule.DIVERGED),
        (-2.0, 0, Rule.DIVERGED),
        (np.nan, 0, Rule.DIVERGED),
        (0.0, STALE + 1, Rule.STALE),
        (9.0, STALE + 1, Rule.STALE),
    ],
)
def test_an_action_is_judged_by_its_own_joints_state(position: float, age: int, rule: Rule | None) -> None:
    for joints in ([0, 1], [1, 0]):
        trip = unsafe(followed(np.array(joints), np.zeros(3), state_at(position, age)))
        assert (trip and trip.rule) == rule
        if trip is not None:
            assert trip.joint == 1
    assert unsafe(Followed(0, 0.0, 0, 0)) is None
