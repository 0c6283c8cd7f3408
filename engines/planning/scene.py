"""A collision world with all that measures in it, as long as the same things stand around."""

from __future__ import annotations

from engines.planning.collision.margins import Margins
from engines.planning.collision.sweep import Sweep
from engines.planning.collision.world import World
from engines.planning.ik.checker import LENGTH
from engines.planning.verifier import Verifier


class Scene:
    """Of one world; `margins` are kept in it. Making one takes as long as finding a posture."""

    def __init__(self, world: World, margins: Margins):
        self.world, self.margins = world, margins
        self.sweep = Sweep(world)
        self.verifier = Verifier(world, margins=self.margins, near=LENGTH)

    def forget(self) -> None:
        """As if it were new: the same question has the same answer, whatever was asked before."""
        self.sweep.forget()
        self.verifier.forget()
