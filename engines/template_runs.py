"""Templates that run alone: a trajectory of an instance expanded, deployed, and where it has left the hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from affordance_templates.binding import bind
from affordance_templates.instance import Instance
from affordance_templates.placement import Array
from engines.activities.base import ActivityFailed, Services
from engines.activities.execute import left_to
from engines.activities.meetings import meetings
from engines.activities.waypoints import rewound
from engines.plans.freshness import START_TOLERANCE
from engines.programs import deployment
from engines.programs import program as programs
from engines.programs.deployment import Deployed
from engines.programs.from_template import ARM, AT, OTHER, WHAT, Expanded, Wish, expand
from handrail import messages as m
from handrail.topics import RefusedError, refuse

_THERE = 0.05
"""m that a hand is from a waypoint at most and still counts as there: guarded ways go on until something is felt"""
_KEPT = 20

_Key = tuple[str, str, str, str]
"""instance, trajectory, arm, the other arm of a sync"""


class TemplateRuns:
    """Of one engine; used by its thread, and told of runs by theirs."""

    def __init__(self, services: Services, folder: Path):
        """`folder`: where the programs' files are written."""
        self._services, self._folder = services, folder
        self._runs: dict[str, _Key] = {}
        """by deployment"""
        self._stands: dict[_Key, str] = {}
        """the waypoint that a run reached last"""
        self._plans: dict[_Key, str] = {}
        """id of the plan of a stroke that has led there"""

    def program(self, call: m.ExpandTemplate) -> m.TemplateProgram:
        """Refused where there is no such instance, trajectory, arm or waypoint, or nothing left to go to."""
        expanded, arms = self._expanded(call)
        return m.TemplateProgram(name=expanded.name, text=expanded.text, bindings=_bindings(call, arms))

    def deploy(self, call: m.RunTemplate) -> Deployed:
        """The same, ready to run."""
        expanded, arms = self._expanded(call)
        self._folder.mkdir(exist_ok=True)
        file = self._folder / f"{expanded.name}.yaml"
        file.write_text(expanded.text, encoding="utf-8")
        services = self._services
        request = m.Deploy(program=expanded.name, bindings=_bindings(call, arms))
        deployed = deployment.deploy(request, programs.read(file), services.description, services.affordances)
        self._runs[deployed.id] = (call.instance, call.trajectory, *arms)
        for id in list(self._runs)[:-_KEPT]:
            del self._runs[id]
        return deployed

    def told(self, deployed: Deployed, state: m.RunState) -> None:
        """A run has changed."""
        key = self._runs.get(deployed.id)
        if key is not None and (at := state.data.get(AT)):
            self._stands[key], self._plans[key] = str(at), str(state.data.get("plan") or "")

    def _expanded(self, call: m.ExpandTemplate | m.RunTemplate) -> tuple[Expanded, tuple[str, str]]:
        """And the arms, the other one empty where one hand does it."""
        instance = self._services.affordances.get(call.instance)
        arm, other = arms = self._arms(call, instance)
        wish = Wish(
            trajectory=call.trajectory,
            arm=arm,
            other=other,
            first=call.first,
            steps=call.steps,
            back=call.backwards,
            rounds=call.loop,
            stands=self._standing(instance, call.trajectory, arms),
            plan=self._plans.get((instance.name, call.trajectory, *arms), ""),
        )
        return expand(self._services.description, instance, wish), arms

    def _arms(self, call: m.ExpandTemplate | m.RunTemplate, instance: Instance) -> tuple[str, str]:
        """Those that are asked for; of a sync those that its hands are named as, or the robot's two."""
        robot, resolved = self._services.description.arms, instance.resolve()
        arm, other, sync = call.arm, call.other, resolved.syncs.get(call.trajectory)
        if sync is not None and len(sync.trajectories) == 2:
            named = [resolved.trajectories[each].hand for each in sync.trajectories]
            if not arm and not other and set(named) <= set(robot):
                arm, other = named
            if arm in robot and not other and len(robot) == 2:
                (other,) = set(robot) - {arm}
        arm = arm or (next(iter(robot)) if len(robot) == 1 else "")
        if arm not in robot:
            raise refuse("no such arm", "arm", arm or "none", f"one of: {', '.join(robot) or 'none, it has no arm'}")
        return arm, other

    def _standing(self, instance: Instance, trajectory: str, arms: tuple[str, str]) -> str:
        """The waypoint at which a run has left the hand, or hands, if they are there still; empty: nobody knows."""
        at, command = self._stands.get((instance.name, trajectory, *arms), ""), self._services.daemon.command()
        resolved = instance.resolve()
        if not at or command is None or trajectory not in (*resolved.trajectories, *resolved.syncs):
            return ""
        there = next((each.reached for each in meetings(instance, trajectory) if each.name == at), None)
        if there is None:
            return ""
        if trajectory in resolved.trajectories and resolved.trajectories[trajectory].entry is not None:
            return at if self._on_its_way(self._plans[(instance.name, trajectory, *arms)], at, command) else ""
        for (name, number), arm in zip(there.items(), arms, strict=False):
            found = resolved.trajectories[name]
            if number < 0:
                continue
            bound = bind(rewound(instance, found, number + 1), name, self._services.description, {found.hand: arm})
            off = self._services.tip(command, arm) - bound.waypoints[number].tip_in_world[:3, 3]
            if float(np.linalg.norm(off)) >= _THERE:
                return ""
        return at

    def _on_its_way(self, id: str, at: str, command: Array) -> bool:
        """Whether a stroke can go on on its plan from a waypoint that it has come to: it is fresh, and nothing was moved."""
        try:
            record = self._services.plans.get(id)
            left_to(record, at)
        except (RefusedError, ActivityFailed):
            return False
        if record.reached < 0 or record.executing or self._services.plans.causes(record, start=False):
            return False
        there = record.plan.segments[record.reached].positions[-1]
        rows = self._services.description.index(record.plan.joints)
        return bool(np.abs(command[rows] - there).max() <= START_TOLERANCE)


def _bindings(call: m.ExpandTemplate | m.RunTemplate, arms: tuple[str, str]) -> dict[str, str]:
    arm, other = arms
    return {ARM: arm} | ({OTHER: other} if other else {}) | {WHAT: call.instance}
