"""What a test waits for at the plant's door is answered when it comes, not looked for again and again."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
import zmq

from hal.drives.lifecycle import State
from hal.hil import door
from hal.hil.door import Await, Done, Look, No
from hal.hil.plant_process import Doorkeeper, WatchedWorld
from handrail.runtime import Runtime, memory_folder


class Still:
    """A world that the test moves on; it answers with its time."""

    has_come = WatchedWorld.has_come

    def __init__(self) -> None:
        self.time_ns = 0
        self.description = SimpleNamespace(name="two", joints=("a", "b"))
        self.drives = SimpleNamespace(state=np.full(2, State.SWITCH_ON_DISABLED, np.uint8))

    def answer(self, request: Any) -> Done:
        return Done(self.time_ns)


class Asker:
    """A test's side, and the plant's turns of the bus."""

    def __init__(self, runtime: Runtime, context: zmq.Context):
        self.world = Still()
        self.keeper = Doorkeeper(SimpleNamespace(poll=lambda timeout_s: np.zeros(0)), self.world, runtime)  # type: ignore[arg-type]
        self.socket = context.socket(zmq.REQ)
        self.socket.connect(door.endpoint(runtime))

    def ask(self, request: Any) -> None:
        self.socket.send(door.encode(request))
        assert self.keeper._door.poll(30_000), "it has arrived"

    def told(self) -> Any:
        """The answer, after a turn of the bus; None: there is none yet."""
        self.keeper.poll()
        if self.keeper._awaited is not None:
            return None
        assert self.socket.poll(30_000)
        return msgspec.msgpack.decode(self.socket.recv(), type=Done | No)


@pytest.fixture
def asker() -> Iterator[Asker]:
    folder = tempfile.mkdtemp(prefix="door", dir=memory_folder())
    made = Asker(Runtime.at(folder), zmq.Context.instance())
    with contextlib.closing(made.socket), contextlib.closing(made.keeper._door):
        made.socket.setsockopt(zmq.LINGER, 0)
        yield made
    shutil.rmtree(folder)


def test_a_moment_is_answered_when_it_has_come_and_then_others_are_let_in(asker: Asker) -> None:
    asker.ask(Await(until_ns=5, patience_s=1e9))
    for time_ns in (1, 4):
        asker.world.time_ns = time_ns
        assert asker.told() is None
    asker.world.time_ns = 6
    assert asker.told() == Done(6)
    asker.ask(Look())
    assert asker.told() == Done(6)


def test_a_state_is_answered_when_all_the_drives_asked_for_are_in_it(asker: Asker) -> None:
    asker.ask(Await(joints=["a", "b"], state="operation_enabled", patience_s=1e9))
    asker.world.drives.state[0] = State.OPERATION_ENABLED
    assert asker.told() is None
    asker.world.drives.state[1] = State.OPERATION_ENABLED
    assert asker.told() == Done(0)


def test_whoever_waits_for_what_does_not_come_is_told_so_after_his_patience(asker: Asker) -> None:
    asker.ask(Await(until_ns=5, patience_s=0.0))
    assert asker.told() == Done(0)
    asker.ask(Await(joints=["c"], state="fault"))
    assert isinstance(asker.told(), No)
