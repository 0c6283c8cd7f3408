"""Talking to the hub about the bus: reports, and faults given and taken back."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from hal.can import frames, wire
from hal.can.control import HubControl
from hal.can.faults import Fault
from hal.can.hub import Hub
from hal.can.port import HubPort
from hal.can.timing import frame_ns

Ask = Callable[..., Any]


@pytest.fixture
def ask(hub: Hub) -> Iterator[Ask]:
    """ask(function, *arguments): calls it in a thread while the hub of this process goes on."""
    with ThreadPoolExecutor(1) as pool:

        def call(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
            answer = pool.submit(function, *arguments, **options)
            while not answer.done():
                hub.poll(0.005)
            return answer.result()

        yield call


@pytest.fixture
def control(hub: Hub, folder: Path, ask: Ask) -> Iterator[HubControl]:
    with contextlib.closing(ask(HubControl, folder / "bus.sock")) as made:
        yield made


def test_a_report_names_every_node_and_what_each_identifier_cost(
    hub: Hub, control: HubControl, ask: Ask, join: Callable[..., HubPort], make_frames: Callable[..., np.ndarray]
) -> None:
    hub.own_nodes(["elbow"], ["can1"])
    join(["can0"], name="daemon")
    join(["can1"])
    extended = make_frames([0x12345])
    extended["flags"] |= frames.EXTENDED
    batch = np.concatenate([make_frames([0x100, 0x200, 0x100]), extended])
    hub.transmit(batch)
    report = ask(control.report)
    assert [(node.name, node.channel) for node in report.nodes][:2] == [("elbow", "can1"), ("daemon", "can0")]
    assert report.nodes[2].name == wire.default_name() and len(report.nodes) == 3
    assert {node.state for node in report.nodes} == {"error_active"}
    first, second = report.channels
    assert (first.name, first.frames, second.frames) == ("can0", 4, 0)
    assert [(i.can_id, i.extended, i.frames) for i in first.identifiers] == [
        (0x100, False, 2),
        (0x200, False, 1),
        (0x12345, True, 1),
    ]
    cost = [frame_ns(frames.words(batch), row, 1_000_000, 5_000_000) for row in range(4)]
    assert [i.busy_ns for i in first.identifiers] == [cost[0] + cost[2], cost[1], cost[3]]
    assert first.busy_ns == sum(cost) and not second.identifiers


def test_one_node_is_told_of_by_its_name_on_each_of_its_channels(
    hub: Hub, control: HubControl, ask: Ask, join: Callable[..., HubPort]
) -> None:
    hub.own_nodes(["elbow"], ["can1"])
    join(["can1", "can0"], name="daemon")
    hub.add_fault(Fault(kind="cut", node="daemon", channel="can1"))
    told = ask(control.node, "daemon")
    assert {(node.channel, node.state) for node in told} == {("can0", "error_active"), ("can1", "cut")}
    assert told == [node for node in ask(control.report).nodes if node.name == "daemon"]
    assert [node.channel for node in ask(control.node, "elbow")] == ["can1"]
    assert ask(control.node, "wrist") == []


def test_a_control_connection_is_no_node_and_hears_no_frames(
    hub: Hub, control: HubControl, ask: Ask, make_frames: Callable[..., np.ndarray]
) -> None:
    assert hub.listeners == 0
    hub.transmit(make_frames([1, 2, 3]))
    assert ask(control.report).nodes == []


def test_a_fault_has_a_number_until_it_is_cleared(control: HubControl, ask: Ask) -> None:
    one, two = Fault(kind="drop", node="daemon", after=1e6), Fault(kind="delay", channel="can1", after=1e6)
    numbers = ask(control.add, one), ask(control.add, two)
    assert len(set(numbers)) == 2
    assert ask(control.report).faults == dict(zip(numbers, (one, two), strict=True))
    assert ask(control.clear, numbers[0]) == 1
    assert list(ask(control.report).faults.values()) == [two]
    with pytest.raises(ValueError, match=f"fault {numbers[0]}"):
        ask(control.clear, numbers[0])
    assert ask(control.clear) == 1 and ask(control.report).faults == {}


@pytest.mark.parametrize(
    ("fault", "words"),
    [(Fault(kind="drop", channel="can7"), "can7.*can0"), (Fault(kind="babble"), "babble.*node is missing")],
)
def test_a_fault_that_can_never_act_is_refused_with_the_reason(
    control: HubControl, ask: Ask, fault: Fault, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        ask(control.add, fault)


@pytest.mark.parametrize(
    "request_",
    [
        b"[]",
        b'{"type":"add_fault","fault":{"kind":"smoke"}}',
        b"\xff\xfe",
        b'{"type":"get_bus","x":' + b'{"x":' * 20_000,
    ],
)
def test_a_request_that_is_none_is_refused_and_the_next_one_served(
    control: HubControl, ask: Ask, request_: bytes
) -> None:
    control._socket.send(request_)

    def answer() -> bytes:
        control._poll.poll(2000)
        return control._socket.recv(4096)

    assert msgspec.json.decode(ask(answer))["type"] == "sorry"
    assert ask(control.report).timing is False
