"""A template's trajectory as a program of its own: at each waypoint a state, so that it can be looked at, paused, stepped, saved.

A way that is planned is planned and shown in one state, gone in the next: at the autonomy levels `off`, `low` and `high` the
operator is asked in between, with the plan's ghost before him, and before each motion that nobody plans (on a line, until something
is felt, pressing). A plan that has gone stale meanwhile is made anew. A stroke is planned as a whole and executed from waypoint to
waypoint.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from affordance_templates.binding import BoundWaypoint
from affordance_templates.instance import Instance
from affordance_templates.template import ResolvedTrajectory, ResolvedWaypoint
from engines.activities.base import ActivityFailed
from engines.activities.meetings import hands, legs, meetings, way_together
from engines.activities.waypoints import chosen, way_to
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

ARM, OTHER, WHAT, AT = "arm", "other", "what", "at"
"""names of the program's resources, and of the variable that has the waypoint reached last"""
_ASK = {"autonomy": "high"}
"""the operator is asked before each motion, at this level and below"""
_STALE = "_event.data.reason == 'stale'"
_FAILED = {"event": "error.execution", "target": "failed", "set": {"why": "failure"}}
_PLAIN = re.compile(r"(?!(true|false|yes|no|on|off|null|y|n)$)[A-Za-z_][\w.]*( [\w.+<]+)*", re.IGNORECASE)
MOST = 1000
"""rounds"""


@dataclass(frozen=True)
class Wish:
    """Which part of a trajectory, and which way."""

    trajectory: str
    """or a sync"""
    arm: str
    other: str = ""
    """of a sync: the arm of its second trajectory; `arm` is its first one's"""
    first: str = ""
    """waypoint to go to first; empty: the first of that way, or the next one from where the hand stands"""
    steps: int = 0
    """waypoints to go to; 0: all that are left"""
    back: bool = False
    rounds: int = 1
    stands: str = ""
    """waypoint at which the hand is; empty: at none"""
    plan: str = ""
    """id of the plan of the stroke that has led it there"""


@dataclass(frozen=True)
class Expanded:
    """A program's file."""

    name: str
    text: str


@dataclass(frozen=True)
class _Way:
    """To one waypoint, or to one point of a sync."""

    title: str
    planned: bool


def expand(robot: RobotDescription, instance: Instance, wish: Wish) -> Expanded:
    """Refused where the trajectory, the arms or waypoints are not there, or nothing is left to go to."""
    resolved = instance.resolve()
    known = (*resolved.trajectories, *resolved.syncs)
    if wish.trajectory not in known:
        raise refuse("no such trajectory", "trajectory", wish.trajectory, f"one of: {', '.join(known) or 'none'}")
    for field, arm in (("arm", wish.arm), *([("other", wish.other)] if wish.other else [])):
        if arm not in robot.arms:
            raise refuse("no such arm", field, arm or "none", f"one of: {', '.join(robot.arms) or 'none'}")
    together = wish.trajectory in resolved.syncs
    if together != bool(wish.other):
        words = f"{wish.trajectory} is for {'two hands' if together else 'one hand'}"
        raise refuse(words, "other", wish.other or "none", "another arm" if together else "none")
    if not 1 <= wish.rounds <= MOST:
        raise refuse("it would never begin, or never end", "loop", wish.rounds, f"1 to {MOST}")
    name = re.sub(r"\W+", "_", f"{instance.template.name}_{wish.trajectory}").strip("_").lower()
    found = resolved.trajectories.get(wish.trajectory)
    stroke = found if found is not None and found.entry is not None else None
    if stroke is not None and wish.back:
        words = f"{wish.trajectory} is a stroke, and what it has turned does not come back with the tool"
        raise refuse(words, "backwards", True, "forwards")
    if stroke is not None and wish.stands == stroke.waypoints[-1].name:
        wish = replace(wish, stands="")  # the next stroke
    leaving, part = _part([each.name for each in meetings(instance, wish.trajectory)], wish)
    if wish.rounds > 1 and (wish.steps or wish.back):
        field, value = ("steps", wish.steps) if wish.steps else ("backwards", wish.back)
        raise refuse("a loop goes forwards, and all the way", field, value, "none beside loop")
    if stroke is not None:
        return Expanded(name, _stroke(instance, wish, stroke, part))
    if wish.back:
        _refuse_pushed(instance, wish, leaving or part[0], part[-1])
    ways = _ways(robot, instance, wish, part, leaving)
    return Expanded(name + ("_back" if wish.back else ""), _waypoints(instance, wish, ways, part, leaving))


