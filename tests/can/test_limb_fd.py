"""The limb FD protocol: what goes in at one side comes out at the other, and what is damaged does not."""

from __future__ import annotations

from types import SimpleNamespace

import cantools
import crccheck
import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.can import frames
from hal.drives import DBC_FILES
from hal.drives.crc import crc16
from hal.drives.lifecycle import CONTROLWORD, Command, DriveError, State, statusword
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.joint import JointCommand, JointState, Mode
from handrail.robot import library as descriptions

_N = 18


# neighbours are 4.6 % and 5.6 % apart
STIFFNESS_OF_RAW = np.concatenate([[0.0], 0.1 * 1e5 ** (np.arange(255) / 254)])
DAMPING_OF_RAW = np.concatenate([[0.0], 0.001 * 1e6 ** (np.arange(255) / 254)])

_TALOS = descriptions.load("talos_upper")
_TALOS_PROTOCOL = LimbProtocol(_TALOS)


@pytest.fixture
def protocol(robot: SimpleNamespace) -> LimbProtocol:
    return LimbProtocol(robot)


@pytest.fixture(scope="module")
def database() -> Database:
    loaded = cantools.database.load_file(DBC_FILES["limb_fd"])
    assert isinstance(loaded, Database)
    return loaded


def _command(seed: int) -> JointCommand:
    rng = np.random.default_rng(seed)
    command = JointCommand(_N)
    command.position[:] = rng.uniform(-4.0, 4.0, _N)
    command.velocity[:] = rng.uniform(-30.0, 30.0, _N)
    command.torque[:] = rng.uniform(-600.0, 600.0, _N)
    command.stiffness[:] = np.exp(rng.uniform(np.log(0.1), np.log(10_000.0), _N))
    command.damping[:] = np.exp(rng.uniform(np.log(0.001), np.log(1000.0), _N))
    command.mode[:] = rng.integers(0, 4, _N)
    return command


def _state(seed: int) -> JointState:
    rng = np.random.default_rng(seed)
    state = JointState(_N)
    state.position[:] = rng.uniform(-6.0, 6.0, _N)
    state.velocity[:] = rng.uniform(-30.0, 30.0, _N)
    state.torque[:] = rng.uniform(-600.0, 600.0, _N)
    state.temperature[:] = rng.integers(0, 120, _N)
    state.status[:] = statusword(rng.integers(0, 8, _N))
    state.error[:] = rng.integers(0, 8, _N)
    state.sequence[:] = rng.integers(0, 256, _N)
    return state


@settings(deadline=None)  # the first call may compile
@given(data=st.binary(max_size=64))
def test_the_crc_is_ccitt_false(data: bytes) -> None:
    record = frames.empty(1)
    record["data"][0, : len(data)] = np.frombuffer(data, np.uint8)
    assert crc16(frames.words(record), frames.DATA, len(data)) == crccheck.crc.Crc16CcittFalse.calc(data)
    record["data"][0, :9] = np.frombuffer(b"123456789", np.uint8)
    assert crc16(frames.words(record), frames.DATA, 9) == 0x29B1


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1 << 30), sequence=st.integers(0, 255), watchdog=st.integers(0, 255))
def test_a_command_arrives_within_half_a_step_of_every_scale(seed: int, sequence: int, watchdog: int) -> None:
    protocol, out, targets, sent = _TALOS_PROTOCOL, frames.empty(8), DriveTargets(_N), _command(seed)
    count = protocol.encode_commands(sent, sequence, watchdog, out)
    assert count == 3 and protocol.decode(out, count, targets, check_sequence=False) == (3, 0)
    got = targets.command
    # 1e-9: the rounding of the comparison itself
    assert np.abs(got.position - sent.position).max() <= 0.5 * 0.000125 + 1e-9
    assert np.abs(got.velocity - sent.velocity).max() <= 0.5 * 0.001 + 1e-9
    assert np.abs(got.torque - sent.torque).max() <= 0.5 * 0.02 + 1e-9
    assert np.abs(np.log(got.stiffness / sent.stiffness)).max() <= 0.5 * np.log(1e5) / 254 + 1e-9
    assert np.abs(np.log(got.damping / sent.damping)).max() <= 0.5 * np.log(1e6) / 254 + 1e-9
    assert np.array_equal(got.mode, sent.mode)
    assert set(targets.sequence) == {sequence} and set(targets.watchdog) == {watchdog}
    assert targets.commanded.all() and targets.answer.all() and not targets.controlled.any()


