"""Templates that run alone: a trajectory of an instance expanded, deployed, and where it has left the hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from affordance_templates.binding import bind
from affordance_templates.instance import Instance
from engines.activities.base import Services
from engines.activities.waypoints import rewound
from engines.programs import deployment
from engines.programs import program as programs
from engines.programs.deployment import Deployed
from engines.programs.from_template import ARM, AT, WHAT, Expanded, Wish, expand
from handrail import messages as m
from handrail.topics import refuse

_THERE = 0.05
"""m that a hand is from a waypoint at most and still counts as there: guarded ways go on until something is felt"""
_KEPT = 20


class TemplateRuns:
    """Of one engine; used by its thread, and told of runs by theirs."""

    def __init__(self, services: Services, folder: Path):
        """`folder`: where the programs' files are written."""
        self._services, self._folder = services, folder
        self._runs: dict[str, tuple[str, str, str]] = {}
        """deployment → instance, trajectory, arm"""
        self._stands: dict[tuple[str, str, str], str] = {}
        """instance, trajectory, arm → waypoint that a run reached last"""

    def program(self, call: m.ExpandTemplate) -> m.TemplateProgram:
        """Refused where there is no such instance, trajectory, arm or waypoint, or nothing left to go to."""
        expanded, arm = self._expanded(call)
        return m.TemplateProgram(name=expanded.name, text=expanded.text, bindings=_bindings(call, arm))

    def deploy(self, call: m.RunTemplate) -> Deployed:
        """The same, ready to run."""
        expanded, arm = self._expanded(call)
        self._folder.mkdir(exist_ok=True)
        file = self._folder / f"{expanded.name}.yaml"
        file.write_text(expanded.text, encoding="utf-8")
        services = self._services
        request = m.Deploy(program=expanded.name, bindings=_bindings(call, arm))
        deployed = deployment.deploy(request, programs.read(file), services.description, services.affordances)
        self._runs[deployed.id] = (call.instance, call.trajectory, arm)
        for id in list(self._runs)[:-_KEPT]:
            del self._runs[id]
        return deployed

    def told(self, deployed: Deployed, state: m.RunState) -> None:
        """A run has changed."""
        key = self._runs.get(deployed.id)
        if key is not None and (at := state.data.get(AT)):
            self._stands[key] = str(at)

    def _expanded(self, call: m.ExpandTemplate | m.RunTemplate) -> tuple[Expanded, str]:
        arms = self._services.description.arms
        arm = call.arm or (next(iter(arms)) if len(arms) == 1 else "")
        if arm not in arms:
            raise refuse(
                "no such arm", "arm", call.arm or "none", f"one of: {', '.join(arms) or 'none, it has no arm'}"
            )
        instance = self._services.affordances.get(call.instance)
        wish = Wish(
            trajectory=call.trajectory,
            arm=arm,
            first=call.first,
            steps=call.steps,
            back=call.backwards,
            rounds=call.loop,
            stands=self._standing(instance, call.trajectory, arm),
        )
        return expand(self._services.description, instance, wish), arm

    def _standing(self, instance: Instance, trajectory: str, arm: str) -> str:
        """The waypoint at which a run has left the hand, if that is there still; empty: nobody knows."""
        at = self._stands.get((instance.name, trajectory, arm), "")
        found = instance.resolve().trajectories.get(trajectory)
        command = self._services.daemon.command()
        if not at or found is None or command is None or at not in (names := [each.name for each in found.waypoints]):
            return ""
        number = names.index(at)
        bound = bind(rewound(instance, found, number + 1), trajectory, self._services.description, {found.hand: arm})
        off = self._services.tip(command, arm) - bound.waypoints[number].tip_in_world[:3, 3]
        return at if float(np.linalg.norm(off)) < _THERE else ""


def _bindings(call: m.ExpandTemplate | m.RunTemplate, arm: str) -> dict[str, str]:
    return {ARM: arm, WHAT: call.instance}
