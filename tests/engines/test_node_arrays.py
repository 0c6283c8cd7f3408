"""Large arrays between nodes and their host: in memory that both map, never waited for, and gone when its users are."""

from __future__ import annotations

import os
import queue
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engines.nodes.host import NodeProcess
from engines.nodes.shared import BLOCKS, Reader, Writer
from engines.nodes.wire import FromNode, Put, Stepped, ToNode, Wire

NODE = """\
import numpy as np
from engines.nodes import Input, Node, Output

class Invert(Node):
    '''Inverts an image.'''
    {more}
    image = Input("array")
    inverted, own = Output("array"), Output("flag")

    def step(self):
        try:
            self.image[0] = 0
        except ValueError:
            self.own = False
        self.inverted = 255 - self.image
"""
IMAGE = np.random.default_rng(1).integers(0, 255, (480, 640, 3), np.uint8)


def mapped() -> int:
    """Blocks that this process maps."""
    return Path("/proc/self/maps").read_text().count("memfd:handrail node")


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    running: list[NodeProcess] = []

    def start(more: str = "", **arguments: Any) -> NodeProcess:
        file = tmp_path / "invert.py"
        file.write_text(NODE.format(more=more))
        running.append(NodeProcess(file, restarts=0, **arguments))
        return running[-1]

    yield start
    for each in running:
        each.close()


@pytest.fixture
def wires() -> Iterator[tuple[Wire, Wire]]:
    ours, theirs = socket.socketpair()
    pair = Wire(ours, FromNode), Wire(theirs, ToNode)
    yield pair
    for each in pair:
        each.close()


def test_an_image_goes_to_a_node_and_comes_back_as_a_view_that_nobody_can_write(node):
    before = mapped()
    found = node().step({"image": IMAGE})
    assert np.array_equal(found["inverted"], 255 - IMAGE)
    assert found["own"] is False, "the node could not write into what its host gave it"
    assert not found["inverted"].flags.writeable
    assert mapped() - before >= 2


def test_one_nodes_array_is_the_next_ones_input(node):
    first, second = node(), node()
    inverted = first.step({"image": IMAGE})["inverted"]
    assert np.array_equal(second.step({"image": inverted})["inverted"], IMAGE)


def test_a_node_that_is_killed_leaves_no_memory_behind_once_nobody_looks_at_it(node):
    node()  # so that the warm process is there
    before, descriptors = mapped(), len(os.listdir("/proc/self/fd"))
    buried = threading.Event()
    process = node(ended=lambda failure: buried.set())
    found = process.step({"image": IMAGE})["inverted"]
    part = found[10:20, ::2]
    del found
    assert mapped() > before
    process.process.kill()
    assert buried.wait(60)
    assert np.array_equal(part, (255 - IMAGE)[10:20, ::2]), "a view outlives the node"
    del part
    assert mapped() <= before
    assert len(os.listdir("/proc/self/fd")) <= descriptors


def test_a_reader_that_keeps_arrays_makes_the_writer_leave_some_out_and_never_wait(wires):
    host, node = wires
    kept = []
    for k in range(BLOCKS):
        assert node.send(Stepped(0, {"image": IMAGE + k, "count": k}, 0.0), leave_out=True) == []
        kept.append(host.receive(60).outputs["image"])
    assert node.send(Stepped(0, {"image": IMAGE, "count": 99}, 0.0), leave_out=True) == ["image"]
    assert host.receive(60).outputs == {"count": 99}
    assert all(np.array_equal(each, IMAGE + k) for k, each in enumerate(kept)), "what is kept stays as it was"
    part = kept.pop(3)[::2]
    assert node.send(Stepped(0, {"image": IMAGE}, 0.0), leave_out=True) == ["image"], "a part is looked at still"
    assert host.receive(60).outputs == {}
    del part
    assert node.send(Stepped(0, {"image": IMAGE}, 0.0), leave_out=True) == []
    assert np.array_equal(host.receive(60).outputs["image"], IMAGE)


def test_an_answer_is_never_left_out(wires):
    host, node = wires
    kept = []
    for k in range(BLOCKS + 2):
        cloud = np.full((5000, 3), float(k))
        host.send(Put({"cloud": cloud}, {}, k, step=True))
        kept.append(node.receive(60).inputs["cloud"])
    as_sent = [
        each if isinstance(each, np.ndarray) else np.frombuffer(each["data"]).reshape(each["shape"]) for each in kept
    ]
    assert [each[0, 0] for each in as_sent] == [float(k) for k in range(BLOCKS + 2)]
    assert sum(isinstance(each, dict) for each in kept) == 2, "through the socket, where no block was free"


def test_blocks_make_room_for_larger_ones(wires):
    host, node = wires
    for size in (100_000, 1_000_000, 10_000_000, 60_000_000, 100_000):
        array = np.ones(size, np.uint8)
        assert node.send(Stepped(0, {"a": array}, 0.0), leave_out=True) == []
        assert host.receive(60).outputs["a"].size == size
    before = mapped()
    assert node.send(Stepped(0, {"a": np.zeros(300_000_000, np.uint8)}, 0.0), leave_out=True) == ["a"]
    assert mapped() <= before


def test_a_block_that_could_be_cut_short_under_its_reader_is_refused():
    reader = Reader()
    travel, descriptors, _ = Writer().prepared({"a": IMAGE}, leave_out=False)
    os.close(descriptors[0])
    reader.descriptors.append(os.memfd_create("not sealed"))
    with pytest.raises(ValueError, match="expected a sealed one"):
        reader.taken(travel)


def test_a_host_that_keeps_what_a_periodic_node_tells_is_told_that_newer_ones_are_left_out(node):
    notes: queue.SimpleQueue[str] = queue.SimpleQueue()
    kept: list[dict[str, Any]] = []
    process = node("every = 0.01", noted=notes.put, told=kept.append)
    process.put({"image": IMAGE})
    assert f"still looks at {BLOCKS} of its arrays: newer ones are left out" in notes.get(timeout=60)
    assert sum("inverted" in each for each in kept) <= BLOCKS
