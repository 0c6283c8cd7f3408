"""A hand or the centre of mass is dragged: what moves along, what is kept, in the ghost and in what a plan is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

from handrail.messages import CentreOfMassGoal, FrameGoal, GazeGoal
from handrail.robot import library as robots
from tablet_client.models.move import Move
from tablet_client.models.whole_body import Camera
from tablet_client.scene.kinematics import Chain


class Bare:
    """A robot that stands somewhere."""

    def __init__(self, name: str):
        self.description = robots.load(name)
        model = yourdfpy.URDF.load(str(self.description.urdf), load_meshes=False, build_scene_graph=False)
        self.chain = Chain(model, self.description.joints)
        self.command = np.array(self.description.home_position("ready"), float)
        self.base = np.eye(4)
        self.base[:3, 3] = [1.0, 2.0, 1.0]
        self.on_feet = bool(self.description.feet)

    def move(self) -> Move:
        d, move = self.description, Move()
        cameras = [Camera(each.name, each.link, (0.0, 0.0, 1.0)) for each in d.cameras]
        tips = {name: arm.tip for name, arm in d.arms.items()}
        joints = {name: arm.joints for name, arm in d.arms.items()}
        limits = (d.lower, d.upper, d.velocity_limit)
        move.meet(self, self.chain, tips, joints, limits, feet=[foot.link for foot in d.feet], cameras=cameras)
        move.stands(self.command, self.base, False, on_feet=self.on_feet)
        return move

    def link(self, position: Any, link: str) -> np.ndarray:
        """(4, 4), in the base."""
        frame = self.chain.frames[link]
        return self.chain.poses(position)[frame.body] @ frame.pose_in_body

    def from_sole(self, position: Any, link: str) -> np.ndarray:
        """(4, 4), in the right foot's sole."""
        return np.linalg.inv(self.link(position, "right_sole_link")) @ self.link(position, link)

    def moved(self, position: Any) -> set[str]:
        return {joint for joint, a, b in zip(self.chain.joints, position, self.command, strict=True) if a != b}


@pytest.fixture(scope="module")
def upper() -> Bare:
    return Bare("talos_upper")


@pytest.fixture(scope="module")
def whole() -> Bare:
    return Bare("talos")


@pytest.mark.parametrize("name", ["upper", "whole"])
def test_the_drawn_chains_centre_of_mass_is_pinocchios_with_all_that_it_carries(request, name):
    bare = request.getfixturevalue(name)
    free = pin.buildModelFromUrdf(str(bare.description.urdf), pin.JointModelFreeFlyer())
    q = pin.neutral(free)
    for joint, x in zip(bare.description.joints, bare.command, strict=True):
        q[free.idx_qs[free.getJointId(joint)]] = x
    found = bare.chain.centre_of_mass(bare.chain.poses(bare.command))
    assert found == pytest.approx(
        pin.centerOfMass(free, free.createData(), q), abs=2e-3
    )  # fingers, which nobody commands


def test_a_tool_alone_moves_its_own_joints_in_ghost_and_plan(upper):
    move = upper.move()
    move.show_target()
    move.place(2, move.target[2, 3] + 0.05)
    assert move.reached and all("arm_right" in joint for joint in upper.moved(move.posture))
    assert set(move.plan().joints) == {joint for joint in upper.chain.joints if "arm_right" in joint}
    assert move.offered == ["torso", "gaze", "steady"], "the other hand stays anyway"


def test_with_the_torso_the_tool_gets_further_and_the_other_hand_stays_if_it_is_asked_to(upper):
    move = upper.move()
    move.show_target()
    move.count("none")
    for further in np.arange(0.0, 0.6, 0.02):
        move.place(1, upper.base[1, 3] + upper.link(upper.command, "tool_right_tip")[1, 3] - further)
        if not move.reached:
            break
    assert not move.reached
    move.keep("torso", True)
    assert move.reached and "hands" in move.offered
    left = upper.link(upper.command, "tool_left_tip")
    assert np.abs(upper.link(move.posture, "tool_left_tip") - left).max() > 5e-3
    move.keep("hands", True)
    assert move.reached
    assert np.abs(upper.link(move.posture, "tool_left_tip") - left).max() < 5e-3
    call = move.plan()
    hand = next(goal for goal in call.keep if isinstance(goal, FrameGoal))
    assert hand.frame == "tool_left_tip" and hand in call.goals[1:]
    assert hand.pose.position == pytest.approx((upper.base @ left)[:3, 3])
    assert {"torso_1_joint", "arm_left_1_joint", "arm_right_1_joint"} <= set(call.joints)


