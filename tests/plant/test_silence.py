"""When a lock-step world runs free: when its host is silent, and not when the plant itself was late to listen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from hal.plant import service
from hal.plant.service import SILENCE_S, Service

NOTHING = np.zeros(0)
SYNC = np.zeros(1)


class Hub:
    """A bus whose every poll takes so many s and hears so much; then the service is stopped."""

    def __init__(self, script: Sequence[tuple[float, np.ndarray]], pass_time: Callable[[float], None]):
        self.script, self.pass_time = list(script), pass_time
        self.careful, self.heard = False, None
        self.stop: Callable[[], None] = lambda: None

    def own_nodes(self, names, channels) -> None: ...
    def lockstep(self, period, sync, hold) -> None: ...
    def owe_ticks(self, syncs) -> None: ...
    def tick(self) -> None: ...
    def deaf(self) -> None: ...

    def poll(self, wait: float) -> np.ndarray:
        if not self.script:
            self.stop()
            return NOTHING
        takes, records = self.script.pop(0)
        self.pass_time(takes)
        return records


class Node:
    """Drives that have nothing to say."""

    names, channels, sync_id, hold_id = (), (), 0x80, 0x81

    def __init__(self, world) -> None: ...

    def receive(self, records, deaf) -> tuple[int, int]:
        return len(records), 0

    def replies(self) -> np.ndarray:
        return NOTHING

    answer = replies


@pytest.fixture
def free_runs(monkeypatch):
    now = [100.0]

    def pass_time(seconds: float) -> None:
        now[0] += seconds

    def free_runs(script: Sequence[tuple[float, np.ndarray]], stepping_s: float = 0.0) -> int:
        def go_on(steps: int) -> int:
            pass_time(stepping_s)
            return steps

        description = SimpleNamespace(period_ns=2_000_000)
        world = SimpleNamespace(description=description, steps=1, go_on=go_on, catch_up=lambda felt: None)
        hub = Hub(script, pass_time)
        plant = Service(world, hub)
        hub.stop = plant.stop
        plant.run_lockstep()
        return plant.free_runs

    monkeypatch.setattr(service, "BusNode", Node)
    monkeypatch.setattr(service, "time", SimpleNamespace(monotonic=lambda: now[0]))
    return free_runs


def test_a_host_that_is_silent_for_long_enough_has_the_world_run_free(free_runs):
    assert free_runs([(0.0, SYNC), (0.2, NOTHING), (0.2, NOTHING), (0.2, NOTHING)]) == 1
    assert free_runs([(0.0, SYNC), (0.2, NOTHING), (0.2, NOTHING), (0.05, SYNC), (0.2, NOTHING)]) == 0


def test_a_plant_that_was_not_let_run_hears_what_came_meanwhile_before_it_runs_free(free_runs):
    assert free_runs([(0.0, SYNC), (2 * SILENCE_S, NOTHING), (0.0, SYNC)]) == 0


def test_the_time_that_a_step_takes_is_none_of_the_hosts_silence(free_runs):
    assert free_runs([(0.0, SYNC), (0.2, NOTHING), (0.0, SYNC), (0.2, NOTHING)], stepping_s=2 * SILENCE_S) == 0
