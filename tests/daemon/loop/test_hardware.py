"""The drives as one piece of hardware, over the virtual bus."""

import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hal.can import frames
from hal.can.hub import Hub
from hal.can.port import BusLost, HubPort
from hal.drives import lifecycle
from hal.drives.lifecycle import State
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.hardware import LOST_AFTER, Goal, Hardware
from hal.joint import JointCommand, JointState
from hal.punctuality import SETTLES_AFTER


class Node:
    """Drives on a hub: they follow controlwords, and answer when Sync comes."""

    def __init__(self, hub: Hub, protocol: LimbProtocol, n: int):
        self.hub, self.protocol, self.targets, self.state = (
            hub,
            protocol,
            DriveTargets(n, len(protocol.devices)),
            JointState(n),
        )
        self.life = np.full(n, State.SWITCH_ON_DISABLED, np.uint8)
        self.silent = np.zeros(n, bool)
        self.previous = np.zeros(n, np.uint8)
        self.out = frames.empty(64)
        self.broken = False
        self.delay = 0
        self.pipe: list[np.ndarray] = []
        self.syncs = self.holds = 0
        self.commanded = False

    def serve(self, timeout_s: float = 2.0) -> None:
        records = self.hub.poll(timeout_s)
        self.protocol.decode(records, len(records), self.targets)
        self.syncs += self.targets.syncs
        self.holds += self.targets.holds
        self.commanded = bool(self.targets.commanded.any())
        if self.targets.controlled.any():
            self.life = lifecycle.transition(self.life, self.targets.controlword, self.previous)
            self.previous = self.targets.controlword.copy()
        if not self.targets.syncs:
            return
        self.state.status[:] = lifecycle.statusword(self.life)
        self.state.sequence[:] = self.targets.sequence
        answer = self.targets.answer & ~self.silent
        count = self.protocol.encode_status(self.state, np.zeros(len(self.life), np.uint8), answer, self.out)
        if self.broken:
            self.out["data"][:count, 0] ^= 1
        self.pipe.append(self.out[:count].copy())
        if len(self.pipe) > self.delay:
            self.hub.transmit(self.pipe.pop(0))


@pytest.fixture
def wired(talos, talos_protocol) -> Iterator[tuple[Hardware, Node]]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    hub = Hub(folder / "bus.sock", talos.channels)
    joined: list[HubPort] = []
    joining = threading.Thread(
        target=lambda: joined.append(HubPort(folder / "bus.sock", [channel.name for channel in talos.channels]))
    )
    joining.start()
    while joining.is_alive():
        hub.poll(0.01)
    hardware = Hardware(talos, joined[0], talos_protocol)
    yield hardware, Node(hub, talos_protocol, len(talos.joints))
    hardware.close()
    hub.close()
    shutil.rmtree(folder)


def cycle(hardware: Hardware, node: Node, command: JointCommand | None = None, number: int = 0) -> None:
    hardware.write(command, number)
    node.serve()
    hardware.read(2.0)


def test_a_cycle_is_one_datagram_with_sync_and_its_answers_come_back(wired, talos) -> None:
    hardware, node = wired
    node.state.position[:] = np.linspace(-1.0, 1.0, len(talos.joints))
    cycle(hardware, node, number=70000)
    assert node.syncs == 1
    assert node.targets.cycle == 70000
    assert hardware.state.position == pytest.approx(node.state.position, abs=1e-6)
    assert (hardware.state.age == 0).all()
    assert hardware.first_silent() == -1
    assert hardware.counters[:, 0].sum() == len(talos.limbs) + len(talos.channels)
    assert hardware.counters[:, 1].sum() == len(talos.joints)


def test_drives_go_to_operation_only_when_that_is_the_goal(wired) -> None:
    hardware, node = wired
    for _ in range(10):
        cycle(hardware, node, JointCommand(len(node.life)))
    assert not node.commanded
    assert (hardware.drive_state == State.SWITCH_ON_DISABLED).all()
    hardware.goal = Goal.OPERATIONAL
    for _ in range(10):
        cycle(hardware, node, JointCommand(len(node.life)))
    assert hardware.operational
    assert node.commanded
    hardware.goal = Goal.QUICK_STOP
    cycle(hardware, node, JointCommand(len(node.life)))
    assert not node.commanded
    assert (hardware.drive_state == State.QUICK_STOP_ACTIVE).all()
    assert hardware.first_lost() == 0
    for _ in range(10):
        cycle(hardware, node)
    assert (hardware.drive_state == State.QUICK_STOP_ACTIVE).all()
    hardware.goal = Goal.INACTIVE
    cycle(hardware, node)
    assert (hardware.drive_state == State.SWITCH_ON_DISABLED).all()


