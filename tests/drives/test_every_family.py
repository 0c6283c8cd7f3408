"""What every drive family's folder must hold, built-in or a user's own: made from the descriptions, one test a rule."""

from __future__ import annotations

import functools
import re
from typing import Any

import cantools
import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.can import frames
from hal.device import DeviceCommand, DeviceState
from hal.drives import docs, family
from hal.drives.family import Family, signal_of
from hal.drives.fields import Role
from hal.drives.lifecycle import CONTROLWORD, Command, State, statusword
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.joint import JointCommand, JointState, Mode
from tests.drives.conftest import network

ALL = sorted(family.folders())
JOINTS = [name for name in ALL if family.load(name).serves == "joints"]
DEVICES = [name for name in ALL if family.load(name).serves == "devices"]
_N = 5


@functools.cache
def _protocol(name: str) -> LimbProtocol:
    if name in JOINTS:
        return LimbProtocol(network({"left": (name, 3), "right": (name, 2)}))
    return LimbProtocol(network({"left": ("limb_fd", 1)}, {"a": name, "b": name, "c": name}))


@functools.cache
def _database(name: str) -> Database:
    loaded = cantools.database.load_file(family.load(name).dbc)
    assert isinstance(loaded, Database)
    return loaded


def _signals(record: Any, name: str) -> dict[str, float]:
    values = _database(name).decode_message(
        int(record["can_id"]), record["data"].tobytes()[: record["length"]], decode_choices=False
    )
    assert isinstance(values, dict)
    return values  # type: ignore[return-value]


def _step(made: Family, role: Role, field: str) -> tuple[float, float, float]:
    """Scale, least and greatest value of a linear field of the family's first message of a role."""
    signal = signal_of({**made.messages[role].fields, **made.messages[role].columns}[field])
    numbers = {"limb": 0, "axis": 0, "device": 0}
    scale, offset, low, high = made.layout(role, **numbers).rows([signal.signal.format_map(numbers)])[1][0]
    return float(scale), float(low * scale + offset), float(high * scale + offset)


def _is_linear(made: Family, role: Role, field: str) -> bool:
    given = {**made.messages[role].fields, **made.messages[role].columns}.get(field)
    return (
        given is not None and bool(signal_of(given).signal) and not signal_of(given).log and not signal_of(given).values
    )


def _command(made: Family, seed: int, beyond: float = 1.0) -> JointCommand:
    """Set-points anywhere in the family's ranges (or `beyond` times them)."""
    rng, command = np.random.default_rng(seed), JointCommand(_N)
    for field in ("position", "velocity", "torque", "stiffness", "damping"):
        if _is_linear(made, Role.COMMAND, field):
            _, low, high = _step(made, Role.COMMAND, field)
            getattr(command, field)[:] = rng.uniform(low * beyond, high * beyond, _N)
        elif field in made.messages[Role.COMMAND].fields:
            low, high = signal_of(made.messages[Role.COMMAND].fields[field]).log or (0.0, 0.0)
            getattr(command, field)[:] = np.exp(rng.uniform(np.log(low), np.log(high), _N))
    modes = [Mode[mode.upper()] for mode in made.modes]
    command.mode[:] = rng.choice(modes, _N)
    return command


@pytest.mark.parametrize("name", ALL)
def test_every_message_of_a_family_is_one_that_cantools_reads_and_the_codec_has(name: str) -> None:
    made = family.load(name)
    for role in made.messages:
        for numbers in made.instances(role):
            layout = made.layout(role, **numbers)
            message = _database(name).get_message_by_name(layout.name)
            assert (message.frame_id, message.length) == (layout.frame_id, layout.length)


@pytest.mark.parametrize("name", ALL)
def test_the_messages_of_a_role_are_alike_but_for_their_numbers(name: str) -> None:
    made, database = family.load(name), _database(name)
    for role in made.messages:
        found = {
            tuple(numbers.values()): database.get_message_by_name(made.layout(role, **numbers).name)
            for numbers in made.instances(role)
        }
        first = found[0, 0, 0]
        # By how much an identifier goes up with limb, axis and device.
        strides = [
            found[one].frame_id - first.frame_id if one in found else 0 for one in ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        ]
        for numbers, message in found.items():
            assert message.frame_id == first.frame_id + int(np.dot(strides, numbers)), message.name
            assert _likeness(message) == _likeness(first), message.name
        axes: dict[str, set[Any]] = {}
        for signal in first.signals:
            stem, _, axis = signal.name.rpartition("_")
            if axis.isdigit():
                axes.setdefault(stem, set()).add(_likeness_of_signal(signal))
        assert all(len(alike) == 1 for alike in axes.values()), first.name


