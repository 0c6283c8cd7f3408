"""A screen that nobody sees, and windows on it: what the tablet's tests stand on."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.virtual_screen import virtual_screen
from tests.tablet.behind import Behind
from tests.tablet.fake_robot import FakeRobot
from tests.tablet.shown import Shown, closed_here


def wait_until(holds: Callable[[], Any], seconds: float = 60.0, turn: Callable[[], None] | None = None) -> Any:
    """Wait for something to become true, letting `turn` run meanwhile; returns what it became."""
    deadline = time.monotonic() + seconds
    while not (value := holds()):
        if time.monotonic() > deadline:
            pytest.fail("did not happen in time")
        if turn is not None:
            turn()
        else:
            threading.Event().wait(0.005)
    return value


@pytest.fixture
def robot() -> FakeRobot:
    return FakeRobot()


@pytest.fixture
def behind(robot: Any) -> Iterator[Behind]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    made = Behind(robot, folder)
    yield made
    made.close()
    shutil.rmtree(folder)


@pytest.fixture
def wait() -> Callable[..., Any]:
    return wait_until


@pytest.fixture(scope="session")
def screen() -> Iterator[str]:
    """A virtual X screen of our own, on a display number that Xvfb chooses."""
    with virtual_screen() as name:
        yield name


@pytest.fixture(scope="session")
def mesh_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("meshes")


@pytest.fixture(scope="session")
def qt(screen: str) -> None:
    os.environ.update(DISPLAY=screen, QT_QPA_PLATFORM="xcb", QSG_RENDER_LOOP="basic")
    from tablet_client.window import application

    application()


@pytest.fixture
def show(qt: None, robot: Any, mesh_folder: Path) -> Iterator[Callable[..., Shown]]:
    with closed_here() as opened:

        def make(**arguments: Any) -> Shown:
            opened.append(Shown(robot, mesh_folder, **arguments))
            return opened[-1]

        yield make


@pytest.fixture
def asking(robot: Any, show: Callable[..., Shown]) -> Shown:
    """A window on a robot that asks whether it may execute a fresh plan."""
    robot.instances, robot.plans = [robot.wheel()], [robot.plan()]
    robot.run, robot.prompts = robot.running(), [robot.prompt()]
    shown = show()
    shown.until(lambda: shown.item("promptCard").isVisible())
    return shown
