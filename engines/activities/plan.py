"""`do: plan`: plan a template's trajectory for an arm from where the robot is commanded to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from engines.activities.base import Activity, ActivityFailed, Argument, Kind, Services
from engines.freshness import Origin
from engines.plans import PlanRecord
from handrail.messages import PlanPreview
from handrail.topics import RefusedError


def make_plan(
    services: Services,
    instance: str,
    trajectory: str,
    arm: str,
    *,
    arc: float | None = None,
    entry_shift: float = 0.0,
    cancelled: Callable[[], bool] | None = None,
    run: str = "",
) -> tuple[PlanRecord, PlanPreview]:
    """Plan, keep and show the plan.

    :param arc: rad, the arc's centre that an earlier stroke chose; None to choose one
    :param entry_shift: rad, how much later than the earliest clear angle to enter
    :param run: id of the run that wants it
    :raises ActivityFailed: `infeasible` with the constraint that failed and by how much, `refused` for names that are not there,
        `unknown_state` before the daemon was heard
    """
    from engines.planning.plan import (  # loads pinocchio: the checks of `handrail program check` do without
        Cancelled,
        Infeasible,
    )

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
    world = services.daemon.world()
    if world is None:
        raise ActivityFailed("unknown_state", "the daemon has not told where the robot is: is it running?")
    try:
        plan = services.planner.plan(
            placed, trajectory, arm, world.command, arc=arc, entry_shift=entry_shift, cancelled=cancelled
        )
    except Infeasible as problem:
        raise ActivityFailed(
            "infeasible", f"no plan for {trajectory} at {instance} with the {arm} arm: {problem}"
        ) from problem
    except ValueError as problem:
        raise ActivityFailed("refused", f"can't plan {trajectory} at {instance}: {problem}") from problem
    except Cancelled as problem:
        raise ActivityFailed("cancelled", "planning was cancelled") from problem
    asked: dict[str, float | str] = {"instance": instance, "trajectory": trajectory, "arm": arm}
    asked |= {"entry_shift": entry_shift} | ({} if arc is None else {"arc": arc})
    origin = Origin(world, services.description.joints, (placed,), asked, run)
    record = PlanRecord(plan, placed, known[trajectory], origin)
    return record, services.plans.add(record)


class PlanActivity(Activity):
    """Plans one visit; the later strokes of a task pass the `arc` that the first one chose."""

    arguments = {
        "instance": Argument(Kind.INSTANCE),
        "trajectory": Argument(Kind.NAME),
        "arm": Argument(Kind.ARM),
        "arc": Argument(Kind.NUMBER, required=False, unit="rad"),
        "entry_shift": Argument(Kind.NUMBER, required=False, default=0.0, unit="rad"),
    }
    outputs = frozenset({"plan", "arc_centre", "clearance", "limit_margin", "duration"})

    def run(self) -> dict[str, Any]:
        self.services.daemon.hold_time(self.context.hold_s)
        values = self.values
        record, preview = make_plan(
            self.services,
            values["instance"],
            values["trajectory"],
            values["arm"],
            arc=values["arc"],
            entry_shift=values["entry_shift"] or 0.0,
            cancelled=self.cancelled.is_set,
            run=self.context.run,
        )
        return {
            "plan": record.plan.id,
            "arc_centre": record.plan.outputs.get("arc_centre"),
            "clearance": preview.clearance,
            "limit_margin": preview.limit_margin,
            "duration": preview.duration,
        }