def test_stock_cantools_reads_our_commands(protocol: LimbProtocol, robot: SimpleNamespace, database: Database) -> None:
    out, sent = frames.empty(8), _command(3)
    seen = protocol.quantise(sent)
    for record in out[: protocol.encode_commands(sent, 77, 20, out)]:
        message = database.get_message_by_frame_id(int(record["can_id"]))
        values = message.decode(record["data"].tobytes(), decode_choices=False)
        limb = robot.limbs[int(record["can_id"]) - 0x100]
        assert message.name == f"LimbCommand_{limb.index}" and isinstance(values, dict)
        assert (values["Sequence"], values["Watchdog"]) == (77, 20)
        assert values["Crc"] == crccheck.crc.Crc16CcittFalse.calc(record["data"].tobytes()[:60])
        for axis, name in enumerate(limb.joints):
            joint = robot.joints.index(name)
            assert values[f"Position_{axis}"] == pytest.approx(seen.position[joint], abs=1e-12)
            assert values[f"Velocity_{axis}"] == pytest.approx(seen.velocity[joint], abs=1e-12)
            assert values[f"Torque_{axis}"] == pytest.approx(seen.torque[joint], abs=1e-12)
            assert STIFFNESS_OF_RAW[values[f"Stiffness_{axis}"]] == pytest.approx(seen.stiffness[joint])
            assert DAMPING_OF_RAW[values[f"Damping_{axis}"]] == pytest.approx(seen.damping[joint])
            assert values[f"Mode_{axis}"] == seen.mode[joint]


def test_stock_cantools_reads_our_answers(protocol: LimbProtocol, robot: SimpleNamespace, database: Database) -> None:
    out, state = frames.empty(_N), _state(4)
    mode = np.arange(_N, dtype=np.uint8) % 4
    assert protocol.encode_status(state, mode, np.ones(_N, np.bool_), out) == _N
    for joint, record in enumerate(out):
        limb = next(limb for limb in robot.limbs if robot.joints[joint] in limb.joints)
        axis = limb.joints.index(robot.joints[joint])
        message = database.get_message_by_name(f"DriveStatus_{limb.index}_{axis}")
        assert record["can_id"] == message.frame_id and robot.channels[record["bus"]].name == limb.channel
        data = record["data"].tobytes()[: record["length"]]
        values = message.decode(data, decode_choices=False)
        assert isinstance(values, dict)
        assert values["Position"] == pytest.approx(state.position[joint], abs=0.51e-6)
        assert values["Velocity"] == pytest.approx(state.velocity[joint], abs=0.51e-3)
        assert values["Torque"] == pytest.approx(state.torque[joint], abs=0.0101)
        assert values["Statusword"] == state.status[joint] and values["Temperature"] == state.temperature[joint]
        assert values["Error"] == state.error[joint] and values["Sequence"] == state.sequence[joint]
        assert values["Mode"] == mode[joint]
        assert values["Crc"] == crccheck.crc.Crc16CcittFalse.calc(data[:18])


def test_can_tools_show_drive_states_controlwords_and_errors_by_name(
    protocol: LimbProtocol, database: Database
) -> None:
    out, drives, all_joints = frames.empty(_N), JointState(_N), np.ones(_N, np.bool_)
    for state in State:
        drives.status[:], drives.error[:] = statusword(state), DriveError.WATCHDOG
        protocol.encode_status(drives, np.full(_N, Mode.POSITION, np.uint8), all_joints, out)
        shown = database.decode_message(0x200, out["data"][0].tobytes()[:20])
        assert shown["Statusword"] == state.name.lower()
        assert (shown["Error"], shown["Mode"]) == ("watchdog", "position")
    for command in Command:
        protocol.encode_control(np.full(_N, CONTROLWORD[command]), 0, out)
        shown = database.decode_message(0x0C0, out["data"][0].tobytes()[:12])
        assert shown["Controlword_6"] == command.name.lower()
    message = database.get_message_by_frame_id(0x200)
    for name, kind in (("Error", DriveError), ("Mode", Mode)):
        choices = message.get_signal_by_name(name).choices
        assert choices is not None and {k: str(v) for k, v in choices.items()} == {v: v.name.lower() for v in kind}


def test_the_host_reads_what_the_drives_answered(protocol: LimbProtocol) -> None:
    out, sent, got = frames.empty(_N), _state(5), JointState(_N)
    answer = np.arange(_N) % 3 != 1
    count = protocol.encode_status(sent, np.zeros(_N, np.uint8), answer, out)
    assert count == answer.sum() and protocol.decode_status(out, count, got) == (count, 0)
    assert np.array_equal(got.age == 0, answer)
    assert np.abs(got.position - sent.position)[answer].max() <= 0.51e-6
    for name in ("status", "error", "sequence", "temperature"):
        assert np.array_equal(getattr(got, name)[answer], getattr(sent, name)[answer])
        assert not getattr(got, name)[~answer].any()


