"""A drive's life after CiA 402 (IEC 61800-7-201): states, statuswords, controlwords.

::

    NOT_READY → SWITCH_ON_DISABLED ⇄ READY_TO_SWITCH_ON ⇄ SWITCHED_ON ⇄ OPERATION_ENABLED → QUICK_STOP_ACTIVE
                        ↑                                                                         │
                        ├───────────────────────── disable voltage ───────────────────────────────┘
                        └── fault reset ── FAULT ← FAULT_REACTION_ACTIVE ← any state

From quick stop active the only way on is disable voltage: a drive that was stopped does not move until it is enabled anew
(the standard's optional way straight back to operation enabled is not taken). Everything here works on single values and on
arrays alike; the tables are plain arrays, so that compiled code can index them too.
"""

from __future__ import annotations

import enum
from typing import Any

import numpy as np
import numpy.typing as npt


class State(enum.IntEnum):
    """States of CiA 402; `name.lower()` is what people read."""

    NOT_READY_TO_SWITCH_ON = 0
    SWITCH_ON_DISABLED = 1
    READY_TO_SWITCH_ON = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION_ACTIVE = 6
    FAULT = 7


class Command(enum.IntEnum):
    """What a controlword asks for (CiA 402, table 28)."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3
    """also: disable operation"""
    ENABLE_OPERATION = 4
    FAULT_RESET = 5


class DriveError(enum.IntEnum):
    """Why a drive stopped; the status frame's error byte."""

    NONE = 0
    WATCHDOG = 1
    """the command stream stopped"""
    OVERTEMPERATURE = 2
    OVERSPEED = 3
    ENCODER = 4
    OVERCURRENT = 5
    COMMUNICATION = 6
    INTERNAL = 7
    UNDERVOLTAGE = 8
    """no power: the relay is open, or the battery empty"""


NO_NUMBER = 255
"""What the host notes in place of a drive's error byte: what it said last was no finite number, and counted for nothing."""


CONTROLWORD = np.array([0x00, 0x02, 0x06, 0x07, 0x0F, 0x80], np.uint8)
"""Controlword of each Command, low byte."""

FOLLOW = 0xFF
"""No controlword: the drive is written a set-point instead, in a cycle in which others are not (LimbProtocol.encode_cycle)."""

_STATUSWORD = np.array([0x0000, 0x0040, 0x0021, 0x0023, 0x0027, 0x0007, 0x000F, 0x0008], np.uint16)

VOLTAGE_ENABLED = 0x0010
"""Statusword bit 4: power is on the motor's stage."""
WARNING = 0x0080
"""Statusword bit 7."""
REMOTE = 0x0200
"""Statusword bit 9: the drive follows its controlword."""
TARGET_REACHED = 0x0400
"""Statusword bit 10."""
INTERNAL_LIMIT = 0x0800
"""Statusword bit 11: a limit inside the drive acts."""


def _state_table() -> npt.NDArray[np.uint8]:
    table = np.full(128, State.NOT_READY_TO_SWITCH_ON, np.uint8)
    for low in range(128):
        for state in State:
            powered = state in (
                State.READY_TO_SWITCH_ON,
                State.SWITCHED_ON,
                State.OPERATION_ENABLED,
                State.QUICK_STOP_ACTIVE,
            )
            mask = 0x6F if powered else 0x4F
            if low & mask == int(_STATUSWORD[state]) & mask:
                table[low] = state
    return table


STATE_OF_STATUSWORD = _state_table()
"""(128,) State of a statusword's low 7 bits."""


def _command_table() -> npt.NDArray[np.uint8]:
    table = np.zeros((2, 256), np.uint8)
    for reset_before in (0, 1):
        for word in range(256):
            if word & 0x80 and not reset_before:
                command = Command.FAULT_RESET
            elif not word & 0x02:
                command = Command.DISABLE_VOLTAGE
            elif not word & 0x04:
                command = Command.QUICK_STOP
            elif not word & 0x01:
                command = Command.SHUTDOWN
            elif not word & 0x08:
                command = Command.SWITCH_ON
            else:
                command = Command.ENABLE_OPERATION
            table[reset_before, word] = command
    return table


COMMAND_OF_CONTROLWORD = _command_table()
"""(2, 256) Command of a controlword; row: was fault reset (bit 7) set in the controlword before? It acts on its rising edge."""


