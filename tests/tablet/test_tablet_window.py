"""The real window on a virtual screen, with a robot that only answers."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any, get_args

import msgspec
import pytest

from handrail.config import ConfigError
from handrail.messages import (
    AnswerPrompt,
    ClearStop,
    Enable,
    GetPlan,
    PauseRun,
    PlanWaypoint,
    PlanWorst,
    PromptClosed,
    ResumeRun,
    Run,
    SetAutonomy,
    SetBreakpoints,
    StaleCause,
    StepRun,
    Stop,
    StopRun,
    TakeTransition,
)
from tests.tablet.shown import Shown, distance, judge

pytestmark = pytest.mark.window

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


@pytest.fixture
def asking(robot: Any, show: Callable[..., Shown]) -> Shown:
    """A window on a robot that asks whether it may execute a fresh plan."""
    robot.instances, robot.plans = [robot.wheel()], [robot.plan()]
    robot.run, robot.prompts = robot.running(), [robot.prompt()]
    shown = show()
    shown.until(lambda: shown.item("promptCard").isVisible())
    return shown


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


# ----------------------------------------------------------------------------------------------------------------- scene


def test_the_robots_links_move_when_its_state_changes(robot, show):
    shown = show().drawn()
    robot.publish(robot.state())
    elbow = shown.until(
        lambda: abs(shown.node("link_arm_left_4_link")[2]) > 0.01 and shown.node("link_arm_left_4_link")
    )
    robot.publish(robot.state(arm_left_1_joint=0.6))
    shown.until(lambda: shown.node("link_arm_left_4_link") != elbow)
    chain, description = shown.opened.stage._robot.chain, robot.description
    position = description.home_position()
    position[description.index("arm_left_1_joint")] = 0.6
    expected = chain.poses(position)[chain.bodies.index("arm_left_4_link")][:3, 3]
    assert shown.node("link_arm_left_4_link") == pytest.approx(expected, abs=1e-4)


def test_a_robot_whose_base_is_free_is_drawn_where_it_is_estimated_and_what_is_not_known_is_said(robot, show):
    import msgspec

    from handrail.messages import Base, Pose

    shown = show().drawn()
    base = Base(
        time_ns=robot.time_ns,
        pose_in_world=Pose(position=(0.4, -0.2, 0.1), orientation=(0.0, 0.0, 1.0, 0.0)),
        linear_velocity=(0.0, 0.0, 0.0),
        angular_velocity=(0.0, 0.0, 0.0),
        position_deviation=0.001,
        orientation_deviation=0.01,
        source="feet",
    )
    robot.publish(msgspec.structs.replace(robot.state(), base=base))
    chain = shown.opened.stage._robot.chain
    link = chain.poses(robot.description.home_position())[chain.bodies.index("arm_left_4_link")][:3, 3]
    expected = (0.4 - link[0], -0.2 - link[1], 0.1 + link[2])
    shown.until(lambda: distance(shown.node("link_arm_left_4_link"), expected) < 1e-3)
    assert not shown.item("baseUnknown").isVisible()
    lost = msgspec.structs.replace(base, source="none", problem="the inertial sensor does not answer")
    robot.publish(msgspec.structs.replace(robot.state(), base=lost))
    shown.until(lambda: shown.item("baseUnknown").isVisible())
    assert "the inertial sensor does not answer" in shown.item("baseUnknown").property("text")


def test_a_ghost_appears_with_a_plan_moves_and_goes_with_the_motion(robot, show):
    from handrail.messages import ActionEvent

    shown = show().drawn()
    robot.publish(robot.state())
    shown.turn(0.1)
    assert not shown.item("ghostBar").isVisible()
    robot.publish(robot.plan())
    shown.until(lambda: shown.item("ghostBar").isVisible())
    shown.desk.scrub(2.0)
    ghost, link = "ghost_arm_right_7_link", "link_arm_right_7_link"
    shown.until(lambda: distance(shown.node(ghost), shown.node(link)) > 0.05)
    there = shown.node(ghost)
    shown.desk.scrub(3.0)
    shown.until(lambda: distance(shown.node(ghost), there) > 0.01)
    robot.publish(ActionEvent(id="a", state="running", time_ns=0, cycle=0))
    shown.until(lambda: not shown.item("ghostBar").isVisible())


def test_a_stale_ghost_is_red_and_says_why(robot, show):
    shown = show().drawn()
    robot.publish(robot.state(), robot.plan(fresh=False, stale_because="wheel_1 was moved"))
    shown.until(lambda: shown.opened.stage.property("ghostStale"))
    shown.until(lambda: "wheel_1 was moved" in shown.item("ghostReason").property("text"))


def test_the_time_line_shows_where_a_plan_is_nearest_and_a_tap_on_the_figure_puts_the_ghost_there(robot, show):
    near = PlanWorst(value=0.012, time=1.5, about="arm_right_5_link and rim")
    ways = [PlanWaypoint(name="approach", time=2.0, clearance=near), PlanWaypoint(name="turn", time=3.0, residual=0.0)]
    shown = show().drawn()
    robot.publish(robot.state(), robot.plan(waypoints=ways))
    shown.until(lambda: shown.item("worstClearance").isVisible())
    shown.turn(0.05)
    mark, track = shown.item("worstClearance"), shown.item("worstClearance").parentItem()
    assert mark.x() + mark.width() / 2 == pytest.approx(track.width() * 1.5 / 3.0, abs=1.0)
    assert shown.item("way_approach").isVisible() and not shown.item("way_turn").isVisible()
    assert mark.property("tone") == shown.words("Theme.danger")
    from PySide6.QtCore import Qt

    where = shown.middle("figure_clearance")
    shown.test.mouseClick(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, where)
    shown.until(lambda: shown.desk.property("ghostTime") == 1.5)


def test_a_ghost_that_did_not_come_with_its_plan_is_fetched(robot, show):
    shown = show()
    robot.answers_plan = robot.plan()
    robot.publish(robot.state(), robot.plan(segments=[]))
    shown.until(lambda: [call.id for call in robot.calls_of(GetPlan)] == ["plan-1"])
    shown.until(lambda: shown.item("scrub").property("to") == 3.0)


def test_the_template_stands_where_its_instance_says_and_follows_it(robot, show):
    from handrail.messages import Pose

    robot.instances = [robot.wheel()]
    shown = show()
    scene = shown.find("scene")
    shown.until(lambda: scene.findChild(type(shown.find("rig")), "template_wheel_1"))
    shown.until(lambda: shown.node("template_wheel_1") == pytest.approx((0.55, -0.35, 0.30), abs=1e-4))
    robot.publish(robot.wheel(version=2, pose_in_world=Pose(position=(0.6, -0.2, 0.4))))
    shown.until(lambda: shown.node("template_wheel_1") == pytest.approx((0.6, -0.2, 0.4), abs=1e-4))


def test_what_the_camera_sees_is_shown_can_be_hidden_and_says_when_it_is_old(robot, show):
    shown = show().drawn()
    robot.publish(robot.state())
    assert not shown.item("cloud").isEnabled() and shown.item("cloud").property("why") == "sees nothing"
    robot.publish(robot.picture())
    shown.until(lambda: shown.item("cloud").isEnabled())

    def grains() -> Any:
        """The drawn cloud's model, as the scene has it."""
        return shown.find("scene").findChild(type(shown.find("rig")), "cloud_head")

    def bounds() -> tuple[float, ...]:
        low = shown.opened.stage._clouds.geometry(0).boundsMin()
        return low.x(), low.y(), low.z()

    shown.until(lambda: grains() and grains().property("visible"))
    assert bounds() == pytest.approx((0.50, -0.40, 0.25), abs=0.006)
    assert not shown.item("cloudAge").isVisible()
    robot.time_ns += 7_000_000_000
    robot.publish(robot.state())
    shown.until(lambda: shown.item("cloudAge").isVisible() and "7 s old" in shown.item("cloudAge").property("text"))
    shown.press("cloud")
    shown.until(lambda: not grains().property("visible") and not shown.item("cloudAge").isVisible())
    robot.publish(robot.picture((0.65, -0.35, 0.30)))  # seen meanwhile: there when it is wanted again
    shown.turn(0.2)
    shown.press("cloud")
    shown.until(lambda: grains().property("visible") and bounds()[0] == pytest.approx(0.60, abs=0.006))
    assert not shown.item("cloudAge").isVisible()


