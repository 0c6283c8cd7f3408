"""What the tablet knows and permits, without a screen and without a network."""

from __future__ import annotations

import msgspec
import pytest

from handrail.messages import (
    ActionEvent,
    AnswerPrompt,
    DriveStatus,
    Enable,
    EngineSnapshot,
    GetEngine,
    GetRobot,
    LogLine,
    PromptClosed,
)
from tablet_client.models import arrivals
from tablet_client.models.quantities import quantity
from tablet_client.models.situation import Situation


@pytest.fixture
def situation(robot) -> Situation:
    """Attached to a robot that is enabled and asks about a fresh plan."""
    made = Situation("tcp://somewhere:47800")
    made.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    robot.instances, robot.plans = [robot.wheel()], [robot.plan()]
    robot.run, robot.prompts = robot.running(), [robot.prompt()]
    made.take(arrivals.EngineAttached(robot.answer(GetEngine())))
    return made


def codes(situation: Situation) -> list[str]:
    return [entry.code for entry in situation.journal.entries]


def test_a_late_tablet_sees_what_an_early_one_saw(situation):
    assert situation.task.status == "running"
    assert list(situation.world.instances) == ["wheel_1"]
    assert situation.prompts.current.text == "Turn the valve with the right arm?"
    assert situation.plans.shown.id == "plan-1"
    assert situation.why_not_answer("approve") == ""


def test_a_stale_plan_can_be_rejected_but_not_approved(situation, robot):
    situation.take(robot.plan(fresh=False, stale_because="wheel_1 was moved"))
    assert situation.why_not_answer("approve") == "stale"
    assert situation.why_not_answer("reject") == ""
    assert "plan_stale" in codes(situation)


def test_a_plan_that_has_not_arrived_can_not_be_approved(situation, robot):
    situation.take(robot.prompt(id="prompt-0", plan="never-seen"))
    situation.take(PromptClosed(id="prompt-1", answer="approve", by="another"))
    assert situation.why_not_answer("approve") == "plan_missing"


def test_a_prompt_about_no_plan_can_be_answered_while_the_drives_are_off(situation, robot):
    situation.take(PromptClosed(id="prompt-1"))
    situation.take(robot.prompt(id="prompt-2", plan="", options=["yes", "no"]))
    situation.take(robot.status(enabled=False))
    assert situation.why_not_answer("yes") == ""


@pytest.mark.parametrize(
    ("status", "why"), [({"stopped": True, "enabled": False}, "stopped"), ({"enabled": False}, "not_enabled")]
)
def test_nothing_that_moves_the_robot_is_approved_while_it_can_not_move(situation, robot, status, why):
    situation.take(robot.status(**status))
    assert situation.why_not_answer("approve") == why
    assert situation.why_not_answer("reject") == ""


def test_an_answer_is_given_once_and_again_when_it_was_refused(situation):
    call = AnswerPrompt(id="prompt-1", answer="approve", by="operator")
    situation.sent(call)
    assert situation.why_not_answer("approve") == situation.why_not_answer("reject") == "sending"
    situation.take(arrivals.CallFailed(call, "was already answered", refused=True))
    assert situation.why_not_answer("approve") == ""
    assert situation.prompts.refused == "was already answered"


def test_a_prompt_that_someone_else_answered_closes_and_the_next_one_comes_up(situation, robot):
    situation.take(robot.prompt(id="prompt-2", text="And again?"))
    situation.take(PromptClosed(id="prompt-1", answer="reject", by="the other tablet"))
    assert situation.prompts.current.id == "prompt-2"
    assert situation.journal.entries[-1].details == ("reject", "the other tablet")


def test_enable_says_why_it_can_not_be_pressed(situation, robot):
    assert situation.why_not_command("enable") == "already_enabled"
    situation.take(robot.status(enabled=False, stopped=True))
    assert situation.why_not_command("enable") == "stopped"
    assert situation.why_not_command("clear_stop") == ""
    situation.take(robot.status(enabled=False))
    assert situation.why_not_command("enable") == ""
    assert situation.why_not_command("clear_stop") == "not_stopped"


