"""What really happens in the plant."""

from __future__ import annotations

import msgspec

from handrail.messages.base import Message, Pose, travels


@travels(priority=5, reliable=False, superseded_by=("type",))
class GroundTruth(Message):
    """What really happens in the plant. For tests, benchmarks, verdicts and simulated sensors; it never crosses the link."""

    time_ns: int
    joints: dict[str, float]
    """robot joint → rad"""
    hinges: dict[str, float]
    """scene object → its hinge's signed angle, rad; OBJECT.JOINT → rad or m of one with several"""
    poses_in_world: dict[str, Pose]
    """scene object → pose"""
    contact_force: dict[str, float]
    """scene object → N, sum of normal forces between it and the robot, now"""
    peak_contact_force: dict[str, float]
    """scene object → N, the largest since the plant started"""
    base_in_world: Pose = msgspec.field(default_factory=Pose)
    """of the robot's root link; a free one may move"""
