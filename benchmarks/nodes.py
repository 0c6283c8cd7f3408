"""What process nodes cost beyond their own work: ``handrail bench nodes``. Only the start is wall time.

The peer of a start is a fresh interpreter with the same imports, which is what a node would be without a warm process to
fork from.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.rows import Row, against
from engines.nodes import shared
from engines.nodes.host import NodeProcess
from engines.nodes.launcher import LAUNCHER
from handrail import usage

NODES, RATE_HZ = 50, 10.0
_MEASURED_S = 10.0
_STARTS = 7
_NODE = """\
import numpy as np
from engines.nodes import Input, Node, Output

class Counter(Node):
    '''Counts its steps, and tells a wrench.'''
    {more}
    add = Input("number")
    count, wrench = Output("number"), Output("wrench")

    def start(self):
        self._count = 0.0

    def step(self):
        self._count += self.add
        self.count, self.wrench = self._count, np.zeros(6)
"""
_IMAGES = 40
_PASS = """\
from engines.nodes import Input, Node, Output, shared

shared.LEAST_BYTES = {least}

class Pass(Node):
    image = Input("array")
    same = Output("array")

    def step(self):
        self.same = self.image
"""


def rows() -> list[Row]:
    """About 20 s."""
    with tempfile.TemporaryDirectory() as folder:
        periodic, asked = Path(folder) / "periodic.py", Path(folder) / "asked.py"
        periodic.write_text(_NODE.format(more=f"every = {1 / RATE_HZ!r}"))
        asked.write_text(_NODE.format(more=""))
        return [*_start(asked), _image(Path(folder)), *_many(periodic)]


def _start(file: Path) -> list[Row]:
    with NodeProcess(file) as process:  # the warm process, and caches
        process.step({"add": 1.0})
        own_mb, shared_mb = usage.memory_mb(process.process.pid)
    assert LAUNCHER.warm_process is not None
    warm, cold = [], []
    for _ in range(_STARTS):
        began = time.perf_counter()
        with NodeProcess(file):
            warm.append(time.perf_counter() - began)
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import engines.nodes.child"], check=True)
        cold.append(time.perf_counter() - began)
    threads = len(os.listdir(f"/proc/{LAUNCHER.warm_process}/task"))
    return [
        against("a node from start to ready", float(np.median(warm)) * 1e3, "ms", "a fresh interpreter's imports",
                float(np.median(cold)) * 1e3, at_most=0.3),
        Row(name="memory of a node beyond its imports (USS)", value=round(own_mb, 1), unit="MB", goal="≤ 20", holds=own_mb <= 20.0,
            peer="its share of all (PSS)", peer_value=round(shared_mb, 1)),
        Row(name="threads of the warm process", value=threads, unit="", goal="1", holds=threads == 1),
    ]  # fmt: skip


def _image(folder: Path) -> Row:
    """A picture of 0.9 MB to a node and back: processor time of both."""
    image = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    cost = []
    usual = shared.LEAST_BYTES
    for least in (usual, 1 << 60):
        file = folder / f"pass_{least}.py"
        file.write_text(_PASS.format(least=least))
        shared.LEAST_BYTES = least
        try:
            with NodeProcess(file) as process:
                process.step({"image": image})
                before = time.process_time() + usage.processor_s(process.process.pid)
                for _ in range(_IMAGES):
                    process.step({"image": image})
                after = time.process_time() + usage.processor_s(process.process.pid)
        finally:
            shared.LEAST_BYTES = usual
        cost.append((after - before) / _IMAGES * 1e3)
    return against("an image to a node and back", cost[0], "ms", "through their socket", cost[1], at_most=0.7)


def _many(file: Path) -> list[Row]:
    told = [0]
    enough = threading.Event()

    def count(outputs: dict[str, object]) -> None:
        told[0] += 1

    with ExitStack() as running:
        nodes = [running.enter_context(NodeProcess(file, told=count)) for _ in range(NODES)]
        for node in nodes:
            node.put({"add": 1.0})
        processes = [node.process.pid for node in nodes]

        def used() -> tuple[float, float]:
            return time.process_time(), sum(map(usage.processor_s, processes))

        before, told_before, began = used(), told[0], time.monotonic()
        enough.wait(_MEASURED_S)
        after, steps, took = used(), told[0] - told_before, time.monotonic() - began
        own_mb = [usage.memory_mb(process)[0] for process in processes]
    host, theirs = (100.0 * (b - a) / took for a, b in zip(before, after, strict=True))
    rate = steps / took
    return [
        Row(name=f"{NODES} nodes at {RATE_HZ:g} Hz, of a core", value=round(host + theirs, 1), unit="%", goal="≤ 25",
            holds=host + theirs <= 25.0, peer="of it in their host", peer_value=round(host, 1)),
        Row(name="steps a second of all", value=round(rate, 1), unit="1/s", goal=f"≥ {0.98 * NODES * RATE_HZ:g}",
            holds=rate >= 0.98 * NODES * RATE_HZ),
        Row(name="memory of each (USS, largest)", value=round(max(own_mb), 1), unit="MB", goal="≤ 20", holds=max(own_mb) <= 20.0),
    ]  # fmt: skip
