"""The virtual bus: order, fairness to slow listeners, who hears what."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hal.can import frames, wire
from hal.can.counting import BUSY_NS, RECEIVED, SENT
from hal.can.hub import Hub
from hal.can.port import HubPort
from hal.can.wire import BusLost
from tests.can.conftest import Bench

Join = Callable[..., HubPort]
Make = Callable[..., np.ndarray]


def _ids(records: np.ndarray) -> list[int]:
    return [int(can_id) for can_id in records["can_id"]]


def test_the_lowest_identifier_wins_among_the_nodes_that_wait(hub: Hub, join: Join, make_frames: Make) -> None:
    one, two, three, listener = join(), join(), join(), join()
    one.send(make_frames([0x300]))
    two.send(make_frames([0x100]))
    three.send(make_frames([0x200]))
    assert _ids(hub.poll(1.0)) == [0x100, 0x200, 0x300]
    assert _ids(listener.receive(1.0)) == [0x100, 0x200, 0x300]


def test_a_nodes_own_frames_keep_their_order(hub: Hub, join: Join, make_frames: Make) -> None:
    # A transmit queue is first in, first out, as in SocketCAN: the daemon's Sync stays behind its commands.
    daemon, other = join(), join()
    daemon.send(make_frames([0x101, 0x100, 0x080]))
    other.send(make_frames([0x0F0]))
    assert _ids(hub.poll(1.0)) == [0x0F0, 0x101, 0x100, 0x080]


def test_a_standard_identifier_wins_over_the_extended_one_with_the_same_base(
    hub: Hub, join: Join, make_frames: Make
) -> None:
    one, two = join(), join()
    extended = make_frames([0x100 << 18])
    extended["flags"] |= frames.EXTENDED
    one.send(extended)
    two.send(make_frames([0x100]))
    assert _ids(hub.poll(1.0)) == [0x100, 0x100 << 18]


@pytest.mark.parametrize("timing", [False, True])
@pytest.mark.parametrize("flags", [0, frames.EXTENDED])
def test_a_data_frame_wins_over_a_remote_request_for_it(
    bench: Callable[..., Bench], make_frames: Make, timing: bool, flags: int
) -> None:
    on = bench(timing=timing)
    one, two, listener = on.join("one"), on.join("two"), on.join("listener")
    request, data = make_frames([0x100], length=8), make_frames([0x100], length=8)
    request["flags"], data["flags"] = flags | frames.REMOTE, flags
    one.send(request)
    two.send(data)
    on.turn(0.01)
    on.turn(1.0)
    assert [int(frame["flags"]) & frames.REMOTE for frame in listener.receive(1.0)] == [0, frames.REMOTE]


def test_the_drives_of_the_hubs_own_process_arbitrate_one_by_one(hub: Hub, join: Join, make_frames: Make) -> None:
    listener = join()
    hub.transmit(make_frames([0x203, 0x201, 0x202]))
    assert _ids(listener.receive(1.0)) == [0x201, 0x202, 0x203]


def test_every_listener_sees_every_frame_in_the_same_order_and_its_own_only_on_request(
    hub: Hub, join: Join, make_frames: Make
) -> None:
    sender, echoed, first, second = join(), join(own_frames=True), join(), join()
    sender.send(make_frames([5, 4, 3]))
    echoed.send(make_frames([1, 9]))
    seen = _ids(hub.poll(1.0))
    assert sorted(seen) == [1, 3, 4, 5, 9]
    assert _ids(first.receive(1.0)) == _ids(second.receive(1.0)) == _ids(echoed.receive(1.0)) == seen
    assert _ids(sender.receive(1.0)) == [1, 9]


def test_timestamps_are_when_each_frame_ends_on_its_bus(hub: Hub, join: Join, make_frames: Make) -> None:
    port = join()
    batch = make_frames(np.arange(10))
    now = hub.test_clock.now  # type: ignore[attr-defined]
    hub.transmit(batch)
    times = port.receive(1.0)["time_ns"].astype(np.int64)
    assert times[0] > now and np.all(np.diff(times) > 0)
    # Bits on the wire: between the bare frame and one with a stuff bit in every four.
    assert np.all(np.diff(times) > 29_000 + 160 * 200) and np.all(np.diff(times) < 1.25 * (29_000 + 165 * 200))
    busy = hub.statistics()[0].busy_ns
    assert busy == times[-1] - now
    # Frames that come while the bus is busy wait for it.
    hub.transmit(make_frames([0]))
    assert port.receive(1.0)["time_ns"][0] > times[-1]


def test_channels_are_apart_and_numbered_as_each_listener_asked(hub: Hub, join: Join, make_frames: Make) -> None:
    both, only_second, swapped = join(), join(["can1"]), join(["can1", "can0"])
    assert [c.name for c in swapped.channels] == ["can1", "can0"]
    hub.transmit(np.concatenate([make_frames([1], bus=0), make_frames([2], bus=1)]))

    def heard(port: HubPort) -> set[tuple[int, int]]:
        return {(int(r["can_id"]), int(r["bus"])) for r in port.receive(1.0)}

    assert heard(both) == {(1, 0), (2, 1)}
    assert heard(only_second) == {(2, 0)}
    assert heard(swapped) == {(1, 1), (2, 0)}
    only_second.send(make_frames([7], bus=0))
    assert [(int(r["can_id"]), int(r["bus"])) for r in hub.poll(1.0)] == [(7, 1)]


def test_a_datagram_is_never_split_between_two_polls(hub: Hub, join: Join, make_frames: Make) -> None:
    port = join()
    for _ in range(40):
        port.send(make_frames([1, 2, 3]))
    while len(batch := hub.poll(0.0)):
        assert len(batch) % 3 == 0


def test_a_slow_listener_blocks_nobody_and_is_told_what_it_missed(hub: Hub, join: Join, make_frames: Make) -> None:
    slow, fast = join(), join()
    batch = make_frames([0x10] * 400, length=64)
    sent = 0
    while hub.dropped < 2000:
        hub.transmit(batch)
        sent += len(batch)
        assert len(fast.receive(1.0)) == len(batch)
        hub.poll(0.0)
    got = 0
    while got + slow.lost < sent:
        got += len(slow.receive(1.0))
        hub.poll(0.0)
    assert slow.lost == hub.dropped and fast.lost == 0
    hub.transmit(make_frames([0x11]))
    assert _ids(slow.receive(1.0)) == [0x11]


def test_a_listener_that_dies_disturbs_nobody(hub: Hub, join: Join, make_frames: Make) -> None:
    dying, staying = join(), join()
    dying.close()
    hub.transmit(make_frames([1]))
    hub.poll(0.0)
    hub.transmit(make_frames([2]))
    assert _ids(staying.receive(1.0)) == [1, 2]
    assert hub.listeners == 1


@pytest.mark.parametrize(
    "change",
    [
        {"length": 65},
        {"length": 9},
        {"length": 12, "flags": 0},
        {"can_id": 0x800},
        {"bus": 2},
        {"flags": frames.LOST | frames.FD},
        {"flags": frames.BRS},
        {"flags": frames.FD | frames.REMOTE},
    ],
)
def test_what_is_no_frame_is_refused_and_counted(
    hub: Hub, join: Join, make_frames: Make, change: dict[str, int]
) -> None:
    sender, listener = join(), join()
    batch = make_frames([1, 2, 3])
    for name, value in change.items():
        batch[name][1] = value
    sender._socket.send(batch.tobytes())  # as a broken process would: HubPort has no part in it
    assert _ids(hub.poll(1.0)) == [1, 3]
    assert _ids(listener.receive(1.0)) == [1, 3]
    assert hub.refused == 1
    with pytest.raises(ValueError, match="1 of 3 records"):
        hub.transmit(batch)


def test_data_beyond_the_length_is_zero_for_whoever_reads_it(hub: Hub, join: Join, make_frames: Make) -> None:
    sender = join()
    batch = make_frames([1], length=12)
    batch["data"][:] = 0xAA
    sender.send(batch)
    data = hub.poll(1.0)["data"][0]
    assert data.tolist() == [0xAA] * 12 + [0] * 52


NESTED = b'{"type":"hello","x":' + b"[" * 20_000
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**40), 2**40) | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["type", "version", "channels", "role"]) | st.text(max_size=5), inner, max_size=4
        )
    ),
    max_leaves=12,
) | st.fixed_dictionaries(
    {"type": st.just("hello"), "version": st.integers(0, 3)},
    optional={"channels": st.lists(st.text(max_size=5), max_size=3), "role": st.sampled_from(["node", "control", "x"])},
)


@pytest.mark.parametrize(
    "first", [b"x", b"GET / HTTP/1.1\r\n\r\n", b'{"type":"hello","version":1}', bytes(160), NESTED]
)
def test_a_stranger_on_the_socket_is_sent_away(hub: Hub, folder: Path, join: Join, first: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as stranger:
        stranger.connect(str(folder / "bus.sock"))
        stranger.send(first)
        stranger.settimeout(2.0)
        hub.poll(0.05)
        assert b"sorry" in stranger.recv(4096)
        assert stranger.recv(4096) == b""
    assert join().channels[0].name == "can0"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(first=st.binary(min_size=1, max_size=300) | JSON.map(msgspec.json.encode))
def test_whatever_a_stranger_says_first_the_hub_lives(hub: Hub, folder: Path, first: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as stranger:
        stranger.connect(str(folder / "bus.sock"))
        stranger.send(first)
        stranger.settimeout(2.0)
        hub.poll(0.05)
        assert stranger.recv(4096), "welcome or sorry"
    hub.poll(0.05)
    assert hub.listeners == 0


def test_a_node_that_stops_speaking_records_is_sent_away(hub: Hub, join: Join, make_frames: Make) -> None:
    odd, good = join(), join()
    odd._socket.send(b"x" * 79)
    hub.poll(0.05)
    assert hub.listeners == 1
    with pytest.raises(BusLost):
        odd.receive(1.0)
    good.send(make_frames([1]))
    assert _ids(hub.poll(1.0)) == [1]


def test_an_unknown_channel_is_refused_with_the_names_that_there_are(join: Join) -> None:
    with pytest.raises(ValueError, match=r"\['can7'\].*\['can0', 'can1'\]"):
        join(["can7"])


def test_no_hub_and_two_hubs_are_errors_that_say_so(folder: Path, hub: Hub) -> None:
    with pytest.raises(BusLost, match="no hub there"):
        HubPort(folder / "other.sock", timeout_s=0.05)
    with pytest.raises(OSError, match="another hub"):
        Hub(folder / "bus.sock", ["can0"])


def test_a_socket_left_by_a_killed_hub_is_taken_over(folder: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as left:
        left.bind(str(folder / "bus.sock"))
    Hub(folder / "bus.sock", ["can0"]).close()


def test_ports_count_frames_and_the_time_that_they_take(hub: Hub, join: Join, make_frames: Make) -> None:
    one, two = join(), join()
    one.send(make_frames([1, 2], bus=0))
    hub.poll(1.0)
    two.receive(1.0)
    assert one.counters[0].tolist() == [2, 0, one.counters[0, BUSY_NS]]
    assert two.counters[0, RECEIVED] == 2 and two.counters[0, SENT] == 0
    assert one.counters[0, BUSY_NS] == two.counters[0, BUSY_NS] == hub.statistics()[0].busy_ns > 0
    assert one.counters[1].sum() == 0


def test_a_port_notices_that_the_hub_has_ended(hub: Hub, join: Join) -> None:
    port = join()
    hub.close()
    with pytest.raises(BusLost, match="ended"):
        port.receive(1.0)


_LISTENER = """
import sys
import time
from hal.can.port import HubPort
port = HubPort(sys.argv[1])
print("listening", flush=True)
ids = []
while len(ids) < int(sys.argv[2]):
    ids += port.receive(10.0)["can_id"].tolist()