def _likeness(message: Message) -> tuple[Any, ...]:
    signals = [(_numberless(signal.name), signal.start, *_likeness_of_signal(signal)) for signal in message.signals]
    return message.length, message.is_fd, message.is_extended_frame, _numberless(message.comment), signals


def _likeness_of_signal(signal: Signal) -> tuple[Any, ...]:
    choices = tuple((raw, str(text)) for raw, text in (signal.choices or {}).items())
    words = (signal.unit, _numberless(signal.comment), choices)
    scale = (signal.length, signal.byte_order, signal.is_signed, signal.is_float, signal.scale, signal.offset)
    return *scale, signal.minimum, signal.maximum, *words


def _numberless(text: str | None) -> str:
    return re.sub(r"(?<=[_ ])\d+", "#", text or "")


@pytest.mark.parametrize("name", JOINTS)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1 << 30), sequence=st.integers(0, 255))
def test_a_command_arrives_within_half_a_step_and_does_what_its_mode_says(name: str, seed: int, sequence: int) -> None:
    made, protocol = family.load(name), _protocol(name)
    sent, out, targets = _command(made, seed), frames.empty(protocol.frames_a_cycle), DriveTargets(_N)
    count = protocol.encode_commands(sent, sequence, 20, out)
    assert protocol.decode(out, count, targets) == (count, 0)
    assert targets.commanded.all() and targets.answer.all() and not targets.controlled.any()
    got = targets.command
    realised = "mode" not in made.messages[Role.COMMAND].fields or bool(
        signal_of(made.messages[Role.COMMAND].fields["mode"]).signal
    )
    for field in ("position", "velocity", "torque", "stiffness", "damping"):
        wanted = getattr(sent, field).copy()
        if not realised:  # the host makes torque and damping of the impedance law
            if field in ("stiffness", "damping"):
                wanted[sent.mode == Mode.TORQUE] = 0.0
            if field in ("stiffness", "velocity", "torque"):
                wanted[sent.mode == Mode.DAMPING] = 0.0
        if _is_linear(made, Role.COMMAND, field):
            assert np.abs(getattr(got, field) - wanted).max() <= 0.5 * _step(made, Role.COMMAND, field)[0] * (1 + 1e-6)
        elif field in made.messages[Role.COMMAND].fields:
            assert getattr(got, field) == pytest.approx(wanted, rel=0.03)
    if realised:
        assert np.array_equal(got.mode, sent.mode)
    else:
        assert (got.mode == Mode.IMPEDANCE).all()


@pytest.mark.parametrize("name", JOINTS)
def test_what_is_beyond_a_scale_saturates_at_its_end(name: str) -> None:
    made, protocol = family.load(name), _protocol(name)
    command = JointCommand(_N)
    command.mode[:] = Mode.IMPEDANCE
    for field in ("position", "velocity", "torque", "stiffness", "damping"):
        if not _is_linear(made, Role.COMMAND, field):
            continue
        step, low, high = _step(made, Role.COMMAND, field)
        getattr(command, field)[:] = [high + 10, low - 10, high * 100 + 1, high, low]
        seen = getattr(protocol.quantise(command), field)
        assert seen == pytest.approx([high, low, high, high, low], abs=step)


