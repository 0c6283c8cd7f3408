"""Behaviours in files: what is filled in, what is wrong with them, and `handrail behaviour run`."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.actions.cli import app
from daemon.exchange import Answer, Kind, Outcome, PreparedMotion
from daemon.serving.robot_info import robot_info
from daemon.serving.whole_body_door import WholeBodyDoor
from handrail.behaviour_file import BehaviourFile, Part, find
from handrail.config import ConfigError
from handrail.messages import CompliantMotion, ContactEnd, WholeBody
from handrail.robot import library as robots
from tests.daemon.test_server import Rig

EXAMPLE = Path(__file__).parents[2] / "examples" / "press_wall.yaml"
WHOLE_BODY = EXAMPLE.with_name("reach_and_press.yaml")


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig(robots.load("talos_upper"))
    yield made
    made.close()


def test_frame_and_joints_are_said_once_and_groups_stand_for_their_joints() -> None:
    robot = robot_info(robots.load("talos_upper"))
    call = BehaviourFile(EXAMPLE).call("press", "me", robot)
    assert [step.name for step in call.steps] == ["approach", "press", "retreat"]
    for step in call.steps:
        assert isinstance(step.motion, CompliantMotion)
        assert step.motion.frame == "tool_right_tip"
        assert step.motion.joints == [*robot.groups["torso"], *robot.groups["arm_right"]]
    assert call.steps[0].ends == [ContactEnd(frame="tool_right_tip", threshold=5.0)]


def test_what_the_file_leaves_open_is_the_arms_and_what_it_says_stays(tmp_path: Path) -> None:
    robot = robot_info(robots.load("talos_upper"))
    left = Part(robot.tips["left"], tuple(robot.arms["left"]))
    for step in BehaviourFile(find("press"), left).call("press", "me", robot).steps:
        assert isinstance(step.motion, CompliantMotion)
        assert step.motion.frame == "tool_left_tip"
        assert step.motion.joints == [*robot.groups["torso"], *robot.groups["arm_left"]]
    own = BehaviourFile(EXAMPLE, left).call("press", "me", robot)
    assert own.steps[0].motion.frame == "tool_right_tip"


@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        ("threshold: 5", "treshold: 5", r":7: steps\[0\].ends\[0\].*treshold"),
        ("force: 20", "force: much", r":13: steps\[1\].motion.compliance\[0\].force: .*got 'much'"),
        ("axis: x", "axis: q", r":13: steps\[1\].motion.compliance\[0\].axis"),
        ("duration: 1.0", "duration: -1", r":17: steps\[2\].motion.duration: .*got -1"),
        ("torso, arm_right", "torso, arm_rigth", r"steps\[0\].motion.joints: arm_rigth is none of talos_upper's"),
    ],
)
def test_what_is_wrong_with_a_file_is_told_by_line_field_and_value(tmp_path, was: str, becomes: str, told: str) -> None:
    text = EXAMPLE.read_text()
    assert was in text
    file = tmp_path / "press.yaml"
    file.write_text(text.replace(was, becomes))
    with pytest.raises(ConfigError, match=told):
        BehaviourFile(file).call("press", "me", robot_info(robots.load("talos_upper")))


@pytest.mark.parametrize(("outcome", "status"), [(Outcome.DONE, 0), (Outcome.DIVERGED, 1)])
def test_run_tells_every_step_and_exits_by_how_it_ended(rig: Rig, outcome: Outcome, status: int) -> None:
    loop = rig.start_loop()

    def play() -> None:
        loop.wait_for(Kind.BEHAVIOUR)
        slot = loop.snapshot["actions"][0]
        slot["step"], slot["before"], slot["steps_taken"] = 1, 0, 2
        slot["outcome"], slot["condition"], slot["value"], slot["joint"] = Outcome.CONDITION, 0, 6.5, -1
        loop.cycle()
        loop.end_action(outcome, joint=-1)

    player = threading.Thread(target=play)
    player.start()
    ran = CliRunner().invoke(app, ["run", str(EXAMPLE), "--runtime", str(rig.runtime.folder)])
    player.join()
    assert ran.exit_code == status, ran.output
    first, second, last = ran.stdout.splitlines()
    assert first.split()[2] == "approach"
    assert second.endswith("press  (approach: ends[0]: contact reached 6.5)")
    assert last.split()[2:] == ["press", outcome.name.lower()]


def test_run_says_why_the_daemon_refuses(rig: Rig) -> None:
    rig.start_loop().cycle(flags=0)
    ran = CliRunner().invoke(app, ["run", str(EXAMPLE), "--runtime", str(rig.runtime.folder)])
    assert ran.exit_code == 1
    assert "the robot is not enabled" in str(ran.exception) + ran.output


def test_a_whole_body_step_may_have_its_compound_task_written_in_it_and_moves_all_joints() -> None:
    robot = robot_info(robots.load("talos_upper"))
    approach, press, retreat = BehaviourFile(WHOLE_BODY).call("x", "me", robot).steps
    assert isinstance(approach.motion, WholeBody)
    assert isinstance(retreat.motion, WholeBody)
    assert (approach.motion.compound, approach.motion.joints, approach.motion.frame) == ("hand", [], "tool_right_tip")
    assert retreat.motion.compound == '{"extends": "hand"}'
    assert press.motion.joints == robot.joints


@pytest.fixture(scope="session")
def loaded() -> None:
    """What the server's door to whole-body motions loads, and compiles where nothing was: longer than a test waits."""
    robot = robots.load("talos_upper")
    door = WholeBodyDoor(robot)
    assert door.open(250.0)
    door.checked(WholeBody(compound="hand", frame="tool_right_tip"), (), robot.home_position(), 1 << 18)