def _refuse_pushed(instance: Instance, wish: Wish, begin: str, end: str) -> None:
    """Where a way back from one waypoint to another comes over a push."""
    reached = {each.name: each.reached for each in meetings(instance, wish.trajectory)}
    for trajectory, number in reached[begin].items():
        for waypoint in (
            instance.resolve().trajectories[trajectory].waypoints[reached[end][trajectory] + 1 : number + 1]
        ):
            if waypoint.approach == "along" and waypoint.force is not None:
                raise refuse(
                    f"{waypoint.name} pushes {waypoint.joint}, which does not come back with the hand",
                    "backwards",
                    True,
                    f"steps that end at {waypoint.name}, or forwards",
                )


def _part(names: Sequence[str], wish: Wish) -> tuple[str, list[str]]:
    """The waypoint that the hand leaves (empty: it comes from anywhere), and those to go to, in order."""
    way = list(reversed(names)) if wish.back else list(names)
    if wish.first and wish.first not in names:
        raise refuse("no such waypoint", "first", wish.first, f"one of: {', '.join(names)}")
    begin, leaving = 0, ""
    if wish.first:
        begin = way.index(wish.first)
        leaving = wish.stands if begin and wish.stands == way[begin - 1] else ""
    elif wish.stands in way and (wish.steps or wish.back):
        begin, leaving = way.index(wish.stands) + 1, wish.stands
        if begin == len(way):
            raise refuse(
                f"the hand stands at {wish.stands}, and nothing is left that way",
                "first",
                "none",
                f"one of: {', '.join(names)}",
            )
    part = way[begin : begin + wish.steps] if wish.steps else way[begin:]
    return leaving if wish.back else "", part


def _ways(
    robot: RobotDescription, instance: Instance, wish: Wish, part: Sequence[str], leaving: str
) -> tuple[_Way, ...]:
    """To the waypoints of the part, in order, as they will be gone to."""
    first, last = (part[-1], part[0]) if wish.back else (part[0], part[-1])
    where = {"first": first, "last": last, "leaving": leaving}
    try:
        if not wish.other:
            found = chosen(robot, instance, wish.trajectory, wish.arm, back=wish.back, **where)
            _check_hand(robot, wish.arm, found)
            return tuple(_Way(_title(each), way_to(each, instance) is not None) for each in found)
        arms = hands(instance, wish.trajectory, (wish.arm, wish.other), robot)
        steps = legs(robot, instance, wish.trajectory, arms, back=wish.back, **where)
    except ActivityFailed as failed:
        raise refuse(str(failed)) from failed
    for trajectory, arm in arms.items():
        _check_hand(robot, arm, [each for step in steps for each in step.ways[trajectory]])
    return tuple(_Way(f"Both hands to {step.name}", way_together(step, instance) is not None) for step in steps)


def _check_hand(robot: RobotDescription, arm: str, waypoints: Sequence[BoundWaypoint]) -> None:
    if not robot.arms[arm].hand_poses and len({each.waypoint.hand_pose for each in waypoints} - {""}) > 1:
        raise refuse(
            f"the {arm} arm of {robot.name} has no hand that could open and close", "arm", arm, "an arm with a hand"
        )


# ------------------------------------------------------------------------------------------------------------- the file


@dataclass(frozen=True)
class _Step:
    """One waypoint's states."""

    name: str
    plan: str
    """state that plans the way there; empty: nobody plans it"""
    move: str
    """state that goes there"""
    title: str
    where: dict[str, Any]
    """arguments that say which waypoint, and from where"""

    @property
    def entry(self) -> str:
        """The state that it begins with."""
        return self.plan or self.move

    @property
    def asked(self) -> dict[str, str]:
        """Of a transition to it: a way that is planned is asked about once it is there to be seen."""
        return {} if self.plan else _ASK


