"""What the 3-D view is made of, without Qt: the chain of bodies, meshes and their cache, shapes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
import yourdfpy

from handrail.robot import library as robots
from tablet_client.scene import meshes, robot, solids
from tablet_client.scene.kinematics import Chain


@pytest.fixture(scope="module")
def talos():
    return robots.load("talos_upper")


@pytest.fixture(scope="module")
def model(talos):
    return yourdfpy.URDF.load(str(talos.urdf), load_meshes=False)


@pytest.fixture(scope="module")
def drawn(talos, mesh_folder):
    return robot.load(talos, mesh_folder)


def test_bodies_and_tool_tips_are_where_yourdfpy_puts_them(talos, model):
    chain = Chain(model, talos.joints)
    draw = np.random.default_rng(7)
    for _ in range(5):
        position = draw.uniform(talos.lower, talos.upper)
        model.update_cfg(dict(zip(talos.joints, position, strict=True)))
        poses = chain.poses(position)
        for body, name in enumerate(chain.bodies):
            assert poses[body] == pytest.approx(model.get_transform(name, model.base_link), abs=1e-9), name
        tip = talos.arms["right"].tip
        assert chain.positions(tip, position[None])[0] == pytest.approx(model.get_transform(tip)[:3, 3], abs=1e-9)


def test_many_postures_at_once_are_the_same_as_one_by_one(talos, model):
    chain = Chain(model, talos.joints)
    positions = np.random.default_rng(3).uniform(talos.lower, talos.upper, (4, len(talos.joints)))
    assert chain.poses(positions) == pytest.approx(np.array([chain.poses(position) for position in positions]))


def test_a_joint_that_the_model_does_not_move_is_an_error_with_its_name(model):
    with pytest.raises(KeyError, match="no_such_joint"):
        Chain(model, ["no_such_joint"])


def test_prismatic_and_mimic_joints_move(tmp_path):
    file = tmp_path / "gripper.urdf"
    file.write_text(
        '<robot name="gripper"><link name="base"/><link name="left"/><link name="right"/>'
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="left"/><axis xyz="0 1 0"/>'
        '<limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="other" type="prismatic"><parent link="base"/><child link="right"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="0" effort="1" velocity="1"/>'
        '<mimic joint="slide" multiplier="-1" offset="0.01"/></joint></robot>'
    )
    chain = Chain(yourdfpy.URDF.load(str(file), load_meshes=False), ["slide"])
    poses = dict(zip(chain.bodies, chain.poses(np.array([0.2])), strict=True))
    assert poses["left"][:3, 3] == pytest.approx([0.0, 0.2, 0.0])
    assert poses["right"][:3, 3] == pytest.approx([0.0, -0.19, 0.0])


def test_every_body_of_the_robot_has_something_to_draw(drawn):
    assert all(len(mesh.faces) for mesh in drawn.meshes)
    assert drawn.floor < -0.9, "the feet are a leg's length below the pelvis"
    assert set(drawn.tips) == {"left", "right"}


def test_the_floor_is_where_the_description_has_it_and_else_below_what_does_not_move(mesh_folder):
    bench = robots.load("sea_bench")
    assert robot.load(bench, mesh_folder).floor == pytest.approx(-0.75)  # the stand's plate
    assert robot.load(dataclasses.replace(bench, floor=-1.2), mesh_folder).floor == -1.2
    assert robots.load("talos").floor == pytest.approx(-1.035), "where its soles are, not its pelvis"


def test_meshes_are_prepared_once(drawn, talos, mesh_folder):
    files = sorted(mesh_folder.glob("*.npz"))
    assert files
    before = [file.stat().st_mtime_ns for file in files]
    again = robot.load(talos, mesh_folder)
    assert [file.stat().st_mtime_ns for file in sorted(mesh_folder.glob("*.npz"))] == before
    for one, other in zip(drawn.meshes, again.meshes, strict=True):
        assert np.array_equal(one.vertices, other.vertices) and np.array_equal(one.faces, other.faces)


def test_a_broken_file_in_the_cache_is_made_anew(tmp_path):
    ball = tmp_path / "ball.stl"
    trimesh.creation.icosphere().export(ball)
    first = meshes.from_file(ball, (1.0, 1.0, 1.0), tmp_path / "cache")
    (kept,) = (tmp_path / "cache").glob("*.npz")
    kept.write_bytes(kept.read_bytes()[:100])
    assert np.array_equal(meshes.from_file(ball, (1.0, 1.0, 1.0), tmp_path / "cache").vertices, first.vertices)


def test_detailed_meshes_are_thinned_out_and_keep_their_size(tmp_path):
    ball = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=5).export(ball)  # 20,480 triangles
    mesh = meshes.from_file(ball, (0.5, 0.5, 0.5), tmp_path / "cache")
    assert len(mesh.faces) < 10_000
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(0.5, abs=0.01)


def test_a_mirrored_mesh_still_faces_outwards(tmp_path):
    ball = tmp_path / "ball.stl"
    trimesh.creation.icosphere().export(ball)
    mesh = meshes.from_file(ball, (1.0, -1.0, 1.0), tmp_path / "cache")
    corners = mesh.vertices[mesh.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fi->f", facing, corners.mean(axis=1)) > 0).all()
    assert (np.einsum("vi,vi->v", mesh.normals, mesh.vertices) > 0).all()


@pytest.mark.parametrize(
    ("kind", "size", "extent"),
    [
        ("capsule", (0.1, 1.0), (0.2, 0.2, 1.2)),
        ("cylinder", (0.1, 1.0), (0.2, 0.2, 1.0)),
        ("box", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        ("sphere", (0.1,), (0.2, 0.2, 0.2)),
        ("torus", (1.0, 0.1), (2.2, 2.2, 0.2)),
    ],
)
def test_shapes_are_as_large_as_they_say_around_their_centre(kind, size, extent):
    vertices = solids.solid(kind, size).vertices
    assert np.ptp(vertices, axis=0) == pytest.approx(extent, rel=0.03)
    assert (vertices.max(axis=0) + vertices.min(axis=0)) / 2 == pytest.approx([0, 0, 0], abs=0.01)


def test_an_unknown_shape_names_those_that_are_known():
    with pytest.raises(ValueError, match=r"cone.*capsule"):
        solids.solid("cone", (1.0,))


def test_a_cloud_is_drawn_point_by_point_with_its_colours_and_thinned_out_evenly_when_it_is_large():
    positions = np.random.default_rng(1).uniform(-1, 1, (1000, 3)).astype(np.float32)
    colours = np.random.default_rng(2).integers(0, 256, (1000, 3), np.uint8)
    mesh = solids.cloud(positions, colours, 0.005, 1000)
    grains = mesh.vertices.reshape(1000, -1, 3)
    assert grains.mean(axis=1) == pytest.approx(positions, abs=1e-6)
    assert np.ptp(grains, axis=1) == pytest.approx(np.full((1000, 3), 0.005), abs=1e-6)
    assert mesh.colors.reshape(1000, -1, 4)[:, 0, :3] * 255 == pytest.approx(colours, abs=0.01)
    grain_of = mesh.faces // grains.shape[1]
    assert (grain_of == grain_of[:, :1]).all(), "no triangle joins two points"
    few = solids.cloud(positions, colours, 0.005, 300).vertices.reshape(-1, grains.shape[1], 3).mean(axis=1)
    assert few == pytest.approx(positions[::4], abs=1e-6)
    assert len(solids.cloud(np.zeros((0, 3)), None, 0.005, 300).faces) == 0


def test_a_trail_of_points_that_coincide_is_nothing():
    assert len(solids.tube(np.zeros((10, 3)), 0.01, (1, 1, 1, 1)).faces) == 0
    assert len(solids.tube(np.array([[0, 0, 0], [0, 0, 1.0]]), 0.01, (1, 1, 1, 1)).faces) == 12
