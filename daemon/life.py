"""The robot's life: inactive, enabling, enabled, stopped. The limb of a lost drive is isolated, and the rest held."""

from __future__ import annotations

import numpy as np

from daemon.actions.table import ActionTable, Refusal
from daemon.controllers.base import Ended
from daemon.controllers.manager import ControllerManager
from daemon.devices import Devices
from daemon.exchange import Answer, Flag, Outcome, Rule
from daemon.safety.balance import PATIENCE, BalanceWatch
from daemon.safety.keepalive import Keepalives, Stage
from daemon.safety.ledger import GUARDS, Ledger
from daemon.safety.rules import Trip, isolated_with, latched, overrun, stranger
from daemon.safety.stop_socket import StopRequest
from daemon.state.base_state import BaseSource
from hal.hardware import Goal, Hardware
from hal.joint import JointCommand
from handrail.robot.description import RobotDescription

ENABLING_TIME = 2.0
"""s of robot time after which drives that do not come to operation are given up"""

_LIES, _SINKS = 0.2, 3.0
"""rad/s below which every joint of a robot that fell lies still; s that it is given for that"""

_UNKNOWN, _HANGS = int(BaseSource.NONE), int(BaseSource.STILL)
_ENABLED, _STOPPED, _ENABLING, _ISOLATED = (
    int(flag) for flag in (Flag.ENABLED, Flag.STOPPED, Flag.ENABLING, Flag.ISOLATED)
)


