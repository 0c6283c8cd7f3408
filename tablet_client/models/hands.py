"""The robot's grippers: where they are, how far they go, and whether they hold something."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from handrail.messages import CommandGripper, DeviceStates, GripperState
from handrail.robot.description import RobotDescription


@dataclass(frozen=True)
class Span:
    """What a gripper can do."""

    low: float
    high: float
    """rad or m, of its driven joint"""
    poses: Mapping[str, float] = field(default_factory=dict)
    """name → position"""


def spans(description: RobotDescription) -> dict[str, Span]:
    """Gripper → what it can do, of a robot's description."""
    found = {}
    for device in description.devices:
        if device.family == "gripper" and device.joint in description.device_limits:
            low, high, *_ = description.device_limits[device.joint]
            poses = {
                name: pose[device.joint]
                for arm in description.arms.values()
                for name, pose in arm.hand_poses.items()
                if device.joint in pose
            }
            found[device.name] = Span(low, high, poses)
    return found


class Hands:
    """Grippers by name."""

    def __init__(self) -> None:
        self.states: dict[str, GripperState] = {}
        self.spans: dict[str, Span] = {}

    def take(self, devices: DeviceStates) -> None:
        """Where they are now."""
        self.states = {each.name: each for each in devices.grippers}

    def call(self, name: str, position: float) -> CommandGripper | None:
        """What to send a gripper somewhere, no further than it goes; None: there is none of that name."""
        span = self.spans.get(name)
        if span is None:
            return None
        return CommandGripper(gripper=name, position=min(max(position, span.low), span.high))
