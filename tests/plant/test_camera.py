"""Depth cameras: what they see is where it really is; as a process they look when it is time, and hold nobody."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmarks.camera import from_the_wheels_surface
from hal.plant import scene
from hal.plant.camera import DepthCamera, Service, Shutter
from hal.plant.likeness import Likeness
from hal.plant.scene import Scene
from handrail import cloud
from handrail.messages import GroundTruth, PointCloud, Pose
from handrail.robot.description import Camera, RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime
from handrail.topics import Publisher, Subscriber

CAMERA = (sys.executable, "-m", "hal.plant.camera")
Look = Callable[..., np.ndarray]


def truth(robot: RobotDescription, place: Scene, time_ns: int = 1_000, **changes: object) -> GroundTruth:
    joints = dict(zip(robot.joints, robot.home_position().tolist(), strict=True))
    return msgspec.structs.replace(
        GroundTruth(
            time_ns=time_ns,
            joints=joints,
            hinges={},
            poses_in_world=place.poses_in_world,
            contact_force={},
            peak_contact_force={},
        ),
        **changes,
    )


@pytest.fixture(scope="module")
def valve() -> Scene:
    return scene.load("valve")


@pytest.fixture
def look(robot: RobotDescription) -> Iterator[Look]:
    """Points (n, 3) that a camera sees in a scene, of the robot's own camera where none is given."""
    likenesses: dict[tuple[int, int], Likeness] = {}

    def take(
        place: Scene,
        camera: Camera | None = None,
        *,
        noise: bool = False,
        of: RobotDescription = robot,
        **changes: object,
    ) -> np.ndarray:
        key = (id(place), id(of))
        if key not in likenesses:
            likenesses[key] = Likeness(of, place)
        eye = DepthCamera(camera or robot.cameras[0], likenesses[key], noise=noise)
        return cloud.unpack(eye.take(truth(robot, place, **changes))).positions

    yield take
    for likeness in likenesses.values():
        likeness.close()


def scene_of(folder: Path, text: str) -> Scene:
    file = folder / "scene.yaml"
    file.write_text(f"objects:\n{text}")
    return scene.load(file)


def test_points_lie_on_the_wheel_however_it_is_turned(look, valve):
    wheel, centre = valve.objects["valve"], valve.poses_in_world["valve"].position
    for angle in (0.0, 0.5):
        points = look(valve, hinges={"valve": angle})
        error = from_the_wheels_surface(points, wheel, centre, angle)
        assert len(points) > 1500
        assert np.percentile(error, 95) < 0.003 and error.max() < 0.01
        around = np.arctan2(points[:, 1] - centre[1], points[:, 2] - centre[2])
        assert len(np.unique(np.floor(around / 0.2))) > 30, "all round the rim"
    wrong = from_the_wheels_surface(points, wheel, centre, 0.0)
    assert wrong.max() > 0.02, "spokes that are not where the hinge has turned them would be seen"


def test_noise_is_a_real_cameras_and_the_same_again_for_the_same_truth(look, valve):
    wheel, centre = valve.objects["valve"], valve.poses_in_world["valve"].position
    points = look(valve, noise=True)
    error = from_the_wheels_surface(points, wheel, centre, 0.0)
    assert 0.0005 < np.median(error) < 0.003 and error.max() < 0.02
    np.testing.assert_array_equal(points, look(valve, noise=True))


def test_of_a_wall_it_sees_the_front_at_its_place_and_nothing_beyond_its_reach(look, tmp_path):
    wall = scene_of(
        tmp_path,
        "  near: {kind: box, size: [0.2, 6, 0.4], pose_in_world: {position: [1.4, 0, 0]}}\n"
        "  far: {kind: box, size: [0.2, 20, 20], pose_in_world: {position: [9, 0, 0]}}\n",
    )
    points = look(wall)
    assert len(points) > 1000
    front = points[(np.abs(points[:, 2]) < 0.19)]
    assert np.abs(front[:, 0] - 1.3).max() < 0.005
    assert points[:, 0].max() < 1.5 + 0.01


def test_sees_an_object_where_it_has_been_moved_to(look, tmp_path):
    box = scene_of(tmp_path, "  box: {kind: box, size: [0.1, 0.1, 0.1], pose_in_world: {position: [0.6, -0.3, 0.2]}}\n")
    moved = Pose(position=(0.7, -0.5, 0.3), orientation=(0.0, 0.0, math.sin(0.4), math.cos(0.4)))
    points = look(box, poses_in_world={"box": moved}) - moved.position
    turned = points @ np.array([[math.cos(0.8), -math.sin(0.8), 0], [math.sin(0.8), math.cos(0.8), 0], [0, 0, 1]])
    assert len(points) > 100
    assert np.abs(np.abs(turned).max(axis=1) - 0.05).max() < 0.003, "every point is on one of its faces"


def test_sees_the_robots_own_tool_where_the_kinematics_has_it(look, robot):
    bent = dict(zip(robot.joints, robot.home_position(), strict=True))
    bent |= {"arm_right_1_joint": 0.0, "arm_right_2_joint": -1.4, "arm_right_3_joint": 0.15, "arm_right_4_joint": -1.9}
    kinematics = Kinematics(robot)
    position = np.array([bent[joint] for joint in robot.joints])
    tip = kinematics.frame(position, robot.arms["right"].tip)
    points = look(scene.EMPTY, joints=bent)
    along = (points - tip.translation) @ tip.rotation[:, 2]
    on_the_stub = points[(along > -0.03) & (along < 0.10)]
    beside = np.linalg.norm(np.cross(on_the_stub - tip.translation, tip.rotation[:, 2]), axis=1)
    near = beside[beside < 0.03]
    assert len(near) > 50
    assert np.abs(near - 0.012).max() < 0.005, "on a cylinder of 12 mm"


