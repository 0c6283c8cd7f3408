"""How near one arm comes to what stands around it and to its own robot, on its way to an object that its tool may touch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning import constraints
from engines.planning.collision.connect import Connector
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.sweep import Chosen, Nearest, Sweep, lines
from engines.planning.collision.world import World
from engines.planning.constraints import Constraint
from engines.planning.ik.mechanism import Mechanism
from handrail.robot.description import Arm, RobotDescription

Array = NDArray[np.float64]

_BETWEEN = 1e-3
"""m that a clearance may be missed by between the rows of a path at which it is kept"""


@dataclass(frozen=True)
class Clearance:
    """Distances over a way of k postures, the smallest, and between whom. Negative: penetration."""

    distance: float
    between: str
    along: Array
    """(k,) m at every posture"""
    pairs: tuple[str, ...]
    """(k,) between whom that is"""

    @classmethod
    def of(cls, along: Array, pairs: tuple[str, ...]) -> Clearance:
        """From what is nearest at every posture, at least one."""
        row = int(np.argmin(along))
        return cls(float(along[row]), pairs[row], along, pairs)


def nearer(one: Clearance, other: Clearance) -> Clearance:
    """Of two over the same way, what is nearer at every posture."""
    pairs = tuple(a if x <= y else b for x, y, a, b in zip(one.along, other.along, one.pairs, other.pairs, strict=True))
    return Clearance.of(np.minimum(one.along, other.along), pairs)


class CollisionScene:
    """One arm among obstacles; all other joints stand still. Positions are (k, n) rad of all joints, in the description's order."""

    def __init__(
        self, mechanism: Mechanism, description: RobotDescription, arm: Arm, obstacles: Sequence[Obstacle], touched: str,
        seen: Sequence[Obstacle] = (),
    ):  # fmt: skip
        """`touched`: the instance that the arm's tool may touch, where it may; `seen`: what has no name, and may be that."""
        self._mechanism = mechanism
        self._columns = description.index(mechanism.joints)
        self.world = World(mechanism, [*obstacles, *seen], description.allowed_collision_pairs, moving=arm.joints)
        self._sweep = Sweep(self.world)
        self.touching = tuple(
            (arm.tool, name) for name in (f"* of {touched}", *sorted({solid.label for solid in seen}))
        )
        """names, as the world's, of those who may touch where the tool may"""
        self.itself = constraints.self_clearance(description.guard)
        self.margins = Margins(itself=self.itself.bound, objects=constraints.CLEARANCE.bound)
        itself = self.world.of_itself
        tool = self.world.touching(*self.touching)
        self._chosen: dict[tuple[Constraint, bool], Chosen] = {
            (self.itself, False): itself,
            (self.itself, True): itself,
            (constraints.CLEARANCE, False): ~itself,
            (constraints.CLEARANCE, True): ~itself & ~tool,
        }
        self._floors = {
            False: self.margins.floors(self.world) - _BETWEEN,
            True: self.margins.floors(self.world, self.touching) - _BETWEEN,
        }

    def configurations(self, positions: Array) -> Array:
        """(k, nq) of the mechanism."""
        return np.array([self._mechanism.configuration(row) for row in positions[:, self._columns]])

    def to_self(self, positions: Array) -> Clearance:
        """The robot from itself."""
        return self._smallest(positions, self._chosen[self.itself, False])

    def to_obstacles(self, positions: Array, *, tool_may_touch: bool) -> Clearance:
        """What the arm carries from the obstacles; the tool counts, but for what it is at where it may touch that."""
        return self._smallest(positions, self._chosen[constraints.CLEARANCE, tool_may_touch])

    def between(self, positions: Array, *, tool_may_touch: bool) -> tuple[Constraint, Nearest] | None:
        """Where straight lines through positions come too near to something between them, if anywhere."""
        met = self._sweep.meeting(lines(self.configurations(positions)), self._floors[tool_may_touch])
        if met is None:
            return None
        itself = self.world.of_itself[met.pair]
        return (self.itself if itself else constraints.CLEARANCE), met

    def way(self, start: Array, goal: Array, cancelled: Callable[[], bool]) -> Array:
        """(k, n) a clear way from positions (n,) to others. Raises Infeasible, Cancelled."""
        connector = Connector(
            self.world, margins=self.margins, limit_margin=constraints.LIMIT_MARGIN.bound, cancelled=cancelled
        )
        found = connector.way(*self.configurations(np.array([start, goal])))
        positions = np.repeat(start[None], len(found), axis=0)
        positions[:, self._columns] = found[:, self._mechanism.q_rows]
        return positions

    def _smallest(self, positions: Array, chosen: Chosen) -> Clearance:
        found: list[Nearest] = []
        for q in self.configurations(positions):
            found.append(self._sweep.nearest(q, chosen, guess=found[-1].pair if found else -1))
        return Clearance.of(np.array([one.distance for one in found]), tuple(one.between for one in found))
