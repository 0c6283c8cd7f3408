"""The window's half of benchmarks/tablet.py, a process of its own: the operator's window, told by nobody but this.

    python -m benchmarks.tablet_scene STARTED

Speaks JSON lines: {"do": "first"} → s from STARTED (Unix time) to the first frame with the robot in it; {"do": "fps", "seconds": 3}
→ frames a second; {"do": "idle", "seconds": 3} → share of a core; {"do": "clouds", "count": 10000} → MB that it grew by.
"""

from __future__ import annotations

import json
import math
import sys
import time
from typing import Any

import msgspec
import numpy as np
import psutil
from PySide6.QtCore import QEventLoop, QObject, QTimer

from affordance_templates import catalogue
from handrail import cloud
from handrail.messages import (
    DaemonStatus,
    EngineSnapshot,
    InstanceState,
    LoopStatistics,
    PlanPreview,
    PlanSegment,
    PointCloud,
    Pose,
    RobotInfo,
    RobotState,
)
from handrail.robot import library as robots
from tablet_client.app import mesh_cache
from tablet_client.models.arrivals import Attached, EngineAttached
from tablet_client.window import open_window

ROBOT, SIZE, POINTS = "talos_upper", (1280, 800), 50_000
PLACES = ((0.55, -0.35, 0.30), (0.6, 0.0, 0.35), (0.55, 0.35, 0.30))
"""of three wheels, m"""


def picture(number: int) -> PointCloud:
    """What a camera would see: 50,000 points in front of the robot, other ones each time."""
    rng = np.random.default_rng(number)
    near = rng.uniform((0.5, -0.6, -0.2), (1.1, 0.6, 0.7), (POINTS, 3))
    return cloud.pack("head", number, near, rng.integers(0, 256, (POINTS, 3)).astype(np.uint8), (0.15, 0.0, 0.56))


def wheels() -> list[InstanceState]:
    """Three templates."""
    known = catalogue.load("wheel")
    return [
        InstanceState(
            name=f"wheel_{number}", template="wheel", template_hash=known.hash, version=1,
            pose_in_world=Pose(position=place), parameters={}, joint_state={},
        )
        for number, place in enumerate(PLACES)
    ]  # fmt: skip


class Scene:
    """The window, and what it is told."""

    def __init__(self) -> None:
        self.robot = robots.load(ROBOT)
        self.home = self.robot.home_position()
        self.opened = open_window("tcp://nowhere:1", robots.load, mesh_cache(), size=SIZE)
        self.frames = 0
        self.opened.window.frameSwapped.connect(self._count)
        robot, arms = self.robot, self.robot.arms
        info = RobotInfo(
            name=robot.name, joints=list(robot.joints), lower=robot.lower.tolist(), upper=robot.upper.tolist(),
            velocity_limit=robot.velocity_limit.tolist(), torque_limit=robot.torque_limit.tolist(), groups={}, tools={},
            tips={}, arms={name: list(arm.joints) for name, arm in arms.items()}, home=robot.home, period_ns=robot.period_ns,
        )  # fmt: skip
        status = DaemonStatus(
            time_ns=0, clock="wall", enabled=True, stopped=False, stop_reason="", speed=1.0, drives=[], controllers={},
            loop=LoopStatistics(), buses=[],
        )  # fmt: skip
        joints = list(arms["right"].joints)
        start = self.home[robot.index(joints)]
        goal = start + np.linspace(0.3, -0.4, len(joints))
        plan = PlanPreview(
            id="plan", label="Reach", joints=joints, made_from={}, fresh=True, duration=4.0,
            segments=[PlanSegment(name="reach", times=[0.0, 4.0], positions=[start.tolist(), goal.tolist()])],
        )  # fmt: skip
        for item in (
            Attached(info, status),
            EngineAttached(EngineSnapshot(instances=wheels(), plans=[plan], run=None, prompts=[])),
            self._state(0.0),
            picture(0),
        ):
            self.opened.desk.inbox.put(item)
        self.rig: Any = self.opened.window.findChild(QObject, "rig")

    def _count(self) -> None:
        self.frames += 1

    def _state(self, phase: float) -> RobotState:
        position = (self.home + 0.1 * math.sin(phase)).tolist()
        zero = [0.0] * len(position)
        return RobotState(
            time_ns=int(phase * 1e9), cycle=1, position=position, velocity=zero, torque=zero, command=position
        )

    def turn(self, seconds: float) -> None:
        """Let the window work."""
        loop = QEventLoop()
        QTimer.singleShot(round(seconds * 1000), loop.quit)
        loop.exec()

    def next_frame(self) -> None:
        before = self.frames
        while self.frames == before:
            self.turn(0.001)

    def first(self, started: float) -> float:
        """s"""
        while self.opened.stage.property("state") != "ready":
            self.turn(0.005)
        self.next_frame()
        return time.time() - started

    def fps(self, seconds: float) -> float:
        """Frames a second while the camera goes round, the robot moves and the ghost plays."""
        before, began = self.frames, time.monotonic()
        while (passed := time.monotonic() - began) < seconds:
            self.rig.setProperty("yaw", 38 + 40 * passed)
            self.opened.desk.inbox.put(self._state(3 * passed))
            self.next_frame()
        return (self.frames - before) / (time.monotonic() - began)

    def idle(self, seconds: float) -> float:
        """Share of a core that the process takes while nothing changes and the ghost stands."""
        self.opened.desk.play(False)
        self.turn(1.5)
        process = psutil.Process()
        before, began = sum(process.cpu_times()[:2]), time.monotonic()
        self.turn(seconds)
        return (sum(process.cpu_times()[:2]) - before) / (time.monotonic() - began)

    def clouds(self, count: int) -> float:
        """MB that the process grew by over the last nine tenths of so many pictures, one in fifty of which is drawn."""
        pictures = [picture(number) for number in range(4)]
        process, base = psutil.Process(), 0
        for number in range(count):
            told = msgspec.structs.replace(pictures[number % 4], time_ns=number)
            self.opened.desk.situation.take(told)
            self.opened.stage.show(self.opened.desk.situation)
            if number % 50 == 0:
                self.next_frame_of_its_own()
            if number == count // 10:
                base = process.memory_info().rss
        return (process.memory_info().rss - base) / 1e6

    def next_frame_of_its_own(self) -> None:
        """One frame, whatever else there is to draw."""
        self.opened.window.update()
        self.next_frame()


def main() -> None:
    started, scene = float(sys.argv[1]), Scene()
    for line in sys.stdin:
        asked = json.loads(line)
        do, number = asked["do"], asked.get("seconds", asked.get("count", started))
        answer = {"first": scene.first, "fps": scene.fps, "idle": scene.idle, "clouds": scene.clouds}[do]
        print(json.dumps(answer(number)), flush=True)


if __name__ == "__main__":
    main()
