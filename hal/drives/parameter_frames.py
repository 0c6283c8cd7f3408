"""Parameter requests and replies: frames of one drive's parameter, taken out of a batch or written one by one.

A request or reply is a row of PARAMETER_COLUMNS int64: the frame's limb or joint; the raw values of axis, index, write, result,
value; nothing; the sequence number.
"""

from __future__ import annotations

import numpy as np

from hal.can.frames import DATA
from hal.drives.borrowing import borrowed
from hal.drives.fields import END, ENTITY, FIELD, FIRST, HEAD, Field
from hal.drives.signals import begin, get_raw, put_raw, sign, tables, words_of
from handrail.compiled import compiled

PARAMETER_COLUMNS = 8
MOST_PARAMETERS = 32
"""requests or replies that one batch may hold; more are dropped, their askers ask again"""

_AXIS, _VALUE, _SEQUENCE = int(Field.AXIS), int(Field.VALUE), int(Field.SEQUENCE)


@compiled
def take_parameter(words, first, frames, f, ops, rows, count):
    """Row `count` of `rows` becomes what a frame says."""
    for column in range(PARAMETER_COLUMNS):
        rows[count, column] = 0
    rows[count, 0] = frames[f, ENTITY]
    for o in range(frames[f, FIRST], frames[f, END]):
        field = ops[o, FIELD]
        if _AXIS <= field <= _VALUE:
            rows[count, 1 + field - _AXIS] = np.int64(get_raw(words, first, ops, o))
        elif field == _SEQUENCE:
            rows[count, 7] = np.int64(get_raw(words, first, ops, o))


@compiled
def encode_parameter(records, f, code, row):
    """Write frame f from a row; 1."""
    words, row = words_of(records), borrowed(row)
    frames, ops, _, _, _, _, _, _ = tables(code)
    begin(words, 0, np.uint64(frames[f, HEAD]))
    for o in range(frames[f, FIRST], frames[f, END]):
        field = ops[o, FIELD]
        if _AXIS <= field <= _VALUE:
            put_raw(words, DATA, ops, o, row[1 + field - _AXIS])
        elif field == _SEQUENCE:
            put_raw(words, DATA, ops, o, row[7])
    sign(words, 0, frames, f, ops)
    return 1
