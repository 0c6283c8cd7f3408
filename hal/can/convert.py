"""Records and python-can's messages, one to one."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import can

from hal.can.frames import BRS, BYTES, ESI, EXTENDED, FD, REMOTE, fd_length

_RECORD = struct.Struct("<QIBBBx64s")
assert _RECORD.size == BYTES


def to_message(record: bytes | memoryview, names: Sequence[str], *, rx: bool = True) -> can.Message:
    """One record's bytes as a message; its channel's name out of `names`, its timestamp in s."""
    time_ns, can_id, length, flags, bus, data = _RECORD.unpack(record)
    return can.Message(
        timestamp=time_ns * 1e-9,
        arbitration_id=can_id,
        is_extended_id=bool(flags & EXTENDED),
        is_remote_frame=bool(flags & REMOTE),
        channel=names[bus],
        dlc=length,
        data=None if flags & REMOTE else data[:length],
        is_fd=bool(flags & FD),
        is_rx=rx,
        bitrate_switch=bool(flags & BRS),
        error_state_indicator=bool(flags & ESI),
    )


def to_record(message: can.Message, bus: int) -> bytes:
    """A message as one record's bytes, for the channel with index `bus`.

    FD data of a length that CAN FD does not have is padded with zeros to the next that it has. Raises ValueError for error
    frames, identifiers that don't fit and data that is too long.
    """
    if message.is_error_frame:
        raise ValueError(
            "CAN message: an error frame; expected a data or remote frame, since only controllers send errors"
        )
    limit = 0x1FFFFFFF if message.is_extended_id else 0x7FF
    if not 0 <= message.arbitration_id <= limit:
        raise ValueError(f"CAN message: arbitration_id {message.arbitration_id:#x}; expected 0 to {limit:#x}")
    data = bytes(message.data or b"")
    flags = EXTENDED if message.is_extended_id else 0
    if message.is_fd:
        length = fd_length(len(data))
        flags |= FD | (BRS if message.bitrate_switch else 0) | (ESI if message.error_state_indicator else 0)
    else:
        length = message.dlc if message.is_remote_frame else len(data)
        if length > 8:
            raise ValueError(f"CAN message: {length} bytes of data; expected at most 8 (is_fd=True takes up to 64)")
        flags |= REMOTE if message.is_remote_frame else 0
    return _RECORD.pack(round(message.timestamp * 1e9), message.arbitration_id, length, flags, bus, data)