def _transition_table() -> npt.NDArray[np.uint8]:
    table = np.repeat(np.arange(8, dtype=np.uint8)[:, None], 6, axis=1)
    S, C = State, Command
    for state, command, after in (  # the numbers are the standard's
        (S.SWITCH_ON_DISABLED, C.SHUTDOWN, S.READY_TO_SWITCH_ON),  # 2
        (S.READY_TO_SWITCH_ON, C.SWITCH_ON, S.SWITCHED_ON),  # 3
        (S.READY_TO_SWITCH_ON, C.ENABLE_OPERATION, S.SWITCHED_ON),  # 3; 4 follows with the next controlword
        (S.SWITCHED_ON, C.ENABLE_OPERATION, S.OPERATION_ENABLED),  # 4
        (S.OPERATION_ENABLED, C.SWITCH_ON, S.SWITCHED_ON),  # 5
        (S.SWITCHED_ON, C.SHUTDOWN, S.READY_TO_SWITCH_ON),  # 6
        (S.READY_TO_SWITCH_ON, C.DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 7
        (S.READY_TO_SWITCH_ON, C.QUICK_STOP, S.SWITCH_ON_DISABLED),  # 7
        (S.OPERATION_ENABLED, C.SHUTDOWN, S.READY_TO_SWITCH_ON),  # 8
        (S.OPERATION_ENABLED, C.DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 9
        (S.SWITCHED_ON, C.DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 10
        (S.SWITCHED_ON, C.QUICK_STOP, S.SWITCH_ON_DISABLED),  # 10
        (S.OPERATION_ENABLED, C.QUICK_STOP, S.QUICK_STOP_ACTIVE),  # 11
        (S.QUICK_STOP_ACTIVE, C.DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 12
        (S.FAULT, C.FAULT_RESET, S.SWITCH_ON_DISABLED),  # 15
    ):
        table[state, command] = after
    return table


TRANSITION = _transition_table()
"""(8, 6) State after a State has taken a Command; the drive itself leaves NOT_READY (1), and faults (13, 14)."""


def _towards_table() -> npt.NDArray[np.uint8]:
    S, C = State, Command
    ladder = (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, S.SWITCHED_ON, S.OPERATION_ENABLED)
    rungs = (C.DISABLE_VOLTAGE, C.SHUTDOWN, C.SWITCH_ON, C.ENABLE_OPERATION)
    table = np.full((8, 8), CONTROLWORD[C.DISABLE_VOLTAGE], np.uint8)
    for goal_rung, goal in enumerate(ladder):
        for rung, state in enumerate(ladder):
            # Up one rung at a time; down and staying is the goal's own controlword.
            table[goal, state] = CONTROLWORD[rungs[min(rung + 1, goal_rung)]]
        table[goal, S.FAULT] = CONTROLWORD[C.FAULT_RESET]
    table[S.QUICK_STOP_ACTIVE, :] = CONTROLWORD[C.QUICK_STOP]
    return table


_TOWARDS = _towards_table()
_GOALS = (
    State.SWITCH_ON_DISABLED,
    State.READY_TO_SWITCH_ON,
    State.SWITCHED_ON,
    State.OPERATION_ENABLED,
    State.QUICK_STOP_ACTIVE,
)


def statusword(state: npt.ArrayLike, *, warning: npt.ArrayLike = False, internal_limit: npt.ArrayLike = False) -> Any:
    """The statusword that a drive in `state` reports, remote always set, voltage where its stage is powered; uint16."""
    state = np.asarray(state)
    word = _STATUSWORD[state] | REMOTE
    word = np.where((state >= State.SWITCHED_ON) & (state <= State.FAULT_REACTION_ACTIVE), word | VOLTAGE_ENABLED, word)
    word = np.where(warning, word | WARNING, word)
    return np.where(internal_limit, word | INTERNAL_LIMIT, word).astype(np.uint16)[()]


def decode_statusword(word: npt.ArrayLike) -> Any:
    """The State(s) of statusword(s); uint8, to be compared with State. Words that no state has read as not ready."""
    return STATE_OF_STATUSWORD[np.asarray(word) & 0x7F]


def transition(state: npt.ArrayLike, controlword: npt.ArrayLike, previous: npt.ArrayLike = 0) -> Any:
    """The State(s) after taking one controlword; `previous` is the one before, since a fault resets on bit 7's rising edge.

    uint8. A drive takes one transition a controlword.
    """
    reset_before = np.asarray(previous, np.uint8) >> 7
    return TRANSITION[np.asarray(state), COMMAND_OF_CONTROLWORD[reset_before, np.asarray(controlword, np.uint8)]]


def controlword_towards(goal: State, state: npt.ArrayLike, previous: npt.ArrayLike = 0) -> Any:
    """The controlword(s) that take drive(s) in `state` one step on towards `goal`; sent again and again, they arrive there.

    goal: one of switch on disabled, ready to switch on, switched on, operation enabled, quick stop active. Faults are reset
    on the way, except towards quick stop. `previous`: the controlword(s) sent before; with it, a reset that did not take
    gets a new edge. uint8. Raises ValueError for other goals, which no controlword can ask for.
    """
    if goal not in _GOALS:
        raise ValueError(f"drive state: goal {goal!r}; expected one of {', '.join(g.name for g in _GOALS)}")
    word = _TOWARDS[goal, np.asarray(state)]
    repeated = (word & np.asarray(previous, np.uint8) & 0x80) != 0
    return np.where(repeated, CONTROLWORD[Command.DISABLE_VOLTAGE], word)[()]
