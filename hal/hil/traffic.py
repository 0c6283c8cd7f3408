"""What was said on the bus: recorded frames, and what they mean by the robot's own drive protocol."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hal.drives.lifecycle import DriveError, State, decode_statusword
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.hil.names import joints_of
from hal.joint import JointState
from handrail.robot.description import RobotDescription

REPLY = np.dtype(
    [
        ("time_ns", "<i8"),
        ("state", "u1"),  # hal.drives.lifecycle.State
        ("error", "u1"),  # DriveError
        ("sequence", "u1"),
        ("position", "<f8"),  # rad
        ("velocity", "<f8"),  # rad/s
        ("torque", "<f8"),  # N·m
    ]
)
"""One answer of a drive."""

Records = npt.NDArray[np.void]
Times = npt.NDArray[np.int64]


_NEVER_HEARD = 1 << 40
"""cycles: of a drive that was never heard every answer is new; here all of them are looked at, repeated ones too"""


class _Role(NamedTuple):
    """What an identifier on a channel is for."""

    kind: str
    """command, control, sync, reply or other"""
    joints: frozenset[int]


_OTHER = _Role("other", frozenset())


class Traffic:
    """Frames in the order in which they came on the bus; times are ns of the bus's clock, the end of each frame."""

    def __init__(self, records: Records, description: RobotDescription, protocol: LimbProtocol):
        self.records, self._description, self._protocol = records, description, protocol
        self._keys = records["bus"].astype(np.uint64) << np.uint64(32) | records["can_id"].astype(np.uint64)

    def __len__(self) -> int:
        return len(self.records)

    @functools.cached_property
    def _roles(self) -> dict[int, _Role]:
        return {int(key): self._role(np.flatnonzero(self._keys == key)) for key in np.unique(self._keys)}

    def _role(self, rows: npt.NDArray[np.int64]) -> _Role:
        n = len(self._description.joints)
        targets, state = DriveTargets(n, len(self._protocol.devices)), JointState(n)
        # A frame may have been corrupted: look at a few.
        for row in rows[:8]:
            record = self.records[row : row + 1].copy()
            self._protocol.decode(record, 1, targets)
            for kind, mask in (("command", targets.commanded), ("control", targets.controlled)):
                if mask.any():
                    return _Role(kind, frozenset(np.flatnonzero(mask).tolist()))
            if targets.syncs:
                return _Role("sync", frozenset())
            state.age[:] = _NEVER_HEARD
            if self._protocol.decode_status(record, 1, state)[0]:
                return _Role("reply", frozenset(np.flatnonzero(state.age == 0).tolist()))
        return _OTHER

    def _rows(self, kind: str, joints: str | Iterable[str] | None = None) -> npt.NDArray[np.int64]:
        wanted = None
        if joints is not None:
            wanted = {self._description.joints.index(j) for j in joints_of(self._description, joints)}
        keys = [
            key for key, role in self._roles.items() if role.kind == kind and (wanted is None or role.joints & wanted)
        ]
        return np.flatnonzero(np.isin(self._keys, np.array(keys, np.uint64)))

    def command_times(self, joints: str | Iterable[str]) -> Times:
        """(k,) ns, when set-points for any of these joints were on the bus."""
        return self.records["time_ns"][self._rows("command", joints)].astype(np.int64)

    def control_times(self, joints: str | Iterable[str]) -> Times:
        """(k,) ns, when controlwords for any of these joints were on the bus."""
        return self.records["time_ns"][self._rows("control", joints)].astype(np.int64)

    def sync_times(self) -> Times:
        """(k,) ns, one a cycle (on the first channel)."""
        return self.records["time_ns"][self._rows("sync")].astype(np.int64)

    def replies(self, joint: str) -> npt.NDArray[np.void]:
        """Every valid answer of one joint's drive, as rows of REPLY."""
        (joint,) = joints_of(self._description, joint)
        row = self._description.joints.index(joint)
        state = JointState(len(self._description.joints))
        out = np.zeros(0, REPLY)
        found = []
        for index in self._rows("reply", joint):
            record = self.records[index : index + 1].copy()
            state.age[row] = _NEVER_HEARD
            if self._protocol.decode_status(record, 1, state)[0]:
                found.append(
                    (
                        int(record["time_ns"][0]),
                        int(decode_statusword(state.status[row])),
                        int(state.error[row]),
                        int(state.sequence[row]),
                        float(state.position[row]),
                        float(state.velocity[row]),
                        float(state.torque[row]),
                    )
                )
        return np.array(found, REPLY) if found else out

    def last_command(self, joints: str | Iterable[str]) -> int:
        """ns, when these joints last got set-points. Raises AssertionError when they never did."""
        times = self.command_times(joints)
        assert len(times), f"no set-points for {joints} among {len(self)} frames"
        return int(times[-1])

    def states(self, joint: str) -> list[tuple[int, str, str]]:
        """(ns, state, error) whenever either changed in a drive's own answers."""
        told: list[tuple[int, str, str]] = []
        for reply in self.replies(joint):
            state, error = State(int(reply["state"])).name.lower(), DriveError(int(reply["error"])).name.lower()
            if not told or told[-1][1:] != (state, error):
                told.append((int(reply["time_ns"]), state, error))
        return told

    # -------------------------------------------------------------------------------------------------------- assertions

    def assert_commanded_every_cycle(self, joints: str | Iterable[str], *, allowed: int = 0) -> None:
        """Between their first set-point and their last, these joints got new ones in every cycle, but for `allowed` cycles."""
        period = self._description.period_ns
        for joint in joints_of(self._description, joints):
            times = self.command_times(joint)
            assert len(times) > 1, f"{joint}: {len(times)} set-points on the bus; expected a stream of them"
            missing = round((times[-1] - times[0]) / period) + 1 - len(times)
            assert missing <= allowed, (
                f"{joint}: {missing} cycles without a set-point between {times[0] * 1e-9:.3f} s and "
                f"{times[-1] * 1e-9:.3f} s; allowed {allowed}"
            )

    def assert_silent(self, joints: str | Iterable[str]) -> None:
        """Nobody sent these joints set-points."""
        times = self.command_times(joints)
        assert not len(times), f"{joints}: {len(times)} set-points from {times[0] * 1e-9:.3f} s; expected none"

    def assert_answered(self, joints: str | Iterable[str], *, share: float = 1.0) -> None:
        """So many of the frames to these joints' drives were answered (the last cycle, still under way, is left out)."""
        for joint in joints_of(self._description, joints):
            asked = np.concatenate([self.command_times(joint), self.control_times(joint)])
            answers = self.replies(joint)
            assert len(asked), f"{joint}: nothing was sent to it"
            wanted = share * (len(asked) - 1)
            assert len(answers) >= wanted, (
                f"{joint}: {len(answers)} answers to {len(asked)} frames; expected {wanted:.0f}"
            )
