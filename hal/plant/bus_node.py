"""Where the robot's drives and devices meet the bus: the host's frames in, the drives' answers and the devices' states out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.drives import order
from hal.drives.drive_side import COMMANDS, CONTROLS, HOLDS, REQUESTS, SYNCS, TOLD
from hal.drives.fields import HEAD, Role
from hal.drives.lifecycle import CONTROLWORD, Command, State, statusword
from hal.drives.parameters import ParameterResult
from hal.drives.protocol import DriveTargets, LimbProtocol, ParameterRequest
from hal.drives.rows import joint_state
from hal.joint import JointState
from hal.plant.world import World
from handrail.compiled import compiled

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
        self._targets = DriveTargets(n, d, description.watchdog_cycles)
        self._owed, self._due = self._targets.owed, self._targets.owed[n:]
        self._out, self._senders = frames.empty(protocol.frames_a_cycle), np.zeros(n + d, np.int64)
        self._batches = [self._out[:count] for count in range(len(self._out) + 1)]
        self._state = JointState(n)
        self._requests: list[ParameterRequest] = []
        families = protocol.program.families
        self._short_ladder = np.array(
            [families[family].short_ladder for family in protocol.program.joint_family], np.bool_
        )
        self._climbs_at_once = bool(self._short_ladder.any())
        self._sequences = np.zeros(d, np.uint8)
        self._heard = np.full(d, _NEVER, np.int64)
        self._watched = False
        columns = [families[device.family].columns(Role.DEVICE_COMMAND) for device in devices]
        self._enable = np.array([names.index("enable") if "enable" in names else -1 for names in columns], np.int64)

    def receive(self, records: npt.NDArray[np.void], deaf: npt.NDArray[np.bool_] | None = None) -> tuple[int, int]:
        """Take frames of other nodes; returns how many of them were Sync and HoldTime on the first channel.

        deaf (names,): nodes that the bus keeps the frames from.
        """
        targets, drives, world = self._targets, self._drives, self._world
        host = targets.memory
        cycle = world.time_ns // world.description.period_ns
        if deaf is not None:
            targets.deaf[:] = deaf
        self.refused += self._protocol.decode(records, len(records), targets, cycle)[1]
        if deaf is not None:
            targets.deaf[:] = False
        if host[CONTROLS]:
            self._climb(targets)
            drives.control(targets.controlword, targets.controlled)
        if host[COMMANDS]:
            drives.command(targets.command, targets.commanded, targets.watchdog)
        if host[TOLD]:
            for row in np.flatnonzero(targets.devices.commanded).tolist():
                self._command_device(row)
        if host[REQUESTS]:
            asked = self._protocol.requests(targets)
            self._requests += [request for request in asked if deaf is None or not deaf[request.joint]]
        return int(host[SYNCS]), int(host[HOLDS])

    def answer(self) -> npt.NDArray[np.void]:
        """What is owed, as the world stands now: valid until the next call, sent by `senders`."""
        if self._watched:
            self._watch_devices()
        out, count = self._out, 0
        if 1 in self._owed.tobytes():  # numpy's own ways to ask take longer
            self._look_at_drives()
            devices = self._devices
            count = self._protocol.encode_answers(
                self._owed, self._state, self._drives.actuators.mode,
                devices.measure(self._due) if 1 in self._due.tobytes() else devices.state,
                self._sequences, self._world.time_ns, out, self._senders,
            )  # fmt: skip
            self._owed[:] = False
        self.senders = self._senders[:count]
        if self._requests:
            replying = [self.senders]
            count += self._reply(out[count:], replying)
            self.senders = np.concatenate(replying)
        return self._batches[count]

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
        drives, actuators = self._drives, self._drives.actuators
        _look(  # as their sensors read, not as the world is
            self._state.memory, actuators.measured_position, actuators.measured_velocity, actuators.measured_torque,
            drives.temperature, drives.state, drives.flags, drives.error, self._targets.sequence,
        )  # fmt: skip

    def _command_device(self, row: int) -> None:
        """Let a device follow its command. One that begins a stream may be a late one: it enables nothing."""
        values, enable = self._targets.devices.values[row], self._enable[row]
        if enable >= 0:
            self._heard[row], self._watched = self._world.time_ns, True
            if self._targets.device_order[row] == order.FIRST:
                values[enable] = 0.0
        self._devices.command(row, values)

    def _climb(self, targets: DriveTargets) -> None:
        """Drives that know enabled and disabled only take the whole of CiA 402's ladder at once."""
        if not self._climbs_at_once:
            return
        enable = targets.controlword == CONTROLWORD[Command.ENABLE_OPERATION]
        rows = self._short_ladder & targets.controlled & enable
        for command in (Command.SHUTDOWN, Command.SWITCH_ON):
            self._drives.control(np.full(len(rows), CONTROLWORD[command]), rows)

    def _watch_devices(self) -> None:
        """Disable devices whose commands have stayed away for longer than their watchdog says."""
        patience = self._targets.device_watchdog * np.int64(self._world.description.period_ns)
        late = (self._heard >= 0) & (patience > 0) & (self._world.time_ns - self._heard > patience)
        self._heard[late] = _NEVER
        self._watched = bool((self._heard >= 0).any())
        for row in np.flatnonzero(late).tolist():
            values = self._targets.devices.values[row]
            values[self._enable[row]] = 0.0
            self._devices.command(row, values)


@compiled
def _look(memory, position, velocity, torque, temperature, state, flags, error, sequence):  # type: ignore[no-untyped-def]
    """Fill a JointState's memory with what the drives say of themselves."""
    table, _, status, octets = joint_state(memory, state.shape[0])
    for j in range(state.shape[0]):
        table[0, j], table[1, j], table[2, j], table[3, j] = position[j], velocity[j], torque[j], temperature[j]
        status[j] = _STATUSWORDS[state[j]] | flags[j]
        octets[0, j], octets[1, j] = error[j], sequence[j]
