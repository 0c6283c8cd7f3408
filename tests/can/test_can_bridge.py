"""A bridge carries every frame both ways, and none comes back as an echo."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import can
import numpy as np
import pytest

from hal.can import real_port
from hal.can.bridge import Bridge, EchoFilter, Side, only_bridge
from hal.can.interface import HandrailBus
from hal.can.port import HubPort

Make = Callable[..., np.ndarray]


def _message(can_id: int, *data: int) -> can.Message:
    return can.Message(arbitration_id=can_id, is_extended_id=False, is_fd=True, bitrate_switch=True, data=bytes(data))


@pytest.fixture
def bridged(running: Path) -> Iterator[tuple[HubPort, can.BusABC, Bridge]]:
    """A port on the virtual bus, a bus on the other side (python-can's in-process one as hardware), and the bridge between."""
    real = real_port.open_bus("virtual", "bench", 1_000_000, 5_000_000)
    bridge = Bridge(Side("handrail can0", HandrailBus("can0", runtime=running)), Side("virtual bench", real))
    bridge.start()
    device = can.Bus(interface="virtual", channel="bench", protocol=can.CanProtocol.CAN_FD)
    with closing(HubPort(running / "bus.sock", ["can0"])) as port, device:
        yield port, device, bridge
    bridge.end()


def test_frames_cross_both_ways_once_and_whole(bridged: tuple[HubPort, can.BusABC, Bridge], make_frames: Make) -> None:
    port, device, bridge = bridged
    port.send(make_frames(np.arange(100), length=64))
    heard = [device.recv(2.0) for _ in range(100)]
    assert [m.arbitration_id for m in heard if m] == list(range(100))
    assert all(m is not None and m.is_fd and m.bitrate_switch and m.dlc == 64 for m in heard)
    for can_id in range(0x200, 0x264):
        device.send(_message(can_id, 1, 2, 3))
    got: list[int] = []
    while len(got) < 100 and len(records := port.receive(2.0)):
        got += records["can_id"].tolist()
    assert got == list(range(0x200, 0x264))
    # Nothing goes round: neither side hears what it said itself.
    assert device.recv(0.1) is None and len(port.receive(0.1)) == 0
    assert [side.taken for side in bridge.sides] == [100, 100]


def test_an_interface_that_echoes_makes_no_loop(running: Path, make_frames: Make) -> None:
    # udp_multicast gives every process its own frames back.
    address, udp_port = "239.74.163.2", 20_000 + os.getpid() % 20_000
    udp = {"interface": "udp_multicast", "channel": address, "port": udp_port}
    try:
        device = can.Bus(**udp)  # type: ignore[arg-type]
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast here: {error}")
    bus = HandrailBus("can0", runtime=running)
    far = real_port.open_bus("udp_multicast", address, 1_000_000, 5_000_000, {"port": udp_port})
    bridge = Bridge(Side("handrail can0", bus), Side("udp_multicast", far, echoes=True))
    with closing(HubPort(running / "bus.sock", ["can0"])) as port, device:
        bridge.start()
        for _ in range(5):  # the same frame again and again is no echo of itself either
            port.send(make_frames([0x123]))
        assert all((m := device.recv(2.0)) is not None and m.arbitration_id == 0x123 for _ in range(5))
        device.send(_message(0x123, 9))
        assert port.receive(2.0)["data"][0, 0] == 9
        assert len(port.receive(0.2)) == 0
        bridge.end()
    assert [side.taken for side in bridge.sides] == [5, 1]


def test_an_echo_is_dropped_once_and_forgotten_when_it_never_comes() -> None:
    now = 0.0
    echo = EchoFilter(forget_s=1.0, clock=lambda: now)
    echo.sent(_message(1, 5))
    echo.sent(_message(1, 5))
    assert not echo.is_echo(_message(1, 6))
    assert [echo.is_echo(_message(1, 5)) for _ in range(3)] == [True, True, False]
    echo.sent(_message(2, 5))
    now = 1.5
    assert not echo.is_echo(_message(2, 5))
    echo.sent(_message(3))
    assert len(echo._sent) == 1  # what never came back does not pile up


class _Full(can.BusABC):
    """Hardware whose transmit queue is full."""

    def __init__(self) -> None:
        super().__init__(channel="full")
        self.unplugged = False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Transmit buffer full")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        time.sleep(0.01)
        if self.unplugged:
            raise can.CanOperationError("No such device")
        return can.Message(is_error_frame=True), False


def test_a_side_that_is_full_costs_frames_and_one_that_is_unplugged_ends_the_bridge(
    running: Path, make_frames: Make
) -> None:
    full = _Full()
    bridge = Bridge(Side("handrail can0", HandrailBus("can0", runtime=running)), Side("pcan USB1", full))
    bridge.start()
    with closing(HubPort(running / "bus.sock", ["can0"])) as port:
        port.send(make_frames([1, 2, 3]))
        until = time.monotonic() + 30
        while (bridge.sides[0].refused < 3 or not bridge.sides[1].errors) and time.monotonic() < until:
            time.sleep(0.01)
        assert (bridge.sides[0].refused, bridge.sides[0].why_refused) == (3, "Transmit buffer full")
        assert bridge.sides[1].errors > 0 and len(port.receive(0.05)) == 0  # error frames stay where they are
    full.unplugged = True
    assert bridge.ended.wait(5) and bridge.problem == "pcan USB1: No such device"
    bridge.end()


def test_the_same_two_ends_are_bridged_once(tmp_path: Path) -> None:
    with only_bridge(tmp_path, "handrail can0", "socketcan can0"):
        with only_bridge(tmp_path, "handrail can0", "socketcan can1"):
            pass
        with (
            pytest.raises(ValueError, match=rf"are bridged already \(process {os.getpid()}\).*round for ever"),
            only_bridge(tmp_path, "socketcan can0", "handrail can0"),
        ):
            pass
    with only_bridge(tmp_path, "handrail can0", "socketcan can0"):
        pass
