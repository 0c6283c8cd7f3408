"""Every page: its way there, its controls' size, names and keys, in any language. On a virtual screen."""

from __future__ import annotations

from typing import get_args

import pytest

from handrail.messages import (
    AnswerPrompt,
    PlanWaypoint,
    PlanWorst,
    StaleCause,
)
from tests.tablet.shown import judge

pytestmark = pytest.mark.window


def test_the_rail_brings_every_page_and_loads_it_when_it_is_first_shown(show):
    shown = show()
    for name in shown.pages():
        assert shown.item(f"page_{name}").property("active") == (name == "task")
    for name in shown.pages():
        shown.press(f"tab_{name}")
        shown.until(lambda name=name: shown.item(f"page_{name}").isVisible())
        shown.until(lambda name=name: shown.item(f"page_{name}").property("item") is not None)
        assert [other for other in shown.pages() if shown.item(f"page_{other}").isVisible()] == [name]


def test_the_keyboard_goes_through_the_pages_and_up_and_down_the_rail(show):
    from PySide6.QtCore import Qt

    shown = show()
    shown.window.requestActivate()
    shown.until(shown.window.isActive)
    names = shown.pages()
    shown.test.keyClick(shown.window, Qt.Key.Key_PageUp, Qt.KeyboardModifier.ControlModifier)
    assert shown.words("Pages.current") == names[-1]
    shown.test.keyClick(shown.window, Qt.Key.Key_PageDown, Qt.KeyboardModifier.ControlModifier)
    assert shown.words("Pages.current") == names[0]
    shown.item(f"tab_{names[0]}").forceActiveFocus(Qt.FocusReason.TabFocusReason)
    shown.key(Qt.Key.Key_Down)
    shown.key(Qt.Key.Key_Return)
    assert shown.words("Pages.current") == names[1]


def test_a_wide_page_takes_the_scenes_room_and_gives_it_back_for_a_question(robot, show):
    robot.instances, robot.plans, robot.run = [robot.wheel()], [robot.plan()], robot.running()
    shown = show().drawn()
    shown.words("Pages.all = Pages.all.map(page => Object.assign({}, page, { wide: page.name === 'journal' }))")
    shown.page("journal")
    shown.until(lambda: not shown.item("scenePanel").isVisible())
    shown.press("sceneToggle")
    shown.until(shown.item("scenePanel").isVisible)
    shown.press("sceneToggle")
    shown.until(lambda: not shown.item("scenePanel").isVisible())
    robot.publish(robot.prompt())
    shown.until(shown.item("scenePanel").isVisible)


def test_a_decision_with_all_its_figures_and_a_long_reason_leaves_every_control_in_the_smallest_window(asking, robot):
    near, margin = (
        PlanWorst(value=0.012, time=1.5, about="a and b"),
        PlanWorst(value=0.02, time=1.0, about="arm_right_4_joint"),
    )
    way = PlanWaypoint(name="approach", time=2.0, residual=0.004, clearance=near, limit_margin=margin)
    why = "wheel_1 was moved 12 mm and turned 3.0° after the plan was made (version 1, now 2)"
    stale = robot.plan(fresh=False, stale_because=why, stale_causes=["instance_moved"], waypoints=[way])
    asking.drawn()
    robot.publish(robot.state(), stale)
    asking.until(lambda: asking.item("staleReason").isVisible() and asking.item("detail_residual").isVisible())
    for name in ("scrub", "playGhost", "pause", "stopRun", "option_reject"):
        control = asking.item(name)
        asking.until(lambda control=control: control.mapToScene(control.boundingRect().bottomRight()).y() <= 640)


def test_every_control_of_every_page_is_large_enough_for_a_finger_and_has_a_name(asking):
    asking.drawn().desk.bench.select("wheel_1")
    asking.until(lambda: asking.item("contextBar").isVisible())
    names = asking.pages()
    assert {"task", "objects", "move", "signals"} <= set(names)
    for name in names:
        asking.page(name)
        asking.turn(0.1)
        own = judge(asking, (asking.window.width(), asking.window.height()))
        assert own or name in ("journal", "health"), f"nothing can be done on {name}"  # no process is there


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1200), (1024, 640)])
def test_every_control_is_large_enough_for_a_finger_and_has_a_name(asking, size):
    asking.drawn().window.resize(*size)
    asking.until(lambda: (asking.window.width(), asking.window.height()) == size)
    asking.turn(0.2)
    judge(asking, size)
    stop = asking.item("stop")
    assert stop.mapToScene(stop.boundingRect().topRight()).x() > size[0] - 30


def test_every_control_can_be_reached_and_pressed_by_keyboard(asking, robot):
    from PySide6.QtCore import Qt

    asking.drawn()
    asking.until(lambda: asking.item("option_approve").isEnabled())
    asking.window.requestActivate()
    asking.until(asking.window.isActive)
    reached = set()
    for _ in range(40):
        asking.key(Qt.Key.Key_Tab)
        focused = asking.window.activeFocusItem()
        if focused is not None:
            reached.add(focused.objectName())
    assert {
        "stop", "option_approve", "option_reject", "pause", "stopRun", "playGhost", "scrub", "view_robot", "sceneInput",
    } <= reached  # fmt: skip
    asking.item("option_reject").forceActiveFocus(Qt.FocusReason.TabFocusReason)
    asking.key(Qt.Key.Key_Return)
    asking.until(lambda: [answer.answer for answer in robot.calls_of(AnswerPrompt)] == ["reject"])


# Codes that the models may show, as they are in tablet_client/models.
REASONS = [
    *("no_robot", "no_engine", "no_program", "stopped", "not_stopped", "already_enabled", "not_enabled", "sending"),
    *("is_asked", "program_runs", "nothing_selected", "nothing_done", "nothing_undone", "no_trajectory"),
    *("no_program_chosen", "loading", "unbound", "nothing_fits", "bad_parameter"),
    *("already_paused", "not_paused", "not_running", "run_over", "run_under_way", "no_state", "plan_missing", "stale"),
    *(f"stale_{cause}" for cause in get_args(StaleCause)),
    *("planning", "nothing_to_plan", "beyond_reach", "at_limit"),
]
JOURNAL = [
    *("attached", "detached", "engine_attached", "engine_detached", "refused", "unanswered", "log", "action_ended"),
    *("drives_enabled", "drives_disabled", "drives_stopped", "drives_fault", "drives_quick_stop"),
    *("stop_sending", "stop_answered", "stop_failed", "prompt", "answered", "withdrawn", "plan_stale"),
    *("cloud_unreadable", "code_changed", "overwrote", "template_saved"),
    *("run_ready", "run_running", "run_paused", "run_succeeded", "run_failed", "run_stopped"),
]


def test_every_code_of_the_models_has_words(show):
    shown = show()
    for code in REASONS:
        assert shown.words(f"Words.why('{code}')") != code
    for code in ("clear_first", "enable_first", "failed", "failed_at_once", "stopped", "paused", "paused_before"):
        assert shown.words(f"Words.advice('{code}')") != code
    for code in ("no_robot", "nothing_moves", "program_goes_on", "program_waits", "motion_ends", "holds"):
        assert shown.words(f"Words.ifLost('{code}')") != code
    for code in JOURNAL:
        assert shown.words(f"Words.entry('{code}', ['a', 'b', 'c'])") != f"{code} a b c"
