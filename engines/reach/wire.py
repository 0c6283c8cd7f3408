"""What an engine and its reachability process say to each other (framed as nodes' messages are: `engines.nodes.wire.Wire`)."""

from __future__ import annotations

import msgspec

from handrail.messages import Base, InstanceState, WaypointReach


class Ask(msgspec.Struct, tag=True):
    """To the process: a question; a newer one about the same trajectory and arm takes its place."""

    number: int
    instance: str
    trajectory: str
    arm: str
    clearance: float
    instances: list[InstanceState]
    position: list[float]
    """rad, of all joints"""
    base: Base | None
    deployed: str
    """folder in which templates are looked for first; empty: none"""

    @property
    def about(self) -> tuple[str, str, str]:
        """What a newer one replaces it by."""
        return self.instance, self.trajectory, self.arm


class Told(msgspec.Struct, tag=True):
    """From the process: an answer; those that are not settled are followed by one that is, if nothing newer is asked."""

    number: int
    version: int
    """of the instance"""
    waypoints: list[WaypointReach]
    settled: bool
    problem: str = ""