def test_sees_the_floor_that_the_robot_stands_on_and_moves_with_its_base(look, robot):
    lifted = Pose(position=(0.3, 0.0, 0.2))
    standing = dataclasses.replace(robot, floor=-0.5)
    for base in (Pose(), lifted):
        points = look(scene.EMPTY, of=standing, base_in_world=base)
        assert 1000 < len(points) < 15_000, "thinned out with distance"
        assert np.abs(points[:, 2] + 0.5).max() < 0.005
        ahead = points[:, 0].min() if base is lifted else (nearest := points[:, 0].min())
    assert ahead > nearest + 0.25, "higher and further forward, it sees further away"


def test_a_camera_in_body_axes_sees_what_one_in_optical_axes_sees(look, valve, robot):
    body = msgspec.structs.replace(robot.cameras[0], link="rgbd_depth_frame", optical=False)
    one, other = look(valve), look(valve, body)
    assert len(one) == pytest.approx(len(other), rel=0.02)
    assert np.abs(one.mean(axis=0) - other.mean(axis=0)).max() < 0.002


def test_a_camera_on_a_link_that_the_robot_has_not_is_an_error_with_its_name(look, valve, robot):
    with pytest.raises(KeyError, match="third_eye"):
        look(valve, msgspec.structs.replace(robot.cameras[0], link="third_eye"))


def test_a_picture_is_due_once_in_every_period_of_the_robots_clock_however_that_runs():
    shutter = Shutter(2.0)
    taken = [ms for ms in range(0, 2001, 20) if shutter.opens(ms * 1_000_000)]
    assert taken == [0, 500, 1000, 1500, 2000]
    assert shutter.opens(7_730_000_000), "periods that went by unseen are not made up for"
    assert not shutter.opens(7_980_000_000) and shutter.opens(8_000_000_000)
    assert shutter.opens(20_000_000), "the plant began anew"
    assert not shutter.opens(40_000_000)


@pytest.mark.parametrize(("clock", "stamp"), [(None, 40_000_000), (lambda: 26_000_000_000_000, 26_000_000_000_000)])
def test_a_picture_has_the_robots_time_where_that_is_not_the_plants(robot, valve, clock, stamp):
    # On the wall clock the daemon's time is the computer's: by the plant's a picture would be hours old.
    class Blank:
        camera = robot.cameras[0]

        def take(self, seen: GroundTruth) -> PointCloud:
            return cloud.pack("head", seen.time_ns, np.zeros((1, 3)), np.zeros((1, 3), np.uint8), (0.0, 0.0, 0.0))

    class Truth:
        def receive(self, wait_s: float) -> GroundTruth:
            return truth(robot, valve, 20_000_000)

        def drain(self) -> list[GroundTruth]:
            return [truth(robot, valve, 40_000_000)]

    class Sensors:
        def send(self, picture: PointCloud) -> None:
            service.stop()
            sent.append(picture)

    sent: list[PointCloud] = []
    service = Service([Blank()], Truth(), Sensors(), clock)
    service.run()
    assert [picture.time_ns for picture in sent] == [stamp]


@pytest.fixture
def runtime() -> Iterator[Runtime]:
    with tempfile.TemporaryDirectory(prefix="hr") as folder:
        yield Runtime.at(folder)


def test_as_a_process_it_looks_when_it_is_time_behind_everybody_else(runtime, robot, valve):
    plant = Publisher(runtime.endpoint("plant.truth"))
    sensors = Subscriber(runtime.endpoint("sensors.events"), PointCloud)
    what = ["--robot", "talos_upper", "--scene", "valve", "--runtime", str(runtime.folder)]
    process = subprocess.Popen([*CAMERA, *what], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "camera ready\n"
        assert os.getpriority(os.PRIO_PROCESS, process.pid) == 5
        seen: list[PointCloud] = []
        ms, deadline = 0, time.monotonic() + 20
        while len(seen) < 3:
            assert time.monotonic() < deadline
            ms += 20
            plant.send(truth(robot, valve, ms * 1_000_000))
            seen += sensors.drain()
            time.sleep(0.002)  # ten times as fast as the wall
        periods = [picture.time_ns // 500_000_000 for picture in seen]
        assert periods == sorted(set(periods)), "none twice"
        assert all(picture.camera == "head" and picture.count > 1000 for picture in seen)
        process.send_signal(signal.SIGTERM)
        assert process.wait(5) == 0
        assert process.stdout.read() == ""  # one line, and nothing else
    finally:
        process.kill()
        process.wait()
        plant.close()
        sensors.close()


def test_a_robot_without_cameras_ends_it_with_one_plain_line(tmp_path, robot):
    for file in robot.folder.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_text(file.read_text())
    blind = tmp_path / "robot.yaml"
    blind.write_text(blind.read_text().replace("\ncameras:\n", "\n").replace("  - {name: head, link: rgbd", "# "))
    what = ["--robot", str(tmp_path), "--scene", "valve", "--runtime", str(tmp_path)]
    run = subprocess.run([*CAMERA, *what], capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode != 0 and run.stdout == ""
    assert "talos_upper has no cameras" in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
