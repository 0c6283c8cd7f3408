"""Typed messages: what every family's description gives, built-in or a user's own; one test a rule, one run a family."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import shutil
import typing
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import can
import cantools
import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from hal.can import frames
from hal.can.convert import to_message, to_record
from hal.can.sending import encode_message
from hal.drives import cli, family, typed_fields, typed_source
from hal.drives.family import signal_of
from hal.drives.fields import Role
from hal.drives.lifecycle import Command, DriveError, State
from hal.drives.limb_fd import messages as limb_fd
from hal.drives.mit import messages as mit
from hal.drives.parameters import DICTIONARY, Parameter
from hal.drives.power import messages as power
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.drives.typed import NEXT, FrameError, TypedMessage, messages
from hal.joint import JointCommand, JointState, Mode
from handrail.config import ConfigError
from tests.drives.conftest import network

ALL = sorted(family.folders())
JOINTS = [name for name in ALL if family.load(name).serves == "joints"]
BUILT_IN = [name for name in ALL if family.load(name).folder.parent == Path(family.__file__).parent]


@functools.cache
def _database(name: str) -> Database:
    loaded = cantools.database.load_file(family.load(name).dbc)
    assert isinstance(loaded, Database)
    return loaded


def _drawn(
    data: st.DataObject, name: str, kind: type[TypedMessage]
) -> tuple[TypedMessage, dict[str, typed_fields.TypedField]]:
    """A message with any values that it may have."""
    made = family.load(name)
    told = next(k for k in typed_fields.kinds(made) if k.name == kind.__name__)
    given: dict[str, Any] = {}
    for number in told.numbers:
        room = {"limb": made.limbs, "axis": made.axes, "device": made.devices}[number]
        given[number] = data.draw(st.integers(0, room - 1), number)
    if told.message.payloads:
        return kind(**given, command=data.draw(st.sampled_from(Command))), {}  # type: ignore[call-arg]
    items = {item.name: item for item in typed_fields.fields(made, told)}
    for item in items.values():
        one = _values(item)
        given[item.name] = data.draw(
            st.lists(one, min_size=item.axes, max_size=item.axes) if item.axes else one, item.name
        )
    return kind(**given), items


def _values(item: typed_fields.TypedField) -> st.SearchStrategy[Any]:
    if item.kind == "bool":
        return st.booleans()
    if item.kind == "int":
        return st.integers(round(item.low), round(item.high))
    if not item.bounded and not item.log:
        return st.floats(width=32, allow_nan=False, allow_infinity=False)
    return st.floats(item.low, item.high)


def _close(item: typed_fields.TypedField, sent: float, got: float) -> bool:
    if item.log:
        return got == pytest.approx(sent, rel=0.03) or (got == 0 and sent < item.log[0]) or sent < item.log[0] == got
    return abs(got - sent) <= (0.5 * item.scale * (1 + 1e-6) if item.bounded else 0.0)


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name in ALL for kind in messages(name).MESSAGES])
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_what_is_encoded_is_what_cantools_reads_and_what_is_decoded(
    name: str, kind: type[TypedMessage], data: st.DataObject
) -> None:
    sent, items = _drawn(data, name, kind)
    frame = sent.encode()
    got = messages(name).decode(frame)
    assert isinstance(got, kind)
    if not items:
        return
    assert got == kind.decode(frame)
    read = _database(name).decode_message(frame.arbitration_id, frame.data, decode_choices=False)
    assert isinstance(read, dict)
    numbers = {key: getattr(sent, key, 0) for key in ("limb", "axis", "device")}
    for item in items.values():
        there = [{**numbers, "axis": axis} for axis in range(item.axes)] if item.axes else [numbers]
        values = getattr(got, item.name) if item.axes else [getattr(got, item.name)]
        wanted = getattr(sent, item.name) if item.axes else [getattr(sent, item.name)]
        for own, value, want in zip(there, values, wanted, strict=True):
            assert _close(item, want, value), item.name
            if not item.log:
                assert read[item.signal.format_map(own)] == pytest.approx(float(value), rel=1e-12, abs=1e-9)


def _first(record: np.ndarray) -> can.Message:
    return to_message(record[:1].tobytes(), ("can0", "can1"))


@pytest.mark.parametrize("name", JOINTS)
def test_what_the_daemons_tables_encode_is_read_alike_and_the_other_way_round(name: str) -> None:
    protocol = LimbProtocol(network({"left": (name, 3), "right": (name, 2)}))
    command, out, rng = JointCommand(5), frames.empty(protocol.frames_a_cycle), np.random.default_rng(3)
    for field in ("position", "velocity", "torque", "stiffness", "damping"):
        getattr(command, field)[:] = rng.uniform(0.1, 3.0, 5)
    command.mode[:] = Mode.IMPEDANCE
    count = protocol.encode_commands(command, 77, 20, out)
    seen, targets = protocol.quantise(command), DriveTargets(5)
    made = family.load(name)
    for record in out[:count]:
        said = messages(name).decode(_first(record.reshape(1)))
        for field in ("position", "velocity", "torque", "stiffness", "damping"):
            values = getattr(said, typed_fields.snake(signal_of(made.messages[Role.COMMAND].fields[field]).signal))
            first = 3 * said.limb if isinstance(values, list) else 3 * said.limb + said.axis
            rows = getattr(seen, field)[first : first + (3 if isinstance(values, list) else 1)]
            assert np.ravel(values)[: len(rows)] == pytest.approx(rows, abs=1e-9)
        again = said.record(int(record["bus"]))
        assert again.tobytes() == record.reshape(1).tobytes(), "a typed message of what was read is the same frame"
    assert protocol.decode(out, count, targets) == (count, 0)
    protocol.encode_status(JointState(5), np.zeros(5, np.uint8), np.ones(5, np.bool_), out)
    assert messages(name).decode(_first(out)).encode().data == _first(out).data


@pytest.mark.parametrize("name", [name for name in ALL if family.load(name).algorithm >= 0])
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_a_frame_with_a_flipped_bit_is_refused(name: str, data: st.DataObject) -> None:
    kinds = [kind for kind in messages(name).MESSAGES if "crc" in _entry(name, kind).message.fields]
    kind = data.draw(st.sampled_from(kinds))
    frame = kind().encode()
    crc = signal_of(_entry(name, kind).message.fields["crc"]).signal
    start, bits, _ = family.load(name).layout(_entry(name, kind).role, limb=0, axis=0, device=0).rows([crc])[0][0]  # type: ignore[arg-type]
    begin, end = family.load(name).crc_bytes or (0, int(start) // 8)
    bit = data.draw(st.sampled_from([*range(8 * begin, 8 * end), *range(int(start), int(start + bits))]))
    frame.data[bit // 8] ^= 1 << bit % 8
    with pytest.raises(FrameError, match=r"CRC 0x[0-9a-f]+; expected 0x"):
        kind.decode(frame)


def _entry(name: str, kind: type[TypedMessage]) -> typed_fields.Kind:
    return next(k for k in typed_fields.kinds(family.load(name)) if k.name == kind.__name__)


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_any_frame_is_read_refused_or_none_of_a_familys(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(ALL))
    fd, made = data.draw(st.booleans()), family.load(name)
    known = [made.layout(role, **numbers).frame_id for role in made.messages for numbers in made.instances(role)[:8]]
    length = data.draw(st.sampled_from(frames.FD_LENGTHS if fd else range(9)))
    frame = can.Message(
        arbitration_id=data.draw(st.sampled_from(known) | st.integers(0, 0x7FF)), is_extended_id=False, is_fd=fd,
        data=data.draw(st.binary(min_size=length, max_size=length)),
    )  # fmt: skip
    try:
        said = messages(name).decode(frame)
    except FrameError:
        return
    if said is not None:
        assert said.record()["can_id"][0] == frame.arbitration_id


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (
            limb_fd.LimbCommand(limb=2, position=[0.0, 9.0]),
            "LimbCommand_2: Position_1: 9.0 rad; expected -4.096 to 4.095875 rad",
        ),
        (limb_fd.LimbCommand(torque=[float("nan")]), "LimbCommand_0: Torque_0: nan N*m; expected -655.36 to"),
        (limb_fd.LimbCommand(stiffness=[2e4]), "Stiffness_0: 20000.0 N*m/rad; expected 0, or 0.1 to 10000"),
        (limb_fd.LimbCommand(watchdog=256), "Watchdog: 256 cycles; expected 0 to 255"),
        (limb_fd.LimbCommand(watchdog=1.5), "Watchdog: 1.5; expected a whole number"),  # type: ignore[arg-type]
        (limb_fd.LimbCommand(velocity=["fast"]), "Velocity_0: 'fast'; expected"),  # type: ignore[list-item]
        (limb_fd.LimbCommand(position=[0.0] * 8), "position: 8 values; expected at most 7"),
        (limb_fd.LimbCommand(limb=8), "LimbCommand: limb 8; expected 0 to 7"),
        (limb_fd.ParameterRequest(index=Parameter.SERIAL, value=1e39), "Value: 1e[+]39; expected a finite number"),
        (mit.Command(kp=501.0), "Command_0_0: Kp: 501.0 N[*]m/rad; expected 0 to 500"),
        (power.PowerCommand(relay=2), "PowerCommand_0: Relay: 2; expected 0 to 1"),  # type: ignore[arg-type]
    ],
)
def test_what_does_not_fit_is_refused_by_message_signal_value_and_range(message: TypedMessage, problem: str) -> None:
    with pytest.raises(ValueError, match=problem.replace("N*m", "N[*]m")):
        message.encode()


def test_an_array_is_as_good_as_a_list() -> None:
    values = np.linspace(-1.0, 1.0, 7)
    sent = limb_fd.LimbCommand(limb=2, position=values, sequence=5).encode()  # type: ignore[arg-type]
    assert sent.data == limb_fd.LimbCommand(limb=2, position=values.tolist(), sequence=5).encode().data


def test_enums_numbers_and_flags_come_back_as_what_they_are() -> None:
    sent = limb_fd.LimbStatus(limb=3, state=[State.FAULT], error=[DriveError.UNDERVOLTAGE, 12], warning=[True])
    got = limb_fd.LimbStatus.decode(sent.encode())
    assert got.state[0] is State.FAULT and got.warning == [True] + [False] * 6
    assert got.error[0] is DriveError.UNDERVOLTAGE and got.error[1] == 12
    request = limb_fd.decode(limb_fd.ParameterRequest(index=Parameter.TORQUE_LIMIT, write=limb_fd.Write.WRITE).encode())
    assert isinstance(request, limb_fd.ParameterRequest)
    assert request.index is Parameter.TORQUE_LIMIT and request.write is limb_fd.Write.WRITE


def test_sequence_numbers_go_on_limb_by_limb_and_what_answers_keeps_the_number_that_it_was_given() -> None:
    def number(message: TypedMessage) -> int:
        return type(message).decode(message.encode()).sequence  # type: ignore[attr-defined]

    first = number(limb_fd.LimbControl(limb=6))
    assert number(limb_fd.LimbCommand(limb=6)) == (first + 1) & 0xFF, (
        "a drive counts a limb's frames, whichever they are"
    )
    number(limb_fd.LimbCommand(limb=5))
    assert number(limb_fd.LimbControl(limb=6)) == (first + 2) & 0xFF
    assert number(limb_fd.LimbControl(limb=6, sequence=200)) == 200
    assert number(limb_fd.DriveStatus(sequence=9)) == 9
    with pytest.raises(ValueError, match="Sequence: -1; expected 0 to 255"):
        limb_fd.DriveStatus(sequence=NEXT).encode()


def test_fixed_frames_and_set_points_of_one_identifier_are_told_apart() -> None:
    enable = mit.Control(limb=1, axis=2, command=Command.ENABLE_OPERATION).encode()
    assert mit.decode(enable) == mit.Control(limb=1, axis=2, command=Command.ENABLE_OPERATION)
    with pytest.raises(FrameError, match="the fixed frame enable_operation; expected set-points"):
        mit.Command.decode(enable)
    with pytest.raises(FrameError, match="expected a fixed frame"):
        mit.Control.decode(mit.Command(limb=1, axis=2).encode())


def test_a_frame_of_another_identifier_length_or_constant_is_none_of_these() -> None:
    with pytest.raises(FrameError, match="frame 0x80: no LimbControl; expected 0xc0 to 0xc7"):
        limb_fd.LimbControl.decode(limb_fd.Sync().encode())
    short = limb_fd.LimbControl().encode()
    short.data, short.dlc = short.data[:8], 8
    with pytest.raises(FrameError, match="LimbControl_0: 8 bytes; expected 12 of CAN FD"):
        limb_fd.decode(short)
    answer = mit.Feedback(limb=1, axis=2).encode()
    answer.data[0] ^= 1
    with pytest.raises(FrameError, match="Feedback_1_2: Id: 10; expected 11"):
        mit.decode(answer)
    assert limb_fd.decode(can.Message(arbitration_id=0x7FF, is_extended_id=False)) is None
    assert limb_fd.Sync.decode(np.frombuffer(to_record(limb_fd.Sync(cycle=5).encode(), 0), frames.RECORD)).cycle == 5


def test_a_frame_sent_by_its_messages_name_is_one_that_drives_take() -> None:
    words = ["Controlword_2=shutdown", "Sequence=7"]
    sent = encode_message("LimbControl_3", words, [family.load("limb_fd").dbc])
    assert limb_fd.decode(sent) == limb_fd.LimbControl(limb=3, controlword=[0, 0, 6, 0, 0, 0, 0], sequence=7)
    with pytest.raises(FrameError, match="CRC 0x11; expected"):
        limb_fd.decode(encode_message("LimbControl_3", [*words, "Crc=17"], [family.load("limb_fd").dbc]))
    answer = mit.decode(encode_message("Feedback_1_2", ["Position=0.5"], [family.load("mit").dbc]))
    assert isinstance(answer, mit.Feedback) and answer.position == pytest.approx(0.5, abs=2e-4)


def test_every_parameter_is_an_attribute_that_does_what_the_dictionary_says() -> None:
    kinds = {(True, True): "ReadWrite", (True, False): "Readable", (False, True): "WriteOnly"}
    for parameter, entry in DICTIONARY.items():
        attribute = vars(limb_fd.Parameters)[parameter.name.lower()]
        assert type(attribute).__name__ == kinds[entry.readable, entry.writable]
    assert not hasattr(mit, "Parameters")


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_classes_beside_the_dbc_are_what_the_description_gives(name: str) -> None:
    made = family.load(name)
    assert typed_source.messages_file(made).read_text(encoding="utf-8") == typed_source.source(made), (
        f"run `handrail drives types {name} --out {typed_source.messages_file(made)}`"
    )
    assert messages(name).__file__ == str(typed_source.messages_file(made))


@pytest.fixture
def own_family(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's family, another one's copy with awkward names, and a message to which its description gives no meaning."""
    folder = tmp_path / "drives" / "ours"
    shutil.copytree(
        Path(family.__file__).parent / "power", folder, ignore=shutil.ignore_patterns("*.py", "__pycache__")
    )
    text = (folder / "power.dbc").read_text()
    text = text.replace(" SG_ Voltage ", " SG_ class ").replace("PowerStatus", "Status")
    tuning = 'BO_ 1000 Tuning: 2 Host\n SG_ PosGain : 0|8@1+ (0.5,0) [0|100] "1/s" Power_0\n'
    tuning += ' SG_ encode : 8|1@1+ (1,0) [0|1] "" Power_0\n\n'
    text = text.replace("BO_ 808 Status_0", tuning + "BO_ 808 Status_0")
    text = text.replace('0 "open" 1 "closed"', '0 "0 V" 1 "0-V"')
    (folder / "ours.dbc").write_text(text)
    described = (folder / "family.yaml").read_text().replace("name: power", "name: ours")
    (folder / "family.yaml").write_text(
        described.replace("voltage: Voltage", "voltage: class").replace("PowerStatus", "Status")
    )
    (folder / "power.dbc").unlink()
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    yield folder