@pytest.mark.parametrize(
    ("status", "pause", "resume", "stop_run"),
    [
        ("ready", "not_running", "not_paused", "not_running"),
        ("running", "", "not_paused", ""),
        ("paused", "already_paused", "", ""),
        ("succeeded", "run_over", "run_over", "run_over"),
        ("failed", "run_over", "run_over", "run_over"),
        ("stopped", "run_over", "run_over", "run_over"),
    ],
)
def test_a_run_can_be_paused_resumed_and_ended_only_where_that_means_something(
    situation, robot, status, pause, resume, stop_run
):
    situation.take(robot.running(status=status))
    asked = [situation.why_not_command(command) for command in ("pause", "resume", "stop_run")]
    assert asked == [pause, resume, stop_run]


def test_without_a_robot_every_command_says_so():
    situation = Situation("tcp://somewhere:47800")
    for command in ("enable", "clear_stop", "pause", "resume", "stop_run"):
        assert situation.why_not_command(command) == "no_robot"


def test_a_lost_connection_is_told_and_keeps_what_was_seen(situation):
    situation.sent(Enable())
    situation.take(arrivals.Unanswered(1, "no answer in 3 s"))
    assert situation.link.state == "lost" and situation.link.why == "no answer in 3 s"
    assert situation.task.status == "running", "what was seen last is still shown"
    assert situation.why_not_answer("approve") == "no_engine"
    assert situation.why_not_command("pause") == "no_robot"
    assert not situation.pending
    assert "detached" in codes(situation)


def test_after_an_interruption_the_snapshot_replaces_what_was_seen(situation, robot):
    situation.take(arrivals.Unanswered(1, "gone"))
    situation.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    over = robot.running(status="succeeded", active=[])
    situation.take(arrivals.EngineAttached(EngineSnapshot(instances=[], plans=[], run=over, prompts=[])))
    assert situation.link.state == "attached"
    assert situation.prompts.current is None
    assert situation.plans.shown is None
    assert situation.world.instances == {}
    assert situation.task.status == "succeeded"


def test_a_late_tablet_does_not_show_what_a_program_has_planned_and_executed(situation, robot):
    snapshot = EngineSnapshot(instances=[], plans=[robot.plan()], run=robot.running(status="succeeded"), prompts=[])
    situation.take(arrivals.EngineAttached(snapshot))
    assert situation.plans.shown is None
    situation.take(arrivals.EngineAttached(EngineSnapshot(instances=[], plans=[robot.plan()], run=None, prompts=[])))
    assert situation.plans.shown is not None, "an operator's own plan waits for her"


def test_plans_that_were_stale_before_a_tablet_came_are_not_shown_to_it(situation, robot):
    old = robot.plan(fresh=False, stale_because="it was executed")
    situation.take(arrivals.EngineAttached(EngineSnapshot(instances=[], plans=[old], run=None, prompts=[])))
    assert situation.plans.shown is None


def test_a_motion_hides_the_ghost_of_the_plan_that_it_executes(situation, robot):
    situation.take(PromptClosed(id="prompt-1", answer="approve", by="operator"))
    assert situation.plans.shown is not None
    situation.take(ActionEvent(id="stroke/approach", state="running", time_ns=0, cycle=0))
    assert situation.plans.shown is None
    assert situation.robot.moving
    situation.take(ActionEvent(id="stroke/approach", state="ended", outcome="done", time_ns=0, cycle=0))
    assert not situation.robot.moving


def test_a_guard_that_trips_is_told_and_an_end_as_planned_is_not(situation):
    before = len(situation.journal.entries)
    situation.take(ActionEvent(id="a", state="ended", outcome="done", time_ns=0, cycle=0))
    situation.take(ActionEvent(id="b", state="ended", outcome="pose_error", detail="21 mm", time_ns=0, cycle=0))
    assert [(entry.level, *entry.details) for entry in situation.journal.entries[before:]] == [
        ("warning", "pose_error", "21 mm")
    ]


def test_drives_are_told_by_the_gravest_of_them(situation, robot):
    fault = [DriveStatus(joint="head_1_joint", state="fault", error=3)]
    situation.take(robot.status(enabled=False, drives=fault))
    assert situation.robot.drives == "fault" and situation.robot.faulty == ["head_1_joint"]
    silent = [DriveStatus(joint="head_1_joint", state="quick_stop_active")]
    situation.take(robot.status(enabled=False, drives=silent))
    assert situation.robot.drives == "quick_stop"
    situation.take(robot.status(enabled=False, stopped=True, drives=fault))
    assert situation.robot.drives == "stopped"


