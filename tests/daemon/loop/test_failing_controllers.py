"""What takes over in the cycle in which a controller fails; controllers that command others; claims of single interfaces."""

import dataclasses
from pathlib import Path

import msgspec
import numpy as np
import pytest

from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.exchange import CONTROLLERS, LOADED_CODE, Answer, ControllerState, Kind, Outcome, Rule
from handrail.messages import ConfigureController
from tests.daemon.loop.conftest import SWAY, Desk

HOLD = CONTROLLERS.index("hold")
LEFT = [f"arm_left_{i}_joint" for i in range(1, 8)]
ELBOW = ["arm_left_4_joint"]


@pytest.fixture
def free(desk: Desk) -> Desk:
    """Enabled, with the torque rate limiter off, so that it can't hide a bump."""
    word = desk.bench.loop.last_word
    word.limits = dataclasses.replace(word.limits, torque_step=np.full_like(word.limits.torque_step, np.inf))
    desk.bench.enable()
    return desk


def run_until_it_fails(desk: Desk, slot: int) -> None:
    """Up to and with the cycle in which an active controller fails."""
    for _ in range(500):
        if desk.state(slot) is not ControllerState.ACTIVE:
            return
        desk.bench.run()
    raise AssertionError("it does not fail")


def rated_jump(desk: Desk) -> float:
    """The largest change of any drive's torque by this cycle's command, as a share of its rated torque."""
    return float((np.abs(desk.bench.drives.jumps[-1]) / desk.bench.description.torque_limit).max())


def codes(desk: Desk, joints: list[str]) -> set[int]:
    return set(desk.bench.snapshot()["claims"][:, desk.bench.description.index(tuple(joints))].flat)


def test_a_controller_that_raises_gives_its_joints_to_its_fallback_in_that_cycle(free: Desk, workspace: Path) -> None:
    soft = free.load("soft", "joint_impedance", LEFT[:5], parameters={"stiffness": 0.3})
    frail = free.load("frail", "frail", LEFT, fallback=["soft"])
    assert free.switch([frail]) is Answer.ACCEPTED
    assert free.give(Kind.UNLOAD, go=1 << soft) is Answer.CONTROLLER_STATE, "the active one falls back to it"
    run_until_it_fails(free, frail)
    assert free.state(soft) is ControllerState.ACTIVE
    assert free.state(frail) is ControllerState.UNCONFIGURED
    assert codes(free, LEFT[:5]) == {LOADED_CODE + soft}
    assert codes(free, LEFT[5:]) == {HOLD}, "what the fallback leaves over is held"
    assert rated_jump(free) < 0.01
    cycle = int(free.bench.snapshot()["cycle"])
    free.settle(frail)
    entry, news = free.roster().loaded[frail], free.roster().news[-1]
    assert (news.name, news.state, news.cycle) == ("frail", "unconfigured", cycle)
    assert "RuntimeError: worn out" in news.detail and "frail.py" in news.detail
    assert entry.error == news.detail
    assert free.switch([frail], [soft]) is Answer.CONTROLLER_STATE, "it has to be made anew first"
    again = msgspec.json.encode(ConfigureController(name="frail"))
    assert free.give(Kind.CONFIGURE, go=1 << frail, text=again) is Answer.ACCEPTED
    assert free.settle(frail) is ControllerState.INACTIVE
    assert free.roster().loaded[frail].error == ""
    assert free.switch([frail], [soft]) is Answer.ACCEPTED


def test_without_a_fallback_the_joints_are_held_and_the_others_do_not_notice(free: Desk, workspace: Path) -> None:
    frail = free.load("frail", "frail", LEFT)
    assert free.switch([frail]) is Answer.ACCEPTED
    assert free.bench.start(free.bench.move("arm_right_1_joint", 0.2, 1.0)) is Answer.ACCEPTED
    steps = []

    def note() -> None:
        steps.append(free.bench.loop.actions.slots[0].controller.clock.s)

    free.bench.run(400, note)
    assert free.state(frail) is ControllerState.UNCONFIGURED
    assert codes(free, LEFT) == {HOLD}
    assert np.diff(steps) == pytest.approx(0.002), "its clock ticks once a cycle, in that of the failure, too"


