"""A loop that was taped does the same again, bit for bit, when it is told the same; what is not the same is found."""

from __future__ import annotations

import dataclasses
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.exchange import Answer, ControllerState, Flag, Kind, Outcome, encode_joints
from daemon.replay.player import Replay
from daemon.replay.recorded_loop import Cycle, cycles
from daemon.replay.tape import Entry, TapeReader, TapeWriter
from daemon.replay.tape import Kind as Taped
from daemon.replay.taping import TapedPort
from hal.can import frames
from hal.drives.lifecycle import State
from handrail.messages import CompliantMotion, ContactEnd, JointTarget, Step, StreamJoints, TimeEnd
from tests.daemon.loop.conftest import SWAY, Desk

JOINT, OTHER_LIMB = "arm_right_1_joint", "arm_left_4_joint"


@pytest.fixture
def taped(talos: Any, make_bench: Callable[..., Any]) -> Any:
    return make_bench(talos, tape=True)


def entries(bench: Any) -> list[Entry]:
    """What is on the bench's tape, after its START."""
    tape = TapeReader(bench.runtime.folder / "loop.tape")
    assert tape.attach()
    first, *rest = tape.read()
    assert first.kind is Taped.START and tape.broken_in is None
    return rest


@pytest.fixture
def replay(talos_kinematics: Any, tmp_path_factory: Any) -> Iterator[Replay]:
    folder = Path(tmp_path_factory.mktemp("r"))
    made = Replay(talos_kinematics, True, folder)
    yield made
    made.close()


