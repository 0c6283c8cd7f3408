"""The whole system as a user starts it: `handrail up`, in a runtime folder and on a port of its own."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

import handrail
from handrail import messages
from handrail.runtime import Runtime, memory_folder
from handrail.topics import Caller, Subscriber


def free_port() -> int:
    """A port with a free neighbour: the link's calls and its events."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            with contextlib.suppress(OSError):
                second.bind(("127.0.0.1", port + 1))
                return port


class Stack:
    """A running robot service and what tests ask of it."""

    def __init__(
        self,
        folder: Path,
        *,
        clock: str = "lockstep",
        scene: str = "valve",
        robot: str = "talos_upper",
        camera: bool = False,
    ):
        self.runtime = Runtime.at(folder)
        self.port = free_port()
        self.output: list[str] = []
        self._heard = threading.Condition()
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "handrail.cli", "up", robot, "--scene", scene, "--clock", clock),
                *("--runtime", str(folder), "--port", str(self.port)),
                *(() if camera else ("--no-camera",)),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "HANDRAIL_KEYS": str(folder / "keys")},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        os.environ["HANDRAIL_KEYS"] = str(folder / "keys")

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._heard:
                self.output.append(line)
                self._heard.notify_all()
        with self._heard:
            self._heard.notify_all()

    def wait_output(self, wanted: Callable[[str], bool], what: str, timeout_s: float = 300.0) -> None:
        """Wait for a line of the service's. The first start after kernels have changed compiles them."""
        deadline = time.monotonic() + timeout_s
        with self._heard:
            while not any(wanted(line) for line in self.output):
                left = deadline - time.monotonic()
                if left <= 0 or self.process.poll() is not None:
                    pytest.fail(f"{what} never came; the service said:\n{''.join(self.output)}")
                self._heard.wait(min(left, 0.5))

    def wait_up(self) -> None:
        self.wait_output(lambda line: "All up" in line, "everything up")

    def connect(self) -> handrail.client.Client:
        return handrail.connect(f"tcp://127.0.0.1:{self.port}", timeout_s=60.0)

    def child(self, module: str) -> psutil.Process:
        """The child process that runs a module."""
        for process in psutil.Process(self.process.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                if module in process.cmdline():
                    return process
        pytest.fail(f"no child runs {module}")

    def kill(self, module: str) -> int:
        """SIGKILL a child, as a crash would; returns its pid."""
        process = self.child(module)
        process.send_signal(signal.SIGKILL)
        return process.pid

    def truth(self) -> Truth:
        return Truth(self.runtime)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Simulated time stands meanwhile: in lock-step the robot does not wait for a test that starts a process."""
        caller = Caller(self.runtime.endpoint("daemon.call"), timeout_s=20.0)
        caller.call(messages.HoldTime(owner="test", limit_s=120.0))
        try:
            yield
        finally:
            caller.call(messages.ReleaseTime(owner="test"))
            caller.close()

    def close(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(5)


class Truth:
    """The judge's view: the plant's ground truth."""

    def __init__(self, runtime: Runtime):
        self._subscriber = Subscriber(runtime.endpoint("plant.truth"), messages.GroundTruth)

    def now(self, timeout_s: float = 60.0) -> messages.GroundTruth:
        """A sample that was taken after this call."""
        list(self._subscriber.drain())
        sample = self._subscriber.receive(timeout_s)
        assert sample is not None, "the plant says nothing"
        return sample

    def latest(self) -> messages.GroundTruth | None:
        """What it said last since this was asked before, if anything."""
        return next(reversed(list(self._subscriber.drain())), None)

    def until(self, wanted: Callable[[messages.GroundTruth], bool], what: str, timeout_s: float = 200.0):
        """The first sample that satisfies `wanted`."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            sample = self._subscriber.receive(5.0)
            if sample is not None and wanted(sample):
                return sample
        pytest.fail(f"{what} did not happen in {timeout_s:g} s")

    def after(self, seconds: float) -> messages.GroundTruth:
        """The sample `seconds` of the robot's clock from now."""
        start = self.now().time_ns
        return self.until(lambda sample: sample.time_ns >= start + seconds * 1e9, f"{seconds} s of the plant's time")


@contextlib.contextmanager
def stacks() -> Iterator[Callable[..., Stack]]:
    """Starts `handrail up`; all that was started is ended, and nothing is left of it."""
    with contextlib.ExitStack() as started:

        def start(**options) -> Stack:
            folder = Path(tempfile.mkdtemp(prefix="hr", dir=memory_folder()))
            started.callback(shutil.rmtree, folder, ignore_errors=True)
            stack = Stack(folder, **options)
            started.callback(stack.close)
            return stack

        yield start


@pytest.fixture
def start_stack() -> Iterator[Callable[..., Stack]]:
    """Starts `handrail up` for one test."""
    with stacks() as start:
        yield start


@pytest.fixture(scope="module")
def calm_stack() -> Iterator[Stack]:
    """A stack whose robot is enabled and holds, for all tests that leave it so; `robot` is a client of it."""
    with stacks() as start:
        stack = start()
        stack.wait_up()
        stack.robot = stack.connect()
        stack.robot.enable(60.0)
        yield stack


@pytest.fixture
def running_stack(start_stack) -> Callable[..., Stack]:
    """A stack whose program is turning the valve: the hinge has moved by a third of a radian."""

    def run(**options) -> Stack:
        stack = start_stack(**options)
        stack.wait_up()
        robot = stack.connect()
        stack.robot = robot
        robot.enable(60.0)
        robot.place_instance("wheel_1", "wheel", messages.Pose(position=(0.55, -0.35, 0.30)))
        robot.on(messages.Prompt, lambda prompt: robot.answer(prompt.id, prompt.options[0]))
        ended: list[messages.RunState] = []
        robot.on(messages.RunState, lambda run: ended.append(run) if run.status == "failed" else None)
        robot.run(robot.deploy("turn_valve", {"arm": "right", "valve": "wheel_1"}))

        def turning(sample: messages.GroundTruth) -> bool:
            if ended:
                pytest.fail(f"the run failed: {ended[0].detail}; {robot.status().loop}; {''.join(stack.output)}")
            return sample.hinges["valve"] > 0.3

        stack.truth().until(turning, "turning the valve")
        return stack

    yield run
