"""How the link and the robot's processes are, as the window's models have it; and a window that may only look."""

from __future__ import annotations

import pytest

from handrail.messages import (
    AnswerPrompt,
    Enable,
    GetProcesses,
    GetProcessLog,
    GetRobot,
    Ok,
    Processes,
    ProcessLog,
    ProcessUse,
    RestartProcess,
    SaidLine,
)
from tablet_client.models import arrivals
from tablet_client.models.arrivals import Pinged
from tablet_client.models.link_quality import LinkQuality, settled
from tablet_client.models.service import Service
from tablet_client.models.situation import Situation
from tests.tablet.shown import judge

LOOP = ProcessUse(name="loop", state="up", process=7)
NODE = ProcessUse(name="low_pass", depth=1, state="up", process=8)
PROCESSES = [
    ProcessUse(name="loop", state="up", for_s=900.0, process=41, cpu=0.31, memory_mb=212.0, last="loop ready"),
    ProcessUse(name="engine", state="up", for_s=60.0, process=43, cpu=0.02, memory_mb=330.0, deaths=1),
    ProcessUse(name="low_pass", depth=1, state="up", process=44, cpu=0.01, memory_mb=18.0),
    ProcessUse(name="link", state="back-off", deaths=3, last="was ended by SIGKILL; starting it anew in 1 s"),
]


def quality(*took: float | None, sizes: dict[str, int] | None = None) -> LinkQuality:
    made = LinkQuality()
    for second, each in enumerate(took):
        made.take(Pinged(float(second), each, {kind: size * second for kind, size in (sizes or {}).items()}))
    return made


@pytest.mark.parametrize(
    ("took", "expected"),
    [
        ((), "unknown"),
        ((0.01, 0.02, 0.9), "good"),
        ((0.3, 0.2, 0.01), "slow"),
        ((*[0.01] * 20, None), "slow"),
        ((*[0.01] * 5, None), "bad"),
        ((1.0, 0.9), "bad"),
        ((None,), "bad"),
    ],
)
def test_a_link_is_as_good_as_half_its_answers_are_quick_and_most_come(took, expected):
    assert quality(*took).figures().quality == expected


def test_what_the_link_carries_is_told_by_class_over_the_last_seconds():
    figures = quality(*[0.01] * 30, sizes={"RobotState": 4000, "DaemonStatus": 1000, "PointCloud": 90_000, "": 200})
    rates = dict(figures.figures().rates)
    assert rates == pytest.approx({"camera": 90_000, "robot": 5000, "answers": 200})
    assert list(rates) == ["camera", "robot", "answers"] and figures.figures().rate == pytest.approx(95_200)


def test_only_the_last_minute_counts_and_another_connection_begins_anew():
    old = quality(*[None] * 60, *[0.01] * 60)
    assert old.figures().loss == 0.0
    old.take(Pinged(121.0, 0.02, {"RobotState": 10}))
    old.take(Pinged(122.0, 0.02, {"RobotState": 5}))
    assert (old.figures().latency_s, old.figures().rate) == (0.02, 0.0)


def test_a_number_that_trembles_is_shown_as_before():
    assert [settled(20.0, now, 5.0) for now in (16.0, 24.0, 26.0, 2.0)] == [20.0, 20.0, 26.0, 2.0]


def test_processes_are_asked_for_while_somebody_looks_and_never_twice_at_once():
    service = Service()
    assert service.want(0.0) == []
    service.look(True)
    assert service.want(1.0) == [GetProcesses()] and service.want(1.1) == []
    assert service.want(9.0) == [], "the first question is still out"
    service.take(GetProcesses(), Processes(processes=[LOOP, NODE]))
    service.choose("loop")
    assert service.want(9.1) == [GetProcesses(), GetProcessLog(process="loop")]
    service.take(GetProcessLog(process="loop"), ProcessLog(process="loop", lines=[SaidLine(0.1, "ready")]))
    assert [line.text for line in service.lines] == ["ready"]
    service.choose("low_pass")
    service.take(GetProcessLog(process="loop"), ProcessLog(process="loop", lines=[SaidLine(0.1, "late")]))
    assert service.lines == [], "of another one than is chosen now"
    service.failed(GetProcesses(), "nobody supervises")
    assert service.problem == "nobody supervises"
    service.look(False)
    assert service.want(99.0) == []


def test_only_what_the_supervisor_keeps_is_started_anew():
    service = Service()
    service.take(GetProcesses(), Processes(processes=[LOOP, NODE]))
    assert service.restart("loop") == RestartProcess(process="loop")
    assert service.restart("low_pass") is None and service.restart("nobody") is None
    assert not service.troubled
    service.take(GetProcesses(), Processes(processes=[ProcessUse(name="loop", state="back-off", deaths=1)]))
    assert service.troubled
    service.take(RestartProcess(process="loop"), Ok())


def test_who_observes_may_command_nothing_and_hears_why(robot):
    situation = Situation()
    situation.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    situation.take(Pinged(0.0, 0.01, {}, name="otto", role="observer"))
    situation.take(robot.prompt())
    for why in (
        *(situation.why_not_command(name) for name in ("enable", "clear_stop", "run", "pause", "step")),
        *(situation.why_not_execute(), situation.why_not_hand(), situation.why_not_jog()),
        situation.why_not_answer("approve"),
    ):
        assert why == "observer"
    assert any(entry.code == "role" for entry in situation.journal.entries)
    situation.take(Pinged(1.0, 0.01, {}, name="otto", role="operator"))
    assert situation.why_not_command("enable") == "already_enabled" and situation.only_looks == ""


@pytest.mark.window
def test_a_process_is_read_and_started_anew_after_a_second_press(robot, show):
    robot.processes = PROCESSES
    shown = show()
    shown.press("tab_health")
    shown.until(lambda: shown.there("process_loop"))
    shown.press("process_loop")
    shown.until(lambda: "all is well" in shown.item("processLog").property("text"))
    shown.press("restart")
    shown.until(lambda: shown.there("restarting"))
    assert "drives get no commands" in shown.item("restarting").property("text") and not robot.calls_of(RestartProcess)
    shown.press("restart")
    shown.until(lambda: robot.calls_of(RestartProcess))
    assert robot.calls_of(RestartProcess) == [RestartProcess(process="loop")]
    judge(shown, (1024, 640))
    shown.until(lambda: shown.words("Pages.marks.health") == shown.words("Theme.danger"))


@pytest.mark.window
def test_an_observers_window_shows_all_sends_nothing_but_stop_and_each_control_says_why(robot, show):
    robot.role, robot.prompts, robot.plans = "observer", [robot.prompt()], [robot.plan()]
    robot.instances = [robot.wheel()]
    shown = show().drawn()
    shown.until(lambda: shown.desk.header["enableWhy"] == "observer" and shown.desk.prompt["open"])
    assert shown.item("enable").property("why") == shown.words('Words.why("observer")')
    assert not shown.item("enable").isEnabled()
    assert {option["why"] for option in shown.desk.prompt["options"]} == {"observer"}
    shown.desk.command("enable")
    shown.desk.answer("approve")
    shown.desk.bench.add("wheel")
    shown.desk._send(Enable())
    shown.press("stop")
    shown.until(lambda: robot.stopped)
    assert not robot.calls_of(Enable) and not robot.calls_of(AnswerPrompt)
