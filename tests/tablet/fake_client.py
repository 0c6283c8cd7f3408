"""What `handrail.connect` would return, on a robot that only answers."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from handrail.client import Live, Selection
from handrail.messages import (
    GetEngine,
    GetInstances,
    Stop,
)
from handrail.topics import Unreachable

if TYPE_CHECKING:
    from tests.tablet.fake_robot import FakeRobot


class ChosenStream:
    """Events that were chosen, until it is closed."""

    def __init__(self, robot: FakeRobot, chosen: tuple[Selection, ...]):
        self.chosen, self._robot = chosen, robot
        self._waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
        robot.chosen.append(self)

    def put(self, event: Any) -> None:
        if event is None or any(type(event) is each.kind and each.wants(event) for each in self.chosen):
            self._waiting.put(event)

    def __iter__(self) -> Iterator[Any]:
        while (event := self._waiting.get()) is not None:
            yield event

    def close(self) -> None:
        if self in self._robot.chosen:
            self._robot.chosen.remove(self)
        self._waiting.put(None)


class FakeClient:
    """What `handrail.connect` would return, without a network."""

    def __init__(self, robot: FakeRobot):
        self._robot = robot
        self._stream: queue.SimpleQueue[Any] = queue.SimpleQueue()

    @property
    def traffic_by_kind(self) -> dict[str, int]:
        return dict(self._robot.traffic)

    def call(self, message: Any, timeout_s: float | None = None) -> Any:
        robot = self._robot
        if not robot.reachable:
            raise Unreachable("nobody is there")
        if isinstance(message, GetEngine | GetInstances) and not robot.engine_there:
            raise Unreachable("the engine is not running; nothing was done")
        if robot.hanging.is_set() and not isinstance(message, Stop):
            robot.released.wait(10)
            raise Unreachable("hung")
        return robot.answer(message)

    def events(self, *kinds: type, timeout_s: float = 5.0) -> Iterator[Any]:
        self._robot._streams.append(self._stream)
        self._stream.put(Live())
        while (event := self._stream.get()) is not None:
            if isinstance(event, kinds):
                yield event

    def subscribe(self, *chosen: Selection, timeout_s: float = 5.0) -> ChosenStream:
        return ChosenStream(self._robot, chosen)

    def close(self) -> None:
        self._stream.put(None)
        for stream in list(self._robot.chosen):
            stream.close()
        self._robot.released.set()
