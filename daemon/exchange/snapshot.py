"""Fills the record that leaves the loop in every cycle."""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np

from daemon.actions.table import Action, ActionTable
from daemon.controllers.manager import ControllerManager
from daemon.controllers.table import ControllerTable
from daemon.exchange import MAX_HOLDS, ActionState, Flag, StateWriter
from daemon.life import Life
from daemon.orders import Orders
from daemon.state.base_state import BaseSource
from daemon.state.robot_state import RobotState
from hal.can.counting import BUSY_NS, RECEIVED, SENT
from hal.hardware import Hardware
from hal.joint import JointCommand

# Fields of the snapshot that lie side by side and are written as one.
_NUMBERS = ("cycle", "time_ns", "misses", "stale_replies", "crc_errors", "limited", "work_ns", "late_ns", "flags")
_PACKED = struct.Struct(f"={len(_NUMBERS)}q")
_TRAFFIC = ("frames_sent", "frames_received", "busy_ns")
assert (SENT, RECEIVED, BUSY_NS) == (0, 1, 2), "the columns of a port's counters, in the order of _TRAFFIC"
_HELD = int(Flag.HELD)


class SnapshotWriter:
    """Copies what the loop's parts hold into the ring's record (daemon.exchange.snapshot_dtype), and publishes it."""

    def __init__(
        self,
        ring: StateWriter,
        hardware: Hardware,
        robot: RobotState,
        manager: ControllerManager,
        life: Life,
        actions: ActionTable,
        controllers: ControllerTable,
        orders: Orders,
    ):
        self._ring, self._record = ring, ring.record
        self._hardware, self._robot, self._manager = hardware, robot, manager
        self._life, self._actions, self._controllers, self._orders = life, actions, controllers, orders
        self._slots = [self._record["actions"][slot : slot + 1] for slot in range(len(actions.slots))]
        self._written: list[tuple[int, ActionState, int, float] | None] = [None] * len(self._slots)
        self._over: list[Action | None] = [None] * len(self._slots)
        """whose end was told: nothing of these changes any more"""
        self._news: tuple[object, ...] = ()
        self._record["safety"] = life.ledger.rows
        self._identities = -1
        state, record = hardware.state, self._record
        # Views of fields and blocks, made once: a field access on a numpy record costs more than the copy.
        measured = (
            "position",
            "velocity",
            "torque",
            "temperature",
            "age",
            "measured_ns",
            "status",
            "error",
            "sequence",
        )
        self._copies = [
            (_block(record, state.memory, {name: getattr(state, name) for name in measured}), state.memory),
            (_side_by_side(record, _TRAFFIC), hardware.counters.T),
        ]
        if len(devices := hardware.devices):
            parts = {
                "device_values": devices.values,
                "device_age": devices.age,
                "device_measured_ns": devices.measured_ns,
            }
            self._copies.append((_block(record, devices.memory, parts), devices.memory))
        base = robot.base
        parts = {
            "base_pose": base.pose,
            "base_twist": base.twist,
            "base_sigma": base.sigma,
            "foot_force": base.force,
            "base_since_ns": base.since_ns,
            "base_source": base.source,
            "base_trouble": base.trouble,
            "foot_contact": base.contact,
        }
        told = _block(record, base.memory, parts)
        told[...] = base.memory
        if base.source[0] != BaseSource.FIXED:
            self._copies.append((told, base.memory))
        like = JointCommand(len(state))
        self._command = _block(record, like.memory, {"command": like.table, "mode": like.mode})
        self._external_force, self._felt = record["external_force"], False
        self._numbers = _side_by_side(record, _NUMBERS).data.cast("B")
        self._path_force, self._progress = record["actions"]["path_force"], record["actions"]["progress"]

    def publish(
        self,
        written: JointCommand,
        holding: list[int],
        cycle: int,
        time_ns: int,
        misses: int,
        limited: int,
        work_ns: int,
        late_ns: int,
    ) -> bool:
        """Publish the robot as it is in this cycle. True when something happened that somebody may wait for.

        `written`: the command that went out; `holding`: owners that hold time; `misses`, `limited`: counted since the start.
        """
        for field, values in self._copies:
            field[...] = values
        self._command[...] = written.memory
        wrenches = self._robot.wrenches
        if wrenches or self._felt:
            self._felt = bool(wrenches)
            self._external_force[...] = next(iter(wrenches.values()))[:3] if wrenches else 0.0

        if self._hardware.identities != self._identities:
            self._write_identities()
        if self._life.ledger.news:
            self._record["safety"] = self._life.ledger.told(time_ns)
        flags = self._life.flags | (_HELD if holding else 0)
        stale, refused = self._hardware.stale_replies, self._hardware.crc_errors
        _PACKED.pack_into(self._numbers, 0, cycle, time_ns, misses, stale, refused, limited, work_ns, late_ns, flags)
        switches, roster = self._manager.changes, self._controllers.roster
        news = (flags, self._life.stop_reason, self._orders.answered, tuple(holding), switches, roster)
        happened = self._write_actions(written, time_ns)
        if news != self._news:
            self._news, happened = news, True
            self._write_news(holding)
        self._ring.publish()
        return happened

    def _write_identities(self) -> None:
        """What the drives say of themselves: once, and anew when one was away."""
        record, hardware = self._record, self._hardware
        record["protocol_version"], record["firmware_version"] = hardware.protocol_version, hardware.firmware_version
        self._identities = hardware.identities

    def _write_news(self, holding: list[int]) -> None:
        """What changes seldom: the answer to a command, who holds time, who commands what, why the robot is stopped."""
        record, answer = self._record, self._orders.answer
        record["answered"], record["answer"] = self._orders.answered, int(answer.answer)
        record["answer_joint"], record["answer_value"] = answer.joint, answer.value
        record["holds"][:] = holding + [0] * (MAX_HOLDS - len(holding))
        record["claims"] = self._manager.claims
        record["controller_states"], record["controller_changes"] = self._controllers.look()
        record["roster"], record["speed"] = self._controllers.roster, self._actions.speed
        record["stop_reason"] = _truncated(self._life.stop_reason, record.dtype["stop_reason"].itemsize)

    def _write_actions(self, written: JointCommand, time_ns: int) -> bool:
        changed = False
        for number, action in enumerate(self._actions.slots):
            if action is None or action is self._over[number]:
                continue
            chain = action.chain
            clock = action.controller.clock
            mark = (action.serial, action.state, chain.taken if chain else 0, clock.speed)
            news = mark != self._written[number]
            if news or action.alive:
                self._path_force[number] = action.controller.path_force
                self._progress[number] = clock.s
            if news:
                self._written[number] = mark
                row = self._slots[number]
                _fill(row, action, time_ns)
                row["position"], row["command"] = self._robot.joints.position, written.position
                self._over[number] = None if action.alive else action
                changed = True
        return changed


