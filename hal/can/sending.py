"""Frames as people type them: cansend's notation, or a message's name with its signals."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Sequence
from pathlib import Path

import can
import cantools

from hal.can.capture import load_dbc, messages_of
from hal.can.frames import fd_length
from hal.drives.family import dbc_files

_RAW = re.compile(
    r"(?P<id>[0-9A-Fa-f]{1,8})#(?:(?P<remote>[Rr])(?P<dlc>[0-8])?|#(?P<flags>[0-9A-Fa-f])(?P<fd>[0-9A-Fa-f.]*)|(?P<data>[0-9A-Fa-f.]*))"
)
_HOW = "expected ID#DATA (123#DEADBEEF), ID##FLAGS DATA for CAN FD (123##1DEADBEEF), ID#R for a remote request, or a message's name"


def parse_frame(text: str) -> can.Message:
    """A frame in cansend's notation: ``123#DEADBEEF``, ``123#R8``, CAN FD ``123##1DEADBEEF`` (1: at the data rate).

    An identifier of eight digits is an extended one. Raises ValueError with what was expected.
    """
    match = _RAW.fullmatch(text)
    if match is None:
        raise ValueError(f"frame {text!r}; {_HOW}")
    identifier = int(match["id"], 16)
    extended = len(match["id"]) > 3
    if identifier > (0x1FFFFFFF if extended else 0x7FF):
        raise ValueError(
            f"frame {text!r}: identifier {identifier:X}; expected at most 7FF, or 1FFFFFFF as eight digits"
        )
    digits = (match["fd"] if match["fd"] is not None else match["data"] or "").replace(".", "")
    if len(digits) % 2:
        raise ValueError(f"frame {text!r}: {len(digits)} hex digits of data; expected two a byte")
    data = bytes.fromhex(digits)
    if match["flags"] is None:
        if len(data) > 8:
            raise ValueError(f"frame {text!r}: {len(data)} bytes; expected at most 8 (ID##1DATA is CAN FD, up to 64)")
        return can.Message(
            arbitration_id=identifier,
            is_extended_id=extended,
            is_remote_frame=match["remote"] is not None,
            dlc=int(match["dlc"] or 0) if match["remote"] else len(data),
            data=None if match["remote"] else data,
        )
    flags = int(match["flags"], 16)
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=extended,
        is_fd=True,
        bitrate_switch=bool(flags & 1),
        error_state_indicator=bool(flags & 2),
        data=data.ljust(fd_length(len(data)), b"\0"),
    )


def encode_message(name: str, signals: Sequence[str], dbcs: Sequence[str | os.PathLike[str]]) -> can.Message:
    """The message `name` of the first DBC file that has it, with signals given as ``Name=value`` (a number or one of its
    choices); what is not given is zero, but for CRC and constants of a drive family's message. Raises ValueError naming what there
    is.
    """
    names: list[str] = []
    for file in dbcs:
        there = messages_of(file).values()
        names += there
        if name in there:
            database = load_dbc(file)
            break
    else:
        near = difflib.get_close_matches(name, names, 4)
        hint = f"did you mean {', '.join(near)}?" if near else f"one of {', '.join(names[:8])}, ..."
        raise ValueError(f"message {name!r} is in no DBC; {_HOW} ({hint})")
    definition = database.get_message_by_name(name)
    known = {signal.name: signal for signal in definition.signals}
    values: dict[str, float | str] = {
        signal.name: signal.minimum if signal.minimum and signal.minimum > 0 else 0 for signal in definition.signals
    }
    for given in signals:
        signal, equals, text = given.partition("=")
        if not equals or signal not in known:
            raise ValueError(f"{name}: {given!r}; expected SIGNAL=VALUE with one of {', '.join(known)}")
        choices = [str(choice) for choice in (known[signal].choices or {}).values()]
        try:
            values[signal] = float(text) if text not in choices else text
        except ValueError as error:
            one_of = f" or one of {', '.join(choices)}" if choices else ""
            raise ValueError(f"{name}.{signal}: {text!r}; expected a number{one_of}") from error
    try:
        data = definition.encode(values)
    except (cantools.Error, ValueError, OverflowError) as error:
        raise ValueError(f"{name}: {error}") from error
    message = can.Message(
        arbitration_id=definition.frame_id,
        is_extended_id=definition.is_extended_frame,
        is_fd=definition.is_fd or len(data) > 8,
        bitrate_switch=definition.is_fd or len(data) > 8,
        data=data,
    )
    own = next((family for family, known_as in dbc_files().items() if known_as == Path(file)), "")
    if not own:
        return message
    from hal.drives.typed import signed  # compiled kernels, which a frame in hex does without

    return signed(own, message, {text.partition("=")[0] for text in signals})
