"""The real window on a virtual screen, with a robot that only answers."""

from __future__ import annotations

import os
import subprocess
import sys

import msgspec
import pytest

from handrail.messages import (
    AnswerPrompt,
    ClearStop,
    Enable,
    PauseRun,
    PromptClosed,
    ResumeRun,
    Run,
    SetAutonomy,
    SetBreakpoints,
    StepRun,
    Stop,
    StopRun,
    TakeTransition,
)

pytestmark = pytest.mark.window


# --------------------------------------------------------------------------------------------------------------- answers


def test_approve_answers_the_prompt_and_the_card_goes(asking, robot):
    asking.press("option_approve")
    asking.until(lambda: robot.calls_of(AnswerPrompt))
    answer = robot.calls_of(AnswerPrompt)[0]
    assert (answer.id, answer.answer, answer.by) == ("prompt-1", "approve", "Ada")
    asking.until(lambda: not asking.item("promptCard").isVisible())


def test_reject_answers_the_prompt(asking, robot):
    asking.press("option_reject")
    asking.until(lambda: [answer.answer for answer in robot.calls_of(AnswerPrompt)] == ["reject"])


def test_a_stale_plan_disables_approve_and_says_why(asking, robot):
    robot.publish(robot.plan(fresh=False, stale_because="wheel_1 was moved", stale_causes=["instance_moved"]))
    asking.until(lambda: asking.item("option_approve").property("why") == "template was moved")
    assert "wheel_1 was moved" in asking.item("staleReason").property("text")
    asking.until(lambda: asking.item("option_reject").isEnabled())
    assert not asking.item("option_approve").isEnabled()
    approve = asking.middle("option_approve")
    from PySide6.QtCore import Qt

    asking.test.mouseClick(asking.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, approve)
    asking.desk.answer("approve")
    asking.turn(0.1)
    assert not robot.calls_of(AnswerPrompt)


def test_answers_wait_a_moment_so_that_a_card_that_pops_up_takes_no_touch_meant_for_another(asking, robot):
    robot.publish(PromptClosed(id="prompt-1", answer="approve", by="another"))
    asking.until(lambda: not asking.item("promptCard").isVisible())
    robot.publish(robot.prompt(id="prompt-2"))
    asking.until(lambda: asking.item("promptCard").isVisible())
    assert not asking.item("option_approve").isEnabled()
    asking.until(lambda: asking.item("option_approve").isEnabled())


def test_the_numbers_that_matter_are_on_the_card(asking):
    texts = [item.property("text") for item in asking.all_items() if item.property("text")]
    assert {"31 mm", "12.0°", "3.0 s"} <= set(texts)


# ------------------------------------------------------------------------------------------------------------------ stop


def test_stop_goes_out_when_the_button_is_touched_not_when_it_is_let_go(asking, robot, wait):
    from PySide6.QtCore import Qt

    where = asking.middle("stop")
    asking.test.mousePress(asking.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, where)
    wait(lambda: robot.calls_of(Stop))  # the window's thread does nothing meanwhile: as if the view hung
    assert robot.calls_of(Stop)[0].reason == "Ada, at the tablet"
    asking.test.mouseRelease(asking.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, where)
    asking.until(lambda: asking.item("banner").isVisible())
    asking.until(lambda: asking.item("enable").property("why") == "stop is latched")


def test_stop_by_touch(asking, robot):
    device = asking.test.createTouchDevice()
    where = asking.middle("stop")
    asking.test.touchEvent(asking.window, device).press(0, where, asking.window).commit()
    asking.until(lambda: robot.calls_of(Stop))
    asking.test.touchEvent(asking.window, device).release(0, where, asking.window).commit()


@pytest.mark.parametrize("key", ["Key_Escape", "Key_Space", "Key_F12"])
def test_stop_by_key_whatever_has_the_focus(asking, robot, key):
    from PySide6.QtCore import Qt

    asking.until(lambda: asking.item("option_approve").isEnabled())
    asking.item("option_approve").forceActiveFocus(Qt.FocusReason.TabFocusReason)
    asking.key(getattr(Qt.Key, key))
    asking.until(lambda: robot.calls_of(Stop))
    assert not robot.calls_of(AnswerPrompt)


