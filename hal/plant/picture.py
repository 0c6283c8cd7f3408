"""Pictures of a robot in a scene, by PyBullet's software renderer: no screen, no GPU.

    python -m hal.plant.picture --robot talos_upper [--scene valve] [--state STATE.json] --out PICTURE.png

STATE.json holds ``{"joints": {joint: rad}, "hinges": {object: rad}}``, as `handrail.messages.GroundTruth` does; what is left
out stays at the home posture and the scene's own angles.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import sys
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image

from hal.plant import scene
from hal.plant.bodies import hinge_names
from hal.plant.bullet import pybullet as p
from hal.plant.world import World
from handrail.config import ConfigError
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription

WIDTH, HEIGHT = 960, 720
_BACKGROUND = (236, 239, 242)
_FIELD_OF_VIEW = 42.0
"""degrees, vertical"""
_NEAREST, _STEPS_BACK = 0.5, 12  # m; steps of 10 %


class PictureState(msgspec.Struct, kw_only=True):
    """What a picture shows; further fields are allowed and ignored, so that a GroundTruth's JSON is one."""

    joints: dict[str, float] = {}
    """joint → rad"""
    hinges: dict[str, float] = {}
    """scene object → rad"""


def render(robot: RobotDescription, place: scene.Scene, state: PictureState) -> np.ndarray:
    """The robot in the scene, seen from its front right: (720, 960, 3) uint8.

    Raises ValueError naming a joint or hinge that is not there.
    """
    known_joints = [*robot.joints, *robot.device_limits, *robot.mimics]
    rows = {joint: row for row, joint in enumerate(robot.joints)}
    hinges = [hinge for name, thing in place.objects.items() for hinge in hinge_names(name, thing)]
    for field, given, known in (("joints", state.joints, known_joints), ("hinges", state.hinges, hinges)):
        for name, angle in given.items():
            if name not in known:
                raise ValueError(f"{field}.{name}: not in this scene; expected one of {', '.join(known) or 'none'}")
            if not math.isfinite(angle):
                raise ValueError(f"{field}.{name}: got {angle}; expected a finite angle in rad")
    with contextlib.closing(World(robot, place, visual=True)) as world:
        position = world.position.copy()
        for joint, angle in state.joints.items():
            if joint in rows:
                position[rows[joint]] = angle
        world.place(position)
        for gripper in world.devices.grippers.values():
            gripper.place(state.joints.get(gripper.joint, gripper.rest))
        for name, angle in state.hinges.items():
            world.set_hinge_angle(name, angle)
        return _photograph(world)


def _photograph(world: World) -> np.ndarray:
    target, distance = _aim(world)
    # Bodies reach beyond the links' frames: step back until nothing that moves is cut off. Legs and stands may be.
    for _ in range(_STEPS_BACK):
        _, _, seen = _shoot(world, target, distance, WIDTH // 8, HEIGHT // 8)
        edge = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
        body, link = edge & 0xFFFFFF, (edge >> 24) - 1
        objects = [world.body(name) for name in world.scene.objects]
        if not (((edge >= 0) & (body == world.robot.number) & (link >= 0)) | np.isin(body, objects)).any():
            break
        distance *= 1.1
    picture, depth, _ = _shoot(world, target, distance, WIDTH, HEIGHT)
    picture[depth >= 1.0] = _BACKGROUND
    return picture


def _aim(world: World) -> tuple[list[float], float]:
    """The point that the camera looks at, m, and from how far: the frames of the robot's links and of all objects are seen."""
    points = [world.robot.link_motion(link)[1] for link in world.robot.links.values()]
    points += [pose.position for pose in world.truth().poses_in_world.values()]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return ((low + high) / 2).tolist(), _NEAREST + float(np.linalg.norm(high - low))


def _shoot(
    world: World, target: list[float], distance: float, width: int, height: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours (height, width, 3) uint8, depth (height, width) 0..1, and PyBullet's number of the
    body, and in the upper byte of its link + 1, that is seen there."""
    view = p.computeViewMatrixFromYawPitchRoll(
        cameraTargetPosition=target, distance=distance, yaw=38, pitch=-16, roll=0, upAxisIndex=2
    )
    projection = p.computeProjectionMatrixFOV(_FIELD_OF_VIEW, width / height, 0.1, 10.0)
    _, _, colour, depth, bodies = p.getCameraImage(
        width,
        height,
        view,
        projection,
        lightDirection=(0.6, -1.5, 2.5),
        shadow=1,
        flags=p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
        renderer=p.ER_TINY_RENDERER,
        physicsClientId=world.client,
    )
    picture = np.asarray(colour, np.uint8).reshape(height, width, 4)[:, :, :3].copy()
    return picture, np.asarray(depth).reshape(height, width), np.asarray(bodies).reshape(height, width)


def save(picture: np.ndarray, file: str | os.PathLike[str]) -> None:
    """Write a picture (height, width, 3) uint8 as PNG."""
    Image.fromarray(picture).save(file, format="PNG")


def main() -> None:
    """Render one picture from the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m hal.plant.picture", description="A picture of the robot in a scene."
    )
    parser.add_argument("--robot", required=True, help="robot's name or folder")
    parser.add_argument("--scene", help="scene's name or YAML file (default: the robot alone)")
    parser.add_argument(
        "--state", type=Path, help='JSON file: {"joints": {...}, "hinges": {...}} in rad (default: at home)'
    )
    parser.add_argument("--out", required=True, type=Path, help="PNG file to write")
    options = parser.parse_args()
    try:
        state = PictureState()
        if options.state is not None:
            state = msgspec.json.decode(options.state.read_bytes(), type=PictureState)
        place = scene.load(options.scene) if options.scene else scene.EMPTY
        save(render(robots.load(options.robot), place, state), options.out)
    except msgspec.DecodeError as error:
        sys.exit(f"picture: {options.state}: {error}")
    except (ConfigError, OSError, ValueError) as error:
        sys.exit(f"picture: {error}")


if __name__ == "__main__":
    main()
