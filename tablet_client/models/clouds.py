"""What the robot's depth cameras see: the latest cloud of each, unpacked."""

from __future__ import annotations

from dataclasses import dataclass

from handrail import cloud
from handrail.messages import PointCloud

_NS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class Seen:
    """One camera's latest picture."""

    time_ns: int
    """the robot's clock, when it was taken"""
    points: cloud.Points
    origin: tuple[float, float, float]
    """m, world frame: where the camera stood"""


class Clouds:
    """Cameras by name."""

    def __init__(self) -> None:
        self.seen: dict[str, Seen] = {}
        self.problems: dict[str, str] = {}
        """camera → why its last picture can't be shown"""

    def take(self, picture: PointCloud) -> str:
        """Learn from a picture. Returns why it can't be shown where that is news, else nothing."""
        try:
            self.seen[picture.camera] = Seen(picture.time_ns, cloud.unpack(picture), picture.origin)
        except ValueError as error:
            self.seen.pop(picture.camera, None)
            news = str(error) if picture.camera not in self.problems else ""
            self.problems[picture.camera] = str(error)
            return news
        self.problems.pop(picture.camera, None)
        return ""

    def clear(self) -> None:
        """Another robot: nothing is seen yet."""
        self.seen, self.problems = {}, {}

    def age(self, now_ns: int) -> float:
        """s of the robot's clock since the newest picture was taken; -1 without one."""
        if not self.seen:
            return -1.0
        # A clock that began anew (another plant) is before its last picture: that one is as old as can be.
        newest = max(seen.time_ns for seen in self.seen.values())
        return (now_ns - newest) / _NS if now_ns >= newest - _NS else float("inf")