@pytest.mark.parametrize("name", JOINTS)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1 << 30))
def test_an_answer_arrives_within_half_a_step_and_cantools_reads_it_alike(name: str, seed: int) -> None:
    made, protocol, rng = family.load(name), _protocol(name), np.random.default_rng(seed)
    sent, got, out = JointState(_N), JointState(_N), frames.empty(protocol.frames_a_cycle)
    for field in ("position", "velocity", "torque"):
        _, low, high = _step(made, Role.STATUS, field)
        getattr(sent, field)[:] = rng.uniform(low, high, _N)
    sent.temperature[:] = rng.integers(0, 120, _N)
    sent.status[:] = statusword(rng.choice([State.SWITCHED_ON, State.OPERATION_ENABLED], _N))
    sent.sequence[:] = sequence = int(rng.integers(0, 256))
    protocol.encode_control(np.zeros(_N, np.uint8), sequence, out)  # what they answer
    count = protocol.encode_status(sent, np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    assert count == _N and protocol.decode_status(out, count, got) == (_N, 0)
    assert (got.age == 0).all() and np.array_equal(got.status & 0x6F, sent.status & 0x6F)
    for field in ("position", "velocity", "torque"):
        assert np.abs(getattr(got, field) - getattr(sent, field)).max() <= 0.5 * _step(made, Role.STATUS, field)[0] * (
            1 + 1e-6
        )
        signal = signal_of(made.messages[Role.STATUS].fields[field]).signal
        read = [_signals(record, name)[signal] for record in out[:count]]
        assert np.allclose(read, getattr(got, field), atol=1e-9)


@pytest.mark.parametrize("name", JOINTS)
def test_controlwords_arrive_as_the_commands_that_they_are(name: str) -> None:
    made, protocol = family.load(name), _protocol(name)
    out, targets = frames.empty(protocol.frames_a_cycle), DriveTargets(_N)
    payloads = made.messages[Role.CONTROL].payloads
    protocol.decode(out, protocol.encode_control(np.zeros(_N, np.uint8), 255, out), targets)  # a stream's first
    for sequence, command in enumerate(Command):
        count = protocol.encode_control(np.full(_N, CONTROLWORD[command]), sequence, out)
        assert protocol.decode(out, count, targets) == (count, 0)
        assert targets.controlled.all() and not targets.commanded.any()
        if payloads:  # several commands may share a frame; the drive takes the first
            same = [c for c in Command if payloads[c.name.lower()] == payloads[command.name.lower()]]
            assert (targets.controlword == CONTROLWORD[same[0]]).all()
        else:
            assert (targets.controlword == CONTROLWORD[command]).all()


@pytest.mark.parametrize("name", [n for n in JOINTS if family.load(n).algorithm >= 0])
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_no_frame_with_a_flipped_bit_is_believed(name: str, data: st.DataObject) -> None:
    made, protocol, targets, got = family.load(name), _protocol(name), DriveTargets(_N), JointState(_N)
    out = frames.empty(protocol.frames_a_cycle)
    count = protocol.encode_commands(_command(made, 1), 1, 20, out)
    length = made.layout(Role.COMMAND, limb=0, axis=0, device=0).length
    covered = _covered_bits(made, Role.COMMAND, length)
    bit = data.draw(st.sampled_from(covered))
    out["data"][0, bit // 8] ^= 1 << bit % 8
    assert protocol.decode(out, count, targets) == (count - 1, 1)
    count = protocol.encode_control(np.full(_N, CONTROLWORD[Command.SHUTDOWN], np.uint8), 1, out)
    bit = data.draw(st.sampled_from(_covered_bits(made, Role.CONTROL, int(out["length"][0]))))
    out["data"][0, bit // 8] ^= 1 << bit % 8
    words = targets.controlword.copy()
    assert protocol.decode(out[:1], 1, targets)[1] == 1
    assert np.array_equal(targets.controlword, words)
    assert protocol.decode(out, count, targets)[1] == 1
    state = JointState(_N)
    count = protocol.encode_status(state, np.zeros(_N, np.uint8), np.ones(_N, np.bool_), out)
    bit = data.draw(st.sampled_from(_covered_bits(made, Role.STATUS, int(out["length"][0]))))
    out["data"][0, bit // 8] ^= 1 << bit % 8
    assert protocol.decode_status(out, count, got) == (_N - 1, 1)


def _covered_bits(made: Family, role: Role, length: int) -> list[int]:
    """Bits of the bytes that the CRC is over, and of the CRC itself."""
    signal = signal_of(made.messages[role].fields["crc"]).signal
    start, bits, _ = (int(v) for v in made.layout(role, limb=0, axis=0, device=0).rows([signal])[0][0])
    begin, end = made.crc_bytes or (0, start // 8)
    return [*range(8 * begin, 8 * end), *range(start, start + bits)]


@pytest.mark.parametrize("name", DEVICES)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1 << 30))
def test_what_a_device_measured_arrives_within_half_a_step_and_cantools_reads_it_alike(name: str, seed: int) -> None:
    made, protocol, rng = family.load(name), _protocol(name), np.random.default_rng(seed)
    columns, sent, got = made.columns(Role.DEVICE_STATUS), DeviceState(3), DeviceState(3)
    steps = [_step(made, Role.DEVICE_STATUS, column) for column in columns]
    for column, (_, low, high) in enumerate(steps):
        sent.values[:, column] = rng.uniform(low, high, 3)
    out, sequences = frames.empty(protocol.frames_a_cycle), np.full(3, rng.integers(0, 256), np.uint8)
    due = np.array([True, False, True])
    count = protocol.encode_device_status(sent, due, sequences, out)
    got.age[:] = 1 << 30
    protocol._device_sequence[:] = 0
    assert count == 2 and protocol.decode_status(out, count, JointState(1), got) == (2, 0)
    assert np.array_equal(got.age == 0, due)
    for column, (step, _, _) in enumerate(steps):
        assert np.abs(got.values[due, column] - sent.values[due, column]).max() <= 0.5 * step * (1 + 1e-6)
        signal = signal_of(made.messages[Role.DEVICE_STATUS].columns[columns[column]]).signal
        assert np.allclose([_signals(r, name)[signal] for r in out[:count]], got.values[due, column], atol=1e-9)
    bits = _covered_bits(made, Role.DEVICE_STATUS, int(out["length"][0])) if made.algorithm >= 0 else [0]
    for bit in bits:
        flipped = out[:1].copy()
        flipped["data"][0, bit // 8] ^= 1 << bit % 8
        assert protocol.decode_status(flipped, 1, JointState(1), got)[1] == (1 if made.algorithm >= 0 else 0)


@pytest.mark.parametrize("name", [n for n in DEVICES if Role.DEVICE_COMMAND in family.load(n).messages])
def test_a_device_hears_only_what_is_commanded_and_due(name: str) -> None:
    made, protocol = family.load(name), _protocol(name)
    command, targets, out = DeviceCommand(3), DriveTargets(1, 3), frames.empty(protocol.frames_a_cycle)
    for column, key in enumerate(made.columns(Role.DEVICE_COMMAND)):
        command.values[:, column] = _step(made, Role.DEVICE_COMMAND, key)[2]
    command.commanded[:] = [True, True, False]
    assert protocol.encode_devices(command, made.every + 1, 5, 20, out) == 0, "not their turn"
    count = protocol.encode_devices(command, 2 * made.every, 5, 20, out)
    assert count == 2 and protocol.decode(out, count, targets) == (2, 0)
    assert targets.devices.commanded.tolist() == [True, True, False]
    width = len(made.columns(Role.DEVICE_COMMAND))
    assert np.allclose(targets.devices.values[0, :width], command.values[0, :width])
    assert protocol.decode(out, count, targets) == (0, 0) and not targets.devices.commanded.any(), "a repetition"
    command.values[1, 0] = np.nan
    with pytest.raises(ValueError, match="column 0 of b: nan"):
        protocol.encode_devices(command, 0, 6, 20, out)


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_random_frames_are_refused_or_read_and_never_crash(name: str, data: st.DataObject) -> None:
    made, protocol = family.load(name), _protocol(name)
    known = [made.layout(role, **numbers).frame_id for role in made.messages for numbers in made.instances(role)[:8]]
    record = frames.empty(1)
    record["can_id"] = data.draw(st.sampled_from(known) | st.integers(0, 0x1FFFFFFF))
    record["length"] = data.draw(st.sampled_from(frames.FD_LENGTHS))
    record["flags"], record["bus"] = data.draw(st.integers(0, 15)), data.draw(st.integers(0, 15))
    payload = data.draw(st.binary(max_size=64))
    record["data"][0, : len(payload)] = np.frombuffer(payload, np.uint8)
    n, d = len(protocol.joints), len(protocol.devices)
    state, devices, targets = JointState(n), DeviceState(d), DriveTargets(n, d)
    good, refused = protocol.decode_status(record, 1, state, devices)
    assert 0 <= good + refused <= 1 and np.isfinite(state.table).all() and np.isfinite(devices.values).all()
    good, refused = protocol.decode(record, 1, targets)
    assert 0 <= good + refused <= 1 and np.isfinite(targets.command.table).all()
    if made.algorithm >= 0 and not good:
        assert not targets.answer.any()


@pytest.mark.parametrize("name", ALL)
def test_the_reference_in_the_docs_is_what_the_description_gives(name: str) -> None:
    assert docs.reference_file(name).read_text(encoding="utf-8") == docs.reference(family.load(name)), (
        f"run `handrail drives docs {name} --write`"
    )