@settings(max_examples=60, deadline=None)
@given(bit=st.integers(0, 8 * 62 - 1), seed=st.integers(0, 99))
def test_a_command_with_any_flipped_bit_is_refused(bit: int, seed: int) -> None:
    protocol, out, targets = _TALOS_PROTOCOL, frames.empty(8), DriveTargets(_N)
    count = protocol.encode_commands(_command(seed), 1, 20, out)
    out["data"][1, bit // 8] ^= 1 << bit % 8
    assert protocol.decode(out, count, targets) == (2, 1)
    assert targets.commanded.sum() == _N - 7
    assert not targets.command.stiffness[7:14].any()


@pytest.mark.parametrize("bit", range(0, 8 * 20, 5))
def test_an_answer_with_a_flipped_bit_is_refused_and_ages(protocol: LimbProtocol, bit: int) -> None:
    out, got = frames.empty(_N), JointState(_N)
    protocol.encode_status(_state(6), np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    out["data"][3, bit // 8] ^= 1 << bit % 8
    assert protocol.decode_status(out, _N, got) == (_N - 1, 1)
    assert np.flatnonzero(got.age).tolist() == [3] and got.position[3] == 0.0


def test_controlwords_reach_their_drives(protocol: LimbProtocol, database: Database) -> None:
    out, targets = frames.empty(8), DriveTargets(_N)
    words = np.arange(_N, dtype=np.uint8) + 3
    protocol.decode(out, protocol.encode_control(words, 199, out), targets)
    count = protocol.encode_control(words, 200, out)
    assert protocol.decode(out, count, targets) == (3, 0)
    assert np.array_equal(targets.controlword, words) and set(targets.sequence) == {200}
    assert targets.controlled.all() and not targets.commanded.any()
    values = database.decode_message(int(out["can_id"][2]), out["data"][2].tobytes()[:12], decode_choices=False)
    assert [values[f"Controlword_{axis}"] for axis in range(7)] == [17, 18, 19, 20, 0, 0, 0]
    protocol.encode_control(words, 201, out)
    out["data"][0, 0] ^= 1
    assert protocol.decode(out, count, targets) == (2, 1)
    assert targets.controlled.sum() == _N - 7


def test_sync_and_hold_time_carry_the_cycle_on_every_channel(protocol: LimbProtocol, database: Database) -> None:
    out, targets = frames.empty(4), DriveTargets(_N)
    n = protocol.encode_sync((1 << 32) + 5, out)
    assert n == 2 and out["bus"][:2].tolist() == [0, 1] and set(out["can_id"][:2]) == {0x080}
    assert protocol.decode(out, n, targets) == (2, 0)
    assert (targets.syncs, targets.holds, targets.cycle) == (1, 0, 5)
    n = protocol.encode_hold_time(9, out)
    assert database.decode_message(int(out["can_id"][0]), out["data"][0].tobytes()[:4]) == {"Cycle": 9}
    protocol.decode(out, n, targets)
    assert (targets.syncs, targets.holds, targets.cycle) == (0, 1, 9)
    assert not targets.answer.any()


def test_frames_of_other_nodes_and_wrong_channels_are_passed_over(protocol: LimbProtocol) -> None:
    out, targets, got = frames.empty(_N), DriveTargets(_N), JointState(_N)
    count = protocol.encode_commands(_command(1), 1, 20, out)
    out["bus"][0] = 1  # limb 0 is on channel 0
    out["can_id"][1] = 0x7F0
    assert protocol.decode(out, count, targets) == (1, 0)
    protocol.encode_status(_state(1), np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    out["bus"][0], out["can_id"][1] = 1, 0x12345678
    assert protocol.decode_status(out, _N, got) == (_N - 2, 0)


def test_short_and_classic_frames_are_refused(protocol: LimbProtocol) -> None:
    out, targets, got = frames.empty(_N), DriveTargets(_N), JointState(_N)
    count = protocol.encode_commands(_command(1), 1, 20, out)
    out["length"][0], out["flags"][1] = 48, 0
    assert protocol.decode(out, count, targets) == (1, 2)
    protocol.encode_status(_state(1), np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    out["length"][0] = 12
    assert protocol.decode_status(out, _N, got) == (_N - 1, 1)


def test_commands_saturate_at_the_ends_of_their_scales(protocol: LimbProtocol) -> None:
    command = JointCommand(_N)
    for name, value, expected in (
        ("position", 10.0, 4.095875),
        ("velocity", -100.0, -32.768),
        ("torque", 1e6, 655.34),
        ("stiffness", 1e9, 10_000.0),
        ("damping", 1e9, 1000.0),
    ):
        getattr(command, name)[4] = value
        assert getattr(protocol.quantise(command), name)[4] == pytest.approx(expected)


def test_zero_gains_are_exactly_zero_and_negative_ones_too(protocol: LimbProtocol) -> None:
    command = JointCommand(_N)
    command.stiffness[1], command.damping[1] = -5.0, -5.0
    seen = protocol.quantise(command)
    assert not seen.stiffness.any() and not seen.damping.any()
    command.stiffness[:], command.damping[:] = STIFFNESS_OF_RAW[1:19], DAMPING_OF_RAW[200:218]
    seen = protocol.quantise(command)
    assert seen.stiffness == pytest.approx(command.stiffness, rel=1e-12)
    assert seen.damping == pytest.approx(command.damping, rel=1e-12)


def test_quantising_twice_changes_nothing(protocol: LimbProtocol) -> None:
    once = protocol.quantise(_command(9))
    twice = protocol.quantise(once, JointCommand(_N))
    for name in ("position", "velocity", "torque", "stiffness", "damping", "mode"):
        assert np.array_equal(getattr(once, name), getattr(twice, name))


@pytest.mark.parametrize("field", ["position", "velocity", "torque", "stiffness", "damping"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_command_that_is_not_finite_is_refused_by_joint_and_field(
    protocol: LimbProtocol, field: str, value: float
) -> None:
    command = _command(1)
    getattr(command, field)[12] = value
    with pytest.raises(ValueError, match=f"{field} of left_5: (nan|-?inf)"):
        protocol.encode_commands(command, 0, 20, frames.empty(8))


def test_a_broken_sensor_reads_zero_not_nonsense(protocol: LimbProtocol) -> None:
    out, state, got = frames.empty(_N), _state(2), JointState(_N)
    state.position[0], state.torque[0] = np.nan, np.inf
    protocol.encode_status(state, np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    assert protocol.decode_status(out, _N, got) == (_N, 0)
    assert got.position[0] == 0.0 and got.torque[0] == 0.0


def test_the_last_of_several_frames_to_a_limb_counts(protocol: LimbProtocol) -> None:
    out, targets = frames.empty(8), DriveTargets(_N)
    first = protocol.encode_commands(_command(1), 10, 20, out)
    second = protocol.encode_commands(_command(2), 11, 20, out[first:])
    assert protocol.decode(out, first + second, targets) == (6, 0)
    assert set(targets.sequence) == {11}
    assert np.array_equal(targets.command.position, protocol.quantise(_command(2)).position)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"index": 8}, "limb right: index 8; expected 0 to 7"),
        ({"index": 1}, "limb left: index 1; expected 0 to 7, each once"),
        ({"channel": "can9"}, "limb right: channel can9; expected one of can0, can1"),
        ({"joints": tuple(f"right_{i}" for i in range(6))}, "right_6; expected every joint"),
        ({"joints": tuple(f"right_{i}" for i in range(8))}, "limb right: 8 joints; expected 1 to 7"),
    ],
)
def test_a_robot_that_the_protocol_cannot_carry_is_refused(
    robot: SimpleNamespace, change: dict[str, object], says: str
) -> None:
    vars(robot.limbs[0]).update(change)
    with pytest.raises(ValueError, match=says):
        LimbProtocol(robot)


def test_the_real_robot_fits(database: Database) -> None:
    robot, protocol, out = _TALOS, _TALOS_PROTOCOL, frames.empty(_N)
    command, state = JointCommand(_N), JointState(_N)
    command.position[:] = robot.home_position("ready")
    command.stiffness[:], command.mode[:] = robot.stiffness, Mode.IMPEDANCE
    assert np.abs(protocol.quantise(command).stiffness / robot.stiffness - 1).max() < 0.024
    # Every joint's limits fit the scales: nothing saturates that the robot may be told.
    for limit in (robot.lower, robot.upper):
        command.position[:] = limit
        assert np.abs(protocol.quantise(command).position - limit).max() < 1e-4
    command.position[:], command.torque[:], command.velocity[:] = 0.0, robot.torque_limit, robot.velocity_limit
    assert np.abs(protocol.quantise(command).torque - robot.torque_limit).max() < 0.011
    assert np.abs(protocol.quantise(command).velocity - robot.velocity_limit).max() < 0.0006
    state.status[:] = statusword(State.OPERATION_ENABLED)
    assert protocol.encode_status(state, command.mode, np.ones(_N, np.bool_), out) == len(robot.joints)
    for record in out:
        database.decode_message(int(record["can_id"]), record["data"].tobytes()[: record["length"]])
