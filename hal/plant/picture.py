"""Pictures of a robot in a scene, by PyBullet's software renderer: no screen, no GPU.

    python -m hal.plant.picture --robot talos_upper --scene valve --state STATE.json --out PICTURE.png

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
from hal.plant.bullet import pybullet as p
from hal.plant.world import World
from handrail.config import ConfigError
from handrail.robot import description
from handrail.robot.description import RobotDescription

WIDTH, HEIGHT = 960, 720
_BACKGROUND = (236, 239, 242)
_FIELD_OF_VIEW = 42.0
"""degrees, vertical"""


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
    rows = {joint: row for row, joint in enumerate(robot.joints)}
    hinges = [name for name, thing in place.objects.items() if isinstance(thing, scene.Wheel)]
    for field, given, known in (("joints", state.joints, list(rows)), ("hinges", state.hinges, hinges)):
        for name, angle in given.items():
            if name not in known:
                raise ValueError(f"{field}.{name}: not in this scene; expected one of {', '.join(known) or 'none'}")
            if not math.isfinite(angle):
                raise ValueError(f"{field}.{name}: got {angle}; expected a finite angle in rad")
    with contextlib.closing(World(robot, place, visual=True)) as world:
        position = world.position.copy()
        for joint, angle in state.joints.items():
            position[rows[joint]] = angle
        world.place(position)
        for name, angle in state.hinges.items():
            world.set_hinge_angle(name, angle)
        return _photograph(world.client)


def _photograph(client: int) -> np.ndarray:
    view = p.computeViewMatrixFromYawPitchRoll(
        cameraTargetPosition=(0.25, -0.18, 0.30), distance=1.5, yaw=38, pitch=-16, roll=0, upAxisIndex=2
    )
    projection = p.computeProjectionMatrixFOV(_FIELD_OF_VIEW, WIDTH / HEIGHT, 0.1, 10.0)
    _, _, colour, depth, _ = p.getCameraImage(
        WIDTH,
        HEIGHT,
        view,
        projection,
        lightDirection=(0.6, -1.5, 2.5),
        shadow=1,
        renderer=p.ER_TINY_RENDERER,
        physicsClientId=client,
    )
    picture = np.asarray(colour, np.uint8).reshape(HEIGHT, WIDTH, 4)[:, :, :3].copy()
    picture[np.asarray(depth).reshape(HEIGHT, WIDTH) >= 1.0] = _BACKGROUND
    return picture


def save(picture: np.ndarray, file: str | os.PathLike[str]) -> None:
    """Write a picture (height, width, 3) uint8 as PNG."""
    Image.fromarray(picture).save(file, format="PNG")


def main() -> None:
    """Render one picture from the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m hal.plant.picture", description="A picture of the robot in a scene."
    )
    parser.add_argument("--robot", required=True, help="robot's name or folder")
    parser.add_argument("--scene", required=True, help="scene's name or YAML file")
    parser.add_argument(
        "--state", required=True, type=Path, help='JSON file: {"joints": {...}, "hinges": {...}} in rad'
    )
    parser.add_argument("--out", required=True, type=Path, help="PNG file to write")
    options = parser.parse_args()
    try:
        state = msgspec.json.decode(options.state.read_bytes(), type=PictureState)
        save(render(description.load(options.robot), scene.load(options.scene), state), options.out)
    except msgspec.DecodeError as error:
        sys.exit(f"picture: {options.state}: {error}")
    except (ConfigError, OSError, ValueError) as error:
        sys.exit(f"picture: {error}")


if __name__ == "__main__":
    main()
