"""Templates under an operator's fingers, in the real window on a virtual screen."""

from __future__ import annotations

from typing import Any

import pytest

from handrail.messages import EditInstance, ExecutePlan, GetReach, MakePlan, Stop
from tests.tablet.shown import Shown, distance

pytestmark = pytest.mark.window


@pytest.fixture
def selected(robot: Any, show: Any) -> Shown:
    """A window with a wheel that was tapped on."""
    robot.instances = [robot.wheel()]
    shown = show().drawn()
    shown.window.resize(1280, 800)
    robot.publish(robot.state())
    shown.until(lambda: shown.window.width() == 1280 and shown.find("scene").property("height") > 600)
    rim = shown.spot((0.55, -0.35 + 0.15, 0.30))
    from PySide6.QtCore import Qt

    shown.until(shown.opened.stage.solids)
    shown.test.mouseClick(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, rim)
    shown.until(lambda: shown.desk.bench.view["selected"] == "wheel_1")
    return shown


def test_a_finger_drags_the_selected_template_by_its_handle_and_undo_brings_it_back(selected, robot):
    from PySide6.QtCore import QPoint

    view, before = selected.find("rig"), robot.instances[0].pose_in_world
    turned = view.property("yaw")
    start, end = selected.spot(selected.arrow(2)), selected.spot((0.55, -0.35, 0.30))
    apart = QPoint(12, 0)  # a finger is not exact
    with selected.finger(start + apart) as finger:
        selected.until(lambda: selected.desk.bench.hot == "tz")
        finger.to(start + apart + (start - end))
    selected.until(lambda: selected.desk.bench.hot == "" and not selected.desk.situation.bench.edits.waiting)
    selected.until(lambda: robot.instances[0].pose_in_world.position[2] > 0.4)
    x, y, _ = robot.instances[0].pose_in_world.position
    assert (x, y) == pytest.approx((0.55, -0.35), abs=1e-6), "along its axis alone"
    assert view.property("yaw") == turned, "the view stays"
    assert len(robot.calls_of(EditInstance)) <= 12
    selected.press("undo")
    selected.until(lambda: robot.instances[0].pose_in_world == before)
    selected.until(lambda: distance(selected.node("template_wheel_1"), before.position) < 1e-4)


def test_a_finger_that_moved_the_handle_by_a_few_pixels_has_not_tapped_beside_it(selected, robot):
    from PySide6.QtCore import QPoint

    tip = selected.spot(selected.arrow(2))
    with selected.finger(tip) as finger:
        selected.until(lambda: selected.desk.bench.hot == "tz")
        finger.to(tip - QPoint(0, 6))
    selected.until(lambda: selected.desk.bench.hot == "" and not selected.desk.situation.bench.edits.waiting)
    selected.until(lambda: robot.instances[0].pose_in_world.position[2] > 0.301)
    assert selected.desk.bench.view["selected"] == "wheel_1"
    place = selected.find("scene").mapToScene(selected.find("scene").boundingRect().topLeft()).toPoint()
    with selected.finger(place + QPoint(40, 300)):
        pass
    selected.until(lambda: selected.desk.bench.view["selected"] == "")  # a tap beside it is one still


def test_waypoints_stand_in_the_scene_in_the_colour_of_their_reach_and_beside_it_in_words(selected, robot):
    selected.until(lambda: robot.calls_of(GetReach))
    words = "not reached: clearance (arm and rim) missed by 21 mm"
    selected.until(lambda: selected.item("reach_turn").property("why") == words)
    assert selected.item("reach_engage").property("why") == "near: joint limits (elbow), 2.9° left"
    place = pytest.approx((0.40, -0.25, 0.30), abs=1e-3)
    selected.until(lambda: selected.has_node("waypoint_approach") and selected.node("waypoint_approach") == place)
    stage = selected.opened.stage
    assert stage._states[:4] == ["reached", "", "near", "not"]
    selected.press("plan")
    selected.until(lambda: [(call.trajectory, call.arm) for call in robot.calls_of(MakePlan)] == [("turn", "right")])


def test_a_parameters_slider_changes_the_instance_and_what_is_drawn(selected, robot):
    from PySide6.QtCore import Qt

    slider = selected.until(lambda: selected.item("parameter_radius"))
    slider.forceActiveFocus(Qt.FocusReason.TabFocusReason)
    selected.key(Qt.Key.Key_Right)
    selected.until(lambda: robot.calls_of(EditInstance))
    assert robot.instances[0].parameters["radius"] == pytest.approx(0.15 + 0.0032)


def test_numbers_can_be_typed_and_space_is_stop_in_their_fields_too(selected, robot):
    from PySide6.QtCore import Qt

    field = selected.item("number_z")
    field.forceActiveFocus(Qt.FocusReason.TabFocusReason)
    selected.until(lambda: selected.window.activeFocusItem() is not None)
    field.setProperty("text", "")
    for key in (Qt.Key.Key_4, Qt.Key.Key_1, Qt.Key.Key_2):
        selected.key(key)
    selected.key(Qt.Key.Key_Return)
    selected.until(lambda: robot.instances[0].pose_in_world.position[2] == pytest.approx(0.412))
    assert not robot.calls_of(Stop)
    selected.key(Qt.Key.Key_Space)
    selected.until(lambda: robot.calls_of(Stop))


def test_a_tap_beside_everything_selects_nothing(selected):
    from PySide6.QtCore import QPoint, Qt

    scene = selected.item("sceneInput")
    corner = selected.middle("sceneInput") + QPoint(round(-0.45 * scene.width()), round(0.4 * scene.height()))
    selected.turn(0.6)  # not the second half of a double tap
    selected.test.mouseClick(selected.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, corner)
    selected.until(lambda: selected.desk.bench.view["selected"] == "")
    assert not selected.find("handle").property("visible")


def test_a_plan_is_executed_from_its_time_line_unless_the_button_says_why_not(robot, show):
    robot.plans = [robot.plan()]
    shown = show().drawn()
    robot.enabled = False
    robot.publish(robot.status(), robot.state())
    shown.until(lambda: shown.item("execute").property("why") == "drives not enabled")
    robot.enabled = True
    robot.publish(robot.status())
    shown.press("execute")
    shown.until(lambda: [call.id for call in robot.calls_of(ExecutePlan)] == ["plan-1"])
    shown.page("robot")
    dark = shown.words("Theme.ground")
    shown.press("theme")
    shown.until(lambda: shown.words("Theme.ground") != dark)
    shown.press("theme")
    shown.until(lambda: shown.words("Theme.ground") == dark)
