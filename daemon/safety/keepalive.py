"""Keepalives: whoever steers a robot by hand says in time that he is there, or it holds, comes to rest, and is damped to a stop.

    alive ── silent for the timeout ──► hold ── it stands (or 1 s) ──► settle ── 2 s ──► damping
      ▲                                  │                               │
      └────────────── a good answer ─────┴───────────────────────────────┘

Pure functions of a binding and the robot's clock. *Hold*: the owner's actions slow down to a stand, and he can start none.
*Damping*: every drive quick-stops; the binding has ended, and only Enable moves the robot again.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

HOLD_NS, SETTLE_NS = 1_000_000_000, 2_000_000_000
"""how long a hold may take to come to a stand; how long it is waited then before the drives are damped"""
STILL = 0.02
"""rad/s: slower than this in every joint, the robot stands"""


class Stage(enum.IntEnum):
    ALIVE = 0
    HOLD = 1
    SETTLE = 2
    DAMPING = 3


@dataclass(frozen=True)
class Binding:
    """One owner's keepalive; times are the robot's clock."""

    timeout_ns: int
    heard_ns: int
    """when he last answered"""
    stage: Stage = Stage.ALIVE
    since_ns: int = 0
    """when this stage began"""


def heard(binding: Binding, now_ns: int) -> Binding:
    """The binding after a good answer. What is damped already stays so."""
    if binding.stage is Stage.DAMPING:
        return binding
    return replace(binding, heard_ns=now_ns, stage=Stage.ALIVE)


def step(binding: Binding, now_ns: int, fastest: float) -> Binding:
    """The binding in the next cycle. `fastest`: rad/s, the fastest joint's speed."""
    match binding.stage:
        case Stage.ALIVE if now_ns - binding.heard_ns > binding.timeout_ns:
            return replace(binding, stage=Stage.HOLD, since_ns=now_ns)
        case Stage.HOLD if fastest < STILL or now_ns - binding.since_ns > HOLD_NS:
            return replace(binding, stage=Stage.SETTLE, since_ns=now_ns)
        case Stage.SETTLE if now_ns - binding.since_ns > SETTLE_NS:
            return replace(binding, stage=Stage.DAMPING, since_ns=now_ns)
    return binding


class Keepalives:
    """The bindings of a robot, by their owners' numbers."""

    def __init__(self) -> None:
        self.bound: dict[int, Binding] = {}

    def bind(self, owner: int, timeout_ns: int, now_ns: int) -> None:
        """From now on `owner` must answer every so often."""
        self.bound[owner] = Binding(timeout_ns, now_ns)

    def release(self, owner: int) -> bool:
        """He need not any more. False: he did not have to."""
        return self.bound.pop(owner, None) is not None

    def hear(self, owner: int, now_ns: int) -> bool:
        """He has answered. False: nothing binds him."""
        if (binding := self.bound.get(owner)) is None:
            return False
        self.bound[owner] = heard(binding, now_ns)
        return True

    def silent(self, owner: int) -> bool:
        """He is bound, and has not answered in time."""
        binding = self.bound.get(owner)
        return binding is not None and binding.stage is not Stage.ALIVE

    @property
    def any_silent(self) -> bool:
        return any(binding.stage is not Stage.ALIVE for binding in self.bound.values())

    def update(self, now_ns: int, fastest: float) -> list[tuple[int, Stage, float]]:
        """One cycle; (owner, stage that begins now, s of silence). Who comes to be damped is bound no longer."""
        changed = []
        for owner, binding in list(self.bound.items()):
            after = step(binding, now_ns, fastest)
            if after is not binding:
                self.bound[owner] = after
                changed.append((owner, after.stage, (now_ns - after.heard_ns) * 1e-9))
                if after.stage is Stage.DAMPING:
                    del self.bound[owner]
        return changed
