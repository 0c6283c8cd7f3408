"""Drives that speak another version of their protocol, or do not say which, are not enabled."""

import dataclasses

import numpy as np

from daemon.exchange import ActionState, Answer, Flag, Kind, Outcome
from daemon.exchange.reports import explain
from daemon.life import ENABLING_TIME
from hal.can import frames
from hal.drives.lifecycle import State
from hal.drives.parameters import Parameter
from hal.drives.protocol import LimbProtocol

JOINT = "arm_left_3_joint"


def ask_version(bench, joint: int) -> None:
    """A tool on the same bus asks a drive, which the loop hears answer."""
    send, request = bench.drives.send, frames.empty(1)
    LimbProtocol(bench.description).encode_request(joint, Parameter.PROTOCOL_VERSION, None, 7, request)

    def with_request(records) -> None:
        bench.drives.send = send
        send(np.concatenate((request, records)))

    bench.drives.send = with_request


def test_a_drive_of_another_protocol_version_refuses_enable_by_name(bench) -> None:
    joint = bench.index(JOINT)
    right = bench.drives.protocol_version[joint]
    bench.drives.protocol_version[joint] = 1.0
    bench.run(30)
    assert bench.ask(Kind.ENABLE) is Answer.PROTOCOL_MISMATCH
    snapshot = bench.snapshot()
    assert (int(snapshot["answer_joint"]), float(snapshot["answer_value"])) == (joint, 1.0)
    words = explain(Answer.PROTOCOL_MISMATCH, JOINT, 1.0)[0]
    assert f"the drive of {JOINT} speaks another version of its protocol" in words
    assert not bench.run(20)["flags"] & Flag.ENABLED
    bench.drives.protocol_version[joint] = right
    bench.drives.silent[joint] = True  # it is exchanged
    bench.run(60)
    bench.drives.silent[joint] = False
    bench.run(10)
    bench.enable()


def test_a_version_that_is_told_only_while_enabling_ends_it_before_any_brake_opens(bench) -> None:
    bench.drives.protocol_version[0] = 1.0
    bench.run(1)
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
    lives = []
    snapshot = bench.run(20, lambda: lives.append(bench.drives.life.max()))
    assert not snapshot["flags"] & (Flag.ENABLED | Flag.ENABLING)
    assert max(lives) < State.OPERATION_ENABLED
    assert bench.ask(Kind.ENABLE) is Answer.PROTOCOL_MISMATCH


def test_a_version_that_is_heard_only_after_enabling_stops_the_robot_and_refuses_to_enable(bench) -> None:
    bench.enable()
    bench.start(bench.move("head_1_joint", 0.1))
    joint = bench.index(JOINT)
    bench.drives.protocol_version[joint] = 1.0
    ask_version(bench, joint)
    assert bench.run(4)["flags"] == 0
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    assert bench.action() == (ActionState.ENDED, Outcome.DRIVE_FAULT)
    assert int(bench.snapshot()["actions"][0]["joint"]) == joint
    assert bench.ask(Kind.ENABLE) is Answer.PROTOCOL_MISMATCH


def test_a_drive_that_never_says_its_version_is_not_enabled_and_named(bench) -> None:
    joint = bench.index(JOINT)
    bench.drives.mute[joint] = True
    bench.run(1)
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED, "it may answer yet"
    lives = []
    snapshot = bench.run(100, lambda: lives.append(bench.drives.life.max()))
    assert not snapshot["flags"] & (Flag.ENABLED | Flag.ENABLING), "it was asked often enough"
    assert max(lives) < State.OPERATION_ENABLED
    assert bench.ask(Kind.ENABLE) is Answer.PROTOCOL_UNKNOWN
    assert int(bench.snapshot()["answer_joint"]) == joint
    words = explain(Answer.PROTOCOL_UNKNOWN, JOINT, 0.0)[0]
    assert f"the drive of {JOINT} does not say which version" in words and "update its firmware" in words
    bench.drives.mute[joint] = False
    bench.run(60)
    bench.enable()


def test_enabling_is_given_up_while_a_drive_that_has_not_said_its_version_is_silent(bench) -> None:
    joint = bench.index(JOINT)
    bench.drives.mute[joint] = True
    bench.run(1)
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
    bench.drives.silent[joint] = True
    assert not bench.run(round(ENABLING_TIME * 1e9 / bench.description.period_ns) + 1)["flags"] & Flag.ENABLING
    assert bench.ask(Kind.ENABLE) is Answer.DRIVE_FAULT
    bench.drives.mute[joint] = bench.drives.silent[joint] = False
    lives = []
    bench.run(60, lambda: lives.append(bench.drives.life.max()))
    assert max(lives) < State.READY_TO_SWITCH_ON, "who comes back later is not enabled unasked"
    bench.enable()


def test_drives_of_a_family_that_has_no_version_are_not_asked(talos, make_bench) -> None:
    limbs = tuple(dataclasses.replace(limb, family="mit") for limb in talos.limbs)
    bench = make_bench(dataclasses.replace(talos, limbs=limbs))
    bench.drives.mute[:] = True
    bench.run(120)
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
