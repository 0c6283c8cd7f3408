"""How late a process wakes up that does nothing else: an idle loop with the daemon's own means, and Debian's cyclictest.

    python -m benchmarks.wake_ups SECONDS PERIOD_US PRIORITY CPU     the idle loop: prints its lateness and misses as JSON

Both run as the daemon's loop does, under SCHED_FIFO and on its core.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.realtime import RealTime, sleep_then_spin_until

INSTALL = "apt-get install rt-tests"
_LONGEST_US = 20_000


@dataclass
class WakeUps:
    """Of one loop: µs (k,) by which each cycle started late, and periods that it skipped."""

    late: NDArray[np.float64]
    misses: int


def idle_loop(seconds: float, period_us: int) -> WakeUps:
    """The daemon's loop on the wall clock without its cycle, in a process of its own."""
    from daemon.loop import CPUS, PRIORITY  # its own process must not load all of the loop

    command = [sys.executable, "-m", "benchmarks.wake_ups", *map(str, (seconds, period_us, PRIORITY, CPUS[0]))]
    told = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    return WakeUps(np.array(told["late"]), told["misses"])


def cyclictest(seconds: float, period_us: int) -> WakeUps | str:
    """Debian's, with the priority and the core of the daemon's loop; or why there is none."""
    from daemon.loop import CPUS, PRIORITY

    if shutil.which("cyclictest") is None:
        return f"not installed: {INSTALL}"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cyclictest.json"
        command = ["cyclictest", "--quiet", "--mlockall", f"--priority={PRIORITY}", f"--affinity={CPUS[0]}"]
        command += [f"--interval={period_us}", f"--duration={max(1, round(seconds))}", f"--histogram={_LONGEST_US}"]
        command.append(f"--json={file}")
        done = subprocess.run(command, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode or not file.exists():
            return f"ended with {done.returncode}: {done.stdout.strip().splitlines()[-1:]}"
        return of_cyclictest(file.read_text())


def of_cyclictest(report: str) -> WakeUps:
    """What cyclictest's JSON has about its one thread; what is beyond its histogram counts as its longest."""
    thread = json.loads(report)["thread"]["0"]
    late = [float(us) for us, times in thread["histogram"].items() for _ in range(times)]
    late += [float(thread["max"])] * (thread["cycles"] - len(late))
    return WakeUps(np.array(late), 0)


def _run(seconds: float, period_ns: int, priority: int, cpu: int) -> WakeUps:
    for warning in RealTime(priority=priority, cpus=[cpu]).warnings:
        print(f"idle loop: {warning}", file=sys.stderr)
    late, misses = np.zeros(round(seconds * 1e9 / period_ns)), 0
    deadline = (time.monotonic_ns() // period_ns + 2) * period_ns
    for i in range(len(late)):
        sleep_then_spin_until(deadline)
        late[i] = (time.monotonic_ns() - deadline) * 1e-3
        deadline += period_ns
        if (over := time.monotonic_ns() - deadline) > 0:
            skipped = over // period_ns + 1
            misses += skipped
            deadline += skipped * period_ns
    return WakeUps(late, misses)


if __name__ == "__main__":
    made = _run(float(sys.argv[1]), int(sys.argv[2]) * 1000, int(sys.argv[3]), int(sys.argv[4]))
    print(json.dumps({"late": made.late.round(3).tolist(), "misses": made.misses}))
