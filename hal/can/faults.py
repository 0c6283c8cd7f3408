"""Faults that a script, a test or the command line lays on the virtual bus, as data: who, which frames, when, how often.

- {kind: drop, node: arm_right_3_joint, probability: 0.3, after: 1.0, duration: 0.5}
- {kind: bit_error, channel: can0, can_id: 0x100, count: 40}
"""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from handrail import config

NonNegative = Annotated[float, msgspec.Meta(ge=0)]

Kind = Literal["drop", "delay", "duplicate", "reorder", "corrupt", "bit_error", "stuck", "babble", "bus_off", "cut"]
"""
drop       the frame never reaches anybody, and its sender does not notice
delay      it reaches everybody `delay` s later
duplicate  it is sent twice
reorder    it goes out after the next frame of the same node on the same channel
corrupt    one to three random bits of its data are flipped where CAN's own CRC does not see it: the protocol's CRC must
bit_error  it is destroyed on the wire: error frame, error counters, automatic retransmission
stuck      its data is frozen as it was when the fault began (a mailbox that is sent again and again: sequence and CRC fit)
babble     `node` sends `can_id` (default 0) over and over, as fast as the bus takes it
bus_off    `node` goes bus-off when the fault begins; it recovers after 128 × 11 recessive bits once the fault has ended
cut        the cable of `node` is cut: it neither sends nor receives, and nobody acknowledges it. No node: the whole channel
"""


class Fault(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """One fault. What is left out matches everything."""

    kind: Kind
    channel: str | None = None
    node: str | None = None
    """sender's name on the bus (a joint's name for its drive, a device's for a device, `daemon` for the host); may be a glob"""
    can_id: Annotated[int, msgspec.Meta(ge=0, le=0x1FFFFFFF)] | None = None
    mask: Annotated[int, msgspec.Meta(ge=0, le=0x1FFFFFFF)] = 0x1FFFFFFF
    """a frame matches when its identifier and `can_id` agree in these bits"""
    after: NonNegative = 0.0
    """s of the bus's clock from when the fault is given until it begins"""
    duration: Annotated[float, msgspec.Meta(gt=0)] | None = None
    """s of the bus's clock; None: until it is taken back"""
    count: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """ends after so many frames were hit"""
    probability: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0
    """of a matching frame to be hit"""
    delay: NonNegative = 0.005
    """s, of kind `delay`"""
    seed: int = 0
    """of this fault's own random numbers"""


class FaultScript(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A file of faults."""

    faults: Annotated[list[Fault], msgspec.Meta(min_length=1)]


def read(file: str | Path, *, channels: Sequence[str] | None = None, nodes: Sequence[str] | None = None) -> list[Fault]:
    """The faults of a YAML file with the one key `faults`. Raises config.ConfigError with file, line, field and expectation.

    channels, nodes: all that there are, where the caller knows them; a fault on another can't ever act, and is refused.
    """
    document = config.read(file)
    script = document.convert(FaultScript).faults
    for number, fault in enumerate(script):
        at = f"faults[{number}]"
        if channels is not None and fault.channel is not None and fault.channel not in channels:
            raise document.error(f"{at}.channel", f"got {fault.channel!r}; expected one of {', '.join(channels)}")
        if fault.node is None and fault.kind in ("babble", "bus_off"):
            raise document.error(f"{at}.node", f"is missing; {fault.kind} expects a node's name")
        if nodes is not None and fault.node is not None and not fnmatch.filter(nodes, fault.node):
            raise document.error(
                f"{at}.node", f"got {fault.node!r}; expected a name, or a glob, of {', '.join(sorted(nodes))}"
            )
    return script
