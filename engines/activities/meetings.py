"""Several hands along a template's `sync`, each along its own trajectory: the points at which they meet, and the ways there.

A point is named as the waypoints that it brings together are, `press` where all have that name, else `before+hold`. What is left of
a trajectory behind the last point leads to one point more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from affordance_templates.binding import BoundWaypoint, bind_together
from affordance_templates.instance import Instance
from engines.activities.base import ActivityFailed
from engines.activities.waypoints import CLEAR, chosen
from handrail.messages import PlanMotion
from handrail.robot.description import RobotDescription


@dataclass(frozen=True)
class Meeting:
    """A point of a sync."""

    name: str
    reached: Mapping[str, int]
    """trajectory → the number of the waypoint at which its hand is then; -1: it has not begun"""


@dataclass(frozen=True)
class Leg:
    """The ways to a meeting from the one before."""

    name: str
    """of the meeting"""
    ways: Mapping[str, tuple[BoundWaypoint, ...]]
    """trajectory → the waypoints that its hand goes to, in order; none: it waits"""


def meetings(instance: Instance, name: str) -> tuple[Meeting, ...]:
    """Of a sync, in order; of a trajectory, whose one hand meets nobody, its waypoints. Raises KeyError where there is neither."""
    resolved = instance.resolve()
    sync = resolved.syncs.get(name)
    if sync is None:
        waypoints = resolved.trajectories[name].waypoints
        return tuple(Meeting(each.name, {name: number}) for number, each in enumerate(waypoints))
    names = {each: [waypoint.name for waypoint in resolved.trajectories[each].waypoints] for each in sync.trajectories}
    points = list(sync.points)
    reached, found = dict.fromkeys(sync.trajectories, -1), list[Meeting]()
    if rest := {each: len(names[each]) - 1 for each in names if len(names[each]) - 1 > _last(points, each)}:
        points.append(rest)
    for point in points:
        reached = {**reached, **point}
        there = list(dict.fromkeys(names[each][number] for each, number in point.items()))
        found.append(Meeting(_unlike("+".join(there), found), reached))
    return tuple(found)


def _last(points: Sequence[Mapping[str, int]], trajectory: str) -> int:
    return max((point.get(trajectory, -1) for point in points), default=-1)


def _unlike(name: str, found: Sequence[Meeting]) -> str:
    taken = {each.name for each in found}
    return next(each for each in (name, *(f"{name}_{k}" for k in range(2, len(taken) + 3))) if each not in taken)


def hands(instance: Instance, sync: str, arms: Sequence[str], robot: RobotDescription) -> dict[str, str]:
    """Which arm goes along which trajectory, the arms being in the order in which the sync names them.

    :raises ActivityFailed: `refused` for what is no sync, for fewer or more arms than it has hands, or one arm for two
    """
    known = instance.resolve().syncs
    if sync not in known:
        raise ActivityFailed(
            "refused",
            f"trajectory: template {instance.template.name} has no sync {sync!r} for two arms; "
            f"expected one of {', '.join(known) or 'none: it has none'}",
        )
    trajectories = known[sync].trajectories
    if len(trajectories) != len(arms):
        raise ActivityFailed("refused", f"other: {sync} is for {len(trajectories)} hands; got {len(arms)} arms")
    given = dict(zip(trajectories, arms, strict=True))
    try:
        bind_together(
            instance,
            sync,
            robot,
            {instance.resolve().trajectories[each].hand: arm for each, arm in given.items()},
        )
    except ValueError as problem:
        raise ActivityFailed("refused", str(problem)) from problem
    return given


def legs(
    robot: RobotDescription, instance: Instance, sync: str, arms: Mapping[str, str], *, first: str = "", last: str = "",
    back: bool = False, leaving: str = "",
) -> tuple[Leg, ...]:  # fmt: skip
    """The ways to the meetings `first` to `last`, in order; arguments and refusals as for `waypoints.chosen`.

    :param arms: trajectory → arm, see `hands`
    """
    stops = meetings(instance, sync)
    names = [each.name for each in stops]
    begin, end = _place(names, "first", first or names[0]), _place(names, "last", last or names[-1])
    if begin > end:
        raise ActivityFailed("refused", f"last: {names[end]} comes before {names[begin]}; expected it or one behind it")
    if leaving and (not back or _place(names, "leaving", leaving) != end + 1):
        raise ActivityFailed(
            "refused", f"leaving: got {leaving}; expected the point behind {names[end]}, on a way back"
        )
    found = []
    for number in range(end, begin - 1, -1) if back else range(begin, end + 1):
        if not back:
            before = stops[number - 1] if number else None
        else:
            before = stops[number + 1] if number < end or leaving else None
        ways = {
            trajectory: _way(robot, instance, trajectory, arm, before, stops[number], back=back)
            for trajectory, arm in arms.items()
        }
        found.append(Leg(names[number], ways))
    return tuple(found)


def _place(names: Sequence[str], field: str, wanted: str) -> int:
    if wanted not in names:
        raise ActivityFailed("refused", f"{field}: there is no point {wanted!r}; expected one of {', '.join(names)}")
    return names.index(wanted)


def _way(
    robot: RobotDescription, instance: Instance, trajectory: str, arm: str, before: Meeting | None, to: Meeting, *, back: bool
) -> tuple[BoundWaypoint, ...]:  # fmt: skip
    """One hand's waypoints between two meetings; `before` None: forwards the first, backwards from anywhere on a line."""
    names = [each.name for each in instance.resolve().trajectories[trajectory].waypoints]
    there = to.reached[trajectory]
    here = before.reached[trajectory] if before is not None else -1
    if not back:
        if there <= here:
            return ()
        return chosen(robot, instance, trajectory, arm, first=names[here + 1], last=names[there])
    if before is None:
        if there < 0:
            return ()
        return chosen(robot, instance, trajectory, arm, first=names[there], last=names[there], back=True)
    there = max(there, 0)
    if here <= there:
        return ()
    return chosen(
        robot, instance, trajectory, arm, first=names[there], last=names[here - 1], back=True, leaving=names[here]
    )


def way_together(leg: Leg, instance: Instance) -> PlanMotion | None:
    """What a planner is asked for so that all hands get there at one time, on one plan; None: not all go freely, in one go."""
    ways = [way for way in leg.ways.values() if way]
    if len(ways) < 2 or any(len(way) != 1 or way[0].waypoint.approach != "free" for way in ways):
        return None
    return PlanMotion(
        goals=[waypoint.goal() for (waypoint,) in ways],
        arm=ways[0][0].arm.name,
        joints=list(dict.fromkeys(joint for (waypoint,) in ways for joint in waypoint.arm.joints)),
        clearance=CLEAR,
        label=f"to {leg.name} of {instance.name}",
    )
