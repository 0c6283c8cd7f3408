"""What the operator's window costs, beside VTK in the same scene and run: ``handrail bench tablet``.

Software GL at 1280x800: TALOS' upper body, its ghost, a cloud of 50,000 points, three templates; both draw the same triangles
(the window thins meshes out; VTK gets them as thin) and all points. Each has a screen of its own. Frames are counted in turns.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import environment
from benchmarks.rows import Row
from benchmarks.virtual_screen import virtual_screen

PEER = ("pyvista==0.46.4",)
_ROUNDS, _SECONDS, _CLOUDS = 3, 4.0, 10_000


class _Child:
    """A process that answers lines of JSON."""

    def __init__(self, command: list[str], variables: dict[str, str]):
        self._name = " ".join(command)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=variables, text=True
        )

    def ask(self, **asked: Any) -> float:
        """Raises OSError where it has ended."""
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise OSError(f"{self._name} ended with status {self._process.wait()}")
        return float(json.loads(answer))

    def close(self) -> None:
        self._process.kill()
        self._process.wait()


def scene(path: Path) -> None:
    """Write what is to be drawn for VTK."""
    from affordance_templates import catalogue
    from affordance_templates.instance import Instance
    from benchmarks.tablet_scene import ROBOT, picture, wheels
    from handrail import cloud
    from handrail.robot import library as robots
    from tablet_client.app import mesh_cache
    from tablet_client.scene import robot as drawn
    from tablet_client.scene import solids

    description = robots.load(ROBOT)
    robot = drawn.load(description, mesh_cache())
    swing = description.home_position() + 0.1 * np.sin(np.linspace(0, 2 * np.pi, 64))[:, None]
    arrays: dict[str, Any] = {}
    meshes = [*robot.meshes, *robot.meshes]
    bodies = len(robot.meshes)
    for number in range(2 * bodies):
        postures = swing if number < bodies else -swing + 2 * description.home_position()
        arrays[f"poses_{number}"] = robot.chain.poses(postures)[:, number % bodies]
    for each in wheels():
        placed = Instance(each.name, catalogue.load(each.template), each.pose_in_world)
        pose = np.eye(4)
        pose[:3, 3] = each.pose_in_world.position
        meshes.append(solids.shapes(placed.resolve().shapes).transformed(pose))
    seen = cloud.unpack(picture(0))
    arrays |= {"points": seen.positions, "points_colors": seen.colours}
    for number, mesh in enumerate(meshes):
        arrays |= {f"vertices_{number}": mesh.vertices, f"colors_{number}": mesh.colors, f"faces_{number}": mesh.faces}
    np.savez(path, count=len(meshes), ghost=np.arange(bodies, 2 * bodies), **arrays)


def rows() -> list[Row]:
    """About five minutes, most of it clouds."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        scene(folder / "scene.npz")
        plain = {
            name: value for name, value in os.environ.items() if name not in ("WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
        }
        plain |= {"LIBGL_ALWAYS_SOFTWARE": "1"}
        ours = _Child(
            [sys.executable, "-m", "benchmarks.tablet_scene", str(time.time())],
            plain
            | {
                "DISPLAY": stack.enter_context(virtual_screen("1280x800")),
                "QT_QPA_PLATFORM": "xcb",
                "QSG_RENDER_LOOP": "basic",
            },
        )
        stack.callback(ours.close)
        first = ours.ask(do="first")
        try:
            python = str(environment("VTK", PEER) / "bin" / "python")
            bare = {name: value for name, value in plain.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
            peer: _Child | None = _Child(
                [python, str(Path(__file__).with_name("tablet_peer.py")), str(folder / "scene.npz")],
                bare | {"DISPLAY": stack.enter_context(virtual_screen("1280x800"))},
            )
        except (OSError, subprocess.CalledProcessError) as problem:
            print(f"VTK is left out: {problem}", file=sys.stderr)
            peer = None
        frames, theirs = [], []
        if peer is not None:
            stack.callback(peer.close)
            peer.ask(seconds=0.5)
        ours.ask(do="fps", seconds=0.5)
        for _ in range(_ROUNDS):
            frames.append(ours.ask(do="fps", seconds=_SECONDS))
            if peer is not None:
                theirs.append(peer.ask(seconds=_SECONDS))
        fps = float(np.median(frames))
        made = [Row(name="frames", value=round(fps, 1), unit="1/s", goal="≥ 20", holds=fps >= 20)]
        if theirs:
            their_fps, ratio = float(np.median(theirs)), float(np.median(np.array(frames) / theirs))
            made.append(
                Row(
                    name="frames, beside VTK", value=round(fps, 1), unit="1/s", goal="ratio ≥ 2", holds=ratio >= 2,
                    peer="pyvista", peer_value=round(their_fps, 1), ratio=round(ratio, 2),
                )
            )  # fmt: skip
        idle = 100 * ours.ask(do="idle", seconds=5.0)
        made.append(
            Row(name="CPU, nothing changes", value=round(idle, 1), unit="% of a core", goal="≤ 1", holds=idle <= 1)
        )
        made.append(
            Row(
                name="start to the first frame with the robot",
                value=round(first, 2),
                unit="s",
                goal="≤ 4",
                holds=first <= 4,
            )
        )
        grown = ours.ask(do="clouds", count=_CLOUDS)
        name = f"memory over {_CLOUDS} clouds"
        made.append(Row(name=name, value=round(grown, 1), unit="MB", goal="≤ 10", holds=grown <= 10))
        return made
