"""Robot descriptions: TALOS as given, and what a wrong robot.yaml is told."""

import shutil

import numpy as np
import pinocchio as pin
import pytest

from handrail import config
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics


@pytest.fixture(scope="module")
def talos():
    return robots.load("talos_upper")


def edited(folder, old, new):
    target = folder / "robot"
    shutil.copytree(robots.find("talos_upper").parent, target)
    file = target / "robot.yaml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    return target


def test_every_joint_of_the_model_is_on_one_limb(talos):
    model = pin.buildModelFromUrdf(str(talos.urdf))
    assert sorted(talos.joints) == sorted(model.names[1:])
    assert talos.joints == tuple(joint for limb in talos.limbs for joint in limb.joints)
    assert all(len(limb.joints) <= 7 for limb in talos.limbs)


def test_the_tool_points_along_minus_z_of_its_tip_frame(talos):
    kinematics = Kinematics(talos)
    tip = kinematics.frame(talos.home_position(), "tool_right_tip")
    np.testing.assert_allclose(tip.translation, [0.27, -0.40, 0.08], atol=0.01)
    np.testing.assert_allclose(-tip.rotation[:, 2], [1, 0, 0], atol=0.02)


def test_the_tools_mass_hangs_on_the_wrist(talos, tmp_path):
    def wrist(robot):
        model = Kinematics(robot).model
        return model.inertias[model.getJointId("arm_right_7_joint")].mass

    heavier = robots.load(edited(tmp_path, "mass: 0.3", "mass: 0.8"))
    assert wrist(heavier) - wrist(talos) == pytest.approx(0.5)


def test_the_jacobian_agrees_with_finite_differences(talos):
    kinematics = Kinematics(talos)
    rng = np.random.default_rng(0)
    position = rng.uniform(talos.lower, talos.upper)
    jacobian = kinematics.jacobian(position, "tool_right_tip")
    here = kinematics.frame(position, "tool_right_tip").translation
    for row in range(len(talos.joints)):
        moved = position.copy()
        moved[row] += 1e-6
        there = kinematics.frame(moved, "tool_right_tip").translation
        np.testing.assert_allclose((there - here) / 1e-6, jacobian[:3, row], atol=1e-5)


def test_the_mass_matrix_is_symmetric_positive_definite(talos):
    mass = Kinematics(talos).mass_matrix(talos.home_position())
    np.testing.assert_allclose(mass, mass.T)
    assert np.linalg.eigvalsh(mass).min() > 0


@pytest.mark.parametrize(
    ("old", "new", "field", "says"),
    [
        ("channel: can1", "channel: can7", "network.limbs[1].channel", "can0, can1"),
        (
            ", head_1_joint, head_2_joint]",
            "]",
            "network.limbs",
            "head_1_joint",
        ),
        ("period: 0.002", "period: fast", "control.period", "got 'fast'"),
        ("arm_right_4_joint: -1.931", "arm_right_4_joint: 1.931", "home.ready.arm_right_4_joint", "expected -2.234"),
        ("tool: tool_right}", "tool: hammer}", "arms.right.tool", "tool_right"),
        ('fix: ["leg_*_joint"]', 'fix: ["tail_*"]', "model", "tail_"),
        ("head_1_joint: 60", "horn_1_joint: 60", "control.stiffness.horn_1_joint", "matches no joint"),
        ("link: rgbd_depth_optical_frame", "link: third_eye", "cameras[0].link", "third_eye"),
        ("optical: true}", "optical: true, near: 4}", "cameras[0].near", "less than far, 4"),
        (
            "{name: head, link: rgbd",
            "{name: head, link: rgbd_link}\n  - {name: head, link: rgbd",
            "cameras[1].name",
            "twice",
        ),
        ("talos_full_v2.urdf", "talos_full_v9.urdf", "model", "talos_full_v9"),
        (
            "  stiffness:\n",
            '  integral: {rate: {"arm_*": 8}, limit: {"*": 0.06}, push: {"*": 9}, band: {"*": 0.001}}\n  stiffness:\n',
            "control.integral.rate",
            "torso_1_joint is given 0 times",
        ),
        (
            "  stiffness:\n",
            '  integral: {rate: {"*": 8}, limit: {"*": 0.06}, push: {"*": 9}, band: {"*": 0.001}, backlash: {"*": 0.03}}\n'
            "  stiffness:\n",
            "control.integral.backlash",
            "given without friction",
        ),
    ],
)
def test_a_wrong_robot_file_is_refused_with_line_and_field(tmp_path, old, new, field, says):
    folder = edited(tmp_path, old, new)
    with pytest.raises(config.ConfigError) as refused:
        robots.load(folder)
    assert refused.value.field == field
    assert refused.value.line is not None
    assert says in str(refused.value)


