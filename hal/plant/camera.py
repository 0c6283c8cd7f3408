"""A simulated robot's depth cameras, as a process of their own.

    python -m hal.plant.camera --robot talos_upper --scene valve --clock lockstep|wall --runtime DIR

They look at the ground truth (`plant.truth`), as light does, and publish clouds of what they see on `sensors.events`; nobody waits
for them. A camera of 2 Hz takes a picture at every half second of the robot's clock; where that clock outruns the pictures, as in
lock-step, some are left out, so that pictures never cost more than a quarter of one core.

A picture is the depth buffer of PyBullet's software renderer: 320×240 in about 50 ms, points within 2 mm of a valve wheel's true
surface (`rayTestBatch` on the same scene: 1 s, since its rays meet the arms' hulls, and blind to every link that has none:
`handrail bench camera`). Depth has the noise of a structured-light camera (Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise",
2012, equation 1). Of the points in each cube of 5 mm one is kept; beyond 1 m cubes are of 15 mm, beyond 2 m of 45 mm, as pixels
are further apart there and depth is worth less.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from hal.plant import scene
from hal.plant.bullet import own_stdout
from hal.plant.bullet import pybullet as p
from hal.plant.likeness import Likeness
from handrail import cloud
from handrail.config import ConfigError
from handrail.messages import GroundTruth, PointCloud
from handrail.robot import library as robots
from handrail.robot.description import Camera
from handrail.runtime import Runtime
from handrail.topics import Publisher, Subscriber

VOXEL = 0.005
"""m: of the points in one cube of this size one is kept; three times as large at 1, 2, 4 ... m from the camera"""
_NS = 1_000_000_000
_NICE = 5
_REST = 3.0
"""times what the last pictures took that the process rests afterwards: a quarter of one core at most"""
_LOOK_S = 0.02
"""the shortest rest"""
_LONGEST_REST_S = 1.0
_PATIENCE_S = 0.2
"""the longest wait, so that SIGTERM is heard"""
# A camera's columns in the axes of its link: right, up, forwards (REP 103: body axes, or optical ones).
_BODY_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_OPTICAL_AXES = np.diag([1.0, -1.0, 1.0])


class DepthCamera:
    """One camera of a robot. `take` gives what it sees of a likeness."""

    def __init__(self, camera: Camera, likeness: Likeness, *, noise: bool = True):
        """Raises KeyError for a link that the robot has not."""
        self.camera, self._likeness, self._noise = camera, likeness, noise
        self._axes = _OPTICAL_AXES if camera.optical else _BODY_AXES
        width, height = camera.width, camera.height
        across = math.tan(camera.field_of_view / 2)
        up = across * height / width
        vertical = math.degrees(2 * math.atan(up))
        self._projection = p.computeProjectionMatrixFOV(vertical, width / height, camera.near, camera.far)
        # The renderer samples pixels at their lower left corners.
        columns = (np.arange(width) / width * 2 - 1) * across
        rows = (1 - (np.arange(height) + 1) / height * 2) * up
        self.rays = np.stack([*np.meshgrid(columns, rows), np.ones((height, width))], axis=-1)
        """(height, width, 3) right, up, forwards: a point for each pixel, 1 m ahead"""
        likeness.frame(camera.link)

    def take(self, truth: GroundTruth) -> PointCloud:
        """A cloud of what the camera sees, in the world. The same truth gives the same cloud."""
        self._likeness.show(truth)
        eye, axes = self.stands()
        depth, colours = self._look(eye, axes)
        seen = depth < self.camera.far
        z = depth[seen]
        if self._noise:
            draw = np.random.default_rng([truth.time_ns, len(z)])
            z = z + draw.standard_normal(len(z)) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
        points = (self.rays[seen] * z[:, None]) @ axes.T + eye
        kept = _thin(points, z)
        origin = (float(eye[0]), float(eye[1]), float(eye[2]))
        return cloud.pack(self.camera.name, truth.time_ns, points[kept], colours[seen][kept], origin)

    def stands(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the camera is, m (3,), and its axes right, up, forwards as columns (3, 3), in the world, when last shown."""
        frame = self._likeness.frame(self.camera.link)
        return frame[:3, 3], frame[:3, :3] @ self._axes

    def _look(self, eye: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth along the line of sight's forward axis, m (height, width), `far` for nothing; colours (height, width, 3) uint8."""
        near, far, shape = self.camera.near, self.camera.far, (self.camera.height, self.camera.width)
        view = p.computeViewMatrix(eye.tolist(), (eye + axes[:, 2]).tolist(), axes[:, 1].tolist())
        _, _, colour, buffer, _ = p.getCameraImage(
            shape[1],
            shape[0],
            view,
            self._projection,
            lightDirection=(
                -axes[:, 2]
            ).tolist(),  # even light: a cloud's colours are its surface's own, not the hour's
            lightAmbientCoeff=0.7,
            lightDiffuseCoeff=0.4,
            lightSpecularCoeff=0.0,
            shadow=0,
            renderer=p.ER_TINY_RENDERER,
            flags=p.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._likeness.client,
        )
        depth = far * near / (far - (far - near) * np.asarray(buffer, float).reshape(shape))
        depth[np.asarray(buffer).reshape(shape) >= 1.0] = far
        return depth, np.asarray(colour, np.uint8).reshape(*shape, 4)[:, :, :3]


def _thin(points: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Rows of the points (n, 3) that are kept, by cubes of the world: what stands still keeps them from picture to picture."""
    doublings = np.clip(np.floor(np.log2(depth)) + 1, 0, 15)  # 0: nearer than 1 m
    cubes = np.floor(points / (VOXEL * 3**doublings)[:, None]).astype(np.int64)
    _, kept = np.unique(cubes @ (1 << 40, 1 << 22, 1 << 4) + doublings.astype(np.int64), return_index=True)
    return kept


class Shutter:
    """Opens at every period of the robot's clock, once each, however many go by."""

    def __init__(self, rate: float):
        """`rate`: Hz."""
        self._period_ns = max(1, round(_NS / rate))
        self._next_ns = self._last_ns = 0

    def opens(self, time_ns: int) -> bool:
        """Is a picture due at this time of the robot's clock? Then the next is due in the next period."""
        began_anew = time_ns < self._last_ns
        self._last_ns = time_ns
        if time_ns < self._next_ns and not began_anew:
            return False
        self._next_ns = (time_ns // self._period_ns + 1) * self._period_ns
        return True


class Service:
    """Takes pictures of the latest truth until `stop` is called (from a signal handler, say)."""

    def __init__(
        self, cameras: list[DepthCamera], truth: Subscriber, sensors: Publisher, clock: Callable[[], int] | None = None
    ):
        """clock: the robot's, ns, where that is not the plant's own time: on the wall clock it is the daemon's."""
        self._clock = clock
        self._cameras = [(camera, Shutter(camera.camera.rate)) for camera in cameras]
        self._truth, self._sensors = truth, sensors
        self._over = threading.Event()

    def stop(self) -> None:
        """Let `run` return, after the picture that it is taking."""
        self._over.set()

    def run(self) -> None:
        """Wait for truth, look, rest; see the module's text."""
        while not self._over.is_set():
            latest = self._truth.receive(_PATIENCE_S)
            for newer in self._truth.drain():
                latest = newer
            began = time.process_time()  # not the wall's: who waits for a core has rested
            if latest is not None:
                heard_ns = latest.time_ns if self._clock is None else self._clock()
                for camera, shutter in self._cameras:
                    if shutter.opens(latest.time_ns):
                        self._sensors.send(msgspec.structs.replace(camera.take(latest), time_ns=heard_ns))
            self._over.wait(min(max(_LOOK_S, _REST * (time.process_time() - began)), _LONGEST_REST_S))


def _stand_back() -> None:
    """Everybody else first."""
    os.nice(_NICE)
    if os.getsid(0) == os.getpid():
        # Where the kernel shares cores out among sessions (sched(7), autogroup), it is the session that has to be nice.
        with contextlib.suppress(OSError):
            Path("/proc/self/autogroup").write_text(str(_NICE), encoding="ascii")


def main() -> None:
    """Run the cameras until SIGTERM or SIGINT; prints `camera ready` when they look."""
    parser = argparse.ArgumentParser(
        prog="python -m hal.plant.camera", description="A simulated robot's depth cameras: clouds of what they see."
    )
    parser.add_argument("--robot", required=True, help="robot's name or folder, e.g. talos_upper")
    parser.add_argument("--scene", required=True, help="scene's name or YAML file, e.g. valve")
    parser.add_argument(
        "--clock", choices=("lockstep", "wall"), default="lockstep", help="as the plant's and the daemon's"
    )
    parser.add_argument("--runtime", help="the robot's runtime folder (default: $HANDRAIL_RUNTIME, else this user's)")
    options = parser.parse_args()
    with own_stdout() as stdout, contextlib.ExitStack() as open_things:
        try:
            if options.clock == "lockstep":
                # There plant and loop run as ordinary programs; on the wall clock they go before everybody by themselves, and
                # a camera that stood back would stop for seconds on a busy computer.
                _stand_back()
            robot = robots.load(options.robot)
            if not robot.cameras:
                raise ValueError(f"{robot.name} has no cameras; expected `cameras:` in its robot.yaml")
            likeness = open_things.enter_context(contextlib.closing(Likeness(robot, scene.load(options.scene))))
            runtime = Runtime.at(options.runtime)
            cameras = [DepthCamera(camera, likeness) for camera in robot.cameras]
        except (ConfigError, OSError, ValueError) as error:
            sys.exit(f"camera: {error}")
        truth = open_things.enter_context(contextlib.closing(Subscriber(runtime.endpoint("plant.truth"), GroundTruth)))
        sensors = open_things.enter_context(contextlib.closing(Publisher(runtime.endpoint("sensors.events"))))
        # On the wall clock the daemon counts as the computer does, the plant from its own start.
        service = Service(cameras, truth, sensors, time.monotonic_ns if options.clock == "wall" else None)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: service.stop())
        print("camera ready", file=stdout, flush=True)
        service.run()


if __name__ == "__main__":
    main()