def test_the_camera_looks_at_the_target_and_the_tool_stays_turned_on_the_way(upper):
    move = upper.move()
    move.show_target()
    move.keep("gaze", True)
    assert move.lost == "gaze" and not move.reached, "the head does not turn down so far"
    for axis, value in enumerate((0.42, -0.4, 0.25)):
        move.place(axis, upper.base[axis, 3] + value)
    move.keep("steady", True)
    assert move.reached
    eye = upper.base @ upper.link(move.posture, "rgbd_depth_optical_frame")
    sight = move.target[:3, 3] - eye[:3, 3]
    assert eye[:3, 2] @ sight / np.linalg.norm(sight) > np.cos(0.05)
    call = move.plan()
    look = next(goal for goal in call.goals if isinstance(goal, GazeGoal))
    assert look.frame == "head" and look.target == pytest.approx(move.target[:3, 3])
    (steady,) = call.keep
    assert steady.angle == 0.1 and steady.below == (None, None, None) and steady not in call.goals
    move.target[:3, :3] = move.target[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    move.count("all")
    assert not move.reached, "turned over, and as it was: both can't be"


def test_the_centre_of_mass_is_dragged_while_hands_stay(upper):
    move = upper.move()
    move.show_target("mass")
    assert move.reached and move.parts == ("tx", "ty", "tz") and move.offered == ["hands"]
    move.count("none")
    move.keep("hands", True)
    move.place(1, move.target[1, 3] + 0.01)
    assert move.reached
    middle = upper.chain.centre_of_mass(upper.chain.poses(move.posture)) + upper.base[:3, 3]
    assert middle[:2] == pytest.approx(move.target[:2, 3], abs=5e-4)
    for tip in ("tool_left_tip", "tool_right_tip"):
        assert np.abs(upper.link(move.posture, tip) - upper.link(upper.command, tip)).max() < 5e-3
    call = move.plan()
    goal, *hands = call.goals
    assert isinstance(goal, CentreOfMassGoal) and goal.height is None and goal.across == 0.0
    assert goal.position == pytest.approx(move.target[:3, 3]) and len(hands) == 2 and call.arm == ""
    move.place(0, move.target[0, 3] + 1.0)
    assert not move.reached
    move.place(0, float("nan"))
    assert np.isfinite(move.target).all()


def test_on_its_feet_the_centre_of_mass_goes_down_over_soles_that_stay(whole):
    move = whole.move()
    move.show_target("mass")
    before = move.target[:3, 3].copy()
    move.place(0, before[0] + 0.1)
    assert move.target[:3, 3] == pytest.approx(before), "across it stays over the feet"
    move.place(2, before[2] - 0.05)
    assert move.reached and move.parts == ("tz",)
    there, home = move.posture, whole.command
    assert whole.from_sole(there, "left_sole_link") == pytest.approx(whole.from_sole(home, "left_sole_link"), abs=5e-3)
    down = whole.from_sole(there, "base_link")[2, 3] - whole.from_sole(home, "base_link")[2, 3]
    assert down < -0.03, "it sits down"
    call = move.plan()
    assert call.goals[0].across == 0.02 and call.goals[0].height == 0.0
    assert {"leg_left_4_joint", "arm_left_1_joint"} <= set(call.joints)


def test_on_its_feet_legs_help_a_hand_down_and_one_that_hangs_is_not_offered_its_legs(whole):
    move = whole.move()
    move.show_target()
    move.count("none")
    move.place(2, move.target[2, 3] - 0.6)
    alone = move.misses[0]
    move.keep("legs", True)
    assert alone > 0.01 and move.reached, move.misses
    assert whole.from_sole(move.posture, "left_sole_link") == pytest.approx(
        whole.from_sole(whole.command, "left_sole_link"), abs=5e-3
    )
    move.stands(whole.command, whole.base, False, on_feet=False)
    assert "legs" not in move.offered and not any("leg" in joint for joint in move.plan().joints)


def test_what_is_asked_for_of_the_window_is_asked_for_of_the_robot(robot, show):
    from PySide6.QtCore import Qt

    from handrail.messages import PlanMotion

    shown = show().drawn()
    robot.time_ns += 10_000_000
    robot.publish(robot.state())
    shown.press("tab_move")
    shown.until(lambda: shown.desk.move.joints.rowCount() == 7)
    shown.press("moveMass")
    shown.until(lambda: shown.desk.move.view["target"] == "mass")
    assert not shown.item("moveSaid").property("text").startswith("Can't")
    shown.press("moveKeep_hands")
    field = shown.item("number_target y")
    field.forceActiveFocus(Qt.FocusReason.TabFocusReason)
    typed = shown.desk.move.view["place"][1] + 5
    for letter in f"{typed:.1f}":
        shown.key(letter)
    shown.key(Qt.Key.Key_Return)
    shown.until(lambda: shown.desk.move.view["place"][1] == pytest.approx(typed, abs=0.1))
    shown.press("moveMassTurn_none")
    shown.until(lambda: shown.desk.move.view["why"]["plan"] == "")
    shown.press("movePlan")
    shown.until(lambda: robot.calls_of(PlanMotion))
    call = robot.calls_of(PlanMotion)[-1]
    assert call.goals[0].position[1] == pytest.approx(typed / 1000.0, abs=1e-4) and len(call.keep) == 2