def test_stop_works_while_another_call_hangs(asking, robot, wait):
    robot.hanging.set()
    asking.press("pause")
    asking.press("stop")
    wait(lambda: robot.calls_of(Stop))
    assert not robot.calls_of(PauseRun)


def test_clearing_the_stop_and_enabling_are_two_deliberate_steps(robot, show):
    robot.stopped, robot.stop_reason = True, "somebody"
    shown = show()
    shown.until(lambda: shown.item("clearStop").isVisible())
    assert "somebody" in shown.item("banner").property("message")
    assert not shown.item("enable").isEnabled()
    shown.press("clearStop")
    shown.until(lambda: robot.calls_of(ClearStop))
    assert not robot.calls_of(Enable)
    shown.press("enable")
    shown.until(lambda: robot.calls_of(Enable))
    shown.until(lambda: not shown.item("clearStop").isVisible() and not shown.item("banner").isVisible())


# ------------------------------------------------------------------------------------------------------------------ task


def test_the_task_shows_the_run_and_pauses_resumes_and_ends_it(robot, show):
    robot.run = robot.running(data={"turned_deg": 142.4, "stroke": 2})
    shown = show()
    shown.until(lambda: shown.item("runStatus").property("text") == "Running")
    assert shown.item("turned").property("text") == "142°"
    assert shown.item("programHash").property("text").endswith("3f9a1c77d2")
    shown.press("pause")
    shown.until(lambda: robot.calls_of(PauseRun))
    robot.publish(robot.running(status="paused"))
    shown.press("resume")
    shown.until(lambda: robot.calls_of(ResumeRun))
    shown.press("stopRun")
    shown.until(lambda: robot.calls_of(StopRun))


def test_a_tap_on_a_state_opens_what_can_be_done_with_it(robot, show):
    robot.run = robot.running(status="paused", active=["turning", "confirm"], waiting=["confirm"])
    shown = show()
    shown.until(lambda: shown.desk.run.tree.rowCount() == 6)
    shown.window.resize(1280, 800)  # all states at once
    shown.until(lambda: shown.there("state_stroking"))
    shown.press("state_stroking")
    shown.until(lambda: shown.desk.run.view["chosen"] == "stroking")
    shown.desk.run.breakpoint("stroking")
    shown.until(lambda: [call.states for call in robot.calls_of(SetBreakpoints)] == [["stroking"]])
    robot.publish(robot.running(status="paused", active=["turning", "confirm"], breakpoints=["stroking"]))
    shown.until(lambda: shown.item("halts_stroking").isVisible())
    shown.press("step")
    shown.until(lambda: robot.calls_of(StepRun))
    shown.press("skip")
    shown.until(lambda: [call.state for call in robot.calls_of(TakeTransition)] == ["confirm"])
    shown.press("autonomy_low")
    shown.until(lambda: [call.level for call in robot.calls_of(SetAutonomy)] == ["low"])


def test_a_run_that_failed_says_so_in_red_with_what_to_do_next(robot, show):
    robot.run = robot.running(status="failed", active=["failed"], detail="the tool met resistance")
    shown = show()
    shown.until(lambda: shown.item("runDetail").property("text") == "the tool met resistance")
    assert shown.item("runDetail").property("color") == shown.words("Theme.badText")
    assert "run it again" in shown.item("runAdvice").property("text")
    robot.enabled = False
    robot.publish(robot.status())
    shown.until(lambda: "enable the drives" in shown.item("runAdvice").property("text"))
    shown.press("start")
    shown.until(lambda: [call.deployment for call in robot.calls_of(Run)] == ["deployment-1"])


