"""The operator's window on a robot that is up: a wheel is placed, brought onto the valve with a finger, and turned."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import handrail
from handrail.robot import library as robots
from tests.line import Line
from tests.stack.conftest import Stack
from tests.tablet.conftest import mesh_folder, qt, screen  # noqa: F401  (fixtures)
from tests.tablet.shown import Shown, closed_here

pytestmark = [pytest.mark.stack]

VALVE = np.array([0.55, -0.35, 0.30])
"""m, where the scene has it: the window is not told, its camera sees it"""
AWAY = (0.5, 0.0, 0.0)
"""m, from where a wheel is placed to where no arm reaches"""


class Remote:
    """What a window is shown with: who its robot is, and clients of it."""

    def __init__(self, port: int):
        self.description = robots.load("talos_upper")
        self.released = threading.Event()
        self._port = port

    def connect(self) -> handrail.client.Client:
        return handrail.connect(f"tcp://127.0.0.1:{self._port}", timeout_s=0)


@pytest.fixture
def stack(start_stack: Callable[..., Stack]) -> Stack:
    stack = start_stack(camera=True)
    stack.wait_up()
    return stack


@pytest.fixture
def line(stack: Stack) -> Iterator[Line]:
    line = Line(stack.port)
    yield line
    line.close()


@pytest.fixture
def tablet(qt: None, mesh_folder: Any) -> Iterator[Callable[[int], Shown]]:  # noqa: F811
    with closed_here() as opened:

        def show(port: int) -> Shown:
            opened.append(Shown(Remote(port), mesh_folder))
            opened[-1].window.resize(1280, 800)
            opened[-1].until(lambda: opened[-1].find("scene").property("height") > 600)
            return opened[-1].drawn()

        yield show


def place_of(shown: Shown) -> np.ndarray:
    """(3,) m, where the robot believes the wheel to be."""
    return np.array(shown.desk.situation.world.instances["wheel_1"].pose_in_world.position)


def handle_of(shown: Shown) -> np.ndarray:
    """(3,) m, where the handle is drawn: a window that has much to draw is a little behind."""
    return np.array(shown.opened.stage.property("handle").toTuple())


def drag(shown: Shown, by: np.ndarray) -> None:
    """With a finger on the arrows of the selected template's handle, one after the other."""
    for axis in np.flatnonzero(np.abs(by) > 0.002).tolist():
        shown.until(lambda: np.abs(handle_of(shown) - place_of(shown)).max() < 1e-3)
        wanted = place_of(shown)[axis] + by[axis]
        assert any(drag_by(shown, axis, by[axis], share) for share in (1.0, 0.85, 0.6, 0.5, 0.4)), f"no arrow {axis}"
        shown.until(lambda: shown.desk.bench.hot == "" and not shown.desk.situation.bench.edits.waiting)
        shown.until(lambda axis=axis, wanted=wanted: abs(place_of(shown)[axis] - wanted) < 0.02)


def drag_by(shown: Shown, axis: int, by: float, share: float) -> bool:
    """Where the finger is on an arrow there, and not nearer to another part of the handle or beside the view."""
    with shown.finger(shown.spot(shown.arrow(axis, share=share))) as finger:
        shown.turn(0.1)
        if shown.desk.bench.hot != "t" + "xyz"[axis]:
            return False
        finger.to(shown.spot(shown.arrow(axis, by, share=share)))
        return True


def reached(shown: Shown) -> dict[str, str]:
    """waypoint → whether it can be reached, as the window shows it; what is not known yet is left out."""
    return {one.name: one.reach.state for one in shown.desk.situation.bench.waypoints if one.reach is not None}


def seen_near(shown: Shown, place: np.ndarray, within: float) -> int:
    """How many points that the camera sees are so near, m, to a place."""
    clouds = shown.desk.situation.clouds.seen.values()
    return sum(int((np.linalg.norm(one.points.positions - place, axis=1) < within).sum()) for one in clouds)


