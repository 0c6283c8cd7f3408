"""What a float-coded drive says or is told may be no number: such a frame counts for nothing, on either side of the bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hal.can import frames
from hal.drives.lifecycle import NO_NUMBER, DriveError
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.joint import JointCommand, JointState, Mode
from tests.drives import float_family

_NONE = [np.nan, np.inf, -np.inf]


@pytest.fixture
def protocol(make_network: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LimbProtocol:
    float_family.make(tmp_path)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    return LimbProtocol(make_network({"arm": (float_family.NAME, 3)}))


@pytest.mark.parametrize("value", _NONE)
def test_an_answer_that_is_no_number_changes_nothing_and_is_told_until_a_good_one_comes(
    protocol: LimbProtocol, value: float
) -> None:
    sent, got, out = JointState(3), JointState(3), frames.empty(protocol.frames_a_cycle)
    sent.position[:] = [0.5, 1e-9, -3.25]
    answers = np.zeros(3, np.uint8), np.ones(3, np.bool_), out
    assert protocol.decode_status(out, protocol.encode_status(sent, *answers), got) == (3, 0)
    assert got.position == pytest.approx(sent.position, rel=1e-6)
    got.age += 1
    sent.position[:], sent.torque[:] = 1.0, 5.0
    count = protocol.encode_status(sent, *answers)
    out["data"][1, float_family.POSITION] = np.frombuffer(np.float32(value).tobytes(), np.uint8)
    before = got.table[:, 1].copy()
    assert protocol.decode_status(out, count, got) == (2, 1)
    assert (got.table[:, 1] == before).all() and got.age.tolist() == [0, 1, 0]
    assert got.error.tolist() == [DriveError.NONE, NO_NUMBER, DriveError.NONE]
    assert got.position[[0, 2]] == pytest.approx(1.0)
    assert protocol.decode_status(out, protocol.encode_status(sent, *answers), got) == (3, 0)
    assert got.error[1] == DriveError.NONE and got.position == pytest.approx(1.0)


@pytest.mark.parametrize("value", _NONE)
def test_a_drive_takes_no_command_that_is_no_number(protocol: LimbProtocol, value: float) -> None:
    command, targets, out = JointCommand(3), DriveTargets(3), frames.empty(protocol.frames_a_cycle)
    command.position[:], command.mode[:] = [0.1, 0.2, 0.3], Mode.IMPEDANCE
    count = protocol.encode_commands(command, 1, 20, out)
    out["data"][2, float_family.TOLD] = np.frombuffer(np.float32(value).tobytes(), np.uint8)
    assert protocol.decode(out, count, targets) == (2, 1)
    assert targets.commanded.tolist() == targets.answer.tolist() == [True, True, False]
    assert targets.command.position == pytest.approx([0.1, 0.2, 0.0])
