"""What a cycle of whole-body control came to."""

from __future__ import annotations

from dataclasses import dataclass

from daemon.wbc.memory import Array


@dataclass(frozen=True)
class Blocked:
    """A constraint that can't hold together with the others."""

    constraint: str
    amount: float
    """by how much it is exceeded at least, in `unit`"""
    unit: str

    def __str__(self) -> str:
        return f"{self.constraint}: exceeded by {self.amount:.3g} {self.unit}"


class Result:
    """What a cycle came to. Arrays are the solver's own, overwritten by the next cycle; everything in them is finite, always."""

    __slots__ = ("acceleration", "active", "blocked", "force", "solved", "torque", "why")

    def __init__(self, acceleration: Array, torque: Array, force: Array):
        self.acceleration = acceleration
        """(nv,) q̈"""
        self.torque = torque
        """(nv,) N·m"""
        self.force = force
        """(nf,) N, N·m, of all contacts and wrenches: what the world exerts on the robot"""
        self.solved = True
        """constraints hold and priorities are strict; otherwise see `why`, and `torque` only holds the robot up against gravity
        where nothing better is known"""
        self.active = 0
        """bounds that are active"""
        self.why = ""
        self.blocked: tuple[Blocked, ...] = ()
        """of constraints that exclude each other, those that had to give, the worst first; all else then holds"""
