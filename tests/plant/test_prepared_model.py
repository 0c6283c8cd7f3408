"""The model that PyBullet gets is the robot that pinocchio knows."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from hal.plant import merge, model
from hal.plant.bullet import pybullet as p


@pytest.fixture(scope="module")
def loaded(robot):
    client = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    body = p.loadURDF(
        str(model.prepare(robot)), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
    )
    infos = [p.getJointInfo(body, i, physicsClientId=client) for i in range(p.getNumJoints(body, client))]
    yield client, body, infos
    p.disconnect(client)


def _configurations(robot, count=30):
    generator = np.random.default_rng(7)
    return [generator.uniform(robot.lower, robot.upper) for _ in range(count)]


def _bullet(robot, infos, position):
    """PyBullet's rows of the joints in vectors of velocities, and the configuration."""
    by_name = {info[1].decode(): info[4] - 6 for info in infos}
    rows = np.array([by_name[joint] for joint in robot.joints])
    configuration = np.zeros(len(rows))
    configuration[rows] = position
    return rows, configuration.tolist()


def test_only_the_robots_moving_joints_and_its_wrist_sensors_are_left(robot, loaded):
    _, _, infos = loaded
    moving = {info[1].decode() for info in infos if info[2] == p.JOINT_REVOLUTE}
    assert moving == set(robot.joints)
    assert {info[12].decode() for info in infos if info[1].decode() not in moving} == {
        "wrist_left_ft_link",
        "wrist_right_ft_link",
    }


def test_the_mass_matrix_agrees_with_pinocchio(robot, kinematics, loaded):
    client, body, infos = loaded
    for position in _configurations(robot):
        rows, configuration = _bullet(robot, infos, position)
        mass = np.array(p.calculateMassMatrix(body, configuration, physicsClientId=client))[np.ix_(rows, rows)]
        np.testing.assert_allclose(mass, kinematics.mass_matrix(position), rtol=0, atol=1e-9)


def test_gravity_agrees_with_pinocchio(robot, kinematics, loaded):
    client, body, infos = loaded
    still = [0.0] * len(robot.joints)
    for position in _configurations(robot):
        rows, configuration = _bullet(robot, infos, position)
        torque = np.array(p.calculateInverseDynamics(body, configuration, still, still, physicsClientId=client))[rows]
        np.testing.assert_allclose(torque, kinematics.gravity(position), rtol=0, atol=1e-11)


def test_every_links_pose_agrees_with_pinocchio(robot, kinematics, loaded):
    client, body, infos = loaded
    for position in _configurations(robot, 10):
        by_name = {info[1].decode(): info[0] for info in infos}
        for joint, angle in zip(robot.joints, position, strict=True):
            p.resetJointState(body, by_name[joint], angle, physicsClientId=client)
        for info in infos:
            state = p.getLinkState(body, info[0], computeForwardKinematics=True, physicsClientId=client)
            expected = kinematics.frame(position, info[12].decode())
            rotation = np.array(p.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            # getLinkState answers in single precision; the dynamics above don't.
            np.testing.assert_allclose(state[4], expected.translation, rtol=0, atol=1e-6)
            np.testing.assert_allclose(rotation, expected.rotation, rtol=0, atol=1e-5)


def test_forearms_wrists_and_tools_collide_and_nothing_else(robot, loaded):
    client, body, infos = loaded
    colliding = {info[12].decode() for info in infos if p.getCollisionShapeData(body, info[0], physicsClientId=client)}
    arms = {f"arm_{side}_{number}_link" for side in ("left", "right") for number in (4, 5, 6, 7)}
    assert colliding == arms | {"wrist_left_ft_link", "wrist_right_ft_link"}
    assert not p.getCollisionShapeData(body, -1, physicsClientId=client)


def test_a_merge_keeps_mass_first_moment_and_inertia():
    # Two rods that a fixed joint connects, tilted against each other: sums about the origin by hand.
    robot = ET.fromstring(
        '<robot name="r"><link name="base"/><link name="a"><inertial><origin xyz="0.1 0 0" rpy="0.3 0.2 -0.4"/>'
        '<mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0.01" ixz="0" iyz="0.02"/></inertial></link>'
        '<link name="b"><inertial><origin xyz="0 0.3 0"/><mass value="1"/>'
        '<inertia ixx="0.05" iyy="0.04" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="f" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0 0 0.5" rpy="1.5707963267948966 0 1"/>'
        "</joint></robot>"
    )
    parts = {link.get("name"): merge.Inertial.of(link) for link in robot.findall("link")}
    placement = merge.origin_of(robot.findall("joint")[1])
    merged = merge.merge_fixed_links(robot)
    body = merge.Inertial.of(next(link for link in merged.root.findall("link") if link.get("name") == "a"))

    def about_origin(part, pose):
        points = part.seen_from(pose)
        arm = points.centre
        return points.inertia + points.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)), points.mass * arm

    total = [about_origin(parts["a"], np.eye(4)), about_origin(parts["b"], placement)]
    inertia, moment = about_origin(body, np.eye(4))
    assert body.mass == pytest.approx(3.0)
    np.testing.assert_allclose(moment, total[0][1] + total[1][1], atol=1e-12)
    np.testing.assert_allclose(inertia, total[0][0] + total[1][0], atol=1e-12)
    assert merged.home["b"][0] == "a"
    np.testing.assert_allclose(merged.home["b"][1], placement, atol=1e-12)


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9])
def test_roll_pitch_and_yaw_survive_a_round_trip_at_the_singularity_too(pitch):
    rotation = merge.rotation_from_rpy(0.4, pitch, -2.0)
    np.testing.assert_allclose(merge.rotation_from_rpy(*merge.rpy_from_rotation(rotation)), rotation, atol=1e-8)


def test_a_model_is_prepared_once_and_then_taken_from_the_cache(robot, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = model.prepare(robot)
    written = first.stat().st_mtime_ns
    assert model.prepare(robot) == first
    assert first.stat().st_mtime_ns == written
    assert tmp_path in first.parents
    assert [folder.name for folder in first.parent.parent.iterdir()] == [first.parent.name]  # nothing half-made is left


def test_a_missing_mesh_is_named(robot, tmp_path, monkeypatch):
    import dataclasses

    text = robot.urdf.read_text().replace("arm_5_collision.STL", "nowhere.STL")
    broken = tmp_path / "broken.urdf"
    broken.write_text(text)
    with pytest.raises(FileNotFoundError, match=r"nowhere\.STL"):
        model.prepare(dataclasses.replace(robot, urdf=Path(broken)))
