"""Which waypoints of a trajectory an arm goes to, forwards or backwards, and the ways there that are planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from affordance_templates.binding import BoundWaypoint, bind
from affordance_templates.instance import Instance
from affordance_templates.template import ResolvedTrajectory
from engines.activities.base import ActivityFailed, Services
from engines.runs.preconditions import Precondition
from handrail.messages import Along, PlanMotion
from handrail.robot.description import RobotDescription
from handrail.topics import RefusedError

CLEAR = 0.015
"""m that these ways keep of everything: more than the daemon's guard does (0.01), for the robot follows them loosely"""


def asked_for(services: Services, name: str) -> Instance:
    """The instance as it stands. Raises ActivityFailed where there is none."""
    try:
        return services.affordances.get(name)
    except RefusedError as refused:
        raise ActivityFailed("refused", str(refused)) from refused


def there_is(services: Services, name: str) -> Precondition:
    """That an instance is there."""
    names = [each.name for each in services.affordances.instances()]
    return Precondition(f"{name} is there", name in names, "it was removed", f"one of: {', '.join(names) or 'none'}")


def chosen(
    robot: RobotDescription, instance: Instance, trajectory: str, arm: str, *, first: str = "", last: str = "",
    back: bool = False, leaving: str = "",
) -> tuple[BoundWaypoint, ...]:  # fmt: skip
    """The waypoints to go to, in order, for the arm: `first` to `last` of the trajectory, either one left out for its own.

    Those that lie before count as gone to already, and what they moved the instance's joints by as moved.

    :param back: the same way from its end, see `backwards`
    :param leaving: of a way back, the waypoint at which the hand stands; empty: none, the first way leads there on a line
    :raises ActivityFailed: `refused` for names that are not there, not in that order, or of a stroke
    """
    found = instance.resolve().trajectories.get(trajectory)
    if found is not None and found.entry is not None:
        raise ActivityFailed(
            "refused",
            f"trajectory: {trajectory} is a stroke, whose entry is planned; expected do: plan and do: execute",
        )
    begin, end, gone = 0, 0, 0
    if found is not None:
        names = [each.name for each in found.waypoints]
        begin, end = (
            _place(names, "first", first or names[0], trajectory),
            _place(names, "last", last or names[-1], trajectory),
        )
        if begin > end:
            raise ActivityFailed(
                "refused", f"last: {names[end]} comes before {names[begin]}; expected it or one behind it"
            )
        gone = begin
        if back:
            stands = _place(names, "leaving", leaving, trajectory) if leaving else end
            if leaving and stands != end + 1:
                raise ActivityFailed("refused", f"leaving: got {leaving}; expected the waypoint behind {names[end]}")
            gone = stands + 1
    try:
        hands = {} if found is None else {found.hand: arm}
        at_start = instance if found is None else rewound(instance, found, gone)
        waypoints = bind(at_start, trajectory, robot, hands).waypoints
    except ValueError as problem:
        raise ActivityFailed("refused", str(problem)) from problem
    if not back:
        return waypoints[begin : end + 1]
    return (
        backwards(waypoints)[len(waypoints) - 1 - end : len(waypoints) - begin]
        if leaving
        else _from_anywhere(backwards(waypoints), len(waypoints) - 1 - end, len(waypoints) - begin)
    )


def _from_anywhere(back: Sequence[BoundWaypoint], begin: int, end: int) -> tuple[BoundWaypoint, ...]:
    """Of a way back, a part whose first waypoint is gone to on a line."""
    first, *rest = back[begin:end]
    onto = replace(first.waypoint, approach="straight", joint="", to=0.0, duration=0.0, speed=None)
    return (replace(first, waypoint=onto), *rest)


def _place(names: Sequence[str], field: str, wanted: str, trajectory: str) -> int:
    if wanted not in names:
        raise ActivityFailed(
            "refused", f"{field}: {trajectory} has no waypoint {wanted!r}; expected one of {', '.join(names)}"
        )
    return names.index(wanted)


def rewound(instance: Instance, trajectory: ResolvedTrajectory, gone: int) -> Instance:
    """The instance as it was before the first `gone` waypoints moved its joints."""
    moved: dict[str, float] = {}
    for waypoint in trajectory.waypoints[:gone]:
        if waypoint.approach == "along":
            moved[waypoint.joint] = moved.get(waypoint.joint, 0.0) + float(waypoint.to)
    if not moved:
        return instance
    joints = instance.resolve().joints
    state = {joint: joints[joint].position - by for joint, by in moved.items()}
    return replace(instance, joint_state={**instance.joint_state, **state})


def backwards(waypoints: Sequence[BoundWaypoint]) -> tuple[BoundWaypoint, ...]:
    """The same way from its end: to its last waypoint on a line, then each leg as it was gone forwards, without its guards and
    pushes; a line that was pressed from its begin to its end is pressed again: two hands carry by that. At each the hand gets the
    shape that it had before it.
    """
    back = []
    for number in reversed(range(len(waypoints))):
        here = waypoints[number]
        leg = waypoints[number + 1].waypoint if number + 1 < len(waypoints) else None
        approach = "straight" if leg is None or leg.approach == "guarded" else leg.approach
        held = leg if approach == "along" else None
        pressed = (
            leg is not None and approach == "straight" and here.force_in_world is not None and leg.force is not None
        )
        shaped = next((before for before in reversed(waypoints[:number]) if before.fingers), None)
        waypoint = replace(
            here.waypoint,
            approach=approach,
            joint=held.joint if held else "",
            to=-float(held.to) if held else 0.0,
            until=None,
            force=leg.force if leg is not None and pressed else None,
            duration=leg.duration if leg else 0.0,
            speed=leg.speed if leg else None,
            hand_pose=shaped.waypoint.hand_pose if shaped else "",
        )
        force = waypoints[number + 1].force_in_world if pressed else None
        back.append(replace(here, waypoint=waypoint, fingers=shaped.fingers if shaped else {}, force_in_world=force))
    return tuple(back)


def way_to(waypoint: BoundWaypoint, instance: Instance, joints: Sequence[str] = ()) -> PlanMotion | None:
    """What a planner is asked for so that the hand gets to a waypoint from the one before; None: no plan leads there, but a motion
    of the control loop, on a line or pressing.

    :param joints: that may move; none: all of the arm
    """
    asked, arm = waypoint.waypoint, waypoint.arm
    if asked.approach == "free":
        return PlanMotion(
            goals=[waypoint.goal()],
            arm=arm.name,
            joints=list(joints),
            clearance=CLEAR,
            label=f"to {asked.name} of {instance.name}",
        )
    if asked.approach != "along" or pushes(waypoint):
        return None
    along = Along(instance=instance.name, joint=asked.joint, by=float(asked.to), frame=arm.tip)
    return PlanMotion(
        goals=[],
        along=along,
        arm=arm.name,
        joints=list(joints),
        clearance=CLEAR,
        label=f"to {asked.name} of {instance.name}",
    )


def pushes(waypoint: BoundWaypoint) -> bool:
    """Whether what moves along a joint is pushed, with a force that the template names: else the hand holds it."""
    return waypoint.waypoint.approach == "along" and waypoint.force_in_world is not None
