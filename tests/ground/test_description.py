"""Robot descriptions: TALOS as given, and what a wrong robot.yaml is told."""

import shutil

import numpy as np
import pinocchio as pin
import pytest

from handrail import config
from handrail.robot import description
from handrail.robot.kinematics import Kinematics


@pytest.fixture(scope="module")
def talos():
    return description.load("talos_upper")


def edited(folder, old, new):
    target = folder / "robot"
    shutil.copytree(description.find("talos_upper").parent, target)
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

    heavier = description.load(edited(tmp_path, "mass: 0.3", "mass: 0.8"))
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
        ("talos_full_v2.urdf", "talos_full_v9.urdf", "model", "talos_full_v9"),
    ],
)
def test_a_wrong_robot_file_is_refused_with_line_and_field(tmp_path, old, new, field, says):
    folder = edited(tmp_path, old, new)
    with pytest.raises(config.ConfigError) as refused:
        description.load(folder)
    assert refused.value.field == field
    assert refused.value.line is not None
    assert says in str(refused.value)


def test_an_unknown_robot_is_told_which_there_are():
    with pytest.raises(config.ConfigError, match="talos_upper"):
        description.load("talso")
