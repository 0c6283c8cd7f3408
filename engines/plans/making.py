"""Plans made for whoever asks, kept and shown: strokes at an instance, motions to goals; from now, or from where a plan ends."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from affordance_templates import attachments
from affordance_templates.instance import Instance
from engines.activities.base import ActivityFailed, Services
from engines.planning.plan import Infeasible, Plan
from engines.planning.waiting import Cancelled, go_on, never
from engines.plans.freshness import Origin, World
from engines.plans.store import PlanRecord
from handrail.messages import Choice, Choices, EditPlan, KeyFrame, PlanMotion, PlanPreview, RankChoices
from handrail.topics import RefusedError

if TYPE_CHECKING:
    from engines.planning.collision.seen import Seen

_Asked = Callable[[], bool]
_Told = Callable[[str], None]
_TRIES = 6
"""choices of which one must lead to a plan"""


def make_plan(
    services: Services,
    instance: str,
    trajectory: str,
    arm: str,
    *,
    arc: float | None = None,
    entry_shift: float = 0.0,
    after: str = "",
    seen: bool = False,
    relax: Sequence[str] = (),
    run: str = "",
    cancelled: _Asked | None = None,
    progress: _Told | None = None,
) -> tuple[PlanRecord, PlanPreview]:
    """Plan a stroke, keep and show the plan.

    :param arm: empty: the first for which there is a plan, in `rank`'s order
    :param arc: rad, the arc's centre that an earlier stroke chose; None to choose one
    :param entry_shift: rad, how much later than the earliest clear angle to enter
    :param run: id of the run that wants it
    :param after: id of the plan from whose end; empty: from where the robot is commanded
    :param seen: whether to keep clear of what cameras see as well
    :param relax: what gives way where there is no plan (MakePlan.relax)
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
    _check_arms(services, [arm] if arm else [])
    world, others = start_of(services, after), _others(services, instance)
    who = f"the {arm} arm" if arm else "any arm"
    with _telling(f"no plan for {trajectory} at {instance} with {who}", f"can't plan {trajectory} at {instance}"):
        strange = _seen(services, [placed, *others]) if seen else None
        tries: list[tuple[str, float | None]] = [(arm, arc)]
        if not arm:
            choices = services.planner.rank(
                placed, world.command, trajectories=[trajectory], others=others, base=world.base, cancelled=cancelled
            )
            tries = [(choice.arm, choice.arc if arc is None else arc) for choice in choices[:_TRIES]]
        plan = _first_plan(
            lambda arm, arc: services.planner.plan(
                placed,
                trajectory,
                arm,
                world.command,
                arc=arc,
                entry_shift=entry_shift,
                others=others,
                seen=strange.obstacles if strange else (),
                relax=relax,
                base=world.base,
                cancelled=cancelled,
                progress=progress,
            ),
            tries,
        )
    arm = plan.arm
    asked: dict[str, float | str] = {"instance": instance, "trajectory": trajectory, "arm": arm}
    asked |= {"entry_shift": entry_shift} | ({} if arc is None else {"arc": arc}) | ({"after": after} if after else {})
    asked |= {"seen": strange.words} if strange else {}
    origin = Origin(world, services.description.joints, (placed, *others), asked, run)
    return _kept(services, PlanRecord(plan, origin, placed, known[trajectory], after=after))


def _first_plan(plan: Callable[[str, float | None], Plan], tries: Sequence[tuple[str, float | None]]) -> Plan:
    """The first that there is. Raises Infeasible as the first try did, ValueError where nothing can be tried."""
    if not tries:
        raise ValueError("arm: got any; expected a robot that has one")
    first: Infeasible | None = None
    for arm, arc in tries:
        try:
            return plan(arm, arc)
        except Infeasible as problem:
            first = first or problem
    assert first is not None
    raise first


def _check_arms(services: Services, arms: Sequence[str]) -> None:
    for arm in arms:
        if arm not in services.description.arms:
            raise ActivityFailed("refused", f"no arm {arm!r}; expected one of {', '.join(services.description.arms)}")


def _others(services: Services, instance: str) -> list[Instance]:
    there = services.affordances.instances()
    left_out = {instance, *attachments.carried(there)}  # what it carries is where its hand is: no obstacle to that
    return [each for each in there if each.name not in left_out]


