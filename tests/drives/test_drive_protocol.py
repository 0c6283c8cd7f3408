"""Masters, replays, times of measurement, parameters, mixed robots, and descriptions that are no good."""

from __future__ import annotations

import shutil
from pathlib import Path

import crccheck
import numpy as np
import pytest

from hal.can import frames
from hal.device import DeviceCommand, DeviceState
from hal.drives import crc, family
from hal.drives.lifecycle import DriveError, State, statusword
from hal.drives.parameters import DICTIONARY, Parameter, ParameterResult, find
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.joint import JointCommand, JointState
from handrail.config import ConfigError
from handrail.robot import library as robots
from tests.drives.conftest import network

_LIMB = network({"arm": ("limb_fd", 7), "torso": ("limb_fd", 4)})
_N = 11


@pytest.fixture(scope="module")
def shared() -> LimbProtocol:
    return LimbProtocol(_LIMB)


@pytest.fixture
def protocol(shared: LimbProtocol) -> LimbProtocol:
    shared._clocks[:] = np.nan
    shared._sent, shared.repeated = -1, 0
    return shared


def _answers(protocol: LimbProtocol, sequence: int, out: np.ndarray, position: float = 0.0, time_ns: int = 0) -> int:
    state = JointState(len(protocol.joints))
    state.position[:], state.sequence[:] = position, sequence
    state.status[:] = statusword(State.OPERATION_ENABLED)
    every = np.ones(len(state), np.bool_)
    return protocol.encode_status(state, np.zeros(len(state), np.uint8), every, out, time_ns)


