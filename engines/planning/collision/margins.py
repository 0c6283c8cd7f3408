"""What a motion has to keep clear by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning.collision.world import World


@dataclass(frozen=True)
class Margins:
    """What has to be kept, m: from the robot itself, and from what stands around."""

    itself: float = 0.01
    objects: float = 0.02

    def floors(self, world: World, touching: tuple[tuple[str, str], ...] = ()) -> NDArray[np.float64]:
        """(pairs,) m of each pair of the world; −inf for those of these names, with wildcards, which may touch."""
        floors = np.where(world.of_itself, self.itself, self.objects)
        if touching:
            floors[world.touching(*touching)] = -np.inf
        return floors
