"""A bus for the tests: in this process, or as a process of its own."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hal.can import frames
from hal.can.control import NodeState
from hal.can.hub import Hub
from hal.can.port import HubPort
from handrail.robot.description import Limb


@pytest.fixture
def folder() -> Iterator[Path]:
    """A runtime folder whose path is short enough for Unix sockets."""
    path = Path(tempfile.mkdtemp(prefix="hr"))
    yield path
    shutil.rmtree(path)


@pytest.fixture
def hub(folder: Path) -> Iterator[Hub]:
    """A hub with two channels in this process; its clock stands still unless a test moves it."""
    clock = SimpleNamespace(now=1_000_000_000)
    with contextlib.closing(Hub(folder / "bus.sock", ["can0", "can1"], clock=lambda: clock.now, queue=1000)) as made:
        made.test_clock = clock  # type: ignore[attr-defined]
        yield made


def join_in_thread(hub: Hub, path: Path, *args: Any, **options: Any) -> HubPort:
    """A port on a hub of this process, which has to go on meanwhile."""
    result: list[Any] = []

    def attempt() -> None:
        try:
            result.append(HubPort(path, *args, **options))
        except (OSError, ValueError) as error:
            result.append(error)

    thread = threading.Thread(target=attempt)
    thread.start()
    while thread.is_alive():
        hub.poll(0.01)
    if isinstance(result[0], Exception):
        raise result[0]
    assert isinstance(result[0], HubPort)
    return result[0]


@pytest.fixture
def join(hub: Hub, folder: Path) -> Iterator[Callable[..., HubPort]]:
    """join(channels=None, **options): a port on the hub of this process."""
    ports: list[HubPort] = []

    def make(*args: Any, **options: Any) -> HubPort:
        ports.append(join_in_thread(hub, folder / "bus.sock", *args, **options))
        return ports[-1]

    yield make
    for port in ports:
        port.close()


class Bench:
    """A hub in this process whose clock the test moves, and ports on it."""

    def __init__(self, folder: Path, **options: Any):
        self.now = 1_000_000_000
        self._path = folder / "bench.sock"
        self.hub = Hub(self._path, ["can0", "can1"], clock=lambda: self.now, **options)
        self._ports: list[HubPort] = []

    def join(self, name: str, channels: list[str] | None = None, **options: Any) -> HubPort:
        """A node of that name."""
        port = join_in_thread(self.hub, self._path, channels, name=name, **options)
        self._ports.append(port)
        return port

    def turn(self, ms: float = 0.0) -> np.ndarray:
        """Let time pass, and the bus with it; the frames that the hub's own process heard."""
        self.now += round(ms * 1e6)
        return self.hub.poll(0.0).copy()

    def node(self, name: str, channel: str = "can0") -> NodeState:
        """What the hub reports of a node."""
        return next(n for n in self.hub.report().nodes if (n.name, n.channel) == (name, channel))

    def close(self) -> None:
        for port in self._ports:
            port.close()
        self.hub.close()


@pytest.fixture
def bench(folder: Path) -> Iterator[Callable[..., Bench]]:
    """bench(**options of Hub): a hub with channels can0 and can1 at 1/5 Mbit/s."""
    with contextlib.ExitStack() as stack:
        yield lambda **options: stack.enter_context(contextlib.closing(Bench(folder, **options)))


@contextlib.contextmanager
def _hub_process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "hal.can.hub_process", "--runtime", str(folder), "--channels", "can0,can1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "hub ready\n"
        yield process
        process.terminate()
        process.wait(5)


@pytest.fixture
def hub_process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A hub with channels can0 and can1 as a process of its own, at the runtime folder `folder`."""
    with _hub_process(folder) as process:
        yield process


@pytest.fixture(scope="session")
def running() -> Iterator[Path]:
    """The runtime folder of a hub process with channels can0 and can1 that all tests share; nobody ends it."""
    path = Path(tempfile.mkdtemp(prefix="hr"))
    with _hub_process(path):
        yield path
    shutil.rmtree(path)


@pytest.fixture
def make_frames() -> Callable[..., np.ndarray]:
    """make_frames(ids, bus=0, length=16): CAN FD frames whose data begin with their place in the batch."""

    def make(ids: Any, bus: int = 0, length: int = 16) -> np.ndarray:
        records = frames.empty(len(ids))
        records["can_id"], records["bus"], records["length"] = ids, bus, length
        records["flags"] = frames.FD | frames.BRS
        if length >= 4:
            records["data"][:, :4] = np.arange(len(ids), dtype="<u4").view(np.uint8).reshape(-1, 4)
        return records

    return make


@pytest.fixture
def robot() -> SimpleNamespace:
    """What the limb protocol needs of a description: two arms of seven joints and a limb of four, on two channels."""
    limbs = [
        Limb("right", 0, "can0", tuple(f"right_{i}" for i in range(7))),
        Limb("left", 1, "can1", tuple(f"left_{i}" for i in range(7))),
        Limb("torso", 2, "can1", ("torso_1", "torso_2", "head_1", "head_2")),
    ]
    channels = [
        SimpleNamespace(name=name, interface="handrail", bitrate=1_000_000, data_bitrate=5_000_000)
        for name in ("can0", "can1")
    ]
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    return SimpleNamespace(name="test_robot", joints=joints, limbs=limbs, channels=channels, devices=())
