"""Where the drives meet the bus: the host's frames in, one DriveStatus a drive out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.drives.lifecycle import State, statusword
from hal.drives.limb_fd import DriveTargets, LimbProtocol
from hal.joint import JointState
from hal.plant.world import World

_STATUSWORDS = statusword(np.arange(len(State)))


class BusNode:
    """All drives of a world's robot on their buses. Every frame to a limb is answered once, after the step that follows it."""

    def __init__(self, world: World):
        self.refused = 0
        """frames for drives that had a bad CRC or a wrong length: ignored, and not answered"""
        drives, limbs = world.drives, world.description.limbs
        n = len(drives)
        self._protocol = LimbProtocol(world.description)
        channel = {joint: limb.channel for limb in limbs for joint in limb.joints}
        self.names = world.description.joints
        """the nodes on the bus: each drive has its joint's name"""
        self.channels = tuple(channel[joint] for joint in self.names)
        self.sync_id, self.hold_id = (self._protocol.codec.layout(name).frame_id for name in ("Sync", "HoldTime"))
        """identifiers by which the host moves and holds time"""
        self.senders = np.zeros(0, np.int64)
        """which of them sent each of the frames that `answer` gave last"""
        self._drives = drives
        self._targets = DriveTargets(n)
        self._owed = np.zeros(n, np.bool_)
        self._out = frames.empty(n)
        # The answers' values are the drives' own arrays, as their sensors read: nothing is copied on the way to the frame.
        self._state = state = JointState(n)
        actuators = drives.actuators
        state.position, state.velocity = actuators.measured_position, actuators.measured_velocity
        state.torque = actuators.measured_torque
        state.temperature, state.error = drives.temperature, drives.error
        state.sequence = self._targets.sequence

    def receive(self, records: npt.NDArray[np.void], deaf: npt.NDArray[np.bool_] | None = None) -> tuple[int, int]:
        """Take frames of other nodes; returns how many of them were Sync and HoldTime on the first channel.

        deaf (names,): nodes that the bus keeps the frames from.
        """
        targets, drives, owed = self._targets, self._drives, self._owed
        self.refused += self._protocol.decode(records, len(records), targets)[1]
        if deaf is not None:
            targets.controlled[deaf] = targets.commanded[deaf] = False
        if np.count_nonzero(targets.controlled):
            drives.control(targets.controlword, targets.controlled)
            np.logical_or(owed, targets.controlled, out=owed)
        if np.count_nonzero(targets.commanded):
            drives.command(targets.command, targets.commanded, targets.watchdog)
            np.logical_or(owed, targets.commanded, out=owed)
        return targets.syncs, targets.holds

    def answer(self) -> npt.NDArray[np.void]:
        """The answers that are owed, as the world stands now; valid until the next call."""
        owed, state = self._owed, self._state
        if not np.count_nonzero(owed):
            return self._out[:0]
        drives = self._drives
        _STATUSWORDS.take(drives.state, out=state.status)
        state.status |= drives.flags
        count = self._protocol.encode_status(state, self._drives.actuators.mode, owed, self._out)
        self.senders = np.flatnonzero(owed)
        owed[:] = False
        return self._out[:count]
