"""Where the robot's drives and devices meet the bus: the host's frames in, the drives' answers and the devices' states out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.drives.fields import ENTITY, HEAD, Role
from hal.drives.kernels import HEARD, REQUESTS
from hal.drives.lifecycle import CONTROLWORD, Command, State, statusword
from hal.drives.parameters import ParameterResult
from hal.drives.protocol import DriveTargets, LimbProtocol, ParameterRequest
from hal.joint import JointState
from hal.plant.world import World

_STATUSWORDS = statusword(np.arange(len(State)))
_NEVER = -1


class BusNode:
    """All drives and devices of a world's robot on their buses.

    Every frame to a limb is answered once, after the step that follows it; devices send after every so many Syncs.
    """

    def __init__(self, world: World):
        self.refused = 0
        """frames for drives or devices that had a bad CRC or a wrong length: ignored, and not answered"""
        drives, description = world.drives, world.description
        n, d = len(drives), len(description.devices)
        channel = {joint: limb.channel for limb in description.limbs for joint in limb.joints}
        devices = description.devices
        self.names = (*description.joints, *(device.name for device in devices))
        """the nodes on the bus: each drive has its joint's name, which a limb's first one lends to its master"""
        self.channels = (*(channel[joint] for joint in description.joints), *(device.channel for device in devices))
        self.senders = np.zeros(0, np.int64)
        """which of them sent each of the frames that were given last"""
        self._world, self._drives, self._devices = world, drives, world.devices
        self._protocol = protocol = LimbProtocol(description)
        heads = protocol.program.frames[:, HEAD]
        self.sync_id, self.hold_id = (
            int(heads[protocol.program.span(role)[0]]) & 0xFFFFFFFF for role in (Role.SYNC, Role.HOLD_TIME)
        )
        """identifiers by which the host moves and holds time"""
        self._targets = DriveTargets(n, d)
        self._owed = np.zeros(n, np.bool_)
        self._out = frames.empty(protocol.frames_a_cycle)
        self._state = JointState(n)
        self._requests: list[ParameterRequest] = []
        frames_of = [range(*protocol.program.span(role)) for role in (Role.STATUS, Role.MASTER_STATUS)]
        self._answering = np.array([protocol.program.frames[f, ENTITY] for span in frames_of for f in span], np.int64)
        span = range(*protocol.program.span(Role.DEVICE_STATUS))
        self._sending = np.array([protocol.program.frames[f, ENTITY] for f in span], np.int64)
        families = protocol.program.families
        self._short_ladder = np.array(
            [families[family].short_ladder for family in protocol.program.joint_family], np.bool_
        )
        self._patterns: dict[bytes, npt.NDArray[np.int64]] = {}
        self._syncs = 0
        self._due = np.zeros(d, np.bool_)
        self._sequences = np.zeros(d, np.uint8)
        self._heard = np.full(d, _NEVER, np.int64)
        columns = [families[device.family].columns(Role.DEVICE_COMMAND) for device in devices]
        self._enable = np.array([names.index("enable") if "enable" in names else -1 for names in columns], np.int64)

    def receive(self, records: npt.NDArray[np.void], deaf: npt.NDArray[np.bool_] | None = None) -> tuple[int, int]:
        """Take frames of other nodes; returns how many of them were Sync and HoldTime on the first channel.

        deaf (names,): nodes that the bus keeps the frames from.
        """
        targets, drives, owed = self._targets, self._drives, self._owed
        self.refused += self._protocol.decode(records, len(records), targets)[1]
        if deaf is not None:
            n = len(drives)
            targets.controlled[deaf[:n]] = targets.commanded[deaf[:n]] = False
            targets.devices.commanded[deaf[n:]] = False
        if np.count_nonzero(targets.controlled):
            self._climb(targets)
            drives.control(targets.controlword, targets.controlled)
            np.logical_or(owed, targets.controlled, out=owed)
        if np.count_nonzero(targets.commanded):
            drives.command(targets.command, targets.commanded, targets.watchdog)
            np.logical_or(owed, targets.commanded, out=owed)
        if np.count_nonzero(targets.devices.commanded):
            for row in np.flatnonzero(targets.devices.commanded).tolist():
                self._heard[row] = self._world.time_ns
                self._devices.command(row, targets.devices.values[row])
        if targets.host[REQUESTS]:
            asked = self._protocol.requests(targets)
            self._requests += [request for request in asked if deaf is None or not deaf[request.joint]]
        syncs = targets.syncs
        if len(self._due):
            for _ in range(syncs):
                self._syncs += 1
                self._due |= self._syncs % self._protocol.every == 0
        return syncs, targets.holds

    def answer(self) -> npt.NDArray[np.void]:
        """What is owed, as the world stands now: valid until the next call, sent by `senders`."""
        self._watch_devices()
        owed, out, count = self._owed, self._out, 0
        senders = self._senders_of(owed, self._due)
        if np.count_nonzero(owed):
            self._look_at_drives()
            count = self._protocol.encode_status(
                self._state, self._drives.actuators.mode, owed, out, time_ns=self._world.time_ns
            )
            owed[:] = False
        if np.count_nonzero(self._due):
            state = self._devices.measure(self._due)
            count += self._protocol.encode_device_status(
                state, self._due, self._sequences, out[count:], time_ns=self._world.time_ns
            )
            self._due[:] = False
        if self._requests:
            replying = [senders]
            count += self._reply(out[count:], replying)
            senders = np.concatenate(replying)
        self.senders = senders
        return out[:count]

    def _senders_of(self, owed: npt.NDArray[np.bool_], due: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
        """Who sends the frames of drives that owe an answer and of devices that are due; nearly always the same few patterns."""
        pattern = owed.tobytes() + due.tobytes()
        if pattern not in self._patterns:
            drives = self._answering[owed[self._answering]]
            devices = len(self._state) + self._sending[due[self._sending]]
            self._patterns[pattern] = np.concatenate((drives, devices))
        return self._patterns[pattern]

    def replies(self) -> npt.NDArray[np.void]:
        """Of what is owed, the answers to parameter requests, which need no step of the world; as `answer` gives them."""
        if not self._requests:
            return self._out[:0]
        senders: list[npt.NDArray[np.int64]] = []
        count = self._reply(self._out, senders)
        self.senders = np.concatenate(senders)
        return self._out[:count]

    def _reply(self, out: npt.NDArray[np.void], senders: list[npt.NDArray[np.int64]]) -> int:
        count = 0
        for request in self._requests:
            result, value = self._serve(request)
            count += self._protocol.encode_reply(request, result, value, out[count:])
            senders.append(np.array([request.joint]))
        self._requests.clear()
        return count

    def _serve(self, request: ParameterRequest) -> tuple[ParameterResult, float]:
        result, value = ParameterResult.OK, 0.0
        if request.write:
            result = self._drives.write_parameter(request.joint, request.index, request.value)
        try:
            value = self._drives.read_parameter(request.joint, request.index)
        except KeyError:
            value = request.value  # nothing to be read: what was written comes back
            result = result if request.write else ParameterResult.UNKNOWN
        return result, value

    def _look_at_drives(self) -> None:
        state, drives = self._state, self._drives
        actuators = drives.actuators  # as their sensors read, not as the world is
        state.position[...], state.velocity[...] = actuators.measured_position, actuators.measured_velocity
        state.torque[...], state.temperature[...] = actuators.measured_torque, drives.temperature
        state.error[...], state.sequence[...] = drives.error, self._targets.sequence
        np.bitwise_or(_STATUSWORDS[drives.state], drives.flags, out=state.status)

    def _climb(self, targets: DriveTargets) -> None:
        """Drives that know enabled and disabled only take the whole of CiA 402's ladder at once."""
        if not self._short_ladder.any():
            return
        enable = targets.controlword == CONTROLWORD[Command.ENABLE_OPERATION]
        rows = self._short_ladder & targets.controlled & enable
        for command in (Command.SHUTDOWN, Command.SWITCH_ON):
            self._drives.control(np.full(len(rows), CONTROLWORD[command]), rows)

    def _watch_devices(self) -> None:
        """Disable devices whose commands have stayed away for longer than their watchdog says.

        Whoever commands them then may count from anywhere.
        """
        if not np.count_nonzero(self._heard >= 0):
            return
        patience = self._targets.device_watchdog * np.int64(self._world.description.period_ns)
        late = (self._heard >= 0) & (patience > 0) & (self._world.time_ns - self._heard > patience)
        self._heard[late] = _NEVER
        self._targets.device_flags[HEARD, late] = 0
        for row in np.flatnonzero(late & (self._enable >= 0)).tolist():
            values = self._targets.devices.values[row]
            values[self._enable[row]] = 0.0
            self._devices.command(row, values)
