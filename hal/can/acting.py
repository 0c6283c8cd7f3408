"""A fault on the bus (hal.can.faults): when it acts, what it remembers, and which nodes and frames it is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np
import numpy.typing as npt

from hal.can.faults import Fault
from hal.can.frames import EXTENDED

STANDARD = 0x7FF
"""the highest identifier of 11 bits"""


@dataclass
class Acting:
    """A fault on the bus."""

    fault: Fault
    begins: int
    ends: int
    """ns of the bus's clock"""
    began: bool = False
    hits: int = 0
    slot: int = -1
    """bit_error: its row of State.errors"""
    rng: np.random.Generator = field(init=False)
    frozen: dict[tuple[int, int], npt.NDArray[np.uint8]] = field(default_factory=dict)
    """stuck: (channel, identifier) → data"""
    held: dict[tuple[int, int], npt.NDArray[np.void]] = field(default_factory=dict)
    """reorder: (channel, node) → the frame that waits for the next"""

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.fault.seed)

    @property
    def due(self) -> int:
        """ns of the bus's clock when it begins or ends next"""
        return min(self.ends, self.ends if self.began else self.begins)

    @property
    def left(self) -> int | None:
        """frames that it may still hit; None: any number"""
        return None if self.fault.count is None else self.fault.count - self.hits

    def hit(self, matching: npt.NDArray[np.int64]) -> list[int]:
        """Which of the rows it is about are hit, as its probability and the frames left have it; counts them."""
        fault = self.fault
        if fault.probability < 1.0:
            matching = matching[self.rng.random(len(matching)) < fault.probability]
        if self.left is not None:
            matching = matching[: self.left]
        self.hits += len(matching)
        return [int(row) for row in matching]


class Reach:
    """Which channels, nodes and frames faults are about."""

    def __init__(self, channels: Sequence[str], names: list[str]):
        """`names`: of the nodes by number, kept up to date by the hub."""
        self.channels, self._names = list(channels), names

    def nodes(self, fault: Fault) -> npt.NDArray[np.bool_]:
        """(nodes,) by number."""
        if fault.node is None:
            return np.ones(len(self._names), np.bool_)
        return np.array([fnmatchcase(name, fault.node) for name in self._names], np.bool_)

    def on(self, fault: Fault) -> npt.NDArray[np.bool_]:
        """(channels,)"""
        return np.array([fault.channel in (None, name) for name in self.channels], np.bool_)

    def where(self, fault: Fault) -> npt.NDArray[np.bool_]:
        """(channels, nodes)"""
        return np.asarray(self.on(fault)[:, None] & self.nodes(fault)[None, :])

    def frames(self, fault: Fault, records: npt.NDArray[np.void], node: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Rows of the records, which these nodes send, that a fault is about."""
        hit = self.where(fault)[records["bus"], node]
        if fault.can_id is not None:
            hit &= (records["can_id"] & np.uint32(fault.mask)) == (fault.can_id & fault.mask)
            hit &= ((records["flags"] & EXTENDED) != 0) == (fault.can_id > STANDARD)
        return np.flatnonzero(hit)
