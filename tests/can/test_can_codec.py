"""The codec built from a DBC gives what cantools gives, bit for bit."""

from __future__ import annotations

import math
from pathlib import Path

import cantools
import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.can import frames, layout
from hal.can.codec import Codec
from hal.drives import DBC_FILES

_LIMB_FD = Codec.from_file(DBC_FILES["limb_fd"])
_NAMES = [message.name for message in _LIMB_FD.database.messages]


def _number(value: object) -> float:
    return float(getattr(value, "value", value))  # type: ignore[arg-type]


def _values(message: Message, draw: st.DataObject) -> dict[str, float]:
    """A physical value for every signal, anywhere in its raw range and between raw steps."""
    values = {}
    for signal in message.signals:
        if signal.is_float:
            wide = signal.length == 64
            raw: float = draw.draw(st.floats(width=64 if wide else 32, allow_nan=False, allow_infinity=False))
            values[signal.name] = raw * signal.scale + signal.offset
            if not wide and abs((values[signal.name] - signal.offset) / signal.scale) > 3e38:
                values[signal.name] = signal.offset
            continue
        low = -(1 << signal.length - 1) if signal.is_signed else 0
        high = low + (1 << signal.length) - 1
        raw = draw.draw(st.integers(low, high)) + draw.draw(st.sampled_from([0.0, 0.0, 0.25, -0.25]))
        values[signal.name] = min(max(raw, low), high) * signal.scale + signal.offset
    return values


def _check_against_cantools(codec: Codec, name: str, draw: st.DataObject) -> None:
    message, layout = codec.database.get_message_by_name(name), codec.layout(name)
    values = _values(message, draw)
    expected = message.encode(values, strict=False)
    record = codec.encode(name, [[values[signal] for signal in layout.signals]], frames.empty(1))
    assert record["data"][0, : layout.length].tobytes() == expected
    assert (record["can_id"][0], record["length"][0]) == (message.frame_id, message.length)
    decoded = message.decode(expected, decode_choices=False)
    assert isinstance(decoded, dict)
    ours = codec.decode(name, record)[0]
    assert ours.tolist() == [_number(decoded[signal]) for signal in layout.signals]


@settings(max_examples=60, deadline=None)
@given(name=st.sampled_from(_NAMES), draw=st.data())
def test_limb_fd_messages_are_encoded_and_decoded_as_cantools_does(name: str, draw: st.DataObject) -> None:
    _check_against_cantools(_LIMB_FD, name, draw)