def twice(tmp_path: Path) -> Path:
    """A posture, the same once more, and a hand's pose."""
    file = tmp_path / "twice.yaml"
    posture = "motion: {type: whole_body, compound: posture, duration: 1}"
    hand = "motion: {type: whole_body, compound: hand, frame: tool_right_tip}"
    steps = [f"  - {{name: {name}, {what}}}" for name, what in (("a", posture), ("b", posture), ("c", hand))]
    file.write_text("\n".join(["steps:", *steps]))
    return file


@pytest.mark.usefixtures("loaded")
def test_whole_body_steps_are_made_before_the_behaviour_starts_and_those_that_are_the_same_only_once(
    rig: Rig, tmp_path: Path
) -> None:
    loop = rig.start_loop()
    player = threading.Thread(target=lambda: (loop.wait_for(Kind.BEHAVIOUR), loop.end_action(Outcome.DONE, joint=-1)))
    player.start()
    ran = CliRunner().invoke(app, ["run", str(twice(tmp_path)), "--runtime", str(rig.runtime.folder)])
    player.join()
    assert ran.exit_code == 0, ran.output
    made = [command.serial for command in loop.commands if command.kind is Kind.PREPARE and command.text]
    motions = [step.motion for step in loop.wait_for(Kind.BEHAVIOUR).steps]
    assert all(isinstance(motion, PreparedMotion) for motion in motions)
    assert [motion.prepared for motion in motions] == [made[0], made[0], made[1]]
    assert [len(motion.joints) for motion in motions] == [len(rig.description.joints)] * 3


@pytest.mark.usefixtures("loaded")
def test_run_asks_again_while_a_step_is_still_being_made(rig: Rig, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("daemon.serving.preparations.PATIENCE_S", 0.0)
    loop = rig.start_loop()
    loop.answers[Kind.PREPARE] = (Answer.NOT_READY, -1, 0.0)
    looks: list[int] = []

    def play() -> None:
        while len(looks) < 3:
            loop.wait_for(Kind.PREPARE)
            looks[:] = [one.serial for one in loop.commands if one.kind is Kind.PREPARE and not one.text]
        loop.answers[Kind.PREPARE] = (Answer.ACCEPTED, -1, 0.0)
        loop.wait_for(Kind.BEHAVIOUR)
        loop.end_action(Outcome.DONE, joint=-1)

    player = threading.Thread(target=play)
    player.start()
    ran = CliRunner().invoke(app, ["run", str(twice(tmp_path)), "--runtime", str(rig.runtime.folder)])
    player.join()
    assert ran.exit_code == 0, ran.output
    begun = [command for command in loop.commands if command.kind is Kind.PREPARE and command.text]
    assert len(begun) == 2, "though it was asked for three times or more"


@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        ("hand, duration: 1.0", "hnd, duration: 1.0", r"no such task; field steps\[2\].motion.references\[0\].task"),
        ("compound: hand #", "compound: hnad #", r"no such compound task.*field steps\[0\].motion.compound"),
        ('"*"', "arm_right", r"each step moves the same joints; field steps\[1\].motion.joints"),
        ("frame: tool_right_tip", "frame: tool_rigt_tip", r"no such frame; field steps\[0\].ends\[0\].frame"),
        ("frame: tool_right_tip", "frame: tool_right_tip", ""),
    ],
)
def test_check_tries_a_behaviour_on_a_robot_that_is_not_up(tmp_path: Path, was: str, becomes: str, told: str) -> None:
    text = WHOLE_BODY.read_text()
    assert was in text
    file = tmp_path / "press.yaml"
    file.write_text(text.replace(was, becomes))
    ran = CliRunner().invoke(app, ["check", str(file), "--robot", "talos_upper"])
    assert ran.exit_code == (1 if told else 0), ran.output
    assert re.search(told or "approach, press, retreat", str(ran.exception) + ran.output)