@pytest.mark.parametrize("when", ["activate", "update"])
def test_a_fallback_that_fails_itself_is_followed_by_hold_in_the_same_cycle(
    free: Desk, workspace: Path, when: str
) -> None:
    line = {"activate": "        self.start,", "update": "        self.phase +="}[when]
    text = SWAY.replace(line, f"        if self.worn:\n            raise OSError\n{line}")
    (workspace / "worse.py").write_text(text.replace("    def activate", "    worn = False\n\n    def activate"))
    free.load("worse", "worse", LEFT)
    frail = free.load("frail", "frail", LEFT, fallback=["worse"])
    assert free.switch([frail]) is Answer.ACCEPTED
    free.table._slots[0].controller.worn = True
    run_until_it_fails(free, frail)
    assert codes(free, LEFT) == {HOLD}
    assert rated_jump(free) < 0.01
    assert free.settle(0) is ControllerState.UNCONFIGURED
    assert ["OSError" in entry.error or "worn out" in entry.error for entry in free.roster().loaded] == [True, True]


def test_a_set_point_that_is_no_number_costs_its_controller_the_joints_and_nobody_else(
    free: Desk, workspace: Path
) -> None:
    (workspace / "lost.py").write_text(SWAY.replace("0.1 *", "(0.1 if self.phase < 0.9 else np.nan) *"))
    soft = free.load("soft", "joint_impedance", LEFT)
    lost = free.load("lost", "lost", LEFT, fallback=["soft"])
    assert free.switch([lost]) is Answer.ACCEPTED
    assert free.bench.start(free.bench.move("arm_right_1_joint", 0.2, 1.0)) is Answer.ACCEPTED
    run_until_it_fails(free, lost)
    assert free.state(soft) is ControllerState.ACTIVE
    assert rated_jump(free) < 0.01
    assert free.bench.loop.life.ledger.rows["times"][Rule.NOT_FINITE] == 1
    assert np.isfinite(free.bench.loop.written.table).all()
    assert free.bench.action()[1] is Outcome.NONE, "the other arm moves on"


def test_an_actions_controller_that_raises_ends_its_action_and_is_told_with_the_traceback(
    free: Desk, monkeypatch
) -> None:
    assert free.bench.start(free.bench.move("arm_right_1_joint", 0.2, 1.0)) is Answer.ACCEPTED
    free.bench.run(100)

    def fall(self, robot, out) -> None:
        raise ArithmeticError("a defect")

    monkeypatch.setattr(JointTrajectory, "update", fall)
    snapshot = free.bench.run()
    assert free.bench.action()[1] is Outcome.CONTROLLER_ERROR
    assert snapshot["actions"][0]["cycle"] == snapshot["cycle"]
    assert (snapshot["claims"] == HOLD).all()
    assert rated_jump(free) < 0.01
    free.settle(0)
    news = free.roster().news[-1]
    assert news.name == "joint_trajectory" and "ArithmeticError: a defect" in news.detail


# ------------------------------------------------------------------------------------------------------------- chains


def test_one_controller_commands_the_references_of_another(free: Desk, workspace: Path) -> None:
    soft = free.load("soft", "joint_impedance", LEFT, parameters={"stiffness": 0.5})
    sway = free.load("sway", "sway", ELBOW, onto="soft")
    assert free.switch([sway]) is Answer.CHAIN_BROKEN
    assert free.bench.snapshot()["answer_value"] == sway
    assert free.switch([sway, soft]) is Answer.ACCEPTED
    assert rated_jump(free) < 0.01
    assert free.claimed(soft) == LEFT
    joint = free.bench.index(ELBOW[0])
    start = float(free.bench.loop.written.position[joint])
    snapshot = free.bench.run(250)
    assert snapshot["command"][0][joint] == pytest.approx(start + 0.2, abs=0.01)
    assert snapshot["command"][3][joint] == pytest.approx(0.5 * free.bench.loop.manager.gains.stiffness[joint])
    second = free.load("second", "sway", LEFT[3:], onto="soft")
    assert free.switch([second]) is Answer.CLAIMED, "one reference, one commander"
    assert free.switch([], [soft]) is Answer.CHAIN_BROKEN
    assert free.state(soft) is ControllerState.ACTIVE
    free.bench.run(60)
    stood = float(free.bench.loop.written.position[joint])
    assert free.switch([], [sway]) is Answer.ACCEPTED
    assert rated_jump(free) < 0.01
    snapshot = free.bench.run(100)
    assert snapshot["command"][0][joint] == pytest.approx(stood, abs=0.01), "the reference stands where it was left"
    assert snapshot["command"][1][joint] == 0.0
    assert free.switch([second]) is Answer.ACCEPTED
    assert free.switch([], [soft, second]) is Answer.ACCEPTED
    assert (free.bench.snapshot()["claims"] == HOLD).all()


