"""Plans made for whoever asks, kept and shown: strokes at an instance, motions to goals; from now, or from where a plan ends."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import msgspec
import numpy as np

from engines.activities.base import ActivityFailed, Services
from engines.freshness import Origin, World
from engines.planning.plan import Cancelled, Infeasible
from engines.plans import PlanRecord
from handrail.messages import EditPlan, KeyFrame, PlanMotion, PlanPreview
from handrail.topics import RefusedError

_Asked = Callable[[], bool]


def make_plan(
    services: Services,
    instance: str,
    trajectory: str,
    arm: str,
    *,
    arc: float | None = None,
    entry_shift: float = 0.0,
    after: str = "",
    run: str = "",
    cancelled: _Asked | None = None,
) -> tuple[PlanRecord, PlanPreview]:
    """Plan a stroke, keep and show the plan.

    :param arc: rad, the arc's centre that an earlier stroke chose; None to choose one
    :param entry_shift: rad, how much later than the earliest clear angle to enter
    :param run: id of the run that wants it
    :param after: id of the plan from whose end; empty: from where the robot is commanded
    :raises ActivityFailed: `infeasible` with the constraint that failed and by how much, `refused` for names that are not there,
        `unknown_state` before the daemon was heard
    """
    try:
        placed = services.affordances.get(instance)
    except RefusedError as refused:
        raise ActivityFailed("refused", str(refused)) from refused
    known = placed.resolve().trajectories
    if trajectory not in known:
        raise ActivityFailed(
            "refused",
            f"template {placed.template.name} has no trajectory {trajectory!r}; expected one of {', '.join(known)}",
        )
    if arm not in services.description.arms:
        raise ActivityFailed("refused", f"no arm {arm!r}; expected one of {', '.join(services.description.arms)}")
    world = start_of(services, after)
    with _telling(
        f"no plan for {trajectory} at {instance} with the {arm} arm", f"can't plan {trajectory} at {instance}"
    ):
        plan = services.planner.plan(
            placed, trajectory, arm, world.command, arc=arc, entry_shift=entry_shift, cancelled=cancelled
        )
    asked: dict[str, float | str] = {"instance": instance, "trajectory": trajectory, "arm": arm}
    asked |= {"entry_shift": entry_shift} | ({} if arc is None else {"arc": arc}) | ({"after": after} if after else {})
    origin = Origin(world, services.description.joints, (placed,), asked, run)
    return _kept(services, PlanRecord(plan, origin, placed, known[trajectory], after=after))


def make_motion(
    services: Services,
    call: PlanMotion,
    *,
    edits: str = "",
    run: str = "",
    seeds: Sequence[np.ndarray] = (),
    cancelled: _Asked | None = None,
) -> tuple[PlanRecord, PlanPreview]:
    """Plan a motion to goals among all instances, keep and show it. Raises ActivityFailed as `make_plan` does.

    :param edits: id of the plan that it is another version of
    :param seeds: (n,) rad each, postures to look for the goals from first
    """
    world, instances = start_of(services, call.after), services.affordances.instances()
    with _telling("no plan to the goals", "can't plan to the goals"):
        plan = services.planner.motion(call, instances, world.command, seeds=seeds, cancelled=cancelled)
    used = tuple(each for each in instances if each.name in plan.made_from)
    asked: dict[str, float | str] = {"goals": plan.label, "arm": call.arm, "clearance": call.clearance}
    asked |= ({"after": call.after} if call.after else {}) | ({"edits": edits} if edits else {})
    origin = Origin(world, services.description.joints, used, asked, run)
    return _kept(services, PlanRecord(plan, origin, asked=call, after=call.after))


def make_edit(services: Services, call: EditPlan) -> tuple[PlanRecord, PlanPreview]:
    """Plan a motion anew with a key frame more or another one, keep and show it. Raises ActivityFailed as `make_plan` does."""
    try:
        record = services.plans.get(call.id)
    except RefusedError as refused:
        raise ActivityFailed("refused", str(refused)) from refused
    before = record.asked
    if before is None:
        raise ActivityFailed(
            "refused",
            f"{call.id} ({record.plan.label}) is a stroke at a template, and has no key frames; expected a motion to goals. "
            "Move the template, or plan a motion and the stroke from where it ends",
        )
    frames = list(before.through)
    if call.frame > len(frames):
        raise ActivityFailed("refused", f"frame: got {call.frame}; expected at most {len(frames)}, which is the end")
    if call.frame == len(frames):
        return make_motion(services, msgspec.structs.replace(before, goals=call.goals), edits=call.id)
    if call.frame >= 0:
        frames[call.frame] = KeyFrame(goals=call.goals)
    else:
        if not call.time <= record.plan.duration:
            raise ActivityFailed("refused", f"time: got {call.time:g}; expected at most {record.plan.duration:.3f} s")
        frames.insert(bisect.bisect(record.plan.key_times, call.time), KeyFrame(goals=call.goals))
    return make_motion(services, msgspec.structs.replace(before, through=frames), edits=call.id)


def start_of(services: Services, after: str) -> World:
    """What a plan begins with: the world as it is, or as it will be when a plan has been executed. Raises ActivityFailed."""
    world = services.daemon.world()
    if world is None:
        raise ActivityFailed("unknown_state", "the daemon has not told where the robot is: is it running?")
    if not after:
        return world
    try:
        return replace(world, command=services.plans.end(after))
    except RefusedError as refused:
        raise ActivityFailed("refused", f"after: {refused}") from refused


def _kept(services: Services, record: PlanRecord) -> tuple[PlanRecord, PlanPreview]:
    return record, services.plans.add(record)


@contextmanager
def _telling(infeasible: str, refused: str) -> Iterator[None]:
    """What planners raise, as failures of an activity, after these words."""
    try:
        yield
    except Infeasible as problem:
        raise ActivityFailed("infeasible", f"{infeasible}: {problem}") from problem
    except ValueError as problem:
        raise ActivityFailed("refused", f"{refused}: {problem}") from problem
    except Cancelled as problem:
        raise ActivityFailed("cancelled", "planning was cancelled") from problem
