"""The library page, with a finger, on a virtual screen."""

from __future__ import annotations

import pytest

from handrail.messages import Deploy, RollBack, Run, SetRunParameters
from tests.tablet.shown import judge

pytestmark = pytest.mark.window


def test_a_program_is_bound_given_a_parameter_and_run_from_the_page(robot, show):
    from PySide6.QtCore import Qt

    robot.instances = [robot.wheel()]
    shown = show()
    shown.press("tab_library")
    shown.until(lambda: any(item.objectName() == "program_turn_valve" for item in shown.all_items()))
    assert not shown.item("program_broken").isEnabled()
    shown.press("program_turn_valve")
    shown.until(lambda: shown.desk.library.view["why"]["run"] == "unbound")
    assert not shown.item("launch").isEnabled()
    shown.press("bind_arm_right")
    field = shown.item("number_goal_deg")
    field.forceActiveFocus()
    for key in (Qt.Key.Key_9, Qt.Key.Key_0, Qt.Key.Key_Return):
        shown.key(key)
    shown.press("launch")
    shown.until(lambda: robot.calls_of(Run))
    (deploy,) = robot.calls_of(Deploy)
    assert (deploy.bindings, deploy.parameters) == ({"arm": "right", "valve": "wheel_1"}, {"goal_deg": 90.0})
    assert [call.deployment for call in robot.calls_of(Run)] == ["deployment-9"]
    shown.until(lambda: shown.words("Pages.current") == "task")


def test_a_run_that_is_under_way_is_given_other_parameters_within_their_bounds(robot, show):
    from PySide6.QtCore import Qt

    robot.instances = [robot.wheel()]
    robot.run = robot.running(program="turn_valve", data={"goal_deg": 120.0, "turned_deg": 30.0})
    shown = show()
    shown.press("tab_library")
    shown.until(lambda: shown.desk.library.view["known"])
    shown.press("program_turn_valve")
    shown.until(lambda: shown.desk.library.view["running"])
    values = {row["name"]: row["value"] for row in shown.desk.library.parameters.lines}
    assert (values["goal_deg"], values["strokes"]) == (120.0, 10), "the run's own, else the file's"
    assert shown.desk.library.why("set") == "nothing_changed"

    def type_(*keys):
        shown.item("number_goal_deg").forceActiveFocus()
        shown.test.keyClick(shown.window, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
        for key in (*keys, Qt.Key.Key_Return):
            shown.key(key)

    type_(Qt.Key.Key_3)
    shown.until(lambda: shown.desk.library.why("set") == "bad_parameter")
    type_(Qt.Key.Key_9, Qt.Key.Key_0)
    shown.press("setInRun")
    shown.until(lambda: [call.parameters for call in robot.calls_of(SetRunParameters)] == [{"goal_deg": 90.0}])
    robot.publish(robot.running(program="turn_valve", data={"goal_deg": 90.0}))
    shown.until(lambda: shown.desk.library.why("set") == "nothing_changed")
    robot.publish(robot.running(program="turn_valve", status="succeeded", active=[], data={"goal_deg": 90.0}))
    shown.until(lambda: shown.item("launch").isVisible())


def test_a_release_is_gone_back_to_after_a_second_press(robot, show):
    shown = show()
    shown.press("tab_library")
    shown.press("library_engines")
    shown.until(lambda: len(shown.desk.library.releases.lines) == 2)
    assert not shown.item("rollBack_2").isEnabled()
    shown.press("rollBack_1")
    shown.turn(0.1)
    assert not robot.calls_of(RollBack)
    shown.press("rollBack_1")
    shown.until(lambda: [line["number"] for line in shown.desk.library.releases.lines] == [3, 2, 1])
    assert [(call.number, call.engine) for call in robot.calls_of(RollBack)] == [(1, "engine")]


def test_every_control_of_the_form_and_of_the_engines_list_is_large_enough_and_has_a_name(robot, show):
    robot.instances = [robot.wheel()]
    shown = show()
    shown.press("tab_library")
    shown.until(lambda: shown.desk.library.view["known"])
    shown.desk.library.choose("turn_valve")
    shown.until(lambda: shown.desk.library.view["why"]["run"] == "unbound")
    shown.turn(0.1)
    judge(shown, (1024, 640))
    shown.press("library_engines")
    shown.until(lambda: len(shown.desk.library.releases.lines) == 2)
    shown.turn(0.1)
    judge(shown, (1024, 640))
