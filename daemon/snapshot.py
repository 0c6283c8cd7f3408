"""Fills the record that leaves the loop in every cycle."""

from __future__ import annotations

from daemon.actions import Action, ActionTable
from daemon.exchange import MAX_HOLDS, Flag, StateWriter
from daemon.life import Life
from daemon.manager import ControllerManager
from daemon.orders import Orders
from daemon.robot_state import RobotState
from hal.can.port import BUSY_NS, RECEIVED, SENT
from hal.hardware import Hardware
from hal.joint import JointCommand

_SCALARS = (
    *("cycle", "time_ns", "flags", "misses", "stale_replies", "crc_errors", "limited", "work_ns", "late_ns"),
    *("answered", "answer", "answer_joint", "answer_value", "stop_reason"),
)


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
        orders: Orders,
    ):
        self._ring, self._record = ring, ring.record
        self._hardware, self._robot, self._manager = hardware, robot, manager
        self._life, self._actions, self._orders = life, actions, orders
        self._slots = [self._record["actions"][slot : slot + 1] for slot in range(len(actions.slots))]
        self._written: list[tuple[int, int] | None] = [None] * len(self._slots)
        self._news: tuple[object, ...] = ()
        state, record = hardware.state, self._record
        # Field views, made once: a field access on a numpy record costs more than the copy.
        self._copies = [
            (record["position"], state.position),
            (record["velocity"], state.velocity),
            (record["torque"], state.torque),
            (record["status"], state.status),
            (record["error"], state.error),
            (record["temperature"], state.temperature),
            (record["frames_sent"], hardware.counters[:, SENT]),
            (record["frames_received"], hardware.counters[:, RECEIVED]),
            (record["busy_ns"], hardware.counters[:, BUSY_NS]),
            (record["claims"], manager.claims),
        ]
        self._age, self._command, self._mode = record["age"], record["command"], record["mode"]
        self._external_force = record["external_force"]
        self._scalars = {name: record[name] for name in _SCALARS}

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
        self._hardware.state.age.clip(0, 1 << 30, out=self._hardware.state.age)
        self._age[...] = self._hardware.state.age
        rows = (written.position, written.velocity, written.torque, written.stiffness, written.damping)
        for number, row in enumerate(rows):
            self._command[number] = row
        self._mode[...] = written.mode
        forces = self._robot.forces
        self._external_force[...] = next(iter(forces.values())) if forces else 0.0

        flags = self._life.flags | (Flag.HELD if holding else Flag(0))
        answer, scalars = self._orders.answer, self._scalars
        for name, value in (
            ("cycle", cycle),
            ("time_ns", time_ns),
            ("flags", int(flags)),
            ("misses", misses),
            ("stale_replies", self._hardware.stale_replies),
            ("crc_errors", self._hardware.crc_errors),
            ("limited", limited),
            ("work_ns", work_ns),
            ("late_ns", late_ns),
            ("answered", self._orders.answered),
            ("answer", int(answer.answer)),
            ("answer_joint", answer.joint),
            ("answer_value", answer.value),
        ):
            scalars[name][...] = value
        self._record["holds"][:] = holding + [0] * (MAX_HOLDS - len(holding))
        changed = self._write_actions(written, time_ns)
        news = (int(flags), self._life.stop_reason, self._orders.answered, tuple(holding), changed)
        if news[1] != (self._news[1] if self._news else None):
            scalars["stop_reason"][...] = _truncated(self._life.stop_reason, self._record.dtype["stop_reason"].itemsize)
        happened = changed or news[:4] != self._news[:4]
        self._news = news
        self._ring.publish()
        return happened

    def _write_actions(self, written: JointCommand, time_ns: int) -> bool:
        changed = False
        for number, action in enumerate(self._actions.slots):
            if action is None:
                continue
            row = self._slots[number]
            row["path_force"] = action.controller.path_force
            row["progress"] = action.controller.clock.s
            mark = (action.serial, int(action.state))
            if mark != self._written[number]:
                self._written[number] = mark
                _fill(row, action, time_ns)
                row["position"], row["command"] = self._robot.joints.position, written.position
                changed = True
        return changed


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
    }
    for name, value in values.items():
        row[name] = value  # type: ignore[index]


def _truncated(text: str, size: int) -> bytes:
    """UTF-8 of at most `size` bytes, never half a character."""
    return text.encode("utf-8")[:size].decode("utf-8", errors="ignore").encode("utf-8")
