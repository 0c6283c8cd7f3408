"""What the virtual bus carries between two processes, and how true its bit timing is: ``handrail bench hal_hub``.

One process sends 64-byte CAN FD frames as fast as they are taken; this one receives them with the hub inside it, as the plant
does. python-can's `udp_multicast`, the bus that it offers between processes without a driver, does the same in turns with it.
For bit timing the hub is a process of its own on the wall clock, and is offered more than its bus can carry.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np

from benchmarks.rows import Row
from hal.can import frames
from hal.can.hub import Hub
from hal.can.port import HubPort
from hal.can.timing import frame_ns

_TURNS = 5
_FRAMES = {1: 40_000, 8: 400_000}
"""frames of one measurement, by how many a datagram carries"""
_UDP_FRAMES = 8_000
_TIMED_S = 2.0
_PATIENCE_S = 20.0
_GROUP, _PORT = "239.74.163.2", 43113

_SENDER = """
import select, sys
from hal.can import frames
from hal.can.port import HubPort
path, batch, total = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
records = frames.empty(batch)
records["can_id"], records["length"], records["flags"] = 0x123, 64, frames.FD | frames.BRS
records["data"] = 0x5A
port = HubPort(path)
room = select.poll()
room.register(port.fileno(), select.POLLOUT)
print("ready", flush=True)
sys.stdin.readline()
left = total // batch
while left:
    before = port.refused
    port.send(records)
    if port.refused == before:
        left -= 1
    else:
        room.poll()
sys.stdin.readline()
"""

_UDP_SENDER = """
import sys
import can
bus = can.Bus(interface="udp_multicast", channel=sys.argv[1], port=int(sys.argv[2]), fd=True)
message = can.Message(arbitration_id=0x123, is_extended_id=False, is_fd=True, bitrate_switch=True, data=bytes(64))
print("ready", flush=True)
sys.stdin.readline()
for _ in range(int(sys.argv[3])):
    bus.send(message)
print("sent", flush=True)
sys.stdin.readline()
bus.shutdown()
"""


@contextlib.contextmanager
def _other(script: str, *arguments: object) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", script, *map(str, arguments)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _say(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


def _through_hub(folder: Path, batch: int) -> tuple[float, int]:
    """(frames/s, frames lost) from one sender, `batch` frames a datagram, to this process with the hub in it."""
    total = _FRAMES[batch]
    with (
        contextlib.closing(Hub(folder / "bus.sock", ["can0"])) as hub,
        _other(_SENDER, folder / "bus.sock", batch, total) as sender,
    ):
        assert sender.stdout is not None
        while hub.listeners < 1:
            hub.poll(0.1)
        sender.stdout.readline()
        _say(sender)
        # The clock starts with the first frames, which are not counted.
        first = len(hub.poll(_PATIENCE_S))
        start, got = time.perf_counter(), first
        while got < total and (more := len(hub.poll(_PATIENCE_S))):
            got += more
        return (got - first) / (time.perf_counter() - start), total - got


def _through_udp() -> tuple[float, int]:
    """(frames/s, frames lost) of python-can's udp_multicast."""
    with (
        can.Bus(interface="udp_multicast", channel=_GROUP, port=_PORT, fd=True) as bus,
        _other(_UDP_SENDER, _GROUP, _PORT, _UDP_FRAMES) as sender,
    ):
        assert sender.stdout is not None
        sender.stdout.readline()
        _say(sender)
        got, start, last = 0, 0.0, 0.0
        while got < _UDP_FRAMES and bus.recv(1.0) is not None:
            last = time.perf_counter()
            start = start or last
            got += 1
        return got / (last - start), _UDP_FRAMES - got


@contextlib.contextmanager
def _urgent() -> Iterator[None]:
    """A real-time process where that is permitted, as the robot's loop is: who offers too little fills no bus."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(50))
    except PermissionError:
        yield
        return
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _timed(folder: Path) -> tuple[float, float]:
    """(µs a frame as they arrive by the wall clock, µs a frame by its bits) on a bus that is offered too much."""
    command = [sys.executable, "-m", "hal.can.hub_process", "--runtime", str(folder), "--timing"]
    with _urgent(), subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            process.stdout.readline()
            sender, listener = HubPort(folder / "bus.sock"), HubPort(folder / "bus.sock")
            batch = frames.empty(32)
            batch["can_id"], batch["length"], batch["flags"] = 0x123, 64, frames.FD | frames.BRS
            rng = np.random.default_rng(0)
            batch["data"] = rng.integers(0, 256, (32, 64))
            counted, needed, first, last = 0, 0, 0.0, 0.0
            for turn in itertools.count():
                if turn % 2 == 0:
                    sender.send(batch)
                records = listener.receive(0.002)
                now = time.perf_counter()
                if len(records):
                    if first:
                        counted += len(records)
                        words = frames.words(records)
                        needed += sum(frame_ns(words, row, 1_000_000, 5_000_000) for row in range(len(records)))
                    first, last = first or now, now
                if first and now - first > _TIMED_S:
                    break
            sender.close()
            listener.close()
            return (last - first) / counted * 1e6, needed / counted * 1e-3
        finally:
            process.terminate()


def rows() -> list[Row]:
    """One row a way to use the bus; medians over turns. About 15 s."""
    with tempfile.TemporaryDirectory(prefix="hr") as name:
        folder = Path(name)
        turns = [(_through_hub(folder, 1), _through_hub(folder, 8), _through_udp()) for _ in range(_TURNS)]
        singly, batches, udp = (float(np.median([turn[way][0] for turn in turns])) for way in range(3))
        lost, lost_in_batches, lost_by_udp = (sum(turn[way][1] for turn in turns) for way in range(3))
        arrives, bits = _timed(folder)
    return [
        _at_least("hub, FD frames singly", singly, 100_000, lost),
        _at_least("hub, FD frames 8 a datagram", batches, 1_000_000, lost_in_batches),
        Row(
            name="hub against python-can, singly",
            value=round(singly),
            unit="frames/s",
            goal="ratio ≥ 4",
            holds=singly >= 4 * udp,
            peer=f"udp_multicast ({lost_by_udp} of {_TURNS * _UDP_FRAMES} lost)",
            peer_value=round(udp),
            ratio=round(singly / udp, 2),
        ),
        Row(
            name="frame on a full bus with bit timing",
            value=round(arrives, 2),
            unit="µs/frame",
            goal="ratio 0.95 to 1.05",
            holds=0.95 <= arrives / bits <= 1.05,
            peer="its bits at 1/5 Mbit/s",
            peer_value=round(bits, 2),
            ratio=round(arrives / bits, 4),
        ),
    ]


def _at_least(name: str, value: float, goal: float, lost: int) -> Row:
    said = f"≥ {goal:,.0f}, none lost" if not lost else f"≥ {goal:,.0f}, none lost; {lost} were"
    return Row(name=name, value=round(value), unit="frames/s", goal=said, holds=value >= goal and not lost)
