"""Moving by hand: nudges and held buttons send places to stop at, sliders and targets only show and plan."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handrail.messages import FrameGoal, Jog, JointsGoal, PlanMotion, RobotState
from handrail.robot import library as robots
from tablet_client.models.move import AHEAD, BRAKE, SPEEDS, Move
from tablet_client.models.view import View


@pytest.fixture(scope="module")
def chain() -> Any:
    import yourdfpy

    from tablet_client.scene.kinematics import Chain

    description = robots.load("talos_upper")
    model = yourdfpy.URDF.load(str(description.urdf), load_meshes=False, build_scene_graph=False)
    return Chain(model, description.joints)


class Bare:
    """A robot that goes where it is sent, at once or not at all."""

    def __init__(self, chain: Any):
        self.description = robots.load("talos_upper")
        self.command = np.array(self.description.home_position(), float)
        self.base = np.eye(4)
        self.move = Move()
        arms = self.description.arms
        limits = (self.description.lower, self.description.upper, self.description.velocity_limit)
        self.move.meet(self, chain, {n: a.tip for n, a in arms.items()}, {n: a.joints for n, a in arms.items()}, limits)
        self.stand()

    def stand(self, moving: bool = False) -> None:
        self.move.stands(self.command.copy(), self.base, moving)

    def go(self, place: Any, share: float = 1.0) -> None:
        """As far as this share of the way."""
        assert isinstance(place, Jog), place
        for joint, value in place.joints.items():
            row = self.description.index(joint)
            self.command[row] += share * (value - self.command[row])
        self.stand(moving=True)


@pytest.fixture
def bare(chain: Any) -> Bare:
    return Bare(chain)


@pytest.mark.parametrize(("part", "axis"), [("tx", 0), ("ty", 1), ("tz", 2)])
@pytest.mark.parametrize(("mode", "metres"), [("fine", 0.001), ("coarse", 0.01)])
def test_a_tap_moves_the_tool_by_its_step_along_the_worlds_axis_and_turns_it_by_nothing(bare, part, axis, mode, metres):
    move, before = bare.move, bare.move.tip
    move.mode = mode
    bare.go(move.press(part, -1))
    away = move.tip[:3, 3] - before[:3, 3]
    assert away[axis] == pytest.approx(-metres, abs=1e-4)
    assert np.linalg.norm(np.delete(away, axis)) < 1e-4
    assert np.abs(move.tip[:3, :3] - before[:3, :3]).max() < 1e-3


def test_a_base_that_is_turned_and_the_tools_own_axes_are_other_ways(bare):
    move = bare.move
    bare.base = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    bare.stand()
    move.mode, before = "coarse", move.tip
    bare.go(move.press("tx", 1))
    assert move.tip[:3, 3] - before[:3, 3] == pytest.approx([0.01, 0, 0], abs=1e-4)
    move.axes, before = "tool", move.tip
    bare.stand()
    bare.go(move.press("tz", 1))
    assert before[:3, :3].T @ (move.tip[:3, 3] - before[:3, 3]) == pytest.approx([0, 0, 0.01], abs=1e-4)


def test_a_tap_turns_the_tool_about_its_tip_by_a_degree(bare):
    move, before = bare.move, bare.move.tip
    bare.go(move.press("rz", 1))
    turned = move.tip[:3, :3] @ before[:3, :3].T
    assert np.degrees(np.arctan2(turned[1, 0], turned[0, 0])) == pytest.approx(1.0, abs=0.05)
    assert np.linalg.norm(move.tip[:3, 3] - before[:3, 3]) < 1e-4


def test_taps_while_it_is_still_on_its_way_add_up(bare):
    move, before = bare.move, bare.move.tip
    move.mode = "coarse"
    bare.go(move.press("tz", 1), 0.2)
    bare.go(move.press("tz", 1), 0.3)
    bare.go(move.press("tz", 1))
    assert move.tip[2, 3] - before[2, 3] == pytest.approx(0.03, abs=3e-4)


def test_the_torso_which_would_take_the_other_arm_along_is_left_alone(bare):
    joints = bare.move.press("tx", 1).joints
    assert joints and all("arm_right" in joint for joint in joints)


def test_what_a_held_button_sends_is_never_further_ahead_than_it_says_and_shrinks_to_the_brake_at_its_end(bare):
    move = bare.move
    move.mode = "hold"
    start = move.tip
    place = move.press("tz", 1)
    for _ in range(6):
        goal = bare.command.copy()
        for joint, value in place.joints.items():
            goal[bare.description.index(joint)] = value
        ahead = move._limbs["right"].tip(goal)[2, 3] - move.tip[2, 3]
        assert 0.0 < ahead <= SPEEDS["t"] * AHEAD * 1.02
        bare.go(place, 0.25)
        place = move.hold()
    last = move.let_go()
    goal = bare.command.copy()
    for joint, value in last.joints.items():
        goal[bare.description.index(joint)] = value
    assert move._limbs["right"].tip(goal)[2, 3] - move.tip[2, 3] == pytest.approx(SPEEDS["t"] * BRAKE, rel=0.05)
    assert move.hold() is None and move.let_go() is None, "one zero, then nothing"
    assert np.linalg.norm((move.tip - start)[:2, 3]) < 1e-3, "a straight line"


def test_while_nothing_is_heard_of_the_robot_a_held_button_sends_it_no_further(bare):
    bare.move.mode = "hold"
    first = bare.move.press("tx", 1)
    assert bare.move.hold().joints == pytest.approx(first.joints, abs=1e-6)


def test_a_held_joint_goes_at_its_pace_up_to_its_limit(bare):
    move, joint = bare.move, "arm_right_4_joint"
    row = bare.description.index(joint)
    move.mode = "hold"
    place = move.press(joint, -1)
    assert list(place.joints) == [joint]
    assert place.joints[joint] == pytest.approx(bare.command[row] - SPEEDS["j"] * AHEAD)
    assert place.speed * bare.description.velocity_limit[row] == pytest.approx(SPEEDS["j"])
    for _ in range(200):
        bare.go(place)
        place = move.hold()
        if place == "at_limit":
            break
    assert place == "at_limit" and move.held == ""
    assert bare.command[row] == pytest.approx(bare.description.lower[row], abs=1e-3)


def test_a_nudge_beyond_the_arms_reach_is_not_sent(bare):
    bare.move.mode = "coarse"
    answers = []
    for _ in range(100):
        place = bare.move.press("tx", 1)
        answers.append(place)
        if isinstance(place, str):
            break
        bare.go(place)
        bare.stand()
    assert answers[-1] == "beyond_reach" and len(answers) > 5


def test_sliders_show_a_posture_and_a_plan_goes_there(bare):
    move, joint = bare.move, "arm_right_4_joint"
    assert move.plan() is None and move.posture is None
    value = bare.command[bare.description.index(joint)] + 0.2
    move.slide(joint, value)
    assert move.posture[bare.description.index(joint)] == pytest.approx(value)
    call = move.plan()
    assert isinstance(call, PlanMotion) and isinstance(call.goals[0], JointsGoal) and call.arm == "right"
    assert call.goals[0].positions[joint] == pytest.approx(value)
    assert call.goals[0].positions["arm_right_1_joint"] == pytest.approx(
        bare.command[bare.description.index("arm_right_1_joint")]
    )
    move.planned()
    assert move.posture is None, "the plan's own ghost goes there now"
    move.slide(joint, value + 0.1)
    assert move.posture is not None
    move.reset()
    assert move.plan() is None


def dragged(move: Move, part: str, pixels: float) -> None:
    view = View(38, -14, 2.25, (0.24, -0.12, 0.1), 42, 900, 600)
    tip = move.target
    (at, along), _ = view.project(np.array([tip[:3, 3], tip[:3, 3] + 0.1 * tip[:3, "xyz".index(part[1])]]))
    way = (along - at) / np.linalg.norm(along - at)
    grip = at + way * 60
    if move.grasp(view, *grip) != part:
        pytest.fail(f"the finger is on {move.hot!r}, not on {part}")
    move.drag(view, *(grip + way * pixels))
    move.release()


def test_the_ghost_follows_a_dragged_target_and_says_when_it_can_not(bare):
    move = bare.move
    move.show_target()
    assert move.reached and np.allclose(move.target, move.tip)
    dragged(move, "tz", -25)
    assert not np.allclose(move.target, move.tip)
    tip = move._limbs["right"].tip(move.posture)
    assert move.reached and np.linalg.norm(tip[:3, 3] - move.target[:3, 3]) < 5e-4
    move.target[:3, 3] += 2.0
    move.count("none")
    assert not move.reached and move.misses[0] > 1.0


def test_what_of_the_targets_orientation_counts_is_what_the_plan_is_asked_for(bare):
    move = bare.move
    move.show_target()
    goals = {}
    for turn in ("all", "z", "none"):
        move.count(turn)
        call = move.plan()
        assert isinstance(call.goals[0], FrameGoal)
        goals[turn] = call.goals[0]
    assert (goals["all"].angle, goals["all"].about) == (0.0, "")
    assert (goals["z"].angle, goals["z"].about) == (0.0, "z")
    assert goals["none"].angle == pytest.approx(np.pi)
    move.relax = move.seen = True
    assert move.plan().relax == ["goals[0].angle", "goals[0].position"] and move.plan().seen


# -------------------------------------------------------------------------------------------------------------- the window


def stand(robot: Any, **moved: float) -> RobotState:
    robot.time_ns += 10_000_000
    return robot.state(**moved)


def test_a_finger_on_a_held_button_streams_until_it_is_lifted(robot, show):
    from PySide6.QtCore import Qt

    shown = show().drawn()
    robot.publish(stand(robot))
    shown.press("tab_move")
    shown.press("moveMode_hold")
    shown.until(lambda: shown.item("move_tz+").isEnabled())
    shown.turn(0.05)
    place = shown.middle("move_tz+")
    shown.test.mousePress(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, place)
    shown.until(lambda: len(robot.calls_of(Jog)) >= 3)
    shown.test.mouseRelease(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, place)
    shown.until(lambda: shown.desk.move.view["held"] == "")
    shown.turn(0.3)  # what was on its way has gone out
    sent = len(robot.calls_of(Jog))
    shown.turn(0.5)
    assert len(robot.calls_of(Jog)) == sent, "nothing more is sent"


def test_a_window_that_goes_while_a_button_is_held_sends_nothing_more(robot, show):
    from PySide6.QtCore import Qt

    shown = show().drawn()
    robot.publish(stand(robot))
    shown.press("tab_move")
    shown.press("moveMode_hold")
    shown.until(lambda: shown.item("move_tx+").isEnabled())
    shown.turn(0.05)
    shown.test.mousePress(
        shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, shown.middle("move_tx+")
    )
    shown.until(lambda: robot.calls_of(Jog))
    shown.page("journal")
    shown.until(lambda: shown.desk.move.view["held"] == "")


def test_a_slider_shows_a_ghost_and_a_plan_is_asked_for(robot, show):
    from PySide6.QtCore import Qt

    shown = show().drawn()
    robot.publish(stand(robot))
    shown.press("tab_move")
    shown.until(lambda: shown.desk.move.joints.rowCount() == 7)
    shown.desk.move.slide("arm_right_4_joint", -1.0)
    shown.until(lambda: shown.opened.stage.property("ghostShown"))
    plan = shown.item("movePlan")
    shown.until(plan.isEnabled)
    plan.forceActiveFocus(Qt.FocusReason.TabFocusReason)
    shown.key(Qt.Key.Key_Return)
    shown.until(lambda: robot.calls_of(PlanMotion))
    robot.publish(robot.plan("by-hand", made_from={}))
    shown.until(lambda: shown.desk.ghost["shown"] and shown.desk.ghost["label"] == "Stroke 1")


def test_a_robot_that_does_not_go_says_why_on_the_page(robot, show):
    from handrail.messages import Refused
    from handrail.topics import RefusedError

    answer = robot.answer

    def refuses(call: Any) -> Any:
        if isinstance(call, Jog):
            raise RefusedError(Refused(message="the arm is leased by Bob"))
        return answer(call)

    robot.answer = refuses
    shown = show().drawn()
    robot.publish(stand(robot))
    shown.press("tab_move")
    shown.until(lambda: shown.item("move_ty-").isEnabled())
    shown.press("move_ty-")
    shown.until(lambda: "leased by Bob" in shown.item("moveSaid").property("text"))
    robot.enabled = False
    robot.publish(robot.status())
    shown.until(lambda: "drives not enabled" in shown.item("moveSaid").property("text"))
    assert not shown.item("move_ty-").isEnabled()
