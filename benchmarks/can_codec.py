"""What a limb's frames cost to encode and decode, against cantools: ``handrail bench can_codec``.

Both work from the same DBC (hal/drives/limb_fd/limb_fd.dbc), one after the other in turns, so that both see the same machine. Ours
includes the CRC, its check, and the logarithmic scales; cantools, one message a call as it works, does none of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import cantools
import msgspec
import numpy as np
from cantools.database.can import Database, Message

from benchmarks.rows import Row, against
from hal.can import frames
from hal.can.codec import Codec
from hal.can.timing import BusTiming
from hal.drives import DBC_FILES
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.joint import JointCommand, JointState
from handrail.robot.description import Limb

_ROUNDS, _ROUND_S = 15, 0.01
_GOAL = 1 / 8
_MOST_US = 1.5


def _robot() -> Any:
    """Two arms of seven joints and a torso of four, on two channels: 3 commands and 18 answers a cycle."""
    limbs = [
        Limb(name, index, channel, tuple(f"{name}_{i}" for i in range(count)))
        for index, (name, channel, count) in enumerate(
            [("right", "can0", 7), ("left", "can1", 7), ("torso", "can1", 4)]
        )
    ]
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    return SimpleNamespace(joints=joints, limbs=limbs, channels=[BusTiming("can0"), BusTiming("can1")], devices=())


def _pace(work: Callable[[], object], count: int) -> float:
    """µs a frame over about _ROUND_S."""
    calls, start = 0, time.perf_counter()
    while (spent := time.perf_counter() - start) < _ROUND_S:
        work()
        calls += 1
    return spent / (calls * count) * 1e6


def _row(name: str, ours: tuple[Callable[[], object], int], peer: tuple[Callable[[], object], int]) -> Row:
    """Medians over turns of both; the callables do so many frames a call."""
    both = np.array([(_pace(*ours), _pace(*peer)) for _ in range(_ROUNDS)])
    value, peer_value = (float(median) for median in np.median(both, axis=0))
    row = against(name, value, "µs/frame", "cantools", peer_value, at_most=_GOAL)
    return msgspec.structs.replace(row, goal=f"≤{_MOST_US:g} µs, 1/8", holds=row.holds and value <= _MOST_US)


def _message(database: Database, name: str) -> tuple[Message, dict[str, Any]]:
    message = database.get_message_by_name(name)
    return message, {signal.name: 1.0 if not signal.choices else 1 for signal in message.signals}


def rows() -> list[Row]:
    """One row a task. About 3 s."""
    database = cantools.database.load_file(DBC_FILES["limb_fd"])
    assert isinstance(database, Database)
    protocol, n = LimbProtocol(_robot()), 18
    command, state, targets = JointCommand(n), JointState(n), DriveTargets(n)
    command.position[:], command.stiffness[:], command.damping[:], command.mode[:] = 0.5, 500.0, 12.0, 2
    state.position[:] = 0.5
    mode, answer = np.full(n, 2, np.uint8), np.ones(n, np.bool_)
    to_drives, to_host, out = frames.empty(n), frames.empty(n), frames.empty(n)
    commands = protocol.encode_commands(command, 1, 20, to_drives)
    protocol.encode_status(state, mode, answer, to_host)

    def decode() -> None:
        state.age[:] = 1 << 30  # else the same answers again would be a replay
        protocol.decode_status(to_host, n, state)

    limb, limb_values = _message(database, "LimbCommand_0")
    drive, drive_values = _message(database, "DriveStatus_0_0")
    limb_data, drive_data = limb.encode(limb_values), drive.encode(drive_values)

    codec = Codec.from_file(DBC_FILES["limb_fd"])
    table = np.ones((n, len(codec.layout("DriveStatus_0_0").signals)))
    batch = codec.encode("DriveStatus_0_0", table, frames.empty(n))
    return [
        _row(
            "host encodes LimbCommand, 3 a batch",
            (lambda: protocol.encode_commands(command, 1, 20, out), commands),
            (lambda: limb.encode(limb_values, strict=False), 1),
        ),
        _row(
            "drives decode LimbCommand, 3 a batch",
            (lambda: protocol.decode(to_drives, commands, targets, check_sequence=False), commands),
            (lambda: limb.decode(limb_data, decode_choices=False), 1),
        ),
        _row(
            "drives encode DriveStatus, 18 a batch",
            (lambda: protocol.encode_status(state, mode, answer, out), n),
            (lambda: drive.encode(drive_values, strict=False), 1),
        ),
        _row(
            "host decodes DriveStatus, 18 a batch",
            (decode, n),
            (lambda: drive.decode(drive_data, decode_choices=False), 1),
        ),
        _row(
            "generic codec encodes DriveStatus, 18 a batch",
            (lambda: codec.encode("DriveStatus_0_0", table, out), n),
            (lambda: drive.encode(drive_values, strict=False), 1),
        ),
        _row(
            "generic codec decodes DriveStatus, 18 a batch",
            (lambda: codec.decode("DriveStatus_0_0", batch), n),
            (lambda: drive.decode(drive_data, decode_choices=False), 1),
        ),
    ]