def test_an_unknown_robot_is_told_which_there_are():
    with pytest.raises(config.ConfigError, match="talos_upper"):
        robots.load("talso")


def written(folder, text):
    folder.mkdir()
    (folder / "robot.yaml").write_text(text)
    return folder


def test_a_robot_that_extends_another_says_only_what_differs(talos, tmp_path):
    heavy = robots.load(
        written(tmp_path / "heavy", "extends: talos_upper\nname: heavy\ncontrol:\n  stiffness: {head_1_joint: 80}\n")
    )
    row = talos.index("head_1_joint")
    assert heavy.stiffness[row] == 80
    assert talos.stiffness[row] == 60
    np.testing.assert_array_equal(np.delete(heavy.stiffness, row), np.delete(talos.stiffness, row))
    assert heavy.joints == talos.joints
    assert heavy.urdf == talos.urdf


@pytest.mark.parametrize(
    ("text", "where", "field", "says"),
    [
        ("extends: talso\nname: x\n", ":1:", "extends", "talos_upper"),
        ("extends: [a]\nname: x\n", ":1:", "extends", "expected a robot's name"),
        ("extends: .\nname: x\n", "", "extends", "no such robot"),
        (
            "extends: talos_upper\nname: x\nhome:\n  ready:\n    head_1_joint: 7\n",
            "x/robot.yaml:5:",
            "home.ready.head_1_joint",
            "got 7",
        ),
        (
            "extends: talos_upper\nname: x\nmodel:\n  tools: null\n",
            "talos_upper/robot.yaml",
            "arms.right.tool",
            "tool_right",
        ),
        ("extends: talos_upper\nname: x\nmodel: {file: nowhere.urdf}\n", "x/robot.yaml:3:", "model", "has file and"),
    ],
)
def test_what_is_wrong_in_a_robot_that_extends_another_is_named_in_the_file_that_says_it(
    tmp_path, text, where, field, says
):
    with pytest.raises(config.ConfigError) as refused:
        robots.load(written(tmp_path / "x", text))
    assert refused.value.field == field
    assert where in str(refused.value)
    assert says in str(refused.value)


def test_robots_that_extend_each_other_in_a_circle_are_refused(tmp_path, monkeypatch):
    (tmp_path / "robots").mkdir()
    written(tmp_path / "robots" / "egg", "extends: hen\nname: egg\n")
    written(tmp_path / "robots" / "hen", "extends: egg\nname: hen\n")
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    with pytest.raises(config.ConfigError, match="expected no circle"):
        robots.load("hen")


def test_a_model_may_lie_in_the_robots_own_folder():
    bench = robots.load("sea_bench")
    assert Kinematics(bench).frame(bench.home_position("hanging"), "weight_tip").translation == pytest.approx(
        [0, 0, -0.6]
    )
    assert bench.actuators[0].spring_stiffness == 3500


def test_joints_that_a_gripper_moves_are_no_joints_of_the_network():
    robot = robots.load("talos_upper_grippers")
    assert len(robot.joints) == 18
    assert robot.device_limits["gripper_right_joint"][:2] == pytest.approx((-0.96, 0.0), abs=1e-3)
    assert {mimic.joint for mimic in robot.mimics.values()} == {"gripper_right_joint", "gripper_left_joint"}
    assert robot.mimics["gripper_right_fingertip_3_joint"].multiplier == -1


def test_links_that_an_srdf_disables_may_touch_and_a_wrong_one_is_told(tmp_path):
    robot = tmp_path / "arm"
    shutil.copytree(robots.find("sea_bench").parent, robot)
    file = robot / "robot.yaml"
    text = file.read_text()
    file.write_text(text.replace("  file: bench.urdf", "  file: bench.urdf\n  srdf: bench.srdf", 1))
    with pytest.raises(config.ConfigError, match=r"model: model.srdf: bench.srdf is not in"):
        robots.load(robot)
    srdf = robot / "bench.srdf"
    srdf.write_text('<robot name="bench"><disable_collisions link1="a" link2="b" reason="Never"/></robot>')
    assert ("a", "b") in robots.load(robot).allowed_collision_pairs
    srdf.write_text('<robot name="bench"><disable_collisions link1="a"/></robot>')
    with pytest.raises(config.ConfigError, match="without link1 or link2"):
        robots.load(robot)