def rank_choices(services: Services, call: RankChoices, *, cancelled: _Asked | None = None) -> Choices:
    """Ways to do a behaviour, the best first. Raises ActivityFailed as `make_plan` does."""
    try:
        placed = services.affordances.get(call.instance)
    except RefusedError as refused:
        raise ActivityFailed("refused", str(refused)) from refused
    _check_arms(services, call.arms)
    world = start_of(services, call.after)
    with _telling("no choice", f"can't rank choices at {call.instance}"):
        found = services.planner.rank(
            placed, world.command, trajectories=[call.trajectory] if call.trajectory else [], arms=call.arms,
            others=_others(services, call.instance), base=world.base, cancelled=cancelled,
        )  # fmt: skip
    arms = services.description.arms
    return Choices(
        choices=[
            Choice(
                trajectory=each.trajectory,
                arm=each.arm,
                arc=each.arc,
                share=round(each.share, 3),
                cost=round(each.cost, 3),
                lacks=each.lacks,
                joints=dict(zip(arms[each.arm].joints, each.posture.round(4).tolist(), strict=True)),
            )
            for each in found
        ]
    )


def make_motion(
    services: Services,
    call: PlanMotion,
    *,
    edits: str = "",
    key_frame: str = "",
    run: str = "",
    seeds: Sequence[np.ndarray] = (),
    cancelled: _Asked | None = None,
    progress: _Told | None = None,
) -> tuple[PlanRecord, PlanPreview]:
    """Plan a motion to goals among all instances, keep and show it. Raises ActivityFailed as `make_plan` does.

    :param edits: id of the plan that it is another version of
    :param key_frame: which of that one's it edits: of the edits of one the newest is kept
    :param seeds: (n,) rad each, postures to look for the goals from first
    """
    world, instances = start_of(services, call.after), services.affordances.instances()
    # What the robot carries is where its hand is: no obstacle to that.
    heeding = msgspec.structs.replace(call, ignore=[*call.ignore, *attachments.carried(instances)])
    with _telling("no plan to the goals", "can't plan to the goals"):
        seen = _seen(services, instances) if call.seen else None
        plan = services.planner.motion(
            heeding,
            instances,
            world.command,
            seeds=seeds,
            seen=seen,
            base=world.base,
            cancelled=cancelled,
            progress=progress,
        )
        go_on(cancelled or never)  # nobody wants it any more: it is not shown
    used = tuple(each for each in instances if each.name in plan.made_from)
    asked: dict[str, float | str] = {"goals": plan.label, "arm": call.arm, "clearance": call.clearance}
    asked |= ({"after": call.after} if call.after else {}) | ({"edits": edits} if edits else {})
    asked |= {"seen": seen.words} if seen else {}
    origin = Origin(world, services.description.joints, used, asked, run)
    return _kept(services, PlanRecord(plan, origin, asked=call, after=call.after, edits=edits, key_frame=key_frame))


def _seen(services: Services, instances: Sequence[Instance]) -> Seen:
    """What cameras see now that nobody has placed. Raises ActivityFailed where none sees."""
    now = start_of(services, "")
    seen = services.planner.see(services.clouds(), now.time_ns, now.command, instances)
    if not any(not camera.left_out for camera in seen.cameras):
        raise ActivityFailed("refused", f"can't keep clear of what is seen: {seen.words}")
    return seen


def make_edit(
    services: Services, call: EditPlan, *, cancelled: _Asked | None = None, progress: _Told | None = None
) -> tuple[PlanRecord, PlanPreview]:
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
    if before.along is not None:
        raise ActivityFailed("refused", f"{call.id} ({record.plan.label}) goes with a joint, and has no key frames")
    if call.frame > len(frames):
        raise ActivityFailed("refused", f"frame: got {call.frame}; expected at most {len(frames)}, which is the end")
    changed = msgspec.structs.replace(before, goals=call.goals)
    if call.frame < 0:
        if not call.time <= record.plan.duration:
            raise ActivityFailed("refused", f"time: got {call.time:g}; expected at most {record.plan.duration:.3f} s")
        frames.insert(bisect.bisect(record.plan.key_times, call.time), KeyFrame(goals=call.goals))
        changed = msgspec.structs.replace(before, through=frames)
    elif call.frame < len(frames):
        frames[call.frame] = KeyFrame(goals=call.goals)
        changed = msgspec.structs.replace(before, through=frames)
    key_frame = f"frame {call.frame}" if call.frame >= 0 else f"{call.time:.3f} s"
    return make_motion(services, changed, edits=call.id, key_frame=key_frame, cancelled=cancelled, progress=progress)


def start_of(services: Services, after: str) -> World:
    """What a plan begins with: the world as it is, or as it will be when a plan has been executed. Raises ActivityFailed."""
    world = services.daemon.world()
    if world is None:
        raise ActivityFailed("unknown_state", "the daemon has not told where the robot is: is it running?")
    if not after:
        return world
    try:
        end = services.plans.end(after)
        return replace(end, time_ns=world.time_ns)
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