def test_a_fault_is_reset_on_the_way_to_operation_and_otherwise_left_to_be_seen(wired) -> None:
    hardware, node = wired
    node.life[5] = State.FAULT
    for _ in range(5):
        cycle(hardware, node)
    assert hardware.drive_state[5] == State.FAULT
    hardware.goal = Goal.OPERATIONAL
    for _ in range(12):
        cycle(hardware, node)
    assert hardware.operational


def test_a_drive_that_stops_answering_is_late_then_lost(wired) -> None:
    hardware, node = wired
    hardware.goal = Goal.OPERATIONAL
    for _ in range(10):
        cycle(hardware, node)
    assert hardware.stale_replies == 0
    node.silent[11] = True
    for _ in range(LOST_AFTER):
        cycle(hardware, node)
    assert hardware.first_lost() == -1
    assert hardware.stale_replies == LOST_AFTER
    cycle(hardware, node)
    assert hardware.first_lost() == hardware.first_silent() == 11
    assert hardware.stale_replies == LOST_AFTER


def test_drives_whose_answers_always_come_late_are_as_old_as_what_they_answer(wired) -> None:
    hardware, node = wired
    node.delay = 3
    for _ in range(node.delay + 1):
        hardware.write(None, 0)
        node.serve()
    hardware.read()
    assert (hardware.state.age == 3).all()
    stale = hardware.stale_replies
    for _ in range(5):
        cycle(hardware, node)
    assert (hardware.state.age == 3).all() and hardware.first_silent() == -1
    assert hardware.stale_replies == stale + 5 * len(node.life)
    for _ in range(SETTLES_AFTER):
        cycle(hardware, node)
    stale = hardware.stale_replies
    for _ in range(5):
        cycle(hardware, node)
    assert hardware.stale_replies == stale, "by now that is how these channels work"


def test_drives_whose_answers_come_later_than_a_lost_drive_s_are_lost(wired) -> None:
    hardware, node = wired
    for delay, silent in ((LOST_AFTER, -1), (LOST_AFTER + 1, 0)):
        node.delay = delay
        while len(node.pipe) < delay:
            hardware.write(None, 0)
            node.serve()
        cycle(hardware, node)
        assert (hardware.state.age == delay).all()
        assert hardware.first_silent() == silent


def test_replies_with_a_bad_crc_are_counted_and_not_believed(wired) -> None:
    hardware, node = wired
    cycle(hardware, node)
    node.broken = True
    node.state.position[:] = 1.0
    hardware.write(None, 0)
    node.serve()
    assert not hardware.read(0.2), "nothing valid has come"
    assert hardware.crc_errors == len(node.life)
    assert (hardware.state.position == 0.0).all()
    hardware.give_up()
    assert hardware.first_silent() == 0


def test_held_time_is_told_without_a_step(wired) -> None:
    hardware, node = wired
    cycle(hardware, node)
    hardware.hold_time(5)
    node.serve()
    assert (node.syncs, node.holds) == (1, 1)


def test_gains_are_rounded_to_what_the_drives_can_be_told(wired, talos, talos_protocol) -> None:
    hardware, _ = wired
    stiffness, damping = hardware.representable_gains(talos.stiffness, np.full(len(talos.joints), 3.0))
    again = hardware.representable_gains(stiffness, damping)
    assert np.array_equal(again[0], stiffness)
    assert np.array_equal(again[1], damping)
    assert stiffness == pytest.approx(talos.stiffness, rel=0.025)


def test_a_bus_that_ends_says_so(wired) -> None:
    hardware, node = wired
    cycle(hardware, node)
    node.hub.close()
    with pytest.raises(BusLost):
        for _ in range(3):
            hardware.write(None, 0)
            hardware.read(0.2)
