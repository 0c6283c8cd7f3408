"""Whether the loop notices that controllers are loaded and switched beside it: ``handrail bench switching``. About 60 s.

Plant, loop and server run as processes on the wall clock, the robot holds. Turns of nothing else alternate with turns in which
controllers are switched on and off and listed as fast as the daemon answers, and with turns in which they are loaded (made,
rehearsed) and unloaded; the loop's own histograms say how late its cycles started in each. The idle turns are the peer.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.rows import Row
from daemon.timing import BINS, distribution
from handrail.demo.children import Children
from handrail.messages import (
    ControllerList,
    Enable,
    GetControllers,
    GetHardware,
    GetRobot,
    GetSafety,
    GetStatus,
    GetTiming,
    LoadController,
    LoopTiming,
    RobotInfo,
    SwitchControllers,
    UnloadController,
)
from handrail.runtime import Runtime, memory_folder
from handrail.topics import Caller

ROBOT, SCENE = "talos_upper", "empty"
_START_S, _PATIENCE_S = 180.0, 30.0
_TURNS, _TURN_S = 4, 4.0
_SLACK = 1.2
"""what a percentile of one run may be more than another one's by chance; histograms have bins of an eighth of an octave"""
_UNNOTICED_US = 200.0
"""a tenth of the period: frames that are so late are answered in the same cycle. Of cycles in a hundred the p99 is a matter of what
else wants the cores, the calls of this benchmark among it"""


_ASKED = (GetControllers(), GetHardware(), GetSafety(), GetStatus())
"""what `handrail controllers list`, `hardware status`, `safety explain` and clients ask: one after each round of switches"""


def rows() -> list[Row]:
    """Lateness while switching, beside that of idle turns; misses; what was done meanwhile."""
    with _daemon() as runtime, closing(Caller(runtime.endpoint("daemon.call"), timeout_s=5.0)) as caller:
        caller.call(Enable())
        _wait(lambda: caller.call(GetStatus()).enabled, "the robot is enabled")
        joints = caller.call(GetRobot())
        turns: dict[str, list[LoopTiming]] = {"idle": [], "switching": [], "loading": []}
        done = {"switching": 0, "loading": 0}
        for _ in range(_TURNS):
            turns["idle"].append(_timed(caller, lambda: time.sleep(_TURN_S))[0])
            _load(caller, joints)
            for name, work in (("switching", _switch), ("loading", _load_anew)):
                timing, count = _timed(caller, partial(work, caller, joints))
                turns[name].append(timing)
                done[name] += count or 0
            _unload(caller)
    return [row for name in done for row in _beside(name, turns, done[name] / (_TURNS * _TURN_S))]


def _beside(name: str, turns: dict[str, list[LoopTiming]], rate: float) -> list[Row]:
    late = [
        Row(
            name=f"lateness while {name}, {share}",
            value=round(there, 1),
            unit="µs",
            peer="idle turns",
            peer_value=round(here, 1),
            ratio=round(there / here, 2),
            goal=f"≤ {_SLACK:g}× idle, or {_UNNOTICED_US:g} µs" if share == "p99" else f"≤ {_SLACK:g}× idle",
            holds=there <= max(_SLACK * here, _UNNOTICED_US if share == "p99" else 0.0),
        )
        for share, here, there in zip(("p50", "p90", "p99"), _late(turns["idle"]), _late(turns[name]), strict=True)
    ]
    missed, missed_idle = (sum(timing.misses for timing in turns[which]) for which in (name, "idle"))
    misses = Row(
        name=f"periods missed while {name}",
        value=missed,
        unit="periods",
        peer="idle turns",
        peer_value=missed_idle,
        goal="≤ 3 more than idle",
        holds=missed <= missed_idle + 3,
    )
    return [
        *late,
        misses,
        Row(name=f"{name}, how often", value=round(rate, 1), unit="1/s", goal="≥ 1", holds=rate >= 1.0),
    ]


@contextmanager
def _daemon() -> Iterator[Runtime]:
    folder = Path(tempfile.mkdtemp(prefix="handrail-bench-", dir=memory_folder()))
    common = ["--robot", ROBOT, "--clock", "wall", "--runtime", str(folder)]
    modules = {"plant": ["hal.plant.world", "--scene", SCENE], "loop": ["daemon.loop"], "server": ["daemon.server"]}
    try:
        with Children(folder / "logs") as children:
            for name, words in modules.items():
                children.start(name, [sys.executable, "-m", *words, *common]).wait_for(f"{name} ready", _START_S)
            yield Runtime.at(folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _timed(caller: Caller, work) -> tuple[LoopTiming, int | None]:  # type: ignore[no-untyped-def]
    """What the loop counted while `work` was done, and what that returned."""
    caller.call(GetTiming(reset=True))
    _wait(lambda: caller.call(GetTiming()).cycles > 0, "the loop counts anew")
    made = work()
    return caller.call(GetTiming()), made


def _load(caller: Caller, robot: RobotInfo) -> None:
    for number, side in enumerate(("left", "right")):
        arm = [joint for joint in robot.joints if side in joint]
        caller.call(LoadController(name=f"c{number}", kind="joint_impedance", joints=arm))
    _wait(lambda: _states(caller) == {"c0": "inactive", "c1": "inactive"}, "both are made")


def _unload(caller: Caller) -> None:
    for number in range(2):
        caller.call(UnloadController(name=f"c{number}"))


def _switch(caller: Caller, _: RobotInfo) -> int:
    """Switch on and off, and ask what there is, until the turn is over; how many switches were made."""
    ends, made = time.monotonic() + _TURN_S, 0
    while time.monotonic() < ends:
        caller.call(SwitchControllers(activate=["c0", "c1"]))
        caller.call(SwitchControllers(activate=["c0"], deactivate=["c0", "c1"]))
        caller.call(SwitchControllers(deactivate=["c0"]))
        caller.call(_ASKED[made // 3 % len(_ASKED)])
        made += 3
    return made


def _load_anew(caller: Caller, robot: RobotInfo) -> int:
    """Unload and load until the turn is over; how many controllers were made."""
    ends, made = time.monotonic() + _TURN_S, 0
    while time.monotonic() < ends:
        _unload(caller)
        _load(caller, robot)
        made += 2
    return made


def _states(caller: Caller) -> dict[str, str]:
    told: ControllerList = caller.call(GetControllers())
    return {info.name: info.state for info in told.controllers if info.name.startswith("c")}


def _late(turns: list[LoopTiming]) -> tuple[float, float, float]:
    """µs: percentiles of all cycles of these turns."""
    counts = np.sum([timing.late.counts for timing in turns], axis=0)
    assert len(counts) == BINS
    longest = max(timing.late.max_us for timing in turns)
    whole = distribution(counts, round(longest * 1e3))
    return whole.p50_us, whole.p90_us, whole.p99_us


def _wait(done, what: str) -> None:  # type: ignore[no-untyped-def]
    gives_up = time.monotonic() + _PATIENCE_S
    while not done():
        if time.monotonic() > gives_up:
            raise TimeoutError(f"not within {_PATIENCE_S:g} s: {what}")
        time.sleep(0.02)
