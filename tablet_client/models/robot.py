"""The robot as its daemon tells it: who it is, where its joints are, whether its drives are enabled or stopped, and why not."""

from __future__ import annotations

from typing import Literal

from handrail.messages import ActionEvent, DaemonStatus, RobotInfo, RobotState
from tablet_client.models.arrivals import StopProgress

Drives = Literal["unknown", "stopped", "fault", "quick_stop", "enabled", "disabled"]

_FAULTS = ("fault", "fault_reaction_active")


class Robot:
    """One robot's identity, latest state and status."""

    def __init__(self) -> None:
        self.info: RobotInfo | None = None
        self.state: RobotState | None = None
        self.status: DaemonStatus | None = None
        self.stop_state: Literal["", "sending", "answered", "failed"] = ""
        """how this tablet's own STOP fares"""
        self.stop_why = ""
        self.running = ""
        """id of the action that moves the robot"""

    def attach(self, info: RobotInfo, status: DaemonStatus) -> None:
        if self.info is not None and self.info.name != info.name:
            self.state = None
        self.info = info
        self.take_status(status)

    def take_status(self, status: DaemonStatus) -> None:
        self.status = status
        self.running = status.action
        if not status.stopped and self.stop_state == "answered":
            self.stop_state = ""  # cleared, by whoever did

    def take_action(self, event: ActionEvent) -> None:
        if event.state != "ended":
            self.running = event.id
        elif self.running == event.id:
            self.running = ""

    def take_stop(self, progress: StopProgress) -> None:
        self.stop_state = progress.state  # type: ignore[assignment]
        self.stop_why = progress.why

    @property
    def moving(self) -> bool:
        """True while an action runs."""
        return bool(self.running)

    @property
    def time_ns(self) -> int:
        """The robot's clock, as last heard."""
        return max(self.state.time_ns if self.state else 0, self.status.time_ns if self.status else 0)

    @property
    def drives(self) -> Drives:
        """The drives as one word, the gravest first."""
        if self.status is None:
            return "unknown"
        if self.status.stopped:
            return "stopped"
        if self.faulty:
            return "fault"
        if any(drive.state == "quick_stop_active" for drive in self.status.drives):
            return "quick_stop"
        return "enabled" if self.status.enabled else "disabled"

    @property
    def faulty(self) -> list[str]:
        """Joints whose drive reports a fault."""
        drives = self.status.drives if self.status else []
        return [drive.joint for drive in drives if drive.state in _FAULTS or drive.error]

    def why_not_enable(self) -> str:
        """Code of the reason why Enable can't be pressed; empty when it can."""
        if self.status is None:
            return "no_robot"
        if self.status.stopped:
            return "stopped"
        return "already_enabled" if self.status.enabled and not self.status.isolated else ""

    def why_not_clear(self) -> str:
        """Code of the reason why Clear stop can't be pressed; empty when it can."""
        if self.status is None:
            return "no_robot"
        return "" if self.status.stopped else "not_stopped"
