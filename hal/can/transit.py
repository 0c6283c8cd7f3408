"""Frames on the wire, and the time that it takes.

The hub's careful path, for a bus that keeps bit timing or is disturbed; without either the hub arbitrates whole batches at once
(hal.can.arbitration). A channel is run up to a moment: what ends by then is delivered, what is on the wire then stays there, and
nobody who comes later can push it off.
"""

from __future__ import annotations

import numpy as np

from hal.can.arbitration import arbitration_field, priority
from hal.can.bus_state import (
    BABBLE,
    BAD,
    BEGAN,
    BUS_MASK,
    CAN_ID,
    CHANCE,
    DROP,
    END,
    EXTENDED_ID,
    HEAD,
    HITS,
    ID_MASK,
    LEFT,
    LENGTH,
    MARK,
    NEVER,
    NEXT,
    NODE,
    READY,
    RECESSIVE,
    ROW,
    TAIL,
    TWICE,
    catch_up,
    recessive,
)
from hal.can.confinement import (
    ERROR_FRAME_BITS,
    OFF,
    OUTSIDE,
    PASSIVE_FROM,
    RESUME,
    SUSPEND_BITS,
    TEC,
    count_error,
    count_success,
    is_passive,
    takes_part,
)
from hal.can.frames import ESI, EXTENDED, FD, WORDS
from hal.can.queues import flush, give_row, take_row
from hal.can.tally import BUSY, ERRORS, FRAMES, FREE, count
from hal.can.timing import frame_ns
from handrail.compiled import compiled


@compiled
def take_off(s, bus, now):
    """Take the frame on the wire off it, since its sender can send no more; it stays at the head of its queue."""
    row = s.wire[bus, ROW]
    if row < 0:
        return
    if s.link[row, MARK] & BABBLE:
        give_row(s, row)
    s.wire[bus, ROW] = -1
    s.totals[bus, BUSY] += max(0, now - s.wire[bus, BEGAN])
    s.totals[bus, FREE] = max(now, s.wire[bus, BEGAN])


@compiled
def run(s, bus, until, out, out_node, k):
    """Run a channel until `until` (ns; NEVER: until nothing is left to send). Frames that end by then go to row k of `out`
    and on, their time_ns the end; returns the row behind the last."""
    room = out.shape[0] // WORDS
    while k < room:
        if s.wire[bus, ROW] >= 0:
            if s.wire[bus, END] > until:
                break
            k = _finish(s, bus, out, out_node, k)
            continue
        start, who = _winner(s, bus)
        if who < 0 or start >= until:
            break
        _start(s, bus, who, start)
    _try_in_vain(s, bus, until)
    return k


@compiled
def run_all(s, now, until, timed, out, out_node, k):
    """Run all channels, the `timed` ones (c,) until `until`, the others until nothing is left to send.

    Returns (the row behind the last of `out`; ns when something happens next by itself on a timed channel; whether a node is
    bus-off or its cable cut at `now`).
    """
    then, impaired = NEVER, False
    for bus in range(s.queue.shape[0]):
        k = run(s, bus, until if timed[bus] else NEVER, out, out_node, k)
        catch_up(s, bus, now)
        if timed[bus]:
            then = min(then, next_time(s, bus))
        for who in range(s.counters.shape[1]):
            impaired |= not takes_part(s.counters, bus, who)
    return k, then, impaired


@compiled
def _winner(s, bus):
    """(when the next frame starts, whose it is; −1: nobody's): of those that are ready first, the lowest identifier's."""
    # Arrays one by one: handing all of `s` to a function for every node cost more than all that it does.
    queue, babble, link, counters = s.queue, s.babble, s.link, s.counters
    free, first, best, lowest = s.totals[bus, FREE], NEVER, -1, np.int64(0)
    for who in range(queue.shape[1]):
        if queue[bus, who, HEAD] >= 0 or babble[bus, who, 0] >= 0:
            first = min(first, max(free, _ready(queue, babble, link, counters, bus, who)))
    if first == NEVER:
        return first, best
    for who in range(queue.shape[1]):
        if queue[bus, who, HEAD] < 0 and babble[bus, who, 0] < 0:
            continue
        if _ready(queue, babble, link, counters, bus, who) <= first:
            babbled = babble[bus, who, 0]
            if babbled >= 0:
                key = arbitration_field(babbled, babbled > 0x7FF, 0)
            else:
                key = priority(s.pool, queue[bus, who, HEAD])
            if best < 0 or key < lowest:
                best, lowest = who, key
    return first, best


@compiled
def _ready(queue, babble, link, counters, bus, who):
    """ns from when on a node that has something to send may; NEVER: bus-off, or cut off."""
    if not takes_part(counters, bus, who):
        return NEVER
    since = babble[bus, who, 1] if babble[bus, who, 0] >= 0 else link[queue[bus, who, HEAD], READY]
    return max(since, counters[bus, who, RESUME])


