"""Who sends next: the order in which waiting frames get onto their buses, and when each of them ends.

Every node has a first-in first-out transmit queue a bus, as SocketCAN has: the heads of the queues compete, and the lowest
identifier wins (ISO 11898-1, 10.8: bitwise arbitration; of equal base identifiers the standard frame wins over the extended, of
equal identifiers the data frame over the remote request).
"""

from __future__ import annotations

import numpy as np

from hal.can.frames import EXTENDED, FD, REMOTE, WORDS
from hal.can.tally import BUSY, FRAMES, FREE, count
from hal.can.timing import frame_ns
from handrail.compiled import compiled

_BUS_SHIFT = np.uint64(48)
_BYTE = np.uint64(0xFF)


@compiled
def bus_of(words, row):
    """Bus index of a record."""
    return np.int64((words[WORDS * row + 1] >> _BUS_SHIFT) & _BYTE)


@compiled
def arbitration_field(can_id, extended, remote):
    """The bits by which a frame competes, as a number: base identifier, IDE, the rest of the identifier, RTR. The lower wins."""
    if extended:
        return (can_id >> 18) << 20 | 1 << 19 | (can_id & 0x3FFFF) << 1 | remote
    return can_id << 20 | remote


@compiled
def priority(words, row):
    """Order on the bus: the lower wins."""
    head = words[WORDS * row + 1]
    flags = np.int64((head >> np.uint64(40)) & _BYTE)
    remote = 1 if flags & REMOTE else 0
    return arbitration_field(np.int64(head & np.uint64(0x1FFFFFFF)), (flags & EXTENDED) != 0, remote)


@compiled
def admit(words, row, bus_map, out, to):
    """Copy record `row` to row `to` of `out` if it is a good one; returns whether it is.

    `bus_map` (16,) turns the sender's channel index into the hub's, −1 where it has none. A record is good when its bus is
    known, its identifier fits, and its length is one that CAN (or CAN FD) has; bytes beyond the length are set to zero.
    """
    head = words[WORDS * row + 1]
    can_id, length = np.int64(head & np.uint64(0xFFFFFFFF)), np.int64((head >> np.uint64(32)) & _BYTE)
    flags, bus = np.int64((head >> np.uint64(40)) & _BYTE), np.int64((head >> _BUS_SHIFT) & _BYTE)
    if bus >= bus_map.shape[0] or bus_map[bus] < 0 or flags >= 2 * REMOTE:
        return False
    if can_id > (0x1FFFFFFF if flags & EXTENDED else 0x7FF):
        return False
    if flags & FD:
        if flags & REMOTE or length > 64:
            return False
        if length > 8 and not (length <= 24 and length % 4 == 0) and length not in (32, 48, 64):
            return False
    elif length > 8 or flags & 3:
        return False
    at, source = WORDS * to, WORDS * row
    out[at] = words[source]
    out[at + 1] = head & np.uint64(0x0000FFFFFFFFFFFF) | np.uint64(bus_map[bus]) << _BUS_SHIFT
    for i in range(8):
        used = min(max((0 if flags & REMOTE else length) - 8 * i, 0), 8)
        word = words[source + 2 + i]
        out[at + 2 + i] = word if used == 8 else word & ((np.uint64(1) << np.uint64(8 * used)) - np.uint64(1))
    return True


@compiled
def by_priority(words, n, order):
    """`order` ← rows 0..n−1, lowest identifier first, equal ones as they came (insertion sort: drives send nearly in order)."""
    for row in range(n):
        key, i = priority(words, row), row
        while i > 0 and priority(words, order[i - 1]) > key:
            order[i] = order[i - 1]
            i -= 1
        order[i] = row


@compiled
def arbitrate(words, node, n, now, bitrates, totals, identifiers, out, out_node, heads, following, buses):
    """Put n waiting frames onto their buses; `out` gets them in the order in which they end, time_ns set to that end.

    words: the waiting records, as they were queued; node (≥ n,): who queued each row.
    now: ns, when they wait; bitrates (c, 2): nominal and data bit/s; totals, identifiers: hal.can.tally, updated.
    heads (c, nodes, 2), all −1 between calls, following (≥ n,) and buses (3, c): work space.
    """
    channels = heads.shape[0]
    # Of each bus: nodes with frames on it, heads[bus, :waiting, 1]; the row that wins it next, −1: none; when that one ends.
    waiting, winner, end = buses[0], buses[1], buses[2]
    waiting[:] = 0
    for row in range(n - 1, -1, -1):
        bus, who = bus_of(words, row), node[row]
        following[row] = heads[bus, who, 0]
        if following[row] < 0:
            heads[bus, waiting[bus], 1] = who
            waiting[bus] += 1
        heads[bus, who, 0] = row
    for bus in range(channels):
        totals[bus, FREE], winner[bus] = max(totals[bus, FREE], now), -1
        if waiting[bus]:
            winner[bus] = _next(words, heads, bus, waiting)
            end[bus] = totals[bus, FREE] + frame_ns(words, winner[bus], bitrates[bus, 0], bitrates[bus, 1])
    for k in range(n):
        first = -1
        for bus in range(channels):
            if winner[bus] >= 0 and (first < 0 or end[bus] < end[first]):
                first = bus
        row = winner[first]
        for i in range(WORDS):
            out[WORDS * k + i] = words[WORDS * row + i]
        out[WORDS * k] = np.uint64(end[first])
        out_node[k] = node[row]
        took = end[first] - totals[first, FREE]
        totals[first, FRAMES] += 1
        totals[first, BUSY] += took
        totals[first, FREE] = end[first]
        count(words, row, first, took, 1, identifiers)
        heads[first, node[row], 0] = following[row]
        winner[first] = _next(words, heads, first, waiting)
        if winner[first] >= 0:
            end[first] += frame_ns(words, winner[first], bitrates[first, 0], bitrates[first, 1])


@compiled
def _next(words, heads, bus, waiting):
    """The row that wins the bus next, −1: none. Of equal identifiers the node with the lower number's."""
    best, lowest, by = -1, np.int64(0), np.int64(0)
    k = 0
    while k < waiting[bus]:
        who = heads[bus, k, 1]
        row = heads[bus, who, 0]
        if row < 0:
            waiting[bus] -= 1
            heads[bus, k, 1] = heads[bus, waiting[bus], 1]
            continue
        key = priority(words, row)
        if best < 0 or key < lowest or (key == lowest and who < by):
            best, lowest, by = row, key, who
        k += 1
    return best


@compiled
def select(words, node, n, listener, bus_map, out):
    """Copy the records that a listener wants into `out`, the bus renumbered as the listener counts; returns how many.

    listener: its node number, whose own frames it does not get (−1: all); bus_map (16,): hub's channel index → the
    listener's, −1 where it does not listen.
    """
    k = 0
    for row in range(n):
        local = bus_map[bus_of(words, row)]
        if local < 0 or node[row] == listener:
            continue
        for i in range(WORDS):
            out[WORDS * k + i] = words[WORDS * row + i]
        out[WORDS * k + 1] = words[WORDS * row + 1] & np.uint64(0x0000FFFFFFFFFFFF) | np.uint64(local) << _BUS_SHIFT
        k += 1
    return k