def _waypoints(instance: Instance, wish: Wish, ways: Sequence[_Way], part: Sequence[str], leaving: str) -> str:
    back = " backwards" if wish.back else ""
    taken, steps = {"begin", "done", "failed"}, list[_Step]()
    for before, name, to in zip([leaving, *part], part, ways, strict=False):
        way = {"way": "backwards"} | ({"leaving": before} if before else {}) if wish.back else {}
        plan = _free(f"plan_{name}", taken) if to.planned else ""
        steps.append(_Step(name, plan, _free(f"to_{name}", taken), to.title, way))
    first = steps[0]
    what = {"instance": WHAT, "trajectory": wish.trajectory, "arm": ARM} | ({"other": OTHER} if wish.other else {})
    lines = _head(f"{instance.template.title}: {wish.trajectory}{back}", instance, wish, [AT, "plan", "why"])
    if not first.plan:
        goes = [{"after": 0.1, "target": first.move, **first.asked}]
        lines += _state("begin", f"Before {first.name}", "", {}, goes, initial=True)
    for step, following in zip(steps, [*steps[1:], None], strict=True):
        if step.plan:
            planned = {"event": f"done.invoke.{step.plan}", "target": step.move, "set": {"plan": "_event.data.plan"}}
            lines += _state(
                step.plan, f"Plan the way to {step.name}", "plan", {**what, "waypoint": step.name, **step.where},
                [{**planned, **_ASK}, _FAILED], initial=step is first,
            )  # fmt: skip
        done, at = {"event": f"done.invoke.{step.move}"}, {AT: f"'{step.name}'"}
        if following is not None:
            goes = [{**done, "target": following.entry, "set": at, **following.asked}]
        else:
            goes = [{**done, "target": "done", "set": at}]
            again = {
                "cond": "round < rounds",
                "target": first.entry,
                "set": {**at, "round": "round + 1"},
                **first.asked,
            }
            goes[:0] = [{**done, **again}] if wish.rounds > 1 else []
        if step.plan:
            goes.append({"event": "error.execution", "cond": _STALE, "target": step.plan})
        where = {**what, "first": step.name, "last": step.name, **step.where, **({"plan": "plan"} if step.plan else {})}
        lines += _state(step.move, step.title, "trajectory", where, [*goes, _FAILED])
    return "\n".join([*lines, *_tail(f"{wish.trajectory} of {{{WHAT}}}{back}: the hand is at {{{AT}}}")])


def _title(leg: BoundWaypoint) -> str:
    return _words(leg.waypoint) + (f" (hand {leg.waypoint.hand_pose})" if leg.fingers else "")


def _words(waypoint: ResolvedWaypoint) -> str:
    how = {"free": "Go to", "along": f"Move {waypoint.joint} to"}.get(waypoint.approach, "Go straight to")
    until = f" until {waypoint.until:g} N are felt" if waypoint.until is not None else ""
    return f"{how} {waypoint.name}{until}"