def test_the_cameras_points_are_really_drawn(robot, show):
    shown = show().drawn()

    def red() -> int:
        picture = shown.window.grabWindow()
        colours = (
            picture.pixelColor(x, y) for x in range(0, picture.width(), 3) for y in range(0, picture.height() // 2, 3)
        )
        return sum(colour.red() > 150 and colour.green() < 60 and colour.blue() < 60 for colour in colours)

    robot.publish(robot.state())
    shown.turn(0.3)
    before = red()  # the STOP button
    robot.publish(robot.picture((0.2, -0.1, 0.4)))
    shown.until(lambda: red() > before + 10)


def test_a_template_of_another_version_is_drawn_and_said(robot, show):
    robot.instances = [robot.wheel(template_hash="another")]
    shown = show()
    shown.until(lambda: shown.opened.stage.property("problems") == [{"name": "wheel_1", "why": "differs"}])


def test_a_template_that_this_tablet_has_not_is_said_and_nothing_breaks(robot, show):
    robot.instances = [robot.wheel(template="teapot")]
    shown = show()
    shown.until(lambda: "teapot" in str(shown.opened.stage.property("problems")))
    shown.press("stop")
    shown.until(lambda: robot.calls_of(Stop))


def test_a_robot_that_can_not_be_drawn_is_said_and_everything_else_works(robot, show):
    def describe(name: str) -> Any:
        raise ConfigError(name, None, "robot", "no such robot")

    robot.run = robot.running()
    shown = show(describe=describe)
    shown.until(lambda: "can't be drawn" in shown.item("emptyTitle").property("text"))
    shown.press("pause")
    shown.until(lambda: robot.calls_of(PauseRun))


def test_mouse_and_touch_turn_move_and_zoom_the_view(robot, show):
    from PySide6.QtCore import QPoint, QPointF, Qt
    from PySide6.QtGui import QWheelEvent

    shown = show().drawn()
    rig, where = shown.find("rig"), shown.middle("sceneInput")

    def view() -> tuple[float, float, float, float]:
        focus = rig.property("focus")
        return rig.property("yaw"), rig.property("distance"), focus.y(), focus.z()

    def drag(button: Qt.MouseButton) -> None:
        shown.test.mousePress(shown.window, button, Qt.KeyboardModifier.NoModifier, where)
        for step in range(1, 9):
            shown.test.mouseMove(shown.window, where + QPoint(12 * step, 4 * step))
            shown.turn(0.005)
        shown.test.mouseRelease(shown.window, button, Qt.KeyboardModifier.NoModifier, where + QPoint(96, 32))

    yaw, distance, *focus = view()
    drag(Qt.MouseButton.LeftButton)
    assert view()[0] < yaw - 10 and view()[1:] == (distance, *focus)

    yaw = view()[0]
    drag(Qt.MouseButton.RightButton)
    assert view()[0] == yaw and list(view()[2:]) != focus

    wheel = QWheelEvent(
        QPointF(where), QPointF(where), QPoint(), QPoint(0, 240), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    from PySide6.QtCore import QCoreApplication

    QCoreApplication.sendEvent(shown.window, wheel)
    assert view()[1] < distance

    distance = view()[1]
    device = shown.test.createTouchDevice()
    left, right = where - QPoint(40, 0), where + QPoint(40, 0)
    shown.test.touchEvent(shown.window, device).press(0, left, shown.window).press(1, right, shown.window).commit()
    for step in range(1, 13):
        apart = QPoint(8 * step, 0)
        shown.test.touchEvent(shown.window, device).move(0, left - apart, shown.window).move(
            1, right + apart, shown.window
        ).commit()
        shown.turn(0.005)
    shown.test.touchEvent(shown.window, device).release(0, left - apart, shown.window).release(
        1, right + apart, shown.window
    ).commit()
    assert view()[1] < distance * 0.7, "two fingers that part come closer"

    yaw = view()[0]
    shown.test.touchEvent(shown.window, device).press(2, where, shown.window).commit()
    for step in range(1, 9):
        shown.test.touchEvent(shown.window, device).move(2, where + QPoint(12 * step, 0), shown.window).commit()
        shown.turn(0.005)
    shown.test.touchEvent(shown.window, device).release(2, where + QPoint(96, 0), shown.window).commit()
    assert view()[0] < yaw - 10, "one finger turns"


def test_view_presets_look_from_where_they_say(robot, show):
    robot.instances = [robot.wheel()]
    shown = show().drawn()
    shown.press("view_front")
    shown.until(lambda: shown.find("rig").property("yaw") == pytest.approx(90))
    shown.press("view_top")
    shown.until(lambda: shown.find("rig").property("pitch") == pytest.approx(-89))


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


# ------------------------------------------------------------------------------------------------------- hands and ears


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
        judge(asking, (asking.window.width(), asking.window.height()))


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


# --------------------------------------------------------------------------------------------------------------- picture


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


def test_the_scene_is_really_drawn(asking, robot):
    asking.drawn()
    robot.publish(robot.state())
    asking.turn(0.4)
    picture = asking.window.grabWindow()
    corner, size = asking.middle("sceneInput"), 200
    colors = {
        picture.pixel(x, y)
        for x in range(corner.x() - size, corner.x() + size, 4)
        for y in range(corner.y() - size, corner.y() + size, 4)
    }
    assert len(colors) > 300, "a robot has many shades, an empty background few"


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


# ----------------------------------------------------------------------------------------------------------------- pages


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