def test_a_users_family_has_its_classes_without_anything_written(own_family: Path) -> None:
    ours: ModuleType = messages("ours")
    assert {kind.__name__ for kind in ours.MESSAGES} == {"PowerCommand", "Status", "Tuning"}
    assert ours.Status.decode(ours.Status(class_=54.0, relay=ours.Relay.N0_V_1).encode()).class_ == 54.0
    assert [field.name for field in dataclasses.fields(ours.Tuning)] == ["pos_gain", "encode_"]
    tuned = ours.decode(ours.Tuning(pos_gain=12.5, encode_=True).encode())
    assert tuned == ours.Tuning(pos_gain=12.5, encode_=True)
    with pytest.raises(ConfigError, match="no such drive family"):
        messages("theirs")


def test_the_command_writes_classes_that_a_program_imports_and_that_say_when_they_are_old(
    own_family: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(own_family))
    out = own_family / "our_messages.py"
    assert CliRunner().invoke(cli.app, ["types", "ours", "--out", str(out)]).exit_code == 0
    written = importlib.import_module("our_messages")
    assert written.decode(written.Status(class_=3.0).encode()).class_ == 3.0
    (own_family / "our_old_messages.py").write_text(out.read_text().replace("class_: float", "voltage: float"))
    old = importlib.import_module("our_old_messages")
    with pytest.raises(ValueError, match=r"another description of family ours: `handrail drives types ours`"):
        old.Status(voltage=3.0).encode()


def test_the_command_refuses_a_family_and_a_place_that_are_not_there(tmp_path: Path) -> None:
    refused = CliRunner().invoke(cli.app, ["types", "canopen"])
    assert refused.exit_code == 1 and "no such drive family; expected one of" in refused.output
    refused = CliRunner().invoke(cli.app, ["types", "mit", "--out", str(tmp_path / "no" / "where.py")])
    assert refused.exit_code == 1 and "where.py" in refused.output


def test_fields_are_typed_for_editors() -> None:
    hints = typing.get_type_hints(limb_fd.DriveStatus)
    assert hints["position"] is float and hints["mode"] is Mode and hints["limb"] is int
