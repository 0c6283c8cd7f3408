"""What the signals of drives' frames can mean: the words of a family's description, and the columns of the kernels' tables."""

from __future__ import annotations

import enum


class Field(enum.IntEnum):
    """A signal's meaning; `name.lower()` is its key in family.yaml. Kernels work through a frame in this order."""

    # of a joint; the first five are rows of JointCommand.table, the first three of JointState.table too
    POSITION = 0
    VELOCITY = 1
    TORQUE = 2
    STIFFNESS = 3
    DAMPING = 4
    TEMPERATURE = 5
    MODE = 6
    CONTROLWORD = 7
    ERROR = 8
    STATUS = 9
    """CiA 402 statusword"""
    STATE = 10
    """number of the CiA 402 state, for families without a statusword"""
    WARNING = 11
    LIMIT = 12
    WATCHDOG = 13
    # of a device
    COLUMN = 14
    # of any frame
    CONSTANT = 15
    SEQUENCE = 16
    TIME = 17
    """µs, of the sender's clock, when it was measured"""
    CRC = 18
    CYCLE = 19
    # of parameter frames: columns of a request or reply, from AXIS on
    AXIS = 20
    INDEX = 21
    WRITE = 22
    RESULT = 23
    VALUE = 24


class Role(enum.IntEnum):
    """What a message is for; `name.lower()` is its key in family.yaml."""

    CONTROL = 0
    COMMAND = 1
    STATUS = 2
    MASTER_STATUS = 3
    SYNC = 4
    HOLD_TIME = 5
    PARAMETER_REQUEST = 6
    PARAMETER_REPLY = 7
    DEVICE_COMMAND = 8
    DEVICE_STATUS = 9


START, LENGTH, KIND, FIELD, ROW, COLUMN, TABLE, SCALING = range(8)
"""Columns of a program's ops, one row a signal: where it lies (as hal.can.layout.MessageLayout.places, and ACROSS in its KIND),
what it means, of which joint or device, which of a device's columns, which look-up table (−1: linear), which row of the scales.
Narrow ones: a cycle walks all of its frames' ops, out of caches that the rest of the cycle has used for something else."""
OP_COLUMNS, OP_WORDS = 8, 2
"""int16 columns of an op, which fill so many words"""
ACROSS = 8
"""Bit of KIND: a big-endian signal, or one that no single word of 64 bits holds"""

(
    HEAD, ROLE, FIRST, END, BYTES, SEQUENCE, TIME, CRC, CRC_FROM, CRC_TO, ALGORITHM, ENTITY, CONSTANTS, PAYLOAD, LAW,
    MEMBERS, EVERY, FLOATS,
) = range(18)  # fmt: skip
"""Columns of a program's frames: word 1 of the record, Role, ops from FIRST to END, data length, the ops of sequence, time and CRC
(−1: none), which bytes the CRC is over, its algorithm, the frame's (first) joint or device, whether some signals are constant,
the first of its payloads (−1: none), whether the host realises modes (the drive knows only the impedance law), the first of the
SEQUENCE ops, one for each joint (or the device) that it is for (−1: none), how many host cycles from one to the next, whether some
signals are floating-point numbers, which alone may be none."""
FRAME_COLUMNS = 18