def tell_stop_socket(bench: Any, text: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(text, str(bench.runtime.stop))


def same(replay: Replay, recorded: list[Cycle]) -> None:
    found = replay.run(recorded)
    assert found is None, found
    assert replay.compared == len(recorded)


def test_an_eventful_loop_is_replayed_bit_for_bit(taped: Any, replay: Replay) -> None:
    """A trajectory paused and slowed down, a behaviour, a guarded contact, a limb lost and taken back, stops, refusals, its end."""
    taped.enable()
    right = list(taped.description.arms["right"].joints)
    action = taped.post_start(taped.move(JOINT, 0.3, 0.3))
    taped.run(40)
    taped.ask(Kind.PAUSE, action=action)
    taped.run(20)
    assert taped.start(taped.move(JOINT, 0.1)) is Answer.CLAIMED
    taped.ask(Kind.SET_SPEED, value=0.4)
    taped.ask(Kind.RESUME, action=action)
    taped.run(60)
    taped.ask(Kind.SET_SPEED, action=action, value=0.9)
    taped.ask(Kind.SET_SPEED, value=1.0)
    taped.run(120)
    target = taped.post_start(JointTarget(joints=[JOINT, "arm_right_4_joint"], positions=[-0.5, -1.8]))
    taped.run(60)
    another = StreamJoints(id="t", sequence=1, positions=[-0.55, -1.85])
    taped._serial += 1
    taped._mailbox.post(*encode_joints(another, taped._serial, target))
    taped.run(400)
    assert taped.snapshot()["actions"]["outcome"].tolist().count(Outcome.DONE) == 2
    still = CompliantMotion(frame="tool_right_tip", joints=right, duration=0.1)
    guard = ContactEnd(frame="tool_right_tip", threshold=15.0)
    first = Step(name="a", motion=still, ends=[TimeEnd(after=0.06)], then={"time": "b"})
    taped.post_behaviour(first, Step(name="b", motion=still, ends=[guard]))
    taped.run(30)
    taped.drives.external_torque[taped.index(JOINT)] = 30.0
    taped.run(50)
    taped.drives.life[taped.index(OTHER_LIMB)] = State.FAULT
    assert taped.run(3)["flags"] & Flag.ISOLATED
    taped.start(taped.move(JOINT, -0.2, 0.2))
    taped.run(30)
    assert taped.ask(Kind.ENABLE) is Answer.ACCEPTED
    assert not taped.run(40)["flags"] & Flag.ISOLATED
    tell_stop_socket(taped, b"STOP too close")
    assert taped.run(10)["flags"] & Flag.STOPPED
    tell_stop_socket(taped, b"CLEAR")
    taped.enable()
    taped.loop.close()
    recorded = list(cycles(entries(taped)))
    assert len(recorded) == taped.loop.cycles and recorded[-1].last_sent, "what the loop sends at its end is told, too"
    same(replay, recorded)


def test_what_happens_while_time_is_held_happens_between_the_same_cycles_again(taped: Any, replay: Replay) -> None:
    taped.enable()
    loop = taped.loop
    loop.holds.add(1, 60.0)
    taped.post_start(taped.move(JOINT, 0.3, 0.3))
    taped.ring_loop()
    loop.wait_while_held()  # the start releases its owner's hold
    taped.run(40)
    loop.holds.add(1, 60.0)
    tell_stop_socket(taped, b"STOP while held")
    loop.wait_while_held()
    assert taped.run(5)["flags"] & Flag.STOPPED
    recorded = list(cycles(entries(taped)))
    assert [len(cycle.then) for cycle in recorded if cycle.then] == [1, 1]
    same(replay, recorded)


def test_a_stop_that_comes_while_the_loop_waits_for_silent_drives_comes_there_again(taped: Any, replay: Replay) -> None:
    taped.enable()
    taped.start(taped.move(JOINT, 0.3, 0.3))
    taped.run(20)
    taped.loop.hardware._port = TapedPort(_Late(taped), taped.loop._tape)
    taped.run(30)
    recorded = list(cycles(entries(taped)))
    stopped = next(cycle for cycle in recorded if cycle.stops)
    assert stopped.stops[0][0] > 0 and len(stopped.received) > 1
    same(replay, recorded)


class _Late:
    """The bench's drives, whose next answer is there only at the fourth look at the bus; a stop comes before."""

    def __init__(self, bench: Any):
        self.counters, self.refused, self.lost = bench.drives.counters, 0, 0
        self._bench, self._looks, self.send, self.close = bench, 0, bench.drives.send, bench.drives.close

    def receive(self, timeout_s: float = 0.0) -> np.ndarray:
        self._looks += 1
        if self._looks == 2:
            tell_stop_socket(self._bench, b"STOP meanwhile")
        return frames.empty(0) if self._looks < 4 else self._bench.drives.receive(timeout_s)

    def fileno(self) -> int:
        return -1


def test_a_changed_controller_is_found_in_the_cycle_in_which_it_first_commands_otherwise(
    taped: Any, replay: Replay, monkeypatch: pytest.MonkeyPatch
) -> None:
    taped.enable()
    taped.start(taped.move(JOINT, 0.3, 0.3))
    taped.run(100)
    recorded = list(cycles(entries(taped)))
    update, seen = JointTrajectory.update, []

    def changed(self: Any, robot: Any, out: Any) -> None:
        update(self, robot, out)
        seen.append(None)
        if len(seen) == 50:
            out.velocity[self.joints] *= 1.0 + 1e-15

    monkeypatch.setattr(JointTrajectory, "update", changed)
    found = replay.run(recorded)
    first = max(cycle.number for cycle in recorded if cycle.orders)
    assert found is not None and (found.cycle, found.node, found.field) == (first + 49, JOINT, "velocity")
    assert float(found.recorded) != float(found.replayed) == pytest.approx(float(found.recorded), rel=1e-14)
    assert replay.compared == found.cycle - 1


def test_what_goes_out_otherwise_is_found_though_the_set_points_are_the_same(taped: Any, replay: Replay) -> None:
    taped.run(3)
    taped.ask(Kind.ENABLE)
    taped.run(20)
    recorded = list(cycles(entries(taped)))
    sent = recorded[6].sent[0]
    forged = recorded[6].sent[0] = sent.copy()
    row = next(row for row in range(len(sent)) if sent["can_id"][row] & 0x7F0 == 0x0C0)  # LimbControl
    forged["data"][row, 0] ^= 1
    found = replay.run(recorded)
    assert found is not None and found.cycle == 7
    assert found.recorded != found.replayed


def test_a_tape_that_nobody_reads_breaks_off_in_a_cycle_that_it_names_and_what_was_before_is_whole(
    tmp_path: Path,
) -> None:
    tape, reader = TapeWriter(tmp_path / "tape", 100), TapeReader(tmp_path / "tape")
    assert reader.attach() and reader.broken_in is None
    for cycle in range(1, 9):
        tape.cycle, tape.time_ns = cycle, 1000 * cycle
        tape.put(Taped.RECEIVED, (cycle, -cycle), np.full(10, cycle, np.uint64))
    assert reader.broken_in == 7, "six entries of fifteen words fit"
    told = list(reader.read())
    assert [entry.cycle for entry in told] == [1, 2, 3, 4, 5, 6]
    assert told[5].body.view(np.int64).tolist() == [6, -6, *[6] * 10] and told[5].time_ns == 6000
    tape.put(Taped.END)
    assert not list(reader.read()), "nothing follows what is missing"


def test_a_tape_goes_round_as_long_as_it_is_read(tmp_path: Path) -> None:
    tape, reader = TapeWriter(tmp_path / "tape", 100), TapeReader(tmp_path / "tape")
    assert reader.attach()
    told: list[Entry] = []
    lengths = [(7 * number) % 30 for number in range(200)]
    for number, length in enumerate(lengths):
        tape.cycle = number
        tape.put(Taped.SENT, (), np.full(length, number, np.uint64))
        if number % 3 == 2:
            told += reader.read()
    told += reader.read()
    assert reader.broken_in is None
    assert [(entry.cycle, len(entry.body), set(entry.body.tolist())) for entry in told] == [
        (number, length, {number} if length else set()) for number, length in enumerate(lengths)
    ]


def test_a_cycle_that_is_missing_is_named(taped: Any) -> None:
    taped.run(10)
    with pytest.raises(ValueError, match="cycle 6 follows where 5 should"):
        list(cycles(entry for entry in entries(taped) if entry.cycle != 5))


@pytest.fixture
def loaded(taped: Any, workspace: Path) -> Any:
    """A user's controller has been loaded, switched on for a while, and off; a kind that there is not was asked for, too."""
    desk = Desk(taped)
    taped.enable()
    slot = desk.load("swaying", "sway", [JOINT])
    assert desk.switch([slot]) is Answer.ACCEPTED
    taped.run(30)
    assert desk.settle(desk.begin("nothing", "levitate", [OTHER_LIMB])) is ControllerState.EMPTY
    taped.run(30)
    assert desk.switch((), [slot]) is Answer.ACCEPTED
    taped.run(5)
    return taped


def test_controllers_that_were_loaded_are_made_anew_and_are_there_in_the_same_cycle(
    loaded: Any, replay: Replay
) -> None:
    recorded = list(cycles(entries(loaded)))
    assert sum(len(cycle.controllers) for cycle in recorded) == 2
    same(replay, recorded)


def test_a_users_controller_that_was_changed_meanwhile_is_found(loaded: Any, replay: Replay, workspace: Path) -> None:
    recorded = list(cycles(entries(loaded)))
    (workspace / "sway.py").write_text(SWAY.replace("0.1 * (1 - np.cos", "0.11 * (1 - np.cos"))
    found = replay.run(recorded)
    assert found is not None and (found.node, found.field) == (JOINT, "position")


def test_a_controller_that_can_not_be_made_any_more_is_a_difference_with_its_error(
    loaded: Any, replay: Replay, workspace: Path
) -> None:
    recorded = list(cycles(entries(loaded)))
    (workspace / "sway.py").write_text(SWAY.replace("import numpy as np", "import no_such_library"))
    found = replay.run(recorded)
    assert found is not None and (found.node, found.field) == ("controller swaying", "state")
    assert found.cycle == next(cycle.number for cycle in recorded if cycle.controllers)
    assert found.recorded == "inactive" and "no_such_library" in found.replayed


def test_cycles_of_the_wall_clock_have_their_times_again_and_their_missed_periods(
    talos: Any, make_bench: Callable[..., Any], tmp_path: Path
) -> None:
    hasty = dataclasses.replace(talos, stop_after_misses=3)
    bench = make_bench(hasty, tape=True)
    loop, began = bench.loop, 123_456_789_012
    loop.lockstep, loop.time_ns = False, began

    def run(cycles: int) -> None:
        for _ in range(cycles):
            loop.time_ns += loop.period_ns
            bench.run()

    run(3)
    bench.post(Kind.ENABLE)
    run(20)
    bench.post_start(bench.move(JOINT, 0.2, 0.2), expires_ns=loop.time_ns + 2 * loop.period_ns)
    loop.skip(2)
    loop.time_ns += 2 * loop.period_ns
    run(1)
    assert Answer(int(bench.snapshot()["answer"])) is Answer.EXPIRED, "by the time that went by"
    bench.post_start(bench.move(JOINT, 0.2, 0.2))
    run(20)
    loop.skip(3)
    run(5)
    assert bench.snapshot()["flags"] & Flag.STOPPED
    replayed = Replay(loop.robot.kinematics, False, tmp_path)
    recorded = list(cycles(entries(bench)))
    try:
        same(replayed, recorded)
    finally:
        replayed.close()