def _stroke(instance: Instance, wish: Wish, stroke: ResolvedTrajectory, part: Sequence[str]) -> str:
    """From its first waypoint on it is planned; else it goes on on the plan that has led the tool to where it is."""
    names = [each.name for each in stroke.waypoints]
    number = names.index(part[0])
    if number and not (wish.plan and wish.stands == names[number - 1]):
        raise refuse(
            f"{wish.trajectory} is a stroke, planned from its begin on: the tool is not at {names[number - 1]} on such a plan",
            "first",
            part[0],
            " or ".join([names[0], *([names[names.index(wish.stands) + 1]] if wish.stands in names[:-1] else [])]),
        )
    moves = {name: f"to_{name}" for name in part}
    plan = wish.plan if number else ""
    lines = _head(f"{instance.template.title}: {wish.trajectory}", instance, wish, [AT, "plan", "why"], plan=plan)
    if number:
        goes = [{"after": 0.1, "target": moves[part[0]], **_ASK}]
        lines += _state("begin", f"Before {part[0]}", "", {}, goes, initial=True)
    else:
        planned = {
            "event": "done.invoke.planning",
            "target": moves[part[0]],
            "set": {"plan": "_event.data.plan"},
            **_ASK,
        }
        what = {"instance": WHAT, "trajectory": wish.trajectory, "arm": ARM}
        lines += _state("planning", "Plan the stroke", "plan", what, [planned, _FAILED], initial=True)
    at_end = "_event.data.outcome == 'done'"
    for name, following in zip(part, [*part[1:], ""], strict=True):
        done, at = {"event": f"done.invoke.{moves[name]}"}, {AT: f"'{name}'"}
        ways: list[dict[str, Any]] = [{**done, "cond": at_end, "target": "done", "set": at}]
        if following:
            ways = [{**done, "cond": at_end, "target": moves[following], "set": at, **_ASK}]
        elif wish.rounds > 1:
            again = {"cond": f"round < rounds and {at_end}", "target": "planning", "set": {**at, "round": "round + 1"}}
            ways[:0] = [{**done, **again}]
        why = "_event.data.segment + ' was ended by ' + _event.data.outcome"
        ways.append({**done, "target": "failed", "set": {"why": why}})
        if not number:
            ways.append({"event": "error.execution", "cond": _STALE, "target": "planning"})
        title = _words(stroke.waypoints[names.index(name)])
        lines += _state(moves[name], title, "execute", {"plan": "plan", "to": name}, [*ways, _FAILED])
    return "\n".join([*lines, *_tail(f"{wish.trajectory} of {{{WHAT}}}: the tool is at {{{AT}}}")])


def _head(title: str, instance: Instance, wish: Wish, variables: Sequence[str], *, plan: str = "") -> list[str]:
    values: dict[str, Any] = {**dict.fromkeys(variables, ""), "plan": plan}
    parameters = []
    if wish.rounds > 1:
        values["round"] = 1
        parameters = [
            "parameters:",
            f"  rounds: {_flow({'default': wish.rounds, 'type': 'integer', 'min': 1, 'max': MOST})}",
        ]
    return [
        f"# Made from a trajectory of the template {instance.template.name}: yours to keep and to change.",
        f"title: {_flow(title)}",
        "",
        "resources:",
        f"  {ARM}: {{kind: arm}}",
        *([f"  {OTHER}: {{kind: arm}}"] if wish.other else []),
        f"  {WHAT}: {_flow({'kind': 'instance', 'template': instance.template.name})}",
        *parameters,
        f"variables: {_flow(values)}",
        "",
        "states:",
    ]


def _state(
    name: str, title: str, do: str, given: dict[str, Any], ways: Sequence[dict[str, Any]], *, initial: bool = False
) -> list[str]:
    return [
        f"  {name}:",
        f"    title: {_flow(title)}",
        *(["    initial: true"] if initial else []),
        *([f"    do: {do}", f"    with: {_flow(given)}"] if do else []),
        "    transitions:",
        *(f"      - {_flow(way)}" for way in ways),
    ]


def _tail(detail: str) -> list[str]:
    return [
        f"  done: {_flow({'final': True, 'outcome': 'succeeded', 'detail': detail})}",
        f"  failed: {_flow({'final': True, 'outcome': 'failed', 'detail': '{why}'})}",
        "",
    ]


def _flow(value: Any) -> str:
    """YAML in one line; texts in quotes where they could be read as something else."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(each)}" for key, each in value.items()) + "}"
    if isinstance(value, str) and _PLAIN.fullmatch(value):
        return value
    return json.dumps(value, ensure_ascii=False)


def _free(wanted: str, taken: set[str]) -> str:
    """A state's name that is like it and not taken yet."""
    name = base = re.sub(r"\W+", "_", wanted)
    while name in taken:
        name = f"{base}_{len(taken)}"
    taken.add(name)
    return name
