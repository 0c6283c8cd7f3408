"""What depth cameras see and nobody has a name for, as solids to keep clear of: octrees of the newest clouds.

Points on the robot's own bodies are left out, and those on instances, whose shapes count by themselves. An octree is cut into
blocks, so that a body is measured against what is near it only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.point_distance import PointDistance
from engines.planning.ik.mechanism import Mechanism
from handrail.cloud import unpack
from handrail.messages import PointCloud

Array = NDArray[np.float64]

RESOLUTION = 0.02
"""m, the edge of an octree's cubes"""
BLOCK = 0.25
"""m, the edge of the blocks that it is cut into"""
OWN, PLACED = 0.04, 0.03
"""m from the robot's bodies and from instances' shapes within which points count as theirs: noise, lag, how well one is placed"""
OLDEST = 5.0
"""s: older clouds show a world that is no more"""
_S = 1e-9


@dataclass(frozen=True)
class Seen:
    """Solids, and where they come from."""

    obstacles: tuple[Obstacle, ...]
    cameras: tuple[Camera, ...]

    @property
    def words(self) -> str:
        """Which cameras' clouds count, how old they are, how many points of them are obstacles, and which don't count and why."""
        return "; ".join(map(str, self.cameras)) or "no camera sees anything"


@dataclass(frozen=True)
class Camera:
    """What became of one camera's cloud."""

    name: str
    age: float
    """s"""
    points: int
    """that are neither the robot's nor an instance's"""
    left_out: str = ""
    """why it does not count"""

    def __str__(self) -> str:
        if self.left_out:
            return f"{self.name}: left out, {self.left_out}"
        return f"{self.name}: {self.points} points, {self.age:.1f} s old"


class Eyes:
    """Makes solids of clouds, for one robot. Not for several threads at once."""

    def __init__(self, mechanism: Mechanism):
        self._mechanism = mechanism
        self._data, self._scratch = mechanism.model.createData(), mechanism.geometry.createData()
        self._bodies = [PointDistance(body.geometry) for body in mechanism.geometry.geometryObjects]

    def solids(
        self, clouds: Iterable[PointCloud], now_ns: int, q: Array, placed: Sequence[Obstacle] = (), *, oldest: float = OLDEST
    ) -> Seen:  # fmt: skip
        """Of the newest cloud of each camera.

        :param clouds: any number of each camera, in the world
        :param now_ns: the robot's clock
        :param q: (nq,) where the robot was when the clouds were taken
        :param placed: the shapes of instances, whose points are left out
        :param oldest: s, above which a cloud does not count, and is told as such
        :raises ValueError: q is not a configuration
        """
        q = self._mechanism.check_configuration("q", q)
        newest: dict[str, PointCloud] = {}
        for cloud in clouds:
            if cloud.camera not in newest or cloud.time_ns >= newest[cloud.camera].time_ns:
                newest[cloud.camera] = cloud
        obstacles: list[Obstacle] = []
        cameras = []
        for name, cloud in sorted(newest.items()):
            age = (now_ns - cloud.time_ns) * _S
            if age > oldest:
                cameras.append(Camera(name, age, 0, f"{age:.1f} s old, at most {oldest:g} s counts"))
                continue
            try:
                points = unpack(cloud).positions.astype(float)
            except ValueError as error:
                cameras.append(Camera(name, age, 0, f"not readable: {error}"))
                continue
            points = self._strange(points, q, placed)
            cameras.append(Camera(name, age, len(points)))
            obstacles += _blocks(f"what {name} saw {max(age, 0.0):.1f} s ago", points)
        return Seen(tuple(obstacles), tuple(cameras))

    def _strange(self, points: Array, q: Array, placed: Sequence[Obstacle]) -> Array:
        """Those that are neither on the robot nor on anything placed."""
        model, geometry = self._mechanism.model, self._mechanism.geometry
        pin.forwardKinematics(model, self._data, q)
        pin.updateGeometryPlacements(model, self._data, geometry, self._scratch)
        for body, distance in enumerate(self._bodies):
            points = points[~distance.within(points, self._scratch.oMg[body], OWN)]
        for obstacle in placed:
            points = points[~PointDistance(obstacle.geometry).within(points, obstacle.placement, PLACED)]
        return points


def _blocks(name: str, points: Array) -> list[Obstacle]:
    if not len(points):
        return []
    _, block = np.unique(np.floor(points / BLOCK).astype(np.int64), axis=0, return_inverse=True)
    block = block.reshape(-1)
    order = np.argsort(block, kind="stable")
    parts = np.split(points[order], np.flatnonzero(np.diff(block[order])) + 1)
    return [Obstacle(name, coal.makeOctree(part, RESOLUTION), pin.SE3.Identity()) for part in parts]