def same(one: Shown, other: Shown) -> bool:
    """Whether two windows show the same instances, plans, run and questions."""

    def told(shown: Shown) -> tuple[Any, ...]:
        now = shown.desk.situation
        run = now.task.run
        return (
            now.world.instances,
            now.plans.shown and now.plans.shown.id,
            run and (run.run, run.status, run.active),
            now.prompts.current and now.prompts.current.id,
        )

    return told(one) == told(other)


def edit_on_the_canvas(shown: Shown) -> None:
    """A state's title, by mouse and keys, saved: the run goes on in that version."""
    from PySide6.QtCore import Qt

    before = shown.desk.situation.task.run
    shown.press("tab_canvas")
    shown.until(lambda: shown.there("canvas_program_turn_valve"))
    shown.press("canvas_program_turn_valve")
    shown.until(lambda: shown.there("state_counting") and shown.item("state_counting").width() > 20)
    shown.press("state_counting")
    shown.until(lambda: shown.desk.workshop.canvas.view["state"].get("name") == "counting")
    shown.item("canvas_title").forceActiveFocus()
    for key in (Qt.Key.Key_End, Qt.Key.Key_O, Qt.Key.Key_K, Qt.Key.Key_Return):
        shown.key(key)
    shown.press("canvasSave")
    shown.until(lambda: shown.desk.situation.task.run.hash != before.hash)
    assert shown.desk.situation.task.run.run == before.run
    shown.until(lambda: "Far enough?ok" in [state.title for state in shown.desk.situation.task.tree.states])
    shown.press("tab_task")


@pytest.mark.timeout(500)
def test_a_wheel_is_placed_dragged_onto_the_valve_that_is_seen_and_turned_though_the_link_was_lost_meanwhile(
    stack, line, tablet
):
    shown, truth = tablet(line.port), stack.truth()
    shown.press("enable")
    shown.until(lambda: shown.desk.situation.robot.status.enabled)
    shown.until(lambda: seen_near(shown, VALVE, 0.16) > 30)
    shown.press("tab_objects")
    shown.press("place_wheel")
    shown.until(lambda: "wheel_1" in shown.desk.situation.world.instances)
    shown.until(lambda: shown.find("handle").property("visible"))
    from PySide6.QtCore import Qt

    shown.item("sceneInput").forceActiveFocus(Qt.FocusReason.TabFocusReason)
    for _ in range(3):
        shown.key(Qt.Key.Key_Minus)  # from further off: all that is dragged stays in sight
    drag(shown, np.array(AWAY))
    shown.until(lambda: "not" in reached(shown).values())
    for _ in range(3):
        drag(shown, VALVE - place_of(shown))
    assert np.abs(place_of(shown) - VALVE).max() < 0.01
    shown.until(
        lambda: set(reached(shown).values()) == {"reached"} or set(reached(shown).values()) == {"reached", "near"}
    )
    before = truth.now().hinges["valve"]

    def turned() -> float:
        """rad, in the plant, whatever the window believes; 0 where it has said nothing since this was asked before."""
        sample = truth.latest()
        return 0.0 if sample is None else abs(sample.hinges["valve"] - before)

    shown.press("tab_library")
    for name in ("program_turn_valve", "bind_arm_right", "bind_valve_wheel_1"):
        shown.until(lambda name=name: shown.there(name))
        shown.press(name)
    shown.press("launch")
    shown.until(lambda: shown.item("promptCard").isVisible())
    shown.press("option_approve")
    shown.until(lambda: turned() > 0.5)
    with stack.connect() as robot:  # simulated time goes by faster than a mouse does
        robot.set_speed(0.1)
        edit_on_the_canvas(shown)
        assert turned() < np.deg2rad(200), "all of that while the arm was on its way"
        line.cut()
        shown.until(lambda: not shown.desk.situation.link.attached)
        cut_at = turned()
        late = tablet(stack.port)
        late.until(lambda: late.desk.situation.link.engine)
        robot.set_speed(1.0)
    late.until(lambda: turned() > cut_at + 0.5)
    line.mend()
    shown.until(lambda: shown.desk.situation.link.attached)
    shown.until(lambda: same(shown, late))
    shown.until(lambda: shown.desk.situation.task.status == "succeeded", 200)
    assert turned() >= np.deg2rad(270)
    late.until(lambda: same(shown, late))
