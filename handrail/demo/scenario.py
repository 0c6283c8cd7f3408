"""Where the demo's valve stands, and how wrongly the operator lays the template over it: everything drawn from one seed.

The valve's hinge points along +x of its own frame. Its true pose is uniform within ±10 cm along each axis and ±20° of yaw and pitch
of the nominal; the instance that the robot is given is off by up to 2 cm in a random direction and up to 4° about a random axis.
The robot knows the instance only; the scene file is for the plant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from handrail.messages import Pose

NOMINAL = (0.55, -0.35, 0.30)
"""m, the valve's middle in the world (the robot's base_link); hinge along the world's +x"""
POSITION_RANGE = 0.10
"""m, each way along each axis"""
ANGLE_RANGE = math.radians(20)
"""rad, each way, yaw and pitch"""
POSITION_ERROR = 0.02
"""m, at most"""
ANGLE_ERROR = math.radians(4)
"""rad, at most"""
OBJECT = "valve"
"""its name in the scene"""

_SCENE = """\
# The valve of `handrail demo --seed {seed}`.
objects:
  {object}:
    kind: wheel
    pose_in_world: {{position: {position}, orientation: {orientation}}}
    radius: 0.15
    tube_radius: 0.012
    spokes: 4
    spoke_radius: 0.010
    hinge_friction: 2.0
"""


@dataclass(frozen=True)
class Scenario:
    """One run's valve."""

    seed: int
    valve_in_world: Pose
    """the truth; for the plant and the judge only"""
    instance_in_world: Pose
    """where the operator places the template"""
    position_error: float
    """m, from the one to the other"""
    angle_error: float
    """rad"""

    def scene(self) -> str:
        """The plant's scene file (YAML)."""
        return _SCENE.format(
            seed=self.seed,
            object=OBJECT,
            position=list(self.valve_in_world.position),
            orientation=list(self.valve_in_world.orientation),
        )


def draw(seed: int) -> Scenario:
    """The valve of a seed. The same seed gives the same valve everywhere."""
    random = np.random.default_rng(seed)
    position = np.array(NOMINAL) + random.uniform(-POSITION_RANGE, POSITION_RANGE, 3)
    yaw, pitch = random.uniform(-ANGLE_RANGE, ANGLE_RANGE, 2)
    # Yaw about the world's z, then pitch about the valve's own y: the hinge looks left or right, up or down.
    orientation = multiply(about((0, 0, 1), yaw), about((0, 1, 0), pitch))
    position_error, angle_error = random.uniform(0, POSITION_ERROR), random.uniform(0, ANGLE_ERROR)
    shift = position_error * _direction(random)
    turn = about(_direction(random), angle_error)
    return Scenario(
        seed=seed,
        valve_in_world=_pose(position, orientation),
        instance_in_world=_pose(position + shift, multiply(turn, orientation)),
        position_error=position_error,
        angle_error=angle_error,
    )


def about(axis: tuple[float, float, float] | np.ndarray, angle: float) -> np.ndarray:
    """Unit quaternion (x, y, z, w) of a rotation by `angle` rad about a unit axis."""
    return np.array([*(np.asarray(axis, float) * math.sin(angle / 2)), math.cos(angle / 2)])


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotation b followed by a (both about fixed axes), as quaternions (x, y, z, w)."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def _direction(random: np.random.Generator) -> np.ndarray:
    """A unit vector, uniform over the sphere."""
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _pose(position: np.ndarray, orientation: np.ndarray) -> Pose:
    x, y, z = position.tolist()
    qx, qy, qz, qw = (orientation / np.linalg.norm(orientation)).tolist()
    return Pose(position=(x, y, z), orientation=(qx, qy, qz, qw))
