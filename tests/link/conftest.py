"""A gate between a fake daemon and engine (real services, no robot) and real clients."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import zmq

from handrail.client import Client, connect
from handrail.link import codec, keys
from handrail.link.gate import Gate
from handrail.messages import (
    DaemonCall,
    DaemonStatus,
    DriveStatus,
    EngineCall,
    EngineSnapshot,
    GetEngine,
    GetRobot,
    GetStatus,
    InstanceState,
    LoopStatistics,
    MakePlan,
    PlaceInstance,
    RobotInfo,
)
from handrail.runtime import Runtime
from handrail.topics import Publisher, Service, refuse

ROBOT = RobotInfo(
    name="talos_upper",
    joints=["arm_right_1_joint"],
    lower=[-1.0],
    upper=[1.0],
    velocity_limit=[2.0],
    torque_limit=[40.0],
    groups={},
    tools={"right": "tool_right"},
    tips={},
    arms={},
    home={"ready": {"arm_right_1_joint": 0.0}},
    period_ns=2_000_000,
)


def status(time_ns: int = 0, *, enabled: bool = False, drives: Sequence[DriveStatus] = ()) -> DaemonStatus:
    return DaemonStatus(
        time_ns=time_ns,
        clock="lockstep",
        enabled=enabled,
        stopped=False,
        drives=list(drives),
        controllers={},
        loop=LoopStatistics(),
        buses=[],
    )


def place(call: PlaceInstance) -> InstanceState:
    return InstanceState(
        name=call.name,
        template=call.template,
        template_hash="0",
        version=1,
        pose_in_world=call.pose_in_world,
        parameters=call.parameters,
        joint_state={},
    )


class HeardPublisher(Publisher):
    """A publisher that knows who listens: what is sent before a subscription has arrived nobody gets."""

    def __init__(self, endpoint: str):
        self._socket = zmq.Context.instance().socket(zmq.XPUB)
        self._socket.setsockopt(zmq.XPUB_VERBOSER, 1)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SNDHWM, 2000)
        self._socket.bind(endpoint)

    def wait_for_gate(self, timeout_s: float = 30.0) -> None:
        """Until a gate that has just been started has subscribed to everything that it passes on."""
        left = len(codec.REMOTE_EVENTS)
        while left:
            assert self._socket.poll(round(timeout_s * 1000)), f"{left} subscriptions have not come"
            left -= self._socket.recv().startswith(b"\x01")


class FakeService:
    """A daemon or engine that keeps what it is asked and answers what it is told to; publishes on demand."""

    def __init__(self, runtime: Runtime, name: str, kinds: Any):
        self.asked: list[Any] = []
        self.answers: dict[type, Callable[[Any], Any]] = {}
        self._service = Service(runtime.endpoint(f"{name}.call"), kinds, self._handle)
        self.publisher = HeardPublisher(runtime.endpoint(f"{name}.events"))
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _handle(self, message: Any) -> Any:
        self.asked.append(message)
        answer = self.answers.get(type(message))
        return answer(message) if answer else None

    def _run(self) -> None:
        with contextlib.suppress(SystemExit):  # a test lets it die in the middle of a call
            while not self._stop.is_set():
                self._service.poll(0.02)

    def publish(self, message: Any) -> None:
        with self._lock:
            self.publisher.send(message)

    def close(self) -> None:
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            self._service.close()
            self.publisher.close()


class RunningGate:
    """A gate that serves in a thread of its own."""

    def __init__(self, runtime: Runtime, folder: Path, port: int):
        self._loop = asyncio.new_event_loop()
        self._until = asyncio.Event()
        started = threading.Event()

        async def serve() -> None:
            ready = asyncio.Event()
            serving = asyncio.create_task(Gate(runtime, keys.for_gate(folder), port=port).serve(self._until, ready))
            await ready.wait()
            started.set()
            await serving

        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(serve()))
        self._thread.start()
        assert started.wait(5)

    def close(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._until.set)
            self._thread.join()
            self._loop.close()


class Stand:
    """Everything that a test of the link needs, started on demand and closed at its end."""

    status = staticmethod(status)

    def __init__(self, folder: Path):
        self.runtime = Runtime.at(folder / "r")
        self.keys = keys.ensure(folder / "keys")
        self.port = free_ports()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._open: list[Any] = []

    def daemon(self) -> FakeService:
        service = self.service("daemon", DaemonCall)
        service.answers[GetRobot] = lambda _: ROBOT
        service.answers[GetStatus] = lambda _: status()
        return service

    def service(self, name: str, kinds: Any) -> FakeService:
        return self._keep(FakeService(self.runtime, name, kinds))

    def engine(self) -> FakeService:
        service = self.service("engine", EngineCall)
        service.answers[PlaceInstance] = place
        service.answers[GetEngine] = lambda _: EngineSnapshot(instances=[], plans=[], run=None, prompts=[])

        def infeasible(call: MakePlan) -> None:
            raise refuse("out of reach", "instance", call.instance, "within 0.9 m")

        service.answers[MakePlan] = infeasible
        return service

    def sensors(self) -> HeardPublisher:
        """What a camera's process publishes on."""
        return self._keep(HeardPublisher(self.runtime.endpoint("sensors.events")))

    def gate(self) -> RunningGate:
        """A gate that hears what all that were started before it publish from now on."""
        gate = self._keep(RunningGate(self.runtime, self.keys, self.port))
        for each in self._open:
            publisher = each.publisher if isinstance(each, FakeService) else each
            if isinstance(publisher, HeardPublisher):
                publisher.wait_for_gate()
        return gate

    def client(self, folder: Path | None = None, timeout_s: float = 30.0) -> Client:
        return self._keep(connect(self.address, folder or self.keys, timeout_s=timeout_s))

    def _keep(self, what: Any) -> Any:
        self._open.append(what)
        return what

    def close(self) -> None:
        for what in reversed(self._open):
            what.close()


def free_ports() -> int:
    """A port that is free, and so is the next one."""
    while True:
        with closing(socket.socket()) as first, closing(socket.socket()) as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


@pytest.fixture
def stand() -> Iterator[Stand]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    stand = Stand(folder)
    yield stand
    stand.close()
    shutil.rmtree(folder)
