"""`make screenshots`: every page of the operator's window on a live simulated robot, in both sizes, into docs/images/tablet.

It starts a robot with keys, a port and a runtime folder of its own, and a window on a virtual screen (Xvfb). Exit status 0 once
all pictures are there. Pictures have 256 colours: all of them together stay below 3 MB.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.virtual_screen import virtual_screen
from handrail.client import Client, connect
from handrail.link.keys import ClientKeys, for_client
from handrail.messages import Mark, Pose, StartRecording, StopRecording
from handrail.robot import library as robots
from handrail.topics import RefusedError, Unreachable

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "images" / "tablet"
SIZES = ((1280, 800), (1920, 1200))
VALVE = Pose(position=(0.55, -0.35, 0.30))
_COLOURS, _PATIENCE = 256, 300.0  # s
_VIVID = 70


@contextmanager
def _robot(port: int, folder: Path) -> Iterator[None]:
    command = [sys.executable, "-m", "handrail.cli", "up", "talos_upper", "--scene", "valve", "--port", str(port)]
    with (folder / "up.log").open("w", encoding="utf-8") as log:
        service = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            yield
        finally:
            service.terminate()
            service.wait(30)


def small(picture: Image.Image) -> Image.Image:
    """The picture with a palette of its own, in which the few bright pixels count as much as the many dark ones."""
    picture = picture.convert("RGB")
    pixels = np.asarray(picture).reshape(-1, 3)
    vivid = pixels[pixels.max(1).astype(int) - pixels.min(1) > _VIVID]
    counted = np.concatenate([pixels, np.repeat(vivid, 12, 0)])
    counted = counted[: len(counted) // picture.width * picture.width].reshape(-1, picture.width, 3)
    palette = Image.fromarray(counted).quantize(_COLOURS)
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


class Camera:
    """The window, and the pictures of it."""

    def __init__(self, address: str, keys: ClientKeys):
        from tablet_client.app import mesh_cache
        from tablet_client.session import Session
        from tablet_client.window import NO_ANTIALIASING, open_window

        self.opened = open_window(address, robots.load, mesh_cache(), antialiasing=NO_ANTIALIASING, operator="Ada")
        self.window, self.desk = self.opened.window, self.opened.desk
        self.session = Session(lambda: connect(address, keys, timeout_s=0), self.desk.inbox)
        self.desk.serve(self.session)
        self.session.start()

    def turn(self, seconds: float) -> None:
        """Let the window work."""
        from PySide6.QtCore import QEventLoop, QTimer

        loop = QEventLoop()
        QTimer.singleShot(round(seconds * 1000), loop.quit)
        loop.exec()

    def until(self, holds: Callable[[], Any], what: str) -> None:
        """Raises TimeoutError."""
        deadline = time.monotonic() + _PATIENCE
        while not holds():
            if time.monotonic() > deadline:
                raise TimeoutError(f"waited {_PATIENCE:g} s for {what}")
            self.turn(0.05)

    def page(self, name: str) -> None:
        self._ask(f"Pages.open('{name}')")

    def pages(self) -> list[str]:
        """Names of the pages that there are."""
        return str(self._ask("Pages.all.map(page => page.name).join(' ')")).split()

    def _ask(self, expression: str) -> Any:
        """A QML expression's value."""
        from PySide6.QtQml import QQmlExpression, qmlContext

        value, _ = QQmlExpression(qmlContext(self.window), self.window, expression).evaluate()
        return value

    def show(self, field: str, value: object, page: str) -> None:
        """Set a property of a page that is open."""
        queue = [self.window.contentItem()]  # what a Repeater made is no child of the window otherwise
        while queue and queue[-1].objectName() != f"page_{page}":
            queue += queue.pop().childItems()
        queue[-1].property("item").setProperty(field, value)

    def lit(self, on: bool) -> None:
        """In the colours for the day."""
        self._ask(f"Theme.dark = {'false' if on else 'true'}")

    def take(self, name: str) -> None:
        """Pictures of what the window shows, one a size."""
        from tablet_client.window import NO_ANTIALIASING, SUPERSAMPLED

        for width, height in SIZES:
            self.window.resize(width, height)
            self.until(lambda w=width: self.window.width() == w, "the window's size")
            self.turn(0.5)
            self.window.setProperty("smoothing", SUPERSAMPLED)
            self.window.grabWindow()  # the first one is still of before
            path = FOLDER / f"{name}_{width}.png"
            self.window.grabWindow().save(str(path))
            small(Image.open(path)).save(path, optimize=True)
            self.window.setProperty("smoothing", NO_ANTIALIASING)
            print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1000:.0f} KB", flush=True)

    def close(self) -> None:
        self.session.close(timeout=0.5)
        self.opened.close()