def test_a_limbs_master_answers_for_all_its_axes_with_one_frame() -> None:
    protocol = LimbProtocol(network({"arm": ("limb_fd", 7), "torso": ("limb_fd", 4)}, answer="master"))
    sent, got, out = JointState(_N), JointState(_N), frames.empty(protocol.frames_a_cycle)
    rng = np.random.default_rng(0)
    sent.position[:], sent.velocity[:] = rng.uniform(-8, 8, _N), rng.uniform(-30, 30, _N)
    sent.torque[:], sent.temperature[:] = rng.uniform(-600, 600, _N), np.arange(_N) + 30
    sent.error[:] = rng.integers(0, 9, _N)
    sent.status[:] = statusword(
        rng.integers(0, 8, _N), warning=np.arange(_N) % 2 == 0, internal_limit=np.arange(_N) % 3 == 0
    )
    sent.sequence[:] = 9
    count = protocol.encode_status(sent, np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    assert count == 2 and out["length"][:2].tolist() == [64, 64]
    assert protocol.decode_status(out, count, got) == (2, 0)
    assert np.abs(got.position - sent.position).max() <= 0.51e-6
    assert np.abs(got.torque - sent.torque).max() <= 0.0101 and np.abs(got.velocity - sent.velocity).max() <= 0.51e-3
    assert np.array_equal(got.status, sent.status) and np.array_equal(got.error, sent.error)
    assert (got.sequence == 9).all() and (got.age == 0).all()
    assert got.temperature.tolist() == [36.0] * 7 + [40.0] * 4, "the hottest axis's"
    out["data"][0, 3] ^= 8
    got.age[:] = 1
    sent.sequence[:] = 10
    assert protocol.decode_status(out, 1, got) == (0, 1)


def test_an_answer_that_repeats_counts_for_nothing_and_the_drive_ages(protocol: LimbProtocol) -> None:
    out, state = frames.empty(protocol.frames_a_cycle), JointState(_N)
    words = np.zeros(_N, np.uint8)
    for sequence in range(1, 4):
        protocol.encode_control(words, sequence, frames.empty(8))
        state.age += 1
        assert protocol.decode_status(out, _answers(protocol, sequence, out, 0.1), state) == (_N, 0)
        assert (state.age == 0).all()
    count = _answers(protocol, 3, out, 0.7)  # what a stuck mailbox sends, again and again
    for sequence in range(4, 200):
        protocol.encode_control(words, sequence & 0xFF, frames.empty(8))
        state.age += 1
        assert protocol.decode_status(out, count, state) == (0, 0)
    assert (state.age == 196).all() and state.position == pytest.approx(0.1)
    assert protocol.repeated == 196 * _N


def test_an_answer_from_before_the_last_is_a_replay(protocol: LimbProtocol) -> None:
    out, state = frames.empty(protocol.frames_a_cycle), JointState(_N)
    for sequence in (250, 253, 2):
        protocol.encode_control(np.zeros(_N, np.uint8), sequence, frames.empty(8))
        state.age += 1
        assert protocol.decode_status(out, _answers(protocol, sequence, out), state)[0] == _N
    for old in (253, 1, 90):
        assert protocol.decode_status(out, _answers(protocol, old, out), state) == (0, 0)
    state.age += 200  # so long silent that order can't be told
    assert protocol.decode_status(out, _answers(protocol, 90, out), state) == (_N, 0)


def test_a_command_that_repeats_neither_moves_a_drive_nor_counts_as_heard(protocol: LimbProtocol) -> None:
    out, targets, command = frames.empty(protocol.frames_a_cycle), DriveTargets(_N), JointCommand(_N)
    count = protocol.encode_commands(command, 7, 20, out)
    assert protocol.decode(out, count, targets) == (2, 0) and targets.commanded.all()
    for again in (7, 6, 200):
        command.position[:] = 1.0
        protocol.encode_commands(command, again, 20, out)
        assert protocol.decode(out, count, targets) == (0, 0)
        assert not targets.commanded.any() and not targets.command.position.any()
    assert targets.repeated == 6
    protocol.encode_commands(command, 8, 20, out)
    assert protocol.decode(out, count, targets) == (2, 0) and targets.commanded.all()


def test_a_time_of_measurement_is_the_arrival_but_for_what_a_frame_was_late(protocol: LimbProtocol) -> None:
    out, state = frames.empty(protocol.frames_a_cycle), JointState(_N)
    clock_offset_ns, least_ns = 123_456_000, 70_000
    for cycle in range(1, 120):  # the drives' 16 bits of µs wrap round
        measured = cycle * 2_000_000
        late = 400_000 if cycle % 3 == 0 else 0
        count = _answers(protocol, cycle, out, time_ns=measured + clock_offset_ns)
        out["time_ns"][:count] = measured + least_ns + late
        protocol.encode_control(np.zeros(_N, np.uint8), cycle, frames.empty(8))
        state.age += 1
        protocol.decode_status(out, count, state)
        assert np.abs(state.measured_ns - (measured + least_ns)).max() <= 5_000


def test_a_parameter_is_asked_for_and_answered(protocol: LimbProtocol) -> None:
    out, targets = frames.empty(protocol.frames_a_cycle), DriveTargets(_N)
    assert protocol.encode_request(8, Parameter.TORQUE_LIMIT, 12.5, 77, out) == 1
    assert protocol.decode(out, 1, targets) == (1, 0)
    (request,) = protocol.requests(targets)
    assert (request.joint, request.index, request.write, request.sequence) == (8, Parameter.TORQUE_LIMIT, True, 77)
    assert request.value == 12.5
    assert protocol.encode_reply(request, ParameterResult.OUT_OF_RANGE, 9.25, out) == 1
    protocol.decode_status(out, 1, JointState(_N))
    (reply,) = protocol.replies()
    assert (reply.joint, reply.index, reply.sequence) == (8, Parameter.TORQUE_LIMIT, 77)
    assert (reply.result, reply.value) == (ParameterResult.OUT_OF_RANGE, 9.25)
    out["data"][0, 5] ^= 1
    assert protocol.decode_status(out, 1, JointState(_N)) == (0, 1) and protocol.replies() == []


def test_a_robot_may_mix_families_and_devices() -> None:
    robot = network(
        {"arm": ("limb_fd", 7), "hand": ("mit", 3)}, {"chest": "imu", "grip": "gripper", "battery": "power"}
    )
    protocol = LimbProtocol(robot)
    command, targets, out = JointCommand(10), DriveTargets(10, 3), frames.empty(protocol.frames_a_cycle)
    command.position[:], command.stiffness[:], command.damping[:], command.mode[:] = 0.5, 20.0, 1.0, 2
    count = protocol.encode_commands(command, 1, 20, out)
    assert count == 1 + 3 and out["length"][:4].tolist() == [64, 8, 8, 8]
    assert not (out["flags"][1:4] & frames.FD).any()
    assert protocol.decode(out, count, targets) == (4, 0) and targets.commanded.all()
    assert targets.command.position == pytest.approx(0.5, abs=2e-4)
    assert protocol.encode_request(9, Parameter.SERIAL, None, 1, out) == 0, "mit drives have no parameters"
    assert protocol.protocol_version.tolist() == [2] * 7 + [0] * 3


def test_a_mit_motor_that_faults_is_seen_to() -> None:
    protocol = LimbProtocol(network({"hand": ("mit", 2)}))
    sent, got, out = JointState(2), JointState(2), frames.empty(protocol.frames_a_cycle)
    sent.status[:], sent.error[:] = statusword(State.FAULT), [DriveError.OVERCURRENT, DriveError.UNDERVOLTAGE]
    count = protocol.encode_status(sent, np.zeros(2, np.uint8), np.ones(2, np.bool_), out)
    protocol.decode_status(out, count, got)
    assert np.array_equal(got.error, sent.error) and (got.status & 0x4F == 0x08).all()
    out["data"][0, 0] ^= 1  # the motor's number
    assert protocol.decode_status(out, 1, got) == (0, 1)


@pytest.mark.parametrize("name", crc.NAMES)
def test_every_crc_is_the_catalogues(name: str) -> None:
    class_of = {
        "crc16_ccitt_false": "Crc16CcittFalse", "crc16_modbus": "Crc16Modbus", "crc16_xmodem": "Crc16Xmodem",
        "crc8_sae_j1850": "Crc8SaeJ1850", "crc8_autosar": "Crc8Autosar", "crc8_smbus": "Crc8Smbus", "crc32": "Crc32",
    }  # fmt: skip
    record = frames.empty(1)
    data = bytes(range(7, 60, 3))
    record["data"][0, : len(data)] = np.frombuffer(data, np.uint8)
    for begin, end in ((0, len(data)), (1, len(data)), (3, 9)):
        theirs = getattr(crccheck.crc, class_of[name]).calc(data[begin:end])
        assert crc.crc_of(frames.words(record), frames.DATA, begin, end, crc.NAMES.index(name)) == theirs


def test_every_parameter_is_described_and_found_by_name_and_index() -> None:
    assert set(DICTIONARY) == set(Parameter)
    for parameter in Parameter:
        assert find(parameter.name.lower().replace("_", "-")) is find(hex(parameter)) is parameter
    with pytest.raises(ValueError, match="parameter speed: unknown; expected an index or one of protocol_version"):
        find("speed")


@pytest.fixture
def own_family(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the IMU's folder in a workspace, under a name of its own."""
    folder = tmp_path / "drives" / "my_imu"
    shutil.copytree(family.folders()["imu"], folder)
    (folder / "imu.dbc").rename(folder / "my_imu.dbc")
    text = (folder / "family.yaml").read_text(encoding="utf-8")
    (folder / "family.yaml").write_text(text.replace("name: imu", "name: my_imu"), encoding="utf-8")
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    return folder


def test_a_users_family_is_a_folder_in_the_workspace(own_family: Path) -> None:
    protocol = LimbProtocol(network({"arm": ("limb_fd", 2)}, {"mine": "my_imu"}))
    assert protocol.program.families["my_imu"].folder == own_family
    assert "my_imu" in family.folders() and "imu" in family.folders()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("name: my_imu", "name: other", "name: got 'other'; expected the folder's name, 'my_imu'"),
        ("crc: crc16_ccitt_false", "crc: crc99", "crc: got 'crc99'; expected one of crc16_ccitt_false"),
        ("orientation_x: OrientationX", "orientation_x: Nonsense", "message ImuStatus_0: no signal Nonsense"),
        ("ImuStatus_{device}", "ImuState_{device}", "message ImuState_0: not in the DBC"),
        ("device_status:", "gadget_status:", "messages.gadget_status: expected one of control"),
        ("time: Time", "colour: Time", "fields.colour: no such field; expected one of position"),
        ("devices: 8\n", "devices: 9\n", "message ImuStatus_8: not in the DBC"),
        ("{device}", "{finger}", "got {finger}; expected {limb}, {axis} or {device}"),
    ],
)
def test_a_description_that_is_no_good_is_refused_by_file_and_field(
    own_family: Path, old: str, new: str, says: str
) -> None:
    file = own_family / "family.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        family.read.__wrapped__(own_family)
    assert says in str(error.value) and "family.yaml" in str(error.value)


