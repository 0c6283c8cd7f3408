"""Talking to the hub about the bus itself: who is on it, how loaded it is, and which faults it shall have.

The same socket as the frames' (hal.can.wire), joined with `Hello(role="control")`: then every datagram is one request in JSON,
answered by one datagram. The hub answers between two turns of the bus; nothing here touches the way of the frames.
"""

from __future__ import annotations

import msgspec

from hal.can.faults import Fault


class IdentifierLoad(msgspec.Struct, kw_only=True):
    """What frames of one identifier have cost so far."""

    can_id: int
    extended: bool
    frames: int
    busy_ns: int


class NodeState(msgspec.Struct, kw_only=True):
    """One node on one channel, after ISO 11898-1's fault confinement."""

    name: str
    channel: str
    state: str
    """error_active, error_passive, bus_off or cut"""
    transmit_errors: int
    receive_errors: int
    waiting: int
    """frames in its transmit FIFO"""
    overflows: int
    """frames refused since the FIFO was full, or thrown away at bus-off"""


class ChannelState(msgspec.Struct, kw_only=True):
    """One channel."""

    name: str
    bitrate: int
    data_bitrate: int
    frames: int
    busy_ns: int
    error_frames: int
    load: float
    """share of the time in use over about the last second of the bus's clock"""
    identifiers: list[IdentifierLoad]


class BusReport(msgspec.Struct, kw_only=True):
    """Answer to `GetBus`: everything about the bus at one moment."""

    time_ns: int
    """of the bus's clock"""
    timing: bool
    """frames take the time that they would on a real bus"""
    channels: list[ChannelState]
    nodes: list[NodeState]
    faults: dict[int, Fault]
    """number → fault that is on the bus, waiting or acting"""
    hits: dict[int, int]
    """number → frames hit so far"""