class Life:
    """Whether the robot may be commanded. Nothing here moves a joint except by letting controllers be active."""

    def __init__(
        self,
        hardware: Hardware,
        manager: ControllerManager,
        actions: ActionTable,
        devices: Devices,
        description: RobotDescription,
    ):
        self._hardware, self._manager, self._actions, self._devices = hardware, manager, actions, devices
        self._patience = round(ENABLING_TIME * 1e9 / description.period_ns)
        self._most_misses = description.stop_after_misses
        self._limb = description.limb_of_joint
        self._enabling_for = -1
        self._balance, self._period = BalanceWatch(manager.robot.period), manager.robot.period
        self._falling_for = -1
        """cycles since the robot fell, while it is damped"""
        self._latched: str | None = None
        self._isolated = False
        self.ledger = Ledger()
        self.keepalives = Keepalives()

    @property
    def stopped(self) -> bool:
        """The operator stop is latched."""
        return self._latched is not None

    @property
    def stop_reason(self) -> str:
        """Why it is; "": it is not, or nobody said."""
        return self._latched or ""

    @property
    def enabled(self) -> bool:
        """Every drive is in operation and every joint has a controller, isolated limbs aside."""
        return self._manager.enabled

    @property
    def isolated(self) -> bool:
        """Some limbs are out of the robot."""
        return self._isolated

    @property
    def enabling(self) -> bool:
        """The drives are on their way to operation."""
        return self._enabling_for >= 0

    @property
    def guarded(self) -> bool:
        """The guard has stopped something, and nobody has acknowledged it."""
        return any(self.ledger.holds(rule) for rule in GUARDS)

    @property
    def flags(self) -> int:
        """The bits of the snapshot (exchange.Flag) that are about this."""
        # Plain numbers: this runs in every cycle, and flags of an enum cost microseconds.
        flags = _ENABLED if self._manager.enabled else 0
        if self._latched is not None:
            flags |= _STOPPED
        if self._enabling_for >= 0:
            flags |= _ENABLING
        if self._isolated:
            flags |= _ISOLATED
        return flags

    def enable(self) -> Refusal | None:
        """Take every drive to operation enabled; in the cycle in which the last one is there, hold where the robot is.

        On an enabled robot this takes isolated limbs back in, faults reset on the way; what is not isolated notices nothing. It
        acknowledges what the guard has stopped: then motions may start again.
        """
        if self.stopped:
            return Refusal(Answer.STOP_LATCHED)
        silent = self._hardware.first_silent()
        if silent >= 0:
            return Refusal(Answer.DRIVE_FAULT, silent)
        strange = self._hardware.first_stranger()
        if strange >= 0:
            version = float(self._hardware.protocol_version[strange])
            return Refusal(Answer.PROTOCOL_MISMATCH, strange, version)
        unknown = self._hardware.first_unknown()
        if unknown >= 0:
            return Refusal(Answer.PROTOCOL_UNKNOWN, unknown)
        if not self._manager.enabled or (self._isolated and self._enabling_for < 0):
            self._enabling_for = 0
        if self._manager.enabled:
            self.ledger.release(*GUARDS)
        return None

    def disable(self) -> None:
        """Take every drive out of operation: brakes close."""
        self._fall_to(Goal.INACTIVE, Outcome.CANCELLED)

    def stop(self, reason: str) -> None:
        """Operator stop: every drive quick-stops, and stays so until `clear_stop` and then `enable`."""
        held, self._latched = self._latched, latched(self._latched, StopRequest(True, reason))
        if held is None:
            self.ledger.trip(Rule.OPERATOR_STOP, holds=True)
        self._fall_to(Goal.QUICK_STOP, Outcome.STOPPED)

    def missed(self, in_a_row: int) -> None:
        """The loop has missed so many periods: the robot is stopped where its description does not allow that."""
        if asked := overrun(in_a_row, self._most_misses, self.enabled):
            self.stop(asked.reason)

    def clear_stop(self) -> None:
        """Unlatch the operator stop. Nothing moves, drives stay as they are."""
        self._latched = latched(self._latched, StopRequest(False, ""))
        self.ledger.release(Rule.OPERATOR_STOP)

    def update(self, last: JointCommand, time_ns: int) -> None:
        """Follow the drives: finish enabling, or isolate the limb of one that is lost. `last`: the command as last written."""
        hardware = self._hardware
        if self.keepalives.bound:
            self._watch_keepalives(time_ns)
        if self._manager.enabled:
            if hardware.first_stranger() >= 0 and (no := self._stranger()):
                self.ledger.trip(no.rule, no.joint, no.value, no.limit, holds=True)
                self._fall_to(Goal.QUICK_STOP, Outcome.DRIVE_FAULT, no.joint)
            elif (lost := hardware.first_lost()) >= 0:
                if self._falling_for >= 0:  # the rest would be held, stiffly
                    self.ledger.trip(Rule.DRIVE_FAULT, lost, holds=True)
                    self._fall_to(Goal.QUICK_STOP, Outcome.BALANCE_LOST)
                else:
                    self._lose(lost, last)
            elif self._isolated and self._enabling_for >= 0:
                self._take_back()
            if self._manager.enabled:
                self._watch_balance(last)
        elif self._enabling_for >= 0:
            self._enabling_for += 1
            wrong = max(hardware.first_stranger(), hardware.first_unknown())
            if wrong >= 0:  # it said so, or kept its silence for long enough, only now
                self.ledger.trip(Rule.PROTOCOL, wrong, holds=True)
                self._fall_to(Goal.INACTIVE, Outcome.DRIVE_FAULT, wrong)
            elif self._enabling_for > self._patience:
                self.ledger.trip(Rule.DRIVE_FAULT, hardware.first_lost(), holds=True)
                self._fall_to(Goal.INACTIVE, Outcome.DRIVE_FAULT)
            elif hardware.goal is not Goal.OPERATIONAL:
                if hardware.acquainted:  # no drive comes to operation that may not understand what it is told there
                    hardware.goal = Goal.OPERATIONAL
            elif hardware.operational:
                self._manager.enable()
                self.ledger.release(Rule.NO_COMMAND, Rule.PROTOCOL, Rule.DRIVE_FAULT, Rule.BALANCE, *GUARDS)
                self._release_keepalive()
                self._devices.enable()
                self._enabling_for = -1

    def _watch_balance(self, last: JointCommand) -> None:
        """Damp a robot that falls, and stop its drives once it lies."""
        robot = self._manager.robot
        if robot.stance is None:
            return
        if self._falling_for >= 0:
            self._falling_for += 1
            passed = self._falling_for * self._period
            if passed > _SINKS or (passed > PATIENCE and np.abs(robot.joints.velocity).max() < _LIES):
                self._fall_to(Goal.QUICK_STOP, Outcome.BALANCE_LOST)
            return
        source = robot.base.source[0]
        if no := self._balance.update(robot.stance, known=source != _UNKNOWN, hangs=source == _HANGS):
            self.ledger.trip(no.rule, no.joint, no.value, no.limit, holds=True)
            self._actions.end_all(Outcome.BALANCE_LOST)
            self._manager.damp(last, Ended(Outcome.BALANCE_LOST))
            self._falling_for = 0

    def keep_alive(self, owner: int, time_ns: int) -> Refusal | None:
        """`owner` has answered his keepalive."""
        if not self.keepalives.hear(owner, time_ns):
            return Refusal(Answer.KEEPALIVE_LOST)
        self._release_keepalive()
        return None

    def bind_keepalive(self, owner: int, timeout: float, time_ns: int) -> Refusal | None:
        """`owner` must answer every `timeout` s; 0: he need not any more."""
        if timeout > 0.0:
            self.keepalives.bind(owner, round(timeout * 1e9), time_ns)
        elif not self.keepalives.release(owner):
            return Refusal(Answer.KEEPALIVE_LOST)
        self._release_keepalive()
        return None

    def _release_keepalive(self) -> None:
        if self._manager.enabled and not self.keepalives.any_silent:
            self.ledger.release(Rule.KEEPALIVE)

    def _watch_keepalives(self, time_ns: int) -> None:
        fastest = float(np.abs(self._hardware.state.velocity).max())
        for owner, stage, silent in self.keepalives.update(time_ns, fastest):
            if stage is Stage.HOLD:
                limit = self.keepalives.bound[owner].timeout_ns * 1e-9
                self.ledger.trip(Rule.KEEPALIVE, value=silent, limit=limit, holds=True)
                self._actions.lose_owner(owner)
            elif stage is Stage.DAMPING and self._manager.enabled:
                self._fall_to(Goal.QUICK_STOP, Outcome.OWNER_LOST)

    def _stranger(self) -> Trip | None:
        spoken, hardware = self._hardware.protocol_version, self._hardware
        expected = np.array([hardware.expected_protocol_version(joint) for joint in range(len(spoken))])
        return stranger(spoken, expected, hardware.isolated)

    def quick_stop(self, joint: int) -> None:
        """Something that must not happen has: there is no command for `joint` that could be written."""
        self.ledger.trip(Rule.NO_COMMAND, joint, holds=True)
        self._fall_to(Goal.QUICK_STOP, Outcome.REFUSED_BY_LIMITS, joint)

    def _lose(self, joint: int, last: JointCommand) -> None:
        """The drive of `joint` is lost: its limb stops, what is left of the robot holds; where nothing is left, all stop."""
        out = isolated_with(self._hardware.lost(), self._limb, self._hardware.isolated)
        self.ledger.trip(Rule.DRIVE_FAULT, joint, holds=True)
        if out.all():
            self._fall_to(Goal.QUICK_STOP, Outcome.DRIVE_FAULT, joint)
            return
        self._enabling_for, self._isolated = -1, True
        self._hardware.isolate(out)
        self._actions.end_all(Outcome.DRIVE_FAULT, joint)
        self._manager.isolate(out, last, Ended(Outcome.DRIVE_FAULT, joint))

    def _take_back(self) -> None:
        """Isolated limbs are on their way back: hold them where they are once all of their drives are in operation."""
        hardware = self._hardware
        self._enabling_for += 1
        wrong = max(hardware.first_stranger(), hardware.first_unknown())
        if wrong >= 0 or self._enabling_for > self._patience:
            self._enabling_for = -1
            rule = Rule.PROTOCOL if wrong >= 0 else Rule.DRIVE_FAULT
            self.ledger.trip(rule, wrong if wrong >= 0 else int(np.argmax(hardware.lost())), holds=True)
            hardware.isolate(hardware.isolated.copy())
        elif not hardware.returning:
            if hardware.acquainted:
                hardware.rejoin()
        elif hardware.returned:
            self._enabling_for, self._isolated = -1, False
            hardware.isolate(np.zeros_like(hardware.isolated))
            self._manager.rejoin()
            self.ledger.release(Rule.PROTOCOL, Rule.DRIVE_FAULT)

    def _fall_to(self, goal: Goal, outcome: Outcome, joint: int = -1) -> None:
        self._hardware.goal = goal
        self._enabling_for = self._falling_for = -1
        self._balance.forget()
        if self._isolated:
            self._isolated = False
            self._hardware.isolate(np.zeros_like(self._hardware.isolated))
        self._manager.release_all(Ended(outcome, joint))
        self._devices.disable()
        self._actions.end_all(outcome, joint)