@st.composite
def _messages(draw: st.DrawFn) -> Message:
    """Any message: signals of any width, sign, byte order, scale, wherever there is room."""
    length = draw(st.sampled_from([8, 16, 64]))
    taken: set[int] = set()
    signals = []
    for number in range(draw(st.integers(1, 8))):
        is_float = draw(st.booleans()) and draw(st.booleans())
        bits = draw(st.sampled_from([32, 64])) if is_float else draw(st.integers(1, 53))
        order = draw(st.sampled_from(["little_endian", "big_endian"]))
        first = draw(st.integers(0, 8 * length - 1))
        sequence = range(first, first + bits)
        if first + bits > 8 * length:
            continue
        # Physical bits, counted as byte·8 + bit from the lowest: big-endian signals run down within each byte.
        where = {8 * (p // 8) + 7 - p % 8 for p in sequence} if order == "big_endian" else set(sequence)
        if where & taken:
            continue
        taken |= where
        start = 8 * (first // 8) + 7 - first % 8 if order == "big_endian" else first
        scale = draw(st.sampled_from([1, 2, 0.5, 0.001, 0.000125, -0.1, 3.7]))
        offset = draw(st.sampled_from([0, -40, 0.25, 1000]))
        signals.append(
            Signal(
                f"s{number}", start, bits, byte_order=order, is_signed=draw(st.booleans()) or is_float,
                conversion=BaseConversion.factory(1 if is_float else scale, 0 if is_float else offset, None, is_float),
            )
        )  # fmt: skip
    return Message(0x123, "m", length, signals, is_fd=length > 8, strict=True)


@settings(max_examples=150, deadline=None)
@given(message=_messages(), draw=st.data())
def test_any_message_is_encoded_and_decoded_as_cantools_does(message: Message, draw: st.DataObject) -> None:
    if message.signals:
        _check_against_cantools(Codec.from_database(Database([message])), "m", draw)


def test_what_does_not_fit_saturates() -> None:
    layout = _LIMB_FD.layout("DriveStatus_0_0")
    for value, expected in ((1e9, [2147.483647, 32.767]), (-1e9, [-2147.483648, -32.768])):
        record = _LIMB_FD.encode("DriveStatus_0_0", [[value] * len(layout.signals)], frames.empty(1))
        assert _LIMB_FD.decode("DriveStatus_0_0", record)[0][:2] == pytest.approx(expected)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_by_name(value: float) -> None:
    layout = _LIMB_FD.layout("DriveStatus_0_0")
    values = np.zeros((3, len(layout.signals)))
    values[2, 1] = value
    with pytest.raises(ValueError, match=r"DriveStatus_0_0: Velocity: (nan|-?inf) in row 2"):
        _LIMB_FD.encode("DriveStatus_0_0", values, frames.empty(3))


def test_errors_name_message_signal_and_expectation(tmp_path: Path) -> None:
    with pytest.raises(KeyError, match="Nonsense"):
        _LIMB_FD.layout("Nonsense")
    with pytest.raises(KeyError, match="message Sync: no signal Speed; it has Cycle"):
        _LIMB_FD.layout("Sync").rows(["Speed"])
    with pytest.raises(ValueError, match=r"shape \(2, 3\).*expected \(k, 1\)"):
        _LIMB_FD.encode("Sync", np.zeros((2, 3)), frames.empty(2))
    with pytest.raises(ValueError, match="a frame of 0 bytes; expected 20"):
        _LIMB_FD.decode("DriveStatus_0_0", frames.empty(1))
    with pytest.raises(ValueError, match=r"missing\.dbc"):
        Codec.from_file(tmp_path / "missing.dbc")
    (tmp_path / "bad.dbc").write_text("BO_ 1 what")
    with pytest.raises(ValueError, match=r"bad\.dbc"):
        Codec.from_file(tmp_path / "bad.dbc")


_ONE = 'VERSION ""\nBU_: A\nBO_ 1 One: 8 A\n SG_ S : 0|8@1+ (0.1,-3) [0|0] "" A\n\n'


def test_a_dbc_that_was_read_once_is_not_read_again_until_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    read: list[object] = []
    monkeypatch.setattr(
        layout, "read_database", lambda file, really=layout.read_database: read.append(file) or really(file)
    )
    file = tmp_path / "one.dbc"
    file.write_text(_ONE + 'BO_ 2 Wide: 8 A\n SG_ W : 0|64@1+ (1,0) [0|0] "" A\n')
    codecs = [Codec.from_file(file) for _ in range(2)]
    assert len(read) == 1
    first, again = (codec.layout("One") for codec in codecs)
    assert (again.name, again.head, again.signals) == (first.name, first.head, first.signals)
    assert np.array_equal(again.places, first.places)
    assert np.array_equal(again.scales, first.scales)
    assert codecs[1].decode("One", codecs[1].encode("One", [[0.7]], frames.empty(1))) == pytest.approx(0.7)
    for codec in codecs:
        with pytest.raises(ValueError, match="Wide: W: 64 bits"):
            codec.layout("Wide")
    file.write_text(_ONE.replace("0|8@", "8|8@"))
    assert Codec.from_file(file).layout("One").places[0, layout.START] == 8
    assert len(read) == 2


def test_multiplexed_messages_and_too_wide_integers_are_refused() -> None:
    text = (
        'VERSION ""\nBU_: A\nBO_ 1 Mux: 8 A\n SG_ M M : 0|8@1+ (1,0) [0|0] "" A\n SG_ X m0 : 8|8@1+ (1,0) [0|0] "" A\n\n'
        'BO_ 2 Wide: 8 A\n SG_ W : 0|64@1+ (1,0) [0|0] "" A\n'
    )
    database = cantools.database.load_string(text, "dbc")
    assert isinstance(database, Database)
    codec = Codec.from_database(database)
    with pytest.raises(ValueError, match="Mux: multiplexed"):
        codec.layout("Mux")
    with pytest.raises(ValueError, match="Wide: W: 64 bits; expected at most 53"):
        codec.layout("Wide")
