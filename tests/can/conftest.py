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
from hal.can.hub import Hub
from hal.can.port import HubPort


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


@pytest.fixture
def join(hub: Hub, folder: Path) -> Iterator[Callable[..., HubPort]]:
    """join(channels=None, **options): a port on the hub of this process."""
    ports: list[HubPort] = []

    def make(*args: Any, **options: Any) -> HubPort:
        result: list[Any] = []

        def attempt() -> None:
            try:
                result.append(HubPort(folder / "bus.sock", *args, **options))
            except (OSError, ValueError) as error:
                result.append(error)

        thread = threading.Thread(target=attempt)
        thread.start()
        while thread.is_alive():
            hub.poll(0.01)
        if isinstance(result[0], Exception):
            raise result[0]
        ports.append(result[0])
        return result[0]

    yield make
    for port in ports:
        port.close()


@contextlib.contextmanager
def _hub_process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "hal.can.hub", "--runtime", str(folder), "--channels", "can0,can1"]
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
        SimpleNamespace(name="right", index=0, channel="can0", joints=tuple(f"right_{i}" for i in range(7))),
        SimpleNamespace(name="left", index=1, channel="can1", joints=tuple(f"left_{i}" for i in range(7))),
        SimpleNamespace(name="torso", index=2, channel="can1", joints=("torso_1", "torso_2", "head_1", "head_2")),
    ]
    channels = [
        SimpleNamespace(name=name, interface="handrail", bitrate=1_000_000, data_bitrate=5_000_000)
        for name in ("can0", "can1")
    ]
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    return SimpleNamespace(name="test_robot", joints=joints, limbs=limbs, channels=channels)
