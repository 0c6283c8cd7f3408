"""What a depth camera's picture costs and how true it is, against PyBullet's rays: ``handrail bench camera``.

Costs are processor time. Both look at the valve scene from the robot's head. The renderer sees the robot's thinned looks, rays its
collision shapes (hulls of forearm, wrist and tool; they pass through whatever has none).
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable

import numpy as np

from benchmarks.rows import Row, against
from hal.plant import likeness, scene
from hal.plant.bullet import pybullet as p
from hal.plant.camera import DepthCamera
from hal.plant.likeness import Likeness
from hal.plant.scene import Wheel
from hal.plant.world import World
from handrail import cloud
from handrail.messages import GroundTruth
from handrail.robot import library as robots

_ROUNDS = 5
_RAYS_A_CALL = 16_000
"""more make PyBullet answer nothing"""


def from_the_wheels_surface(points: np.ndarray, wheel: Wheel, centre: tuple[float, ...], angle: float) -> np.ndarray:
    """m (n,): how far points (n, 3) are from the surface of an upright wheel, its hinge along x and turned by `angle` rad."""
    x, y, z = (points - centre).T
    y, z = math.cos(angle) * y + math.sin(angle) * z, math.cos(angle) * z - math.sin(angle) * y
    distances = [np.abs(np.hypot(np.hypot(y, z) - wheel.radius, x) - wheel.tube_radius)]
    for spoke in range(wheel.spokes):
        turn = 2 * math.pi * spoke / wheel.spokes
        out = np.clip(math.cos(turn) * z - math.sin(turn) * y, 0, wheel.radius)
        beside = np.sqrt(x**2 + (y + math.sin(turn) * out) ** 2 + (z - math.cos(turn) * out) ** 2)
        distances.append(np.abs(beside - wheel.spoke_radius))
    return np.min(distances, axis=0)


def _cast(camera: DepthCamera, world: World, eye: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Points (n, 3) where a ray through each pixel meets something, m."""
    ends = (camera.rays.reshape(-1, 3) * camera.camera.far) @ axes.T + eye
    points = []
    for first in range(0, len(ends), _RAYS_A_CALL):
        some = ends[first : first + _RAYS_A_CALL].tolist()
        hits = p.rayTestBatch([eye.tolist()] * len(some), some, physicsClientId=world.client)
        points += [hit[3] for hit in hits if hit[0] >= 0]
    return np.array(points)


def _ms(work: Callable[[], object]) -> float:
    """Of processor time, which others on this machine can't take away: median."""
    spent = []
    for _ in range(_ROUNDS):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return float(np.median(spent)) * 1e3


def rows() -> list[Row]:
    """About 10 s."""
    robot, place = robots.load("talos_upper"), scene.load("valve")
    thing, centre = place.objects["valve"], place.poses_in_world["valve"].position
    assert isinstance(thing, Wheel)
    joints = dict(zip(robot.joints, robot.home_position().tolist(), strict=True))
    truth = GroundTruth(
        time_ns=0,
        joints=joints,
        hinges={"valve": 0.0},
        poses_in_world=place.poses_in_world,
        contact_force={},
        peak_contact_force={},
    )

    def error_mm(points: np.ndarray) -> float:
        return float(np.percentile(from_the_wheels_surface(points, thing, centre, 0.0), 95)) * 1e3

    with contextlib.closing(Likeness(robot, place)) as shown, contextlib.closing(World(robot, place)) as world:
        camera = DepthCamera(robot.cameras[0], shown, noise=False)
        picture = camera.take(truth)
        cost = _ms(lambda: camera.take(truth))
        eye, axes = camera.stands()
        began = time.process_time()
        cast = _cast(camera, world, eye, axes)
        rays = (time.process_time() - began) * 1e3
        faces, version = likeness.FACES, likeness.VERSION
        likeness.FACES, likeness.VERSION = 10**9, "whole"
        try:
            with contextlib.closing(Likeness(robot, place)) as whole:
                detailed = DepthCamera(robot.cameras[0], whole, noise=False)
                cost_whole = _ms(lambda: detailed.take(truth))
        finally:
            likeness.FACES, likeness.VERSION = faces, version
    error, size = error_mm(cloud.unpack(picture).positions), len(picture.points) + len(picture.colours)
    share = cost * camera.camera.rate / 10
    return [
        against("a picture, 320×240", cost, "ms", "rayTestBatch", rays, at_most=0.25),
        against("the same, robot thinned out", cost, "ms", "its full meshes", cost_whole, at_most=0.9),
        Row(
            name="points from the wheel's surface, p95",
            value=round(error, 2),
            unit="mm",
            goal="≤ 3",
            holds=error <= 3.0,
            peer="rayTestBatch",
            peer_value=round(error_mm(cast), 2),
        ),
        Row(name="points", value=picture.count, unit="", goal="≥ 1500", holds=picture.count >= 1500),
        Row(name="a cloud on the link", value=round(size / 1e3, 1), unit="kB", goal="≤ 40", holds=size <= 40_000),
        Row(name="of one core at 2 Hz", value=round(share, 1), unit="%", goal="≤ 25", holds=share <= 25.0),
    ]