print(hash(tuple(ids)), port.lost, flush=True)
"""


def test_listeners_in_other_processes_see_the_same_order_without_loss(running: Path, make_frames: Make) -> None:
    total = 20_000
    command = [sys.executable, "-c", _LISTENER, str(running / "bus.sock"), str(total)]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    for process in processes:
        assert process.stdout is not None and process.stdout.readline() == "listening\n"
    senders = [HubPort(running / "bus.sock"), HubPort(running / "bus.sock")]
    rng = np.random.default_rng(1)
    sent = 0
    while sent < total:
        for sender in senders:
            batch = make_frames(rng.integers(0, 0x7FF, 20), bus=int(rng.integers(2)))
            while sender.refused >= 0:
                before = sender.refused
                sender.send(batch)
                if sender.refused == before:
                    break
                sender.receive(0.01)  # its queue is full: take what waits here meanwhile
            sent += 20
            sender.receive(0.0)
    answers = [process.communicate(timeout=30)[0] for process in processes]
    assert len(set(answers)) == 1 and answers[0].endswith(" 0\n")
    for sender in senders:
        sender.close()


def test_a_newcomer_speaks_json_that_any_language_can_write(hub: Hub, folder: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as newcomer:
        newcomer.connect(str(folder / "bus.sock"))
        newcomer.send(b'{"type":"hello","version":2,"channels":["can1"]}')
        hub.poll(0.05)
        answer = newcomer.recv(wire.MAX_BYTES)
    assert answer == b'{"type":"welcome","channels":[{"name":"can1","bitrate":1000000,"data_bitrate":5000000}]}'


def test_the_hubs_own_nodes_compete_each_with_its_own_queue(hub: Hub, join: Join, make_frames: Make) -> None:
    hub.own_nodes(["shoulder", "elbow"], ["can0", "can0"])
    listener = join()
    hub.transmit(make_frames([0x300, 0x100, 0x200]), np.array([0, 0, 1]))
    assert _ids(listener.receive(1.0)) == [0x200, 0x300, 0x100]
    with pytest.raises(ValueError, match="expected 1 places in 2 own nodes"):
        hub.transmit(make_frames([1]), np.array([2]))
    with pytest.raises(ValueError, match="can9"):
        hub.own_nodes(["wrist"], ["can9"])


@pytest.mark.parametrize("answers", [0, 18, wire.MAX_RECORDS])
def test_the_word_that_a_cycle_is_over_comes_behind_all_that_was_said_in_it(
    hub: Hub, join: Join, make_frames: Make, answers: int
) -> None:
    asking, other = join(ticks=True), join()
    hub.owe_ticks(2)
    if answers:
        hub.transmit(make_frames(np.full(answers, 0x200)))
    hub.tick()
    hub.tick()  # what was told is not told again
    assert len(asking.receive(1.0)) == answers
    assert asking.ticks == 2
    assert len(other.receive(0.0)) == answers
    assert other.ticks == 0


def test_in_lock_step_who_sends_one_datagram_a_cycle_may_still_send_many(
    hub: Hub, join: Join, make_frames: Make
) -> None:
    hub.lockstep(2_000_000, 0x080, 0x081)
    port, listener = join(), join()
    sent, heard = 0, []
    for many in (1, 1, 1, 40, 1, 3):
        for _ in range(many):
            port.send(make_frames([sent & 0x7FF]))
            sent += 1
        while len(batch := hub.poll(0.0)):
            heard += _ids(batch)
    assert heard == list(range(sent)) == _ids(listener.receive(1.0))


@pytest.mark.parametrize("awake", [False, True])
def test_a_port_waits_no_longer_than_it_is_asked_to(hub: Hub, join: Join, make_frames: Make, awake: bool) -> None:
    port = join()
    if awake:
        port.take_turns()
    for timeout_s in (0.05, 0.0, 0.02):
        began = time.perf_counter()
        assert len(port.receive(timeout_s)) == 0
        assert timeout_s * 0.9 <= time.perf_counter() - began < timeout_s + 5.0
    hub.transmit(make_frames([1, 2]))
    hub.transmit(make_frames([3]))
    assert _ids(port.receive(0.02)) == [1, 2, 3]
    for wait_s in (0.0005, 0.03):  # while it is awake, and when it sleeps
        later = threading.Timer(wait_s, hub.transmit, [make_frames([4])])
        later.start()
        assert _ids(port.receive(10.0)) == [4]
        later.join()
