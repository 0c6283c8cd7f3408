"""Who commands which part of the robot, and what would become of it if this window lost the link."""

from __future__ import annotations

from handrail.messages import DaemonStatus


def commanders(status: DaemonStatus | None) -> list[tuple[str, str]]:
    """(part, owner) of every part that somebody has taken; who is not named may be commanded by anybody."""
    return [] if status is None else [(lease.part, lease.owner) for lease in status.leases]


def if_lost(status: DaemonStatus | None, run: str) -> str:
    """Code of what the robot would do if the link were lost now. `run`: the run's status, as RunState has it, or none."""
    if status is None:
        return "no_robot"
    if status.stopped or not status.enabled:
        return "nothing_moves"
    if run == "running":
        return "program_goes_on"
    if run == "paused":
        return "program_waits"
    return "motion_ends" if status.action else "holds"