def test_a_stop_is_followed_until_it_is_cleared(situation, robot):
    situation.take(arrivals.StopProgress("sending", 1))
    situation.take(arrivals.StopProgress("answered", 1))
    situation.take(robot.status(enabled=False, stopped=True, stop_reason="operator"))
    assert situation.robot.stop_state == "answered"
    situation.take(robot.status(enabled=False))
    assert situation.robot.stop_state == ""


def test_a_removed_instance_is_gone(situation, robot):
    situation.take(robot.wheel(removed=True))
    assert situation.world.instances == {}


def test_of_what_a_camera_sees_the_latest_is_kept_and_its_age_is_by_the_robots_clock(situation, robot):
    assert situation.clouds.age(situation.robot.time_ns) == -1.0
    situation.take(robot.picture((0.5, 0.0, 0.0)))
    situation.take(robot.picture())
    assert situation.clouds.seen["head"].points.positions.mean(axis=0) == pytest.approx((0.55, -0.35, 0.30), abs=0.01)
    assert situation.clouds.age(robot.time_ns + 2_500_000_000) == pytest.approx(2.5)
    assert situation.clouds.age(20_000_000) == float("inf"), "the robot's clock began anew, the picture is from before"


def test_a_cloud_that_can_not_be_read_is_told_once_and_not_shown(situation, robot):
    situation.take(robot.picture())
    for _ in range(3):
        situation.take(robot.picture(points=b"?"))
    assert codes(situation).count("cloud_unreadable") == 1
    assert not situation.clouds.seen
    situation.take(robot.picture())
    assert list(situation.clouds.seen) == ["head"]


def test_another_robots_camera_is_forgotten(situation, robot):
    situation.take(robot.picture())
    other = msgspec.structs.replace(robot.answer(GetRobot()), name="another")
    situation.take(arrivals.Attached(other, robot.status()))
    assert not situation.clouds.seen


def test_progress_is_read_from_the_programs_variables(situation, robot):
    situation.take(
        robot.running(
            data={"turned_deg": 142.5, "goal_deg": 285.0, "stroke": 2, "arc": -0.1, "lag_m": 0.012, "shift_deg": 12}
        )
    )
    assert situation.task.progress.turned_deg == 142.5 and situation.task.progress.goal_deg == 285.0
    assert situation.task.facts == [("Stroke", "2"), ("Lag", "12 mm"), ("Shift", "12°")]
    situation.take(robot.running(data={}))
    assert situation.task.progress is None


def test_the_journal_keeps_the_newest_lines(situation):
    for number in range(2000):
        situation.take(LogLine(source="engine", level="info", text=str(number)))
    assert len(situation.journal.entries) == 500
    assert situation.journal.entries[-1].details[0] == "1999"


def test_what_nodes_print_is_no_history_but_their_errors_are(situation):
    before = len(situation.journal.entries)
    situation.take(LogLine(source="engine/low_pass", level="info", text="3.2 N"))
    situation.take(LogLine(source="engine/low_pass", level="error", text="ArithmeticError: no force"))
    assert [entry.details for entry in situation.journal.entries[before:]] == [
        ("ArithmeticError: no force", "engine/low_pass")
    ]
    assert [line.text for line in situation.output.kept] == ["3.2 N", "ArithmeticError: no force"]


def test_what_is_not_for_the_tablet_is_ignored(situation):
    situation.take(object())


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("clearance_m", 0.0312, ("Clearance", "31 mm")),
        ("reach_m", 1.25, ("Reach", "1.25 m")),
        ("limit_margin_rad", 0.2094, ("Limit margin", "12.0°")),
        ("turned_deg", 285.4, ("Turned", "285°")),
        ("peak_force_n", 34.2, ("Peak force", "34 N")),
        ("duration_s", 12.34, ("Duration", "12.3 s")),
        ("strokes", 4.0, ("Strokes", "4")),
        ("gap_m", -0.0001, ("Gap", "0 mm")),
        ("clearance_m", float("inf"), ("Clearance", "–")),
    ],
)
def test_numbers_are_shown_in_units_that_people_read(name, value, shown):
    assert quantity(name, value) == shown
