"""Who may command which part of the body: taking a part is explicit and has a number, and old commands don't count.

A part is a set of joints and grippers: `body`, a group of the robot's description, or a gripper. A part that nobody has taken may
be commanded by anybody; one that somebody has, by him alone. Every taking gets the next *epoch*. A command says the newest epoch
that its owner knew of when he made it, so that one made before a part was taken (or lost and taken again) is refused; and a
*sequence* number that goes up, so that one that is late or comes twice is refused. Stop, cancel and pause are everybody's; so is
looking.

The leases are kept in a file of the runtime folder: a server that was started anew goes on with them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import msgspec

from handrail.messages import LeaseState
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

BODY = "body"


class _Kept(msgspec.Struct):
    epoch: int = 0
    """of the last lease that was given"""
    held: dict[str, LeaseState] = {}
    """part → its lease"""
    sequences: dict[str, int] = {}
    """owner → number of his last command"""


class Leases:
    """The robot's leases."""

    def __init__(self, description: RobotDescription, file: Path):
        """Takes up what an earlier server left in `file`; a file that can't be read counts as empty."""
        grippers = [device.name for device in description.devices if device.family == "gripper"]
        self.parts = {BODY: frozenset((*description.joints, *grippers))}
        """part → joints and grippers"""
        self.parts |= {name: frozenset(joints) for name, joints in description.groups.items()}
        self.parts |= {name: frozenset((name,)) for name in grippers}
        self._file = file
        try:
            self._kept = msgspec.json.decode(file.read_bytes(), type=_Kept)
        except (FileNotFoundError, msgspec.DecodeError):
            self._kept = _Kept()

    def held(self) -> list[LeaseState]:
        """All of them, in the order in which they were taken."""
        return sorted(self._kept.held.values(), key=lambda lease: lease.epoch)

    def sequence(self, owner: str) -> int:
        """Number of an owner's last command."""
        return self._kept.sequences.get(owner, 0)

    def take(self, owner: str, part: str, take_over: bool = False) -> tuple[LeaseState, list[LeaseState]]:
        """(the lease, those of other owners that it ended). Raises RefusedError when one is in the way and not `take_over`."""
        if part not in self.parts:
            raise refuse("the robot has no such part", "part", part, f"one of {', '.join(self.parts)}")
        shared = [lease for lease in self.held() if self.parts[lease.part] & self.parts[part]]
        others = [lease for lease in shared if lease.owner != owner]
        if others and not take_over:
            one = others[0]
            raise refuse(f"{one.part} is {one.owner}'s: ask for it, or take it over", "part", part, "a free part")
        for lease in others:
            del self._kept.held[lease.part]
        self._kept.epoch += 1
        lease = LeaseState(part=part, owner=owner, epoch=self._kept.epoch)
        self._kept.held[part] = lease
        self._kept.sequences.setdefault(owner, 0)
        self._write()
        return lease, others

    def give_back(self, owner: str, part: str, epoch: int) -> None:
        """End a lease. Raises RefusedError unless it is this one."""
        lease = self._kept.held.get(part)
        if lease is None or lease.owner != owner:
            raise refuse(f"{part} is not {owner}'s", "part", part, f"one that {owner} has taken")
        if lease.epoch != epoch:
            raise refuse("another lease than the present one", "epoch", epoch, str(lease.epoch))
        del self._kept.held[part]
        self._write()

    def lose(self, owner: str) -> list[LeaseState]:
        """End all of an owner's leases; those that there were."""
        lost = [lease for lease in self.held() if lease.owner == owner]
        for lease in lost:
            del self._kept.held[lease.part]
        if lost:
            self._write()
        return lost

    def check(self, owner: str, moved: Iterable[str], epoch: int, sequence: int) -> None:
        """Raise RefusedError unless `owner` may command these joints and grippers by a command of this epoch and sequence.

        A command that passes is counted: it does not pass again.
        """
        if not self._kept.held:
            return
        moved = frozenset(moved)
        needed = [lease for lease in self.held() if self.parts[lease.part] & moved]
        for lease in needed:
            if lease.owner != owner:
                raise refuse(
                    f"{lease.part} is {lease.owner}'s", "owner", owner, f"{lease.owner}, or a lease on {lease.part}"
                )
        if not needed:
            return
        newest = max(lease.epoch for lease in self.held() if lease.owner == owner)
        oldest = max(lease.epoch for lease in needed)
        if not oldest <= epoch <= newest:
            raise refuse(
                f"made under another lease than the present one of {needed[-1].part}",
                "lease",
                epoch,
                f"{oldest}" if oldest == newest else f"{oldest} to {newest}",
            )
        if sequence <= self._kept.sequences[owner]:
            last = self._kept.sequences[owner]
            raise refuse("a command that is late, or came twice", "sequence", sequence, f"more than {last}")
        self._kept.sequences[owner] = sequence
        self._write()

    def _write(self) -> None:
        fresh = self._file.with_suffix(".new")
        fresh.write_bytes(msgspec.json.encode(self._kept))
        os.replace(fresh, self._file)
