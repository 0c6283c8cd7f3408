"""A control loop's port with the plant right behind it, in one process: no bus between, and time moves by Sync alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.plant.bus_node import BusNode
from hal.plant.drive_node import STEP_NS
from hal.plant.world import World


class DirectPort:
    """hal.can.port.Port on a world: it steps one period of the robot at every Sync, and then the drives answer."""

    def __init__(self, world: World):
        self.world = world
        self.counters = np.zeros((len(world.description.channels), 3), np.int64)
        self.refused = self.lost = 0
        self._node = BusNode(world)
        self._steps = world.description.period_ns // STEP_NS
        self._answers = self._node.answer()

    def send(self, records: npt.NDArray[np.void]) -> None:
        syncs, _ = self._node.receive(records)
        if syncs:
            self.advance(syncs * self._steps)
        self._answers = self._node.answer()

    def advance(self, steps: int) -> None:
        """Let so many ms go by; who watches or pushes in between does it here."""
        self.world.advance(steps)

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        answers, self._answers = self._answers, self._answers[:0]
        return answers

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self.world.close()
