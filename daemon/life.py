"""The robot's life: inactive, enabling, enabled, stopped; and what the loss of a drive does to it."""

from __future__ import annotations

from daemon.actions import ActionTable, Refusal
from daemon.devices import Devices
from daemon.exchange import Answer, Flag, Outcome, Rule
from daemon.manager import ControllerManager
from daemon.safety.ledger import Ledger
from hal.hardware import Goal, Hardware

ENABLING_TIME = 2.0
"""s of robot time after which drives that do not come to operation are given up"""

_ENABLED, _STOPPED, _ENABLING = int(Flag.ENABLED), int(Flag.STOPPED), int(Flag.ENABLING)


class Life:
    """Whether the robot may be commanded. Nothing here moves a joint except by letting controllers be active."""

    def __init__(
        self,
        hardware: Hardware,
        manager: ControllerManager,
        actions: ActionTable,
        devices: Devices,
        period: float,
    ):
        self._hardware, self._manager, self._actions, self._devices = hardware, manager, actions, devices
        self._patience = round(ENABLING_TIME / period)
        self._enabling_for = -1
        self.stopped = False
        self.stop_reason = ""
        self.ledger = Ledger()

    @property
    def enabled(self) -> bool:
        """Every drive is in operation and every joint has a controller."""
        return self._manager.enabled

    @property
    def enabling(self) -> bool:
        """The drives are on their way to operation."""
        return self._enabling_for >= 0

    @property
    def flags(self) -> int:
        """The bits of the snapshot (exchange.Flag) that are about this."""
        # Plain numbers: this runs in every cycle, and flags of an enum cost microseconds.
        flags = _ENABLED if self._manager.enabled else 0
        if self.stopped:
            flags |= _STOPPED
        if self._enabling_for >= 0:
            flags |= _ENABLING
        return flags

    def enable(self) -> Refusal | None:
        """Take every drive to operation enabled; in the cycle in which the last one is there, hold where the robot is."""
        if self.stopped:
            return Refusal(Answer.STOP_LATCHED)
        silent = self._hardware.first_silent()
        if silent >= 0:
            return Refusal(Answer.DRIVE_FAULT, silent)
        stranger = self._hardware.first_stranger()
        if stranger >= 0:
            version = float(self._hardware.protocol_version[stranger])
            return Refusal(Answer.PROTOCOL_MISMATCH, stranger, version)
        unknown = self._hardware.first_unknown()
        if unknown >= 0:
            return Refusal(Answer.PROTOCOL_UNKNOWN, unknown)
        if not self._manager.enabled:
            self._enabling_for = 0
        return None

    def disable(self) -> None:
        """Take every drive out of operation: brakes close."""
        self._fall_to(Goal.INACTIVE, Outcome.CANCELLED)

    def stop(self, reason: str) -> None:
        """Operator stop: every drive quick-stops, and stays so until `clear_stop` and then `enable`."""
        if not self.stopped:
            self.stopped, self.stop_reason = True, reason
            self.ledger.trip(Rule.OPERATOR_STOP, holds=True)
        self._fall_to(Goal.QUICK_STOP, Outcome.STOPPED)

    def clear_stop(self) -> None:
        """Unlatch the operator stop. Nothing moves, drives stay as they are."""
        self.stopped, self.stop_reason = False, ""
        self.ledger.release(Rule.OPERATOR_STOP)

    def update(self) -> None:
        """Follow the drives: finish enabling, or quick-stop everything when one of them is lost."""
        hardware = self._hardware
        if self._manager.enabled:
            wrong = max(hardware.first_lost(), hardware.first_stranger())
            if wrong >= 0:
                self.ledger.trip(self._rule_of(wrong), wrong, holds=True)
                self._fall_to(Goal.QUICK_STOP, Outcome.DRIVE_FAULT, wrong)
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
                self.ledger.release(Rule.NO_COMMAND, Rule.PROTOCOL, Rule.DRIVE_FAULT)
                self._devices.enable()
                self._enabling_for = -1

    def quick_stop(self, joint: int) -> None:
        """Something that must not happen has: there is no command for `joint` that could be written."""
        self.ledger.trip(Rule.NO_COMMAND, joint, holds=True)
        self._fall_to(Goal.QUICK_STOP, Outcome.REFUSED_BY_LIMITS, joint)

    def _rule_of(self, joint: int) -> Rule:
        return Rule.PROTOCOL if joint == self._hardware.first_stranger() else Rule.DRIVE_FAULT

    def _fall_to(self, goal: Goal, outcome: Outcome, joint: int = -1) -> None:
        self._hardware.goal = goal
        self._enabling_for = -1
        self._manager.release_all()
        self._devices.disable()
        self._actions.end_all(outcome, joint)