def _side_by_side(record: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """One array (names, ...) over fields of a record that are alike and follow each other without a gap."""
    fields = record.dtype.fields
    assert fields is not None
    kind, first = fields[names[0]][:2]
    for place, name in enumerate(names):
        assert fields[name][:2] == (kind, first + place * kind.itemsize), f"{names} do not lie side by side"
    return np.ndarray((len(names), *kind.shape), kind.base, record.reshape(1).view(np.uint8).data, first)


def _block(record: np.ndarray, memory: np.ndarray, parts: Mapping[str, np.ndarray]) -> np.ndarray:
    """The place in a record where a copy of `memory` fills the fields `parts`, which are views of it."""
    fields = record.dtype.fields
    assert fields is not None
    first = min(fields[name][1] for name in parts)
    for name, part in parts.items():
        if not part.size:  # of a robot without feet
            continue
        lies = fields[name][1] - first, fields[name][0].itemsize
        assert lies == (part.ctypes.data - memory.ctypes.data, part.nbytes), f"{name} does not lie as in the memory"
    return np.ndarray(memory.shape, memory.dtype, record.reshape(1).view(np.uint8).data, first)


def _fill(row: object, action: Action, time_ns: int) -> None:
    values = {
        "serial": action.serial,
        "owner": action.owner,
        "state": int(action.state),
        "outcome": int(action.outcome),
        "condition": action.condition,
        "joint": action.joint,
        "value": action.value,
        "cycle": action.cycle,
        "time_ns": time_ns,
        "step": action.chain.at if action.chain else 0,
        "before": action.chain.before if action.chain else -1,
        "steps_taken": action.chain.taken if action.chain else 0,
        "speed": action.controller.clock.speed,
        "detail": _truncated(action.detail, 160),
    }
    for name, value in values.items():
        row[name] = value  # type: ignore[index]


def _truncated(text: str, size: int) -> bytes:
    """UTF-8 of at most `size` bytes, never half a character."""
    return text.encode("utf-8")[:size].decode("utf-8", errors="ignore").encode("utf-8")
