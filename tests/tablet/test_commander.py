"""Who commands, in the window: the command is taken, returned and taken over, and what it keeps from others says so."""

from __future__ import annotations

from typing import Any

import pytest

from handrail.messages import Enable, GetEngine, GetRobot, PauseRun, ReturnCommand, TakeCommand
from tablet_client.models.arrivals import Attached, EngineAttached, Pinged
from tablet_client.models.situation import Situation

pytestmark = pytest.mark.window


def test_whoever_else_has_it_nothing_moves_from_here_but_what_is_ended(robot: Any):
    situation = Situation("tcp://somewhere:47800")
    situation.take(Attached(robot.answer(GetRobot()), robot.status()))
    robot.run = robot.running()
    situation.take(EngineAttached(robot.answer(GetEngine())))
    situation.take(Pinged(0.0, 0.01, {}, "ada", "operator", "bob"))
    assert situation.others_command == "others_command"
    assert situation.why_not_hand() == situation.why_not_execute() == "others_command"
    for command in ("enable", "clear_stop", "resume", "start", "skip", "autonomy"):
        assert situation.why_not_command(command) == "others_command"
    for command in ("pause", "stop_run"):
        assert situation.why_not_command(command) != "others_command"
    situation.take(Pinged(1.0, 0.01, {}, "ada", "operator", "ada"))
    assert situation.others_command == "" and situation.why_not_command("enable") != "others_command"
    situation.take(Pinged(2.0, 0.01, {}, "ada", "operator", ""))
    told = [(entry.code, entry.details) for entry in situation.journal.entries]
    assert told[-3:] == [("commander", ("bob",)), ("commander", ("ada",)), ("no_commander", ("",))]


def test_it_is_taken_returned_and_taken_over_by_two_presses(robot: Any, show: Any) -> None:
    shown = show()
    shown.press("tab_robot")
    shown.press("takeCommand")
    shown.until(lambda: robot.calls_of(TakeCommand) == [TakeCommand()])
    shown.until(lambda: "You have the command, as ada" in shown.item("commander").property("text"))
    shown.press("takeCommand")
    shown.until(lambda: robot.calls_of(ReturnCommand))
    shown.until(lambda: shown.item("commander").property("text") == "Whoever is connected may command.")
    robot.commander = "bob"
    shown.until(lambda: "bob has the command" in shown.item("commander").property("text"))
    assert shown.words("Words.why(desk.header.enableWhy)") in ("somebody else commands", "already enabled")
    assert shown.desk.situation.why_not_command("clear_stop") == "others_command"
    shown.desk.command("clear_stop")
    shown.press("takeCommand")
    shown.turn(0.1)
    assert len(robot.calls_of(TakeCommand)) == 1, "it asks once more"
    shown.press("takeCommand")
    shown.until(lambda: robot.calls_of(TakeCommand)[1:] == [TakeCommand(take_over=True)])
    shown.until(lambda: shown.desk.header["commandIsMine"])
    assert not robot.calls_of(Enable) and not robot.calls_of(PauseRun) and not robot.stopped
