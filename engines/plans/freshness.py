"""What a plan was made from, and every reason why it may no longer be executed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from handrail.messages import Base, PlanOrigin, Pose, StaleCause

if TYPE_CHECKING:
    from engines.planning.plan import Plan

Array = NDArray[np.float64]

START_TOLERANCE = 0.02
"""rad: a plan whose start is further from the robot's command than this in any joint is stale"""
BASE_TOLERANCE = (0.01, 0.01)
"""m and rad that the base may have moved: what was clear by a centimetre may not be so from there"""


@dataclass(frozen=True)
class World:
    """What plans are made from, at one moment."""

    time_ns: int
    """robot's clock"""
    command: Array
    """(n,) rad, where all joints are commanded"""
    base: Base | None = None
    """None: it is fixed"""


@dataclass(frozen=True)
class Origin:
    """What one plan was made from."""

    world: World
    joints: tuple[str, ...]
    """n, of the whole robot"""
    instances: tuple[Instance, ...]
    asked: Mapping[str, float | str]
    """what was asked for, by the names of `do: plan`'s arguments"""
    run: str = ""
    """id of the run that made it"""

    def told(self) -> PlanOrigin:
        """As clients get it."""
        return PlanOrigin(
            time_ns=self.world.time_ns,
            asked=dict(self.asked),
            run=self.run,
            instances=[instance.state() for instance in self.instances],
            joints={joint: round(float(q), 4) for joint, q in zip(self.joints, self.world.command, strict=True)},
            base_in_world=_pose(self.world.base),
        )


@dataclass(frozen=True)
class Cause:
    """One reason why a plan is stale."""

    code: StaleCause
    words: str


def causes(
    plan: Plan, origin: Origin, instances: Mapping[str, Instance], world: World | None, *, start: bool
) -> list[Cause]:
    """Why a plan may not be executed any more; empty while it may.

    :param instances: as they stand now
    :param world: as it is now, None before the daemon was heard
    :param start: from its beginning; a plan under way has left it, and what it did not plan may move meanwhile
    """
    found = [cause for before in origin.instances for cause in _of_instance(before, instances.get(before.name))]
    if world is not None:
        found += [
            cause
            for cause in _of_base(origin.world.base, world.base)
            if start or plan.base_at_end is None or cause.code == "base_unknown"  # it is under way: the base is to move
        ]
        if start:
            found += _of_joints(plan, origin, world.command)
    return found


def _of_instance(before: Instance, now: Instance | None) -> Iterator[Cause]:
    name = before.name
    if now is None:
        yield Cause("instance_removed", f"{name} was removed after the plan was made")
        return
    if now.version == before.version:
        return
    versions = f"after the plan was made (version {before.version}, now {now.version})"
    moved = moved_by(before.pose_in_world, now.pose_in_world)
    if moved:
        yield Cause("instance_moved", f"{name} was {moved} {versions}")
    first, then = before.template.values(before.parameters), now.template.values(now.parameters)
    changed = [f"{each} {first[each]:g} to {then[each]:g}" for each in first if then.get(each) != first[each]]
    if changed:
        yield Cause("instance_parameters", f"{name} was changed, {', '.join(changed)}, {versions}")
    if not moved and not changed:
        yield Cause("instance_changed", f"{name} was placed or edited {versions}")


def _of_base(before: Base | None, now: Base | None) -> Iterator[Cause]:
    if now is not None and now.source == "none":
        yield Cause("base_unknown", f"where the robot stands is not known: {now.problem}")
    elif moved := moved_by(_pose(before), _pose(now), *BASE_TOLERANCE):
        yield Cause("base_moved", f"the robot's base was {moved} after the plan was made")


def _of_joints(plan: Plan, origin: Origin, command: Array) -> Iterator[Cause]:
    rows = {joint: row for row, joint in enumerate(origin.joints)}
    own = [rows[joint] for joint in plan.joints]
    off = np.abs(command[own] - plan.start)
    worst = int(off.argmax())
    if not off[worst] <= START_TOLERANCE:  # NaN is stale too
        yield Cause(
            "start_left",
            f"the robot is not where the plan starts: {plan.joints[worst]} is {off[worst]:.3f} rad off, "
            f"allowed {START_TOLERANCE:g}; plan anew",
        )
    others = np.abs(command - origin.world.command)
    others[own] = 0.0
    worst = int(others.argmax())
    if not others[worst] <= START_TOLERANCE:
        yield Cause(
            "others_moved",
            f"the plan counts on {origin.joints[worst]} to stay, and it is {others[worst]:.3f} rad from where it was, "
            f"allowed {START_TOLERANCE:g}; plan anew",
        )


def _pose(base: Base | None) -> Pose:
    return Pose() if base is None else base.pose_in_world


def moved_by(before: Pose, now: Pose, far: float = 0.0, turned: float = 0.0) -> str:
    """'moved 12 mm and turned 3.0°' where poses are further apart than `far` m or `turned` rad; else empty."""
    distance = math.dist(before.position, now.position)
    cosine = abs(sum(a * b for a, b in zip(before.orientation, now.orientation, strict=True)))
    angle = 2.0 * math.acos(min(1.0, cosine / (math.hypot(*before.orientation) * math.hypot(*now.orientation))))
    words = []
    if distance > far + 1e-9:
        words.append(f"moved {1000 * distance:.3g} mm")
    if angle > turned + 1e-6:
        words.append(f"turned {math.degrees(angle):.1f}°")
    return " and ".join(words)
