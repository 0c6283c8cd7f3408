"""Fault confinement (ISO 11898-1:2015, 12.1.4): error counters that take a broken node off the bus before it blocks everybody.

`counters` (channels, nodes, 6) holds a node's counters on each channel, columns `TEC` to `RESUME`. A transmitter whose frame
is destroyed counts 8, its receivers 1; every frame that gets through takes 1 back. From 128 on a node is error passive: its
frames carry ESI, and it waits 8 bits longer after its own. From 256 transmit errors on it is bus-off: it neither sends nor
hears, until it has seen 128 times 11 recessive bits.
"""

from __future__ import annotations

from handrail.compiled import compiled

TEC, REC, OFF, SEEN, OUTSIDE, RESUME = 0, 1, 2, 3, 4, 5
"""
TEC      transmit error counter
REC      receive error counter
OFF      bus-off: 1 by its errors, 2 held there by a fault
SEEN     bus-off: how many runs of 11 recessive bits the channel had had when recovery began
OUTSIDE  1: its cable is cut
RESUME   ns before which it does not start a frame: an error-passive node's suspended transmission
"""
COLUMNS = 6

PASSIVE_FROM, OFF_FROM = 128, 256
RECOVERY = 128
"""runs of 11 recessive bits after which a bus-off node is back"""
ERROR_FRAME_BITS = 23
"""error flags one after the other 6 + 6, delimiter 8, intermission 3; at the nominal rate"""
SUSPEND_BITS = 8


@compiled
def is_passive(counters, bus, node):
    """Error passive: it still takes part, but must not disturb."""
    return counters[bus, node, TEC] >= PASSIVE_FROM or counters[bus, node, REC] >= PASSIVE_FROM


@compiled
def takes_part(counters, bus, node):
    """It can send, hear and acknowledge."""
    return counters[bus, node, OFF] == 0 and counters[bus, node, OUTSIDE] == 0


@compiled
def count_success(counters, present, bus, sender):
    """A frame got through: 1 back for the sender and for everybody who received it (rules 7 and 8)."""
    if counters[bus, sender, TEC] > 0:
        counters[bus, sender, TEC] -= 1
    for node in range(counters.shape[1]):
        rec = counters[bus, node, REC]
        if rec > 0 and node != sender and present[bus, node] and takes_part(counters, bus, node):
            counters[bus, node, REC] = min(rec - 1, PASSIVE_FROM - 1)


@compiled
def count_error(counters, present, bus, sender, seen):
    """A frame was destroyed: 8 for the sender, 1 for everybody who was receiving (rules 1 and 3). True: sender is bus-off.

    seen: runs of 11 recessive bits on the channel so far.
    """
    for node in range(counters.shape[1]):
        if node != sender and present[bus, node] and takes_part(counters, bus, node):
            counters[bus, node, REC] = min(counters[bus, node, REC] + 1, OFF_FROM - 1)
    counters[bus, sender, TEC] += 8
    if counters[bus, sender, TEC] < OFF_FROM:
        return False
    counters[bus, sender, OFF], counters[bus, sender, SEEN] = 1, seen
    return True


@compiled
def recover(counters, bus, seen):
    """Bring back the nodes that have been bus-off for long enough, with all counters zero."""
    for node in range(counters.shape[1]):
        if counters[bus, node, OFF] == 1 and seen - counters[bus, node, SEEN] >= RECOVERY:
            counters[bus, node, OFF] = counters[bus, node, TEC] = counters[bus, node, REC] = 0


def state(counters, bus: int, node: int) -> str:  # type: ignore[no-untyped-def]
    """error_active, error_passive, bus_off or cut."""
    if counters[bus, node, OUTSIDE]:
        return "cut"
    if counters[bus, node, OFF]:
        return "bus_off"
    return "error_passive" if is_passive(counters, bus, node) else "error_active"
