"""What placed templates cost the link, and one edit among many: a part of ``handrail bench templates``.

An engine and a gate as processes of their own; two clients, one of whom drags. Bytes are those of events as the client counts them.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from affordance_templates.server import AffordanceServer
from benchmarks.rows import Row
from handrail.client import Client, connect
from handrail.demo.children import Children
from handrail.link import keys
from handrail.messages import EditInstance, InstanceState, PlaceInstance, Pose
from handrail.runtime import Runtime, memory_folder

_MANY = 100
_QUIET_S = 5.0
_DRAG_S = 3.0
_MOST_HZ = 30.0
_EDITS = 200
_MOST_MS = 10.0
_PORT = 48410
_START_S = 180.0
_ARRIVES_S = 10.0


def rows(robot: str = "talos_upper") -> list[Row]:
    """Over a link, and of the server alone."""
    with tempfile.TemporaryDirectory(dir=memory_folder(), prefix="handrail-bench-") as folder:
        runtime, own = Runtime.at(Path(folder) / "run"), keys.ensure(Path(folder) / "keys")
        with Children(runtime.folder / "logs") as children:
            engine = children.start("engine", _command("engines.engine", "--robot", robot, runtime=runtime))
            link = children.start(
                "link", _command("handrail.link.gate", "--port", str(_PORT), "--keys", str(own), runtime=runtime)
            )
            engine.wait_for("engine ready", _START_S)
            link.wait_for("link ready", _START_S)
            address = f"tcp://127.0.0.1:{_PORT}"
            with connect(address, own, timeout_s=30.0) as one, connect(address, own, timeout_s=30.0) as other:
                over_the_link = _over_the_link(one, other)
        return [*over_the_link, _edit(Path(folder))]


def _over_the_link(one: Client, other: Client) -> list[Row]:
    heard: list[InstanceState] = []
    last: InstanceState | None = None
    with other.on(InstanceState, heard.append):  # as it comes: of what waits to be read only the newest is kept
        for number in range(_MANY):
            last = one.place_instance(f"box_{number}", "box", Pose(position=(0.5, 0.01 * number, 0.0)))
        _until(lambda: last in heard)
        before, count = other.traffic[1], len(heard)
        time.sleep(_QUIET_S)
        quiet, unasked = other.traffic[1] - before, len(heard) - count
        count = len(heard)
        begun, edits = time.monotonic(), 0
        while time.monotonic() - begun < _DRAG_S:
            edits += 1
            last = one.edit_instance("box_0", position=(0.5, 0.0, 0.001 * edits)).instance
        took = time.monotonic() - begun
        arrived = _until(lambda: heard[-1] == last)
    rate = (len(heard) - count - 1) / took
    late = len({each.name for each in other.snapshot().instances})
    return [
        Row(name=f"{_MANY} instances, none changes for {_QUIET_S:g} s", value=quiet, unit="bytes", goal="0",
            holds=quiet == 0 == unasked),
        Row(name=f"one of them dragged with {edits / took:.0f} edits/s, its last place told", value=round(rate, 1),
            unit="told/s", goal=f"≤ {_MOST_HZ:g}", holds=rate <= _MOST_HZ and arrived),
        Row(name="told to who comes late", value=late, unit="instances", goal=f"{_MANY}", holds=late == _MANY),
    ]  # fmt: skip


def _edit(folder: Path) -> Row:
    server = AffordanceServer(folder / "instances.json")
    for number in range(_MANY):
        server.place(PlaceInstance(name=f"wheel_{number}", template="wheel", pose_in_world=Pose()))
    begun = time.process_time()
    for number in range(_EDITS):
        server.edit(EditInstance(name="wheel_0", position=(0.001 * number, 0.0, 1.0)))
    taken = 1000 * (time.process_time() - begun) / _EDITS
    return Row(name=f"an edit of one of {_MANY}, on disk", value=round(taken, 2), unit="ms", goal=f"≤ {_MOST_MS:g} ms",
               holds=taken <= _MOST_MS)  # fmt: skip


def _until(so: Callable[[], bool]) -> bool:
    """Whether it is so, within a few seconds."""
    until = time.monotonic() + _ARRIVES_S
    while not so() and time.monotonic() < until:
        time.sleep(0.02)
    return so()


def _command(module: str, *more: str, runtime: Runtime) -> list[str]:
    return [sys.executable, "-m", module, *more, "--runtime", str(runtime.folder)]