@compiled
def _start(s, bus, who, start):
    s.wire[bus, RECESSIVE] = recessive(s, bus, start)
    row = _babbled(s, bus, who) if s.babble[bus, who, 0] >= 0 else s.queue[bus, who, HEAD]
    head = s.pool[WORDS * row + 1]
    if (head >> np.uint64(40)) & np.uint64(FD) and is_passive(s.counters, bus, who):
        s.pool[WORDS * row + 1] = head | np.uint64(ESI) << np.uint64(40)
    took = frame_ns(s.pool, row, s.bitrates[bus, 0], s.bitrates[bus, 1])
    at = _destroyed(s, bus, who, row)
    s.wire[bus, BAD] = 1 if at >= 0.0 else 0
    if at >= 0.0:
        took = np.int64(at * took) + ERROR_FRAME_BITS * 1_000_000_000 // s.bitrates[bus, 0]
    s.wire[bus, ROW], s.wire[bus, BEGAN], s.wire[bus, END] = row, start, start + took


@compiled
def _finish(s, bus, out, out_node, k):
    row, end = s.wire[bus, ROW], s.wire[bus, END]
    who, mark, took = s.link[row, NODE], s.link[row, MARK], end - s.wire[bus, BEGAN]
    s.wire[bus, ROW], s.totals[bus, FREE] = -1, end
    s.totals[bus, BUSY] += took
    s.wire[bus, RECESSIVE] += 1
    if is_passive(s.counters, bus, who):
        s.counters[bus, who, RESUME] = end + SUSPEND_BITS * 1_000_000_000 // s.bitrates[bus, 0]
    if s.wire[bus, BAD]:
        s.totals[bus, ERRORS] += 1
        count(s.pool, row, bus, took, 0, s.identifiers)
        if mark & BABBLE:
            give_row(s, row)
        if count_error(s.counters, s.present, bus, who, s.wire[bus, RECESSIVE]):
            flush(s, bus, who)
        return k
    s.totals[bus, FRAMES] += 1
    count(s.pool, row, bus, took, 1, s.identifiers)
    count_success(s.counters, s.present, bus, who)
    if not mark & DROP:
        for i in range(WORDS):
            out[WORDS * k + i] = s.pool[WORDS * row + i]
        out[WORDS * k] = np.uint64(end)
        out_node[k] = who
        k += 1
    if mark & TWICE:
        s.link[row, MARK] = mark & ~TWICE
        return k
    if not mark & BABBLE:
        s.queue[bus, who, HEAD] = s.link[row, NEXT]
        s.queue[bus, who, LENGTH] -= 1
        if s.link[row, NEXT] < 0:
            s.queue[bus, who, TAIL] = -1
    give_row(s, row)
    return k


@compiled
def _destroyed(s, bus, who, row):
    """Where along the frame a fault destroys it, 0..1; −1: nowhere."""
    head = s.pool[WORDS * row + 1]
    can_id = np.int64(head & np.uint64(0x1FFFFFFF))
    extended = np.int64((head >> np.uint64(40)) & np.uint64(EXTENDED)) != 0
    for i in range(s.errors.shape[0]):
        e = s.errors[i]
        if e[LEFT] == 0 or not (e[BUS_MASK] >> bus) & 1 or not s.error_nodes[i, who]:
            continue
        if e[CAN_ID] >= 0 and ((e[CAN_ID] ^ can_id) & e[ID_MASK] or extended != (e[EXTENDED_ID] == 1)):
            continue
        if np.int64(_draw(s.random, i)) >= e[CHANCE]:
            continue
        if e[LEFT] > 0:
            e[LEFT] -= 1
        e[HITS] += 1
        return np.int64(_draw(s.random, i)) / 9007199254740992.0
    return -1.0


@compiled
def _draw(state, i):
    """53 random bits (splitmix64)."""
    state[i] += np.uint64(0x9E3779B97F4A7C15)
    z = state[i]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (z ^ (z >> np.uint64(31))) >> np.uint64(11)


@compiled
def next_time(s, bus):
    """ns when something happens next on a channel without anybody's doing: a frame ends or starts; NEVER: nothing does."""
    if s.wire[bus, ROW] >= 0:
        return s.wire[bus, END]
    start, who = _winner(s, bus)
    return start + 1 if who >= 0 else NEVER


@compiled
def _try_in_vain(s, bus, until):
    """Nodes behind a cut cable: nobody acknowledges, so they try again until they are error passive, which then stays."""
    for who in range(s.queue.shape[1]):
        row = s.queue[bus, who, HEAD]
        if s.counters[bus, who, OUTSIDE] == 0 or row < 0 or s.counters[bus, who, OFF]:
            continue
        took = frame_ns(s.pool, row, s.bitrates[bus, 0], s.bitrates[bus, 1])
        took += ERROR_FRAME_BITS * 1_000_000_000 // s.bitrates[bus, 0]
        at = max(s.counters[bus, who, RESUME], s.link[row, READY])
        while s.counters[bus, who, TEC] < PASSIVE_FROM and at + took <= until:
            at += took
            s.counters[bus, who, TEC] += 8
        s.counters[bus, who, RESUME] = at


@compiled
def _babbled(s, bus, who):
    """A row with the babbler's frame: classic, eight zero bytes, as a stuck controller sends."""
    row = take_row(s)
    can_id = s.babble[bus, who, 0]
    flags = EXTENDED if can_id > 0x7FF else 0
    s.pool[WORDS * row : WORDS * (row + 1)] = np.uint64(0)
    s.pool[WORDS * row + 1] = np.uint64(can_id | 8 << 32 | flags << 40 | bus << 48)
    s.link[row, NEXT], s.link[row, NODE], s.link[row, READY], s.link[row, MARK] = -1, who, 0, BABBLE
    s.babble[bus, who, 2] += 1
    return row
