"""The plant's looks without its physics: a robot and its scene, put where the ground truth says, for cameras to look at.

A world of its own, which nothing ever steps: a camera never holds the plant. Objects are as the plant has them; the robot's meshes
are thinned out, since PyBullet's renderer goes through every triangle of the robot, seen or not (TALOS' 176,000: 80 ms a picture).
"""

from __future__ import annotations

import os
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import trimesh

from hal.plant.bodies import HINGE, object_urdf
from hal.plant.bullet import pybullet as p
from hal.plant.linkage import joint_rows
from hal.plant.model import prepare
from hal.plant.robot_body import BASE, RobotBody
from hal.plant.scene import Scene
from handrail.messages import GroundTruth, Pose
from handrail.robot.description import RobotDescription
from handrail.robot.urdf import cache_folder, whole_folder

_FLOOR, _THICK, _GREY = 20.0, 0.02, (0.55, 0.56, 0.58, 1.0)
VERSION = "1"
"""part of the cache's key: raise it when thinned meshes change"""
FACES = 2000
"""triangles of a mesh at most: 95 % of the surface of TALOS' torso then stays within 10 mm of where it was, of its arms 2 mm"""


class Likeness:
    """What cameras look at. `close` it."""

    def __init__(self, description: RobotDescription, scene: Scene):
        """Raises FileNotFoundError, ValueError for meshes that can't be used."""
        self.description = description
        self.client: int = p.connect(p.DIRECT)
        self._robot = RobotBody(description, self.client, urdf=thinned(prepare(description, visual=True)))
        if description.floor is not None:
            self._lay_floor(description.floor)
        self._objects = {name: self._load(name, scene) for name in scene.objects}
        self._rows = {name: joint_rows(self.client, body) for name, body in self._objects.items()}
        self._poses = {self._objects[name]: pose for name, pose in scene.poses_in_world.items()}
        self._poses[self._robot.number] = Pose()
        for joint, angle in zip(description.joints, description.home_position(), strict=True):
            self._robot.place(joint, angle)

    def _lay_floor(self, height: float) -> None:
        extent = [_FLOOR / 2, _FLOOR / 2, _THICK / 2]
        slab = p.createVisualShape(p.GEOM_BOX, halfExtents=extent, rgbaColor=_GREY, physicsClientId=self.client)
        below = (0, 0, height - _THICK / 2)
        p.createMultiBody(baseMass=0, baseVisualShapeIndex=slab, basePosition=below, physicsClientId=self.client)

    def _load(self, name: str, scene: Scene) -> int:
        pose = scene.poses_in_world[name]
        with tempfile.TemporaryDirectory(prefix="handrail-") as folder:
            file = Path(folder) / f"{name}.urdf"
            file.write_text(object_urdf(name, scene.objects[name]), encoding="utf-8")
            return p.loadURDF(
                str(file), pose.position, pose.orientation, useFixedBase=True, physicsClientId=self.client
            )

    def show(self, truth: GroundTruth) -> None:
        """Put everything where it really is. Joints and objects that are not there are passed over."""
        for joint, position in truth.joints.items():
            if joint in self._robot.joints:
                self._robot.place(joint, position)
        for name, angle in truth.hinges.items():
            thing, _, joint = name.partition(".")
            if thing in self._objects and (row := self._rows[thing].get(joint, HINGE)) < len(self._rows[thing]):
                p.resetJointState(self._objects[thing], row, angle, physicsClientId=self.client)
        self._put(self._robot.number, truth.base_in_world)
        for name, pose in truth.poses_in_world.items():
            if name in self._objects:
                self._put(self._objects[name], pose)

    def hinge_angle(self, name: str) -> float:
        """As World.hinge_angle. Raises KeyError."""
        thing, _, joint = name.partition(".")
        row = self._rows[thing][joint] if joint else HINGE
        return p.getJointState(self._objects[thing], row, physicsClientId=self.client)[0]

    def _put(self, body: int, pose: Pose) -> None:
        """Put a body's root link at a pose; PyBullet wants its centre of mass's."""
        if pose != self._poses[body]:
            dynamics = p.getDynamicsInfo(body, BASE, physicsClientId=self.client)
            at, turn = p.multiplyTransforms(pose.position, pose.orientation, dynamics[3], dynamics[4])
            p.resetBasePositionAndOrientation(body, at, turn, physicsClientId=self.client)
            self._poses[body] = pose

    def frame(self, link: str) -> np.ndarray:
        """Pose (4, 4) of a link of the description in the world, now. Raises KeyError for a link that the robot has not."""
        carrier, offset, turn = self._robot.frame(link)
        _, position, orientation, _, _ = self._robot.link_motion(carrier)
        rotation = np.array(p.getMatrixFromQuaternion(orientation)).reshape(3, 3)
        here = np.eye(4)
        here[:3, :3], here[:3, 3] = rotation @ turn, rotation @ offset + position
        return here

    def close(self) -> None:
        """Free the world."""
        if self.client >= 0:
            p.disconnect(self.client)
            self.client = -1


def thinned(urdf: Path) -> Path:
    """A prepared URDF (`hal.plant.model.prepare`) with its visual meshes thinned out, made once and kept in the user's cache."""
    folder = cache_folder() / f"thin{VERSION}-{urdf.parent.name}"
    if not folder.is_dir():
        with whole_folder(folder) as partial:
            robot = ET.parse(urdf).getroot()
            for link in robot.findall("link"):
                for shape in link.findall("collision"):
                    link.remove(shape)
            for name in {mesh.get("filename", "") for mesh in robot.iter("mesh")}:
                _thin(urdf.parent / name, partial / name)
            ET.ElementTree(robot).write(partial / "robot.urdf", encoding="utf-8", xml_declaration=True)
    return folder / "robot.urdf"


def _thin(source: Path, file: Path) -> None:
    shape = trimesh.load(source, force="mesh")
    if not isinstance(shape, trimesh.Trimesh) or len(shape.faces) == 0:
        raise ValueError(f"mesh {source}: has no triangles")
    if len(shape.faces) <= FACES:
        os.link(source, file)
        return
    shape.merge_vertices(
        merge_norm=True, merge_tex=True
    )  # else every triangle is an island, which nothing can be taken from
    shape.simplify_quadric_decimation(face_count=FACES).export(
        file, include_normals=True, include_color=False, include_texture=False
    )
