"""Firmware in any language joins the bus by the format that docs/can.md describes: the examples there do."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from hal.can import frames, wire
from hal.can.control import HubControl
from hal.can.port import HubPort

ROOT = Path(__file__).parents[2]
Make = Callable[..., np.ndarray]


@pytest.fixture(scope="module", params=["c", "python"])
def node(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The command that runs the example."""
    if request.param == "python":
        return [sys.executable, "-I", str(ROOT / "examples" / "can_node.py")]
    if shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    program = tmp_path_factory.mktemp("c") / "can_node"
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1"]
    subprocess.run(["cc", *flags, "-o", str(program), str(ROOT / "examples" / "can_node.c")], check=True)
    return [str(program)]


def _sync(make_frames: Make, cycle: int) -> np.ndarray:
    record = make_frames([0x080], bus=1, length=4)
    record["data"][0, :4] = np.frombuffer(cycle.to_bytes(4, "little"), np.uint8)
    return record


def test_a_process_without_our_code_joins_answers_and_is_known_by_name(
    node: list[str], folder: Path, hub_process: subprocess.Popen[str], make_frames: Make
) -> None:
    command = [*node, str(folder / "bus.sock"), "can1"]
    with closing(HubPort(folder / "bus.sock", ["can0", "can1"])) as port:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        with process:
            assert process.stdout is not None and process.stdout.readline() == "can_node ready\n"
            control = HubControl(folder / "bus.sock")
            assert ("thermometer", "can1") in {(n.name, n.channel) for n in control.report().nodes}
            control.close()
            for count, cycle in enumerate((7, 1000)):
                port.send(make_frames([0x081, 0x100], bus=1))  # for others
                port.send(_sync(make_frames, cycle))
                got = port.receive(5.0)
                assert (got["can_id"].tolist(), got["bus"].tolist()) == ([0x500], [1])
                assert (got["flags"][0], got["length"][0]) == (frames.FD | frames.BRS, 8)
                said = bytes(got["data"][0, :8])
                assert said[:7] == cycle.to_bytes(4, "little") + (215).to_bytes(2, "little") + bytes([count])
                assert said[7] == int(np.bitwise_xor.reduce(np.frombuffer(said[:7], np.uint8)))
            hub_process.terminate()
            assert process.wait(5) == 0  # it ends with the bus


def test_a_refusal_reaches_a_process_without_our_code(node: list[str], running: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [*node, str(running / "bus.sock"), "can9"], check=False, capture_output=True, text=True, timeout=10
    )
    assert done.returncode == 1 and "the hub says: " in done.stderr and "can9" in done.stderr
    done = subprocess.run(
        [*node, str(tmp_path / "bus.sock"), "can0"], check=False, capture_output=True, text=True, timeout=10
    )
    assert done.returncode == 1 and "No such file or directory" in done.stderr


def test_the_document_and_the_examples_say_what_the_code_does() -> None:
    document = (ROOT / "docs" / "can.md").read_text()
    assert int(re.search(r'"version": (\d+)', document)[1]) == wire.VERSION  # type: ignore[index]
    assert f"at most {wire.MAX_RECORDS} records" in document and f"{frames.BYTES} bytes" in document
    for name in ("BRS", "ESI", "FD", "EXTENDED", "REMOTE", "LOST"):
        assert re.search(rf"\| {getattr(frames, name)} +\| {name} ", document), name
    for field, (_, offset) in frames.RECORD.fields.items():  # type: ignore[union-attr]
        assert re.search(rf"\| {offset} +\| \d+ +\| `{field}`", document), field
    for example in ("can_node.c", "can_node.py"):
        text = (ROOT / "examples" / example).read_text()
        assert re.search(rf"WIRE_VERSION(, MAX_RECORDS)? = {wire.VERSION},", text)
        assert str(wire.MAX_RECORDS) in text