def test_a_reference_that_the_other_one_does_not_have_is_refused(free: Desk, workspace: Path) -> None:
    soft = free.load("soft", "joint_impedance", ELBOW)
    wide = free.load("wide", "sway", LEFT, onto="soft")
    assert free.switch([soft, wide]) is Answer.CHAIN_BROKEN
    assert free.bench.snapshot()["answer_joint"] == free.bench.index(LEFT[0])
    assert (free.bench.snapshot()["claims"] == HOLD).all()


def test_who_commands_references_and_fails_leaves_them_standing_and_the_other_one_active(
    free: Desk, workspace: Path
) -> None:
    soft = free.load("soft", "joint_impedance", LEFT)
    frail = free.load("frail", "frail", ELBOW, onto="soft")
    assert free.switch([soft, frail]) is Answer.ACCEPTED
    run_until_it_fails(free, frail)
    assert rated_jump(free) < 0.01
    joint = free.bench.index(ELBOW[0])
    stood = float(free.bench.snapshot()["command"][0][joint])
    snapshot = free.bench.run(50)
    assert free.state(soft) is ControllerState.ACTIVE
    assert snapshot["command"][0][joint] == pytest.approx(stood, abs=0.005)
    assert snapshot["command"][1][joint] == 0.0


def test_who_fails_takes_those_with_it_that_command_its_references(free: Desk, workspace: Path, monkeypatch) -> None:
    soft = free.load("soft", "joint_impedance", LEFT)
    sway = free.load("sway", "sway", ELBOW, onto="soft")
    assert free.switch([soft, sway]) is Answer.ACCEPTED
    free.bench.run(100)

    def fall(robot, out) -> None:
        raise ArithmeticError

    monkeypatch.setattr(free.table._slots[soft].controller, "follow", fall)
    free.bench.run()
    assert free.state(soft) is ControllerState.UNCONFIGURED
    assert free.state(sway) is ControllerState.INACTIVE, "it did nothing wrong"
    assert codes(free, LEFT) == {HOLD}
    assert rated_jump(free) < 0.01


# ----------------------------------------------------------------------------------------------------- single interfaces


def test_of_a_joint_that_is_claimed_in_part_the_rest_is_held(free: Desk, workspace: Path) -> None:
    push = SWAY.replace("class Sway(Controller):", 'class Push(Controller):\n    interfaces = ("torque",)\n').replace(
        "self.write_impedance(robot, out, self.start + 0.1 * (1 - np.cos(self.phase)), velocity)",
        "out.torque[self.joints] = robot.gravity[self.joints] + 2.0",
    )
    (workspace / "push.py").write_text(push)
    slot = free.load("push", "push", ELBOW)
    other = free.load("other", "push", ELBOW)
    whole = free.load("whole", "sway", ELBOW)
    joint = free.bench.index(ELBOW[0])
    before = free.bench.snapshot()["command"][:, joint].copy()
    assert free.switch([slot]) is Answer.ACCEPTED
    assert rated_jump(free) < 0.01
    claims = free.bench.snapshot()["claims"][:, joint]
    assert claims.tolist() == [HOLD, HOLD, LOADED_CODE + slot, HOLD, HOLD]
    assert free.switch([other]) is Answer.CLAIMED
    assert free.switch([whole]) is Answer.CLAIMED
    snapshot = free.bench.run(200)
    assert snapshot["command"][[0, 3, 4], joint] == pytest.approx(before[[0, 3, 4]])
    assert snapshot["command"][2, joint] == pytest.approx(free.bench.loop.robot.gravity[joint] + 2.0, abs=1e-6)
    assert snapshot["position"][joint] > before[0] + 1.0 / before[3]
    assert free.switch([other], [slot]) is Answer.ACCEPTED
    assert free.switch([whole], [other]) is Answer.ACCEPTED
    assert rated_jump(free) < 0.01
