"""Whether a configuration brings bodies nearer than they may come: coal's broad phase with a security margin for each pair."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.world import World

Array = NDArray[np.float64]


class BroadPhase:
    """Of one world; `floors` (pairs,) m. Not for several threads at once."""

    def __init__(self, world: World, floors: Array):
        self._model = world.mechanism.model
        self._data, self._scratch = self._model.createData(), world.geometry.createData()
        for request, floor in zip(self._scratch.collisionRequests, floors.tolist(), strict=True):
            request.security_margin = floor
        self._unasked = coal.StdVec_CollisionRequest()
        self._unasked.extend(self._scratch.collisionRequests)
        self._manager = pin.BroadPhaseManager_SSaPCollisionManager(self._model, world.geometry, self._scratch)

    def forget(self) -> None:
        """As if it had not looked at anything yet."""
        self._scratch.collisionRequests = self._unasked

    def only(self, chosen: NDArray[np.bool_]) -> None:
        """Look at the chosen pairs (pairs,) only, from now on."""
        for pair, wanted in enumerate(chosen.tolist()):
            if wanted:
                self._scratch.activateCollisionPair(pair)
            else:
                self._scratch.deactivateCollisionPair(pair)

    def met(self, q: Array) -> bool:
        """At a configuration (nq,)."""
        return bool(pin.computeCollisions(self._model, self._data, self._manager, q, True))
