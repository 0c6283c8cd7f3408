"""The parts of the body that a run commands: it takes their leases (docs/safety.md) when a motion needs them, and returns them."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Mapping, Sequence

import msgspec

from engines.daemon_client import DaemonClient
from handrail.messages import (
    DaemonStatus,
    GetStatus,
    Lease,
    ReturnLease,
    StartAction,
    StartBehaviour,
    TakeLease,
    WholeBody,
)
from handrail.topics import RefusedError, Unreachable

BODY = "body"


class Parts:
    """What one run holds. An engine has one run at a time, so that its commands' numbers are the run's to count: those of what is
    moved by hand in a pause of it, too.
    """

    def __init__(self, daemon: DaemonClient, groups: Mapping[str, Sequence[str]]):
        """`groups`: the robot's; a motion of joints that none of them has needs the whole body."""
        self._daemon, self._groups = daemon, groups
        self._held: dict[str, Lease] = {}
        self._sequence = 0
        self._lock = threading.RLock()

    def hold(self, message: StartAction | StartBehaviour) -> StartAction | StartBehaviour:
        """The message as the holder of all that it moves says it. What somebody else has is never taken over.

        Raises RefusedError, which says whose it is; Unreachable.
        """
        with self._lock:
            for part in self._needed(message):
                if part not in self._held:
                    self._held[part] = lease = self._daemon.call(TakeLease(owner=self._daemon.owner, part=part))
                    self._sequence = max(self._sequence, lease.sequence)
            self._sequence += 1
            newest = max((lease.epoch for lease in self._held.values()), default=0)
            return msgspec.structs.replace(message, lease=newest, sequence=self._sequence)

    def taken_over(self) -> str:
        """Who has taken what this run held, in words; empty where nobody has, or the daemon does not say."""
        try:
            status = self._daemon.call(GetStatus())
        except (RefusedError, Unreachable):
            return ""
        leases = status.leases if isinstance(status, DaemonStatus) else []
        others = [lease for lease in leases if lease.owner != self._daemon.owner]
        taken = [one for one in others if any(self._meet(one.part, part) for part in self._held)]
        return ", ".join(f"{one.owner} has taken over {one.part}" for one in taken)

    def give_back(self) -> None:
        """The run has ended. What the daemon does not hear of, it takes back by itself from an engine that is silent."""
        with self._lock:
            for part, lease in self._held.items():
                with contextlib.suppress(RefusedError, Unreachable):
                    self._daemon.call(ReturnLease(owner=self._daemon.owner, part=part, epoch=lease.epoch))
            self._held.clear()

    def _needed(self, message: StartAction | StartBehaviour) -> list[str]:
        own = moved(message)
        if own is None:
            return [BODY]
        grippers = _grippers(message)
        joints = own.difference(grippers)
        parts = [name for name, members in self._groups.items() if joints.intersection(members)]
        if joints.difference(*(self._groups[name] for name in parts)):
            return [BODY]
        return [*parts, *grippers]

    def _meet(self, one: str, other: str) -> bool:
        if BODY in (one, other) or one == other:
            return True
        return not set(self._groups.get(one, ())).isdisjoint(self._groups.get(other, ()))


def meet(one: StartAction | StartBehaviour, other: StartAction | StartBehaviour) -> bool:
    """Whether both move the same joint, or order the same gripper."""
    first, second = (moved(message) for message in (one, other))
    return first is None or second is None or not first.isdisjoint(second)


def moved(message: StartAction | StartBehaviour) -> frozenset[str] | None:
    """The joints that it moves, and the grippers that it orders about; None: all of the body."""
    motions = [step.motion for step in message.steps] if isinstance(message, StartBehaviour) else [message.motion]
    if any(isinstance(motion, WholeBody) and not motion.joints for motion in motions):
        return None
    return frozenset(joint for motion in motions for joint in motion.joints).union(_grippers(message))


def _grippers(message: StartAction | StartBehaviour) -> list[str]:
    steps = message.steps if isinstance(message, StartBehaviour) else []
    return list(dict.fromkeys(step.gripper.gripper for step in steps if step.gripper is not None))
