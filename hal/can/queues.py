"""Transmit queues: every node's first-in first-out queue on every channel, whose frames lie in one pool."""

from __future__ import annotations

from hal.can.arbitration import bus_of
from hal.can.bus_state import (
    HEAD,
    LENGTH,
    MARK,
    NEXT,
    NODE,
    OVERFLOWS,
    POOL,
    READY,
    RESERVE,
    ROW,
    TAIL,
    catch_up,
)
from hal.can.confinement import OFF, OUTSIDE, SEEN
from hal.can.frames import WORDS
from handrail.compiled import compiled


@compiled
def put(s, words, node, marks, n, ready, room):
    """Queue n records at the time `ready` (ns); a FIFO takes `room` (c,) frames. What it does not take is counted."""
    for bus in range(s.queue.shape[0]):
        catch_up(s, bus, ready)
    for row in range(n):
        bus, who = bus_of(words, row), node[row]
        if s.counters[bus, who, OFF] or s.queue[bus, who, LENGTH] >= room[bus] or s.spare[POOL] <= RESERVE:
            s.queue[bus, who, OVERFLOWS] += 1
            continue
        to = take_row(s)
        for i in range(WORDS):
            s.pool[WORDS * to + i] = words[WORDS * row + i]
        s.link[to, NEXT], s.link[to, NODE] = -1, who
        s.link[to, READY], s.link[to, MARK] = ready, marks[row]
        last = s.queue[bus, who, TAIL]
        if last < 0:
            s.queue[bus, who, HEAD] = to
        else:
            s.link[last, NEXT] = to
        s.queue[bus, who, TAIL] = to
        s.queue[bus, who, LENGTH] += 1


@compiled
def trim(s, room):
    """Throw away what stands behind the first `room` frames of every FIFO: a full FIFO takes nothing more."""
    for bus in range(s.queue.shape[0]):
        for who in range(s.queue.shape[1]):
            extra = s.queue[bus, who, LENGTH] - room
            if extra <= 0:
                continue
            last = s.queue[bus, who, HEAD]
            for _ in range(room - 1):
                last = s.link[last, NEXT]
            row = s.link[last, NEXT]
            while row >= 0:
                following = s.link[row, NEXT]
                give_row(s, row)
                row = following
            s.link[last, NEXT], s.queue[bus, who, TAIL] = -1, last
            s.queue[bus, who, LENGTH] = room
            s.queue[bus, who, OVERFLOWS] += extra


@compiled
def flush(s, bus, who):
    """Throw a node's FIFO away, and take what it is sending off the wire."""
    row = s.queue[bus, who, HEAD]
    s.queue[bus, who, OVERFLOWS] += s.queue[bus, who, LENGTH]
    while row >= 0:
        following = s.link[row, NEXT]
        if s.wire[bus, ROW] == row:
            s.wire[bus, ROW] = -1
        give_row(s, row)
        row = following
    s.queue[bus, who, HEAD] = s.queue[bus, who, TAIL] = -1
    s.queue[bus, who, LENGTH] = 0


@compiled
def take_row(s):
    """A free row of the pool."""
    s.spare[POOL] -= 1
    return s.spare[s.spare[POOL]]


@compiled
def give_row(s, row):
    """The row is free again."""
    s.spare[s.spare[POOL]] = row
    s.spare[POOL] += 1


@compiled
def is_quiet(s):
    """Nothing on its way, and no node has an error on its account."""
    if s.spare[POOL] != POOL:
        return False
    for bus in range(s.counters.shape[0]):
        for who in range(s.counters.shape[1]):
            for column in range(SEEN):
                if s.counters[bus, who, column]:
                    return False
            if s.counters[bus, who, OUTSIDE]:
                return False
    return True
