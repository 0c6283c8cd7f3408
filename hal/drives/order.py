"""Which frames come after which, as far as 8 bits of sequence number tell.

Numbers go on by one a host cycle and come round after 256, so a frame that is late by nearly that many cycles looks as if it came
next. How near is how far a stream that lives may jump: a drive whose host was silent for longer than its watchdog's interval has
stopped by itself, so no more than that interval counts as going on, and what comes after a longer silence begins a new stream. A
frame that comes first may be a late one: it stops a drive, but never takes it further.
"""

from __future__ import annotations

from handrail.compiled import compiled

LATE, NEXT, FIRST = 0, 1, 2
"""What a drive takes a frame for: late or a repetition, which counts for nothing; the next one; the first of a stream."""
FARTHEST = 127
"""Numbers that a stream may jump at most, whatever its watchdog: beyond, forwards and backwards are the same."""

_YOUNG, _NEVER_HEARD = 128, 1 << 29
_LONGEST_JUMP = 50
"""frames of a device that may be lost in a row; the cycles of silence after which its frames' order can't be told"""


@compiled
def order_at_drive(sequence, last, heard, silence, patience):
    """LATE, NEXT or FIRST, for a drive that believed number `last` so many cycles ago (`silence`), if it ever `heard` one.

    patience: cycles that its watchdog waits. It has fired for certain one cycle later: a drive's clock counts whole cycles.
    """
    if not heard or silence > patience + 1:
        return FIRST
    return NEXT if 0 < ((sequence - last) & 0xFF) <= min(patience, FARTHEST) else LATE


@compiled
def is_fresh_answer(sequence, last, age, sent):
    """Does this answer come after the last one that was believed, `age` cycles ago?

    `sent`: sequence number of what was last sent (−1: unknown). An answer to something older than what was answered already
    is a replay; once nothing was believed for 128 cycles order can't be told, and only a repetition is one.
    """
    if age > _NEVER_HEARD:
        return True
    if sequence == last:
        return False
    if age >= _YOUNG:
        return True
    if sent < 0:
        return ((sequence - last) & 0xFF) < _YOUNG
    return ((sent - sequence) & 0xFF) < ((sent - last) & 0xFF)


@compiled
def is_fresh_state(sequence, last, age):
    """Does a device's frame, which answers nothing, come after the last one that was believed, `age` cycles ago?"""
    if age > _NEVER_HEARD:
        return True
    return sequence != last and (age > _LONGEST_JUMP or ((sequence - last) & 0xFF) <= _LONGEST_JUMP)
