"""The window's 3-D view, on a virtual screen, with a robot that only answers."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import msgspec
import pytest

from affordance_templates import template_file
from handrail import workspace
from handrail.config import ConfigError, parse
from handrail.messages import (
    GetPlan,
    GetTemplate,
    PauseRun,
    PlanWaypoint,
    PlanWorst,
    Stop,
    TemplateSource,
)
from tests.tablet.shown import distance

pytestmark = pytest.mark.window


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


def test_a_template_that_only_the_robot_has_is_fetched_once_and_drawn(robot, show, monkeypatch):
    monkeypatch.setattr(workspace, "_deployed", None)
    crate = "title: Crate\nparameters: {side: {default: 0.4}}\nobjects: {body: {shapes: [{kind: box, size: [side, side, side]}]}}\n"
    hash_ = template_file.of(parse(crate, Path("crate.yaml")), crate.encode()).hash
    robot.instances = [
        robot.wheel(name=name, template="crate", template_hash=hash_, joint_state={}, parameters={"side": 0.3})
        for name in ("crate_1", "crate_2")
    ]
    answer, come = robot.answer, threading.Event()

    def answers(call: Any) -> Any:
        if isinstance(call, GetTemplate):
            robot.calls.append(call)
            assert come.wait(30)
            return TemplateSource(template="crate", hash=hash_, text=crate)
        return answer(call)

    robot.answer = answers
    shown = show()
    shown.until(lambda: "crate" in str(shown.opened.stage.property("problems")))
    come.set()
    shown.until(lambda: shown.opened.stage.property("problems") == [])
    assert shown.opened.stage._meshes["crate_1"].vertices.max() == pytest.approx(0.15)
    robot.publish(robot.wheel(name="crate_1", template="crate", template_hash=hash_, joint_state={}, version=2))
    shown.until(lambda: shown.desk.situation.world.instances["crate_1"].version == 2)
    assert len(robot.calls_of(GetTemplate)) == 1, "once, however many are of it"


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