def _tour(camera: Camera, start: Callable[[], Client]) -> None:
    """Every page, in an order in which each has something to show."""
    desk = camera.desk
    camera.turn(1.0)
    camera.take("waiting")
    robot = start()
    camera.until(lambda: camera.opened.stage.property("state") == "ready", "the robot's picture")
    camera.until(lambda: desk.header["engine"], "the engine")
    _patiently(robot.enable, camera)
    robot.place_instance("wheel_1", "wheel", VALVE)
    camera.until(lambda: desk.situation.world.instances and desk.header["drives"] == "enabled", "wheel_1, drives")
    desk.signals.choose("arm_right_4_joint.position")
    desk.signals.choose("force.z")
    robot.call(StartRecording(name="valve"))
    for page in camera.pages():
        if page == "task":
            continue  # when it runs
        camera.page(page)
        desk.bench.select("wheel_1" if page == "objects" else "")
        if page == "move":
            camera.until(desk.move.joints.rowCount, "the robot's joints")
            desk.move.showTarget("tool")
            move = desk.situation.move
            move.target[:3, 3] += (0.05, 0.05, 0.08)
            move.count("all")
        elif page == "canvas":
            desk.workshop.code.open("program", "turn_valve")
            camera.until(lambda: desk.workshop.canvas.view["there"], "the program's picture")
            camera.turn(0.5)
            desk.workshop.canvas.touch("stroking")
        elif page == "code":
            robot.start_node("low_pass", name="smooth", params={"cutoff": 5.0})
            desk.workshop.code.open("node", "low_pass")
            code = desk.workshop.code
            camera.until(lambda code=code: code.view["title"] == "low_pass" and code.view["loaded"], "a node's code")
            camera.until(lambda: desk.workshop.nodes.count, "the node that runs")
            camera.show("tuning", True, page)
        elif page == "objects":
            camera.until(lambda: desk.bench.view["selected"], "the selected wheel")
            camera.turn(10.0)  # what is reached comes while it is looked at
        elif page == "output":
            desk.workshop.output.switch("info")
            camera.turn(1.0)  # from here on it is sent
            robot.plan("wheel_1", "turn", "right")
            robot.deploy("turn_valve", {"arm": "right", "valve": "wheel_1"})
            camera.until(lambda: desk.workshop.output.lines.rowCount() > 1, "what the engine says")
        elif page == "health":
            desk.health.choose("engine")
            camera.until(lambda: desk.health.view["log"], "what the engine said")
            camera.turn(8.0)  # processes are looked at twice before it is known what they take
        elif page == "recordings":
            robot.call(Mark(text="the wheel is placed"))
            robot.call(StopRecording())
            camera.until(lambda: any(row["fits"] for row in desk.recordings.found.lines), "the recording")
            desk.recordings.show("valve")
            camera.until(lambda: desk.recordings.time > 1.0, "the replay")
        camera.take(page)
        if page == "canvas":
            _graph(camera, robot)
        elif page == "library":
            camera.show("part", "engines", page)
            camera.until(lambda: desk.library.engines.lines, "the engines")
            camera.take("engines")
            camera.show("part", "programs", page)
        elif page == "objects":
            camera.lit(True)
            camera.take("light")
            camera.lit(False)
        if page == "code":
            robot.stop_node("smooth")
        desk.recordings.back()
        desk.move.reset()
    desk.bench.select("")
    camera.page("task")
    desk.tour.begin()
    camera.take("tour")
    desk.tour.end()
    robot.run(robot.deploy("turn_valve", {"arm": "right", "valve": "wheel_1"}))
    camera.until(lambda: desk.prompt["open"] and desk.ghost["shown"], "the program's question")
    camera.turn(1.5)
    camera.take("task")
    robot.stop_run()
    robot.stop("Ada, at the tablet")
    camera.until(lambda: desk.header["drives"] == "stopped", "the stop")
    camera.take("stopped")


def _graph(camera: Camera, robot: Client) -> None:
    """A node that is made of nodes, while it runs."""
    desk = camera.desk
    robot.start_node("contact", params={"limit": 6.0})
    robot.put_node("contact", {"wrench": [3.0, 6.0, 2.0, 0.0, 0.0, 0.0], "time": 0.0}, step=True)
    desk.workshop.code.open("node", "contact")
    camera.until(lambda: desk.workshop.graph.view["there"] and desk.workshop.graph.view["running"], "a node's picture")
    desk.situation.wiring.select("pressed", ("value", False))
    camera.until(lambda: desk.situation.wiring.ports("pressed", "input"), "the ports of its parts")
    camera.turn(0.5)
    camera.take("graph")
    robot.stop_node("contact")


def _patiently(call: Callable[[], object], camera: Camera) -> None:
    """A robot that has just been started refuses until all of it is there."""
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            call()
            return
        except (RefusedError, Unreachable):
            if time.monotonic() > deadline:
                raise
            camera.turn(0.5)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="handrail-")))
        os.environ.update(
            HANDRAIL_RUNTIME=str(folder / "run"), HANDRAIL_KEYS=str(folder / "keys"),
            HANDRAIL_RECORDINGS=str(folder / "recordings"), XDG_CONFIG_HOME=str(folder / "config"),
            DISPLAY=stack.enter_context(virtual_screen()), QT_QPA_PLATFORM="xcb", QSG_RENDER_LOOP="basic",
        )  # fmt: skip
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = min(free.getsockname()[1], 65000)
        address, keys = f"tcp://127.0.0.1:{port}", for_client(None)
        camera = Camera(address, keys)
        stack.callback(camera.close)

        def start() -> Client:
            stack.enter_context(_robot(port, folder))
            return stack.enter_context(connect(address, keys, timeout_s=_PATIENCE))

        _tour(camera, start)


if __name__ == "__main__":
    main()