def test_a_signal_is_chosen_by_touch_plotted_held_and_saved(robot, show, tmp_path, monkeypatch):
    from PySide6.QtCore import QStandardPaths

    monkeypatch.setattr(QStandardPaths, "writableLocation", lambda _: str(tmp_path))
    shown = show().drawn()
    shown.press("tab_signals")
    shown.press("chooseSignals")
    shown.press("signalsOf_force")
    shown.press("signal_force.z")
    shown.press("chooseSignals")

    def feel(newtons: float) -> None:
        robot.time_ns += 100_000_000
        state = msgspec.structs.replace(robot.state(), external_force=(0.0, 0.0, newtons))
        robot.publish(state)
        # One by one: of a stream the newest is shown, and what it replaces is not plotted.
        shown.until(lambda: shown.desk.situation.robot.state == state)

    for newtons in (0.0, 20.0, 5.0):
        feel(newtons)
    shown.until(lambda: shown.item("signalNow_0").property("text") == "5.0 N")
    colour = shown.item("trace_0").property("color")
    shown.until(lambda: shown.count(shown.item("trace_0"), colour) > 100)
    shown.press("holdSignals")
    feel(7.0)
    assert shown.item("signalNow_0").property("text") == "5.0 N"
    shown.press("saveSignals")
    shown.until(lambda: "Saved" in shown.item("signalsSaid").property("text"))
    (file,) = tmp_path.glob("*.csv")
    rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()]
    assert rows[0] == ["time [s]", "force.z [N]"] and [row[1] for row in rows[-3:]] == ["0", "20", "5"]
    shown.press("holdSignals")
    shown.until(lambda: shown.item("signalNow_0").property("text") == "7.0 N")


# ------------------------------------------------------------------------------------------------------------ connection


def test_a_window_without_a_robot_says_what_to_do_and_fills_when_it_comes(robot, show):
    robot.reachable = False
    shown = show()
    shown.until(lambda: shown.item("emptyTitle").property("text") == "Waiting for a robot")
    commands = [item.property("text") for item in shown.all_items() if item.property("readOnly")]
    assert "handrail up talos_upper --scene valve" in commands
    robot.reachable = True
    shown.drawn()
    shown.until(lambda: shown.item("robotName").property("text") == "talos_upper")
    assert shown.item("drivesChip").property("detail") == "holding"
    robot.speed = 0.4
    robot.publish(robot.status())
    shown.until(lambda: shown.item("drivesChip").property("detail") == "holding · 40 % speed")


def test_a_link_that_goes_and_comes_back_is_shown_and_survived(asking, robot):
    robot.reachable = False
    asking.until(lambda: "Connection lost" in asking.item("banner").property("message"))
    assert not asking.item("option_approve").isEnabled()
    robot.reachable = True
    asking.until(lambda: not asking.item("banner").isVisible())
    asking.press("option_approve")
    asking.until(lambda: robot.calls_of(AnswerPrompt))


def test_the_command_saves_a_picture_of_the_waiting_window_and_exits(screen, tmp_path):
    from PySide6.QtGui import QImage

    picture = tmp_path / "tablet.png"
    nobody = ("--connect", "tcp://127.0.0.1:9", "--keys", str(tmp_path / "keys"))
    ended = subprocess.run(
        (sys.executable, "-m", "handrail.cli", "tablet", *nobody, "--shot", str(picture), "--after", "0.5"),
        env={**os.environ, "DISPLAY": screen, "QT_QPA_PLATFORM": "xcb", "QSG_RENDER_LOOP": "basic"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert "Error" not in ended.stderr, ended.stderr
    image = QImage(str(picture))
    assert (image.width(), image.height()) == (1280, 800)


def test_the_command_names_what_is_wrong_with_its_address(screen, tmp_path):
    ended = subprocess.run(
        (sys.executable, "-m", "handrail.cli", "tablet", "--connect", "robot", "--keys", str(tmp_path / "keys")),
        env={**os.environ, "DISPLAY": screen},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 1
    assert "tcp://HOST:PORT" in ended.stderr
