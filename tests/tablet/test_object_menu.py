"""What can be done with an object, where the finger is: the window's menu, with a robot that only answers."""

from __future__ import annotations

import pytest

from handrail.messages import AttachInstance, EditInstance, RemoveInstance, SaveTemplate
from handrail.topics import refuse
from tests.tablet.shown import judge

pytestmark = pytest.mark.window


@pytest.fixture
def placed(robot, show):
    """A window on two wheels, none of them selected."""
    robot.instances = [robot.wheel(), robot.wheel(name="wheel_2")]
    shown = show().drawn()
    shown.until(lambda: shown.has_node("template_wheel_1"))
    shown.turn(0.3)  # the view has glided to where it begins
    return shown


def opened(shown, instance="wheel_1"):
    """The menu of an instance that is selected, by its button."""
    shown.desk.bench.select(instance)
    shown.until(lambda: shown.item("contextBar").isVisible())
    shown.press("more")
    shown.until(shown.item("objectMenu").isVisible)
    return shown


def test_a_finger_that_rests_on_an_object_opens_its_menu_there_and_a_touch_beside_it_closes_it(placed):
    from PySide6.QtCore import QPoint

    spot = placed.spot((0.55, -0.35, 0.30))
    with placed.finger(spot):
        placed.until(placed.item("objectMenu").isVisible)
    assert placed.desk.situation.bench.selected.startswith("wheel_")
    menu = placed.item("menuDelete").mapToScene(placed.item("menuDelete").boundingRect().center())
    assert abs(menu.x() - spot.x()) < 320
    judge(placed, (placed.window.width(), placed.window.height()))
    scene = placed.item("scenePanel")
    corner = scene.mapToScene(scene.boundingRect().bottomLeft()).toPoint() + QPoint(8, -8)
    with placed.finger(corner):
        pass
    placed.until(lambda: not placed.item("objectMenu").isVisible())


def test_the_right_button_opens_the_menu_of_what_is_under_it_and_nothing_elsewhere(placed):
    from PySide6.QtCore import QPoint, Qt

    right, none = Qt.MouseButton.RightButton, Qt.KeyboardModifier.NoModifier
    scene = placed.item("scenePanel")
    corner = scene.mapToScene(scene.boundingRect().bottomLeft()).toPoint() + QPoint(8, -8)
    placed.test.mouseClick(placed.window, right, none, corner)
    assert not placed.item("objectMenu").isVisible()
    placed.test.mouseClick(placed.window, right, none, placed.spot((0.55, -0.35, 0.30)))
    placed.until(placed.item("objectMenu").isVisible)


def test_the_menu_leads_to_waypoints_parameters_and_joints_of_its_object(placed):
    for entry, head in (("menuJoints", "lookAway"), ("menuParameters", "parameter_radius"), ("menuWaypoints", "plan")):
        opened(placed).press(entry)
        placed.until(lambda: placed.words("Pages.current") == "objects" and placed.words("Pages.section") == "")
        assert not placed.item("objectMenu").isVisible() and placed.item(head) is not None


def test_joints_that_are_looked_at_are_told_when_they_are_so(placed, robot):
    placed.desk.bench.select("wheel_1")
    placed.page("objects")
    placed.desk.bench.lookAt("hinge", 0.9)
    placed.press("believe")
    placed.until(lambda: [call.joints for call in robot.calls_of(EditInstance)] == [{"hinge": 0.9}])
    placed.until(lambda: placed.desk.situation.world.instances["wheel_1"].joint_state == {"hinge": 0.9})
    assert not placed.desk.situation.bench.looked


def test_an_object_is_attached_to_a_tool_and_stands_again(placed, robot):
    tool = next(iter(robot.description.arms.values())).tip
    opened(placed).press("menuAttach")
    placed.press(f"attach_{tool}")
    placed.until(lambda: [call.link for call in robot.calls_of(AttachInstance)] == [tool])
    placed.until(lambda: placed.desk.situation.world.instances["wheel_1"].attachment)
    opened(placed).press("menuAttach")
    placed.until(lambda: placed.item(f"attach_{tool}").property("checked"))
    assert placed.there("attach_wheel_2") and not placed.there("attach_wheel_1")
    placed.press("attach_world")
    placed.until(lambda: placed.desk.situation.world.instances["wheel_1"].attachment is None)


def test_an_object_is_saved_as_a_template_under_a_name_and_a_refusal_stands_below(placed, robot, monkeypatch):
    from PySide6.QtCore import Qt

    opened(placed).press("menuSave")
    assert not placed.item("saveTemplate").isEnabled()
    placed.until(lambda: placed.item("templateName").property("activeFocus"))
    for key in (Qt.Key.Key_B, Qt.Key.Key_I, Qt.Key.Key_G):
        placed.key(key)
    placed.press("saveTemplate")
    placed.until(lambda: "/workspace/big.yaml" in placed.item("templateSaid").property("text"))
    assert robot.calls_of(SaveTemplate) == [SaveTemplate(instance="wheel_1", name="big")]
    answer = robot.answer
    monkeypatch.setattr(robot, "answer", lambda call: _raise() if isinstance(call, SaveTemplate) else answer(call))
    placed.press("saveTemplate")
    placed.until(lambda: "there is a template big" in placed.item("templateSaid").property("text"))


def _raise():
    raise refuse("there is a template big")


def test_an_object_is_deleted_after_a_second_press(placed, robot):
    opened(placed).press("menuDelete")
    placed.turn(0.05)
    assert not robot.calls_of(RemoveInstance)
    placed.press("menuDelete")
    placed.until(lambda: robot.calls_of(RemoveInstance) == [RemoveInstance(name="wheel_1")])


def test_a_finger_that_rests_on_the_handle_opens_no_menu(placed):
    placed.desk.bench.select("wheel_1")
    placed.until(lambda: placed.find("handle").property("visible"))
    placed.turn(0.3)
    with placed.finger(placed.spot(placed.arrow(2))):
        placed.until(lambda: placed.desk.bench.hot == "tz")
        placed.turn(0.8)
        assert not placed.item("objectMenu").isVisible()
