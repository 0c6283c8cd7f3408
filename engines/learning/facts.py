"""Facts: what is known about a run, before it begins and while it goes on, by names that last from run to run."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from affordance_templates.instance import Instance
from engines.programs.deployment import Deployed
from handrail.messages import ActionEvent, PlanPreview, PlanWaypoint


@dataclass(frozen=True)
class Fact:
    """A number, or a word such as which arm; by the roles of the program, not by the names of what was bound to them."""

    value: float | str
    unit: str = ""

    def words(self) -> str:
        """For people."""
        if isinstance(self.value, str):
            return self.value
        shown = math.degrees(self.value) if self.unit == "rad" else self.value
        return f"{shown:.3g} {'°' if self.unit == 'rad' else self.unit}".rstrip()


Facts = Mapping[str, Fact]


def beforehand(deployed: Deployed, instances: Iterable[Instance]) -> dict[str, Fact]:
    """What is known when a program is deployed: its parameters, which arm, where its instances are and what they are like.

    Places are in the world, headings about its z.
    """
    facts: dict[str, Fact] = {}
    for name, parameter in deployed.program.parameters.items():
        value = deployed.parameters[name]
        if isinstance(value, str):
            facts[name] = Fact(value)
        else:
            facts[name] = Fact(float(value), parameter.unit or "")
    placed = {instance.name: instance for instance in instances}
    for role, resource in deployed.program.resources.items():
        bound = deployed.bindings[role]
        if resource.kind != "instance":
            facts[role] = Fact(bound)
        elif bound in placed:
            facts |= {f"{role}.{name}": fact for name, fact in _of_instance(placed[bound]).items()}
    return facts


def _of_instance(instance: Instance) -> dict[str, Fact]:
    state = instance.state()
    x, y, z = state.pose_in_world.position
    qx, qy, qz, qw = state.pose_in_world.orientation
    facts = {"x": Fact(x, "m"), "y": Fact(y, "m"), "z": Fact(z, "m")}
    facts["distance"] = Fact(math.hypot(x, y), "m")
    facts["heading"] = Fact(math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)), "rad")
    units = {name: parameter.unit or "" for name, parameter in instance.template.parameters.items()}
    for name, value in state.parameters.items():
        facts[name] = Fact(float(value), units.get(name, ""))
    return facts


_WORST: Mapping[str, tuple[Callable[[float, float], float], str]] = {
    "residual": (max, "m"),
    "tilt": (max, "rad"),
    "clearance": (min, "m"),
    "limit_margin": (min, "rad"),
    "torque_share": (max, ""),
}


class RunNotes:
    """What a run meets on its way: the worst that its plans promise, the forces that it felt, how often a guard ended a motion."""

    def __init__(self, changed: Callable[[], None] = lambda: None):
        """`changed` is called, by whoever told it, when a fact has come or become worse."""
        self._changed = changed
        self._lock = threading.Lock()
        self._facts: dict[str, Fact] = {}

    def facts(self) -> dict[str, Fact]:
        """As they stand now."""
        with self._lock:
            return dict(self._facts)

    def planned(self, plan: PlanPreview) -> None:
        """A plan was made for the run."""
        found: dict[str, Fact] = {}
        for name, (worse, unit) in _WORST.items():
            values = [value for waypoint in plan.waypoints if (value := _value(waypoint, name)) is not None]
            if values:
                value = values[0]
                for other in values[1:]:
                    value = worse(value, other)
                found[f"plan.{name}"] = Fact(value, unit)
        self._take(found)

    def moved(self, ended: ActionEvent) -> None:
        """A motion of the run has ended."""
        with self._lock:
            stopped = float(self._facts["motion.guarded"].value) if "motion.guarded" in self._facts else 0.0
        guarded = ended.outcome not in ("done", "cancelled", "stopped")
        found = {"motion.guarded": Fact(stopped + guarded)}
        if ended.path_force:
            found["motion.force"] = Fact(abs(ended.path_force), "N")
        self._take(found)

    def _take(self, found: Mapping[str, Fact]) -> None:
        with self._lock:
            before = dict(self._facts)
            for name, fact in found.items():
                old = self._facts.get(name)
                worse = _WORST.get(name.removeprefix("plan."), (max, ""))[0]
                if old is None:
                    self._facts[name] = fact
                else:
                    self._facts[name] = Fact(worse(float(old.value), float(fact.value)), fact.unit)
            changed = self._facts != before
        if changed:
            self._changed()


def _value(waypoint: PlanWaypoint, name: str) -> float | None:
    value = getattr(waypoint, name)
    return value if value is None or isinstance(value, float) else float(value.value)
