"""An hour of the robot's time in lock-step: nothing faults, every cycle is accounted for, memory stays flat (`make soak`)."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from hal.hil.nursery import Process
from hal.hil.robot import Robot
from handrail import messages as m
from handrail.topics import RefusedError
from tests.soaking import SHARE

LENGTH_S = float(os.environ.get("HANDRAIL_SOAK_S", str(3600 * SHARE)))
"""s of the robot's time"""
WARM = 0.1
"""share of it after which memory has come to what it needs"""
GROWTH_MB = 4.0
MOVES = (("arm_right_4_joint", 0.4), ("arm_left_2_joint", 0.3), ("torso_1_joint", 0.2), ("head_2_joint", 0.3))
MOVE_S = 3.0


def held_mb(process: Process) -> float:
    """What a process has written to memory: pages of its programs' files come and go with what else the machine does."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{process.pid}/status").read_text().splitlines())
    return sum(int(status[kind].split()[0]) for kind in ("RssAnon", "RssShmem")) * 1.024e-3


def moved(robot: Robot, joint: str, by: float) -> bool:
    """Move a joint to its end; False where a busy machine kept the server from answering, or this process from checking in."""
    try:
        outcome = robot.move(joint, by, MOVE_S)
    except RefusedError as error:
        assert "gave no answer" in str(error), str(error)
        robot.daemon.wait_status(lambda status: not status.action, "what was asked for has ended", 600.0)
        return False
    assert outcome in ("done", "owner_lost"), outcome
    return outcome == "done"


@pytest.fixture(scope="session")
def small_pages() -> Iterator[None]:
    """numpy has the kernel make large pages of its arrays' small ones, when that likes to: memory then grows by 2 MB at once.

    For the whole session, and before all else: it asks when it is imported, where the processes are forked from.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMPY_MADVISE_HUGEPAGE", "0")
        yield


@pytest.mark.soak
@pytest.mark.timeout(4 * LENGTH_S + 600)
def test_an_hour_in_lock_step_goes_by_without_a_fault_a_lost_cycle_or_growing_memory(
    small_pages, robot, handrail_rig
) -> None:
    daemon, plant = robot.daemon, robot.plant
    period_ns, processes = robot.description.period_ns, [handrail_rig.plant_process, *daemon.processes()]
    daemon.call(m.GetTiming(reset=True))
    plant.look(anew=True)
    plant.wait(0.1)
    before = plant.time_ns
    first: m.LoopTiming = daemon.call(m.GetTiming())
    after = plant.time_ns
    end, warm = before + LENGTH_S * 1e9, before + WARM * LENGTH_S * 1e9
    memory: dict[str, list[float]] = {process.name: [] for process in processes}
    moves = unheard = 0
    for sign in itertools.cycle((1.0, -1.0)):
        for joint, by in MOVES:
            if moved(robot, joint, sign * by):
                moves += 1
            else:
                unheard += 1
        now = plant.time_ns
        if moves % 80 < len(MOVES):
            print(f"an hour: {(now - before) * 1e-9:.0f} of {LENGTH_S:.0f} s, {moves} motions", flush=True)
        if now > warm:
            for process in processes:
                memory[process.name].append(held_mb(process))
        if now > end:
            break
    status = daemon.wait_status(lambda status: status.enabled, "still enabled")
    assert {drive.state for drive in status.drives} == {"operation_enabled"}
    assert plant.look().transitions == [], "no drive has left operation since it was enabled"
    earliest = plant.time_ns - after
    last: m.LoopTiming = daemon.call(m.GetTiming())
    latest = plant.time_ns - before
    assert (last.misses, sum(last.late.counts)) == (0, 0), "in lock-step no cycle is late, and none is skipped"
    cycles = last.cycles - first.cycles
    assert earliest // period_ns - 1 <= cycles <= latest // period_ns + 1
    assert sum(last.work.counts) == last.cycles
    for name, seen in memory.items():
        steps = " ".join(f"{mb:.1f}" for mb in seen[:: max(len(seen) // 40, 1)])
        assert max(seen) - seen[0] < GROWTH_MB, f"{name}: {seen[0]:.1f} MB, then up to {max(seen):.1f} MB: {steps}"
    told = ", ".join(f"{name} {seen[0]:.1f} to {seen[-1]:.1f} MB" for name, seen in memory.items())
    assert unheard <= 1 + moves // 50, "a busy machine is no excuse for more"
    print(f"{cycles} cycles, {moves} motions, {unheard} unheard; {told}")
    print(f"work p99 {last.work.p99_us:.0f} µs, longest {last.work.max_us:.0f} µs")