def test_a_family_that_is_not_there_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"no such drive family; expected one of .*limb_fd"):
        LimbProtocol(network({"arm": ("canopen", 2)}))
    with pytest.raises(ValueError, match="limb arm: family imu is one of devices; expected one of joints"):
        LimbProtocol(network({"arm": ("imu", 2)}))
    with pytest.raises(ValueError, match="limb arm: answer master; family mit has no limb masters"):
        LimbProtocol(network({"arm": ("mit", 2)}, answer="master"))


def test_targets_without_devices_hear_none_and_those_of_another_robot_are_refused():
    robot = robots.load("z1")
    protocol = LimbProtocol(robot)
    out, command = frames.empty(protocol.frames_a_cycle), DeviceCommand(1)
    command.values[:], command.commanded[:] = 0.25, True
    count = protocol.encode_devices(command, 0, 1, 20, out)
    assert count == 1
    deaf, hearing = DriveTargets(6), DriveTargets(6, 1)
    protocol.decode(out, count, deaf)
    protocol.decode(out, count, hearing)
    assert not deaf.devices.commanded.any() and hearing.devices.commanded.all()
    for other in (DriveTargets(5, 1), DriveTargets(6, 2)):
        with pytest.raises(ValueError, match="expected 6 and 1, as the protocol has"):
            protocol.decode(out, count, other)


def test_what_has_fewer_joints_or_devices_than_the_robot_is_refused_not_read_beyond():
    protocol, n = LimbProtocol(robots.load("z1")), 6
    out, short, words = frames.empty(protocol.frames_a_cycle), np.zeros(n - 1, np.uint8), np.zeros(n, np.uint8)
    for joints, controlwords, devices in ((5, words, 1), (6, short, 1), (6, words, 0)):
        with pytest.raises(ValueError, match=r"fewer"):
            protocol.encode_cycle(JointCommand(joints), controlwords, DeviceCommand(devices), 0, 1, 20, out)
    with pytest.raises(ValueError, match="JointCommand: fewer joints than the robot has"):
        protocol.encode_commands(JointCommand(n - 1), 1, 20, out)
    assert protocol.encode_commands(JointCommand(n), 1, 20, out) == 1
    for joints, devices in ((n - 1, 1), (n, 0)):
        with pytest.raises(ValueError, match=r"State: fewer .* than the robot has"):
            protocol.decode_status(out, 0, JointState(joints), DeviceState(devices))
    with pytest.raises(ValueError, match="mode, owed: fewer than the robot has joints, and nodes"):
        protocol.encode_status(JointState(n), short, np.ones(n, np.bool_), out)
