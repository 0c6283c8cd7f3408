"""`do: execute`: run a plan's segments, one action each, and note what the tool's motion did to the template's joint."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from affordance_templates.joint_estimate import angle_about, joint_after_push
from affordance_templates.template import ResolvedWaypoint
from engines.activities.base import Activity, ActivityFailed, Argument, Kind, Services
from engines.plans.store import PlanRecord
from engines.runs.motion import Motion, MotionFailed
from engines.runs.preconditions import Precondition
from handrail import compound_tasks
from handrail.messages import ActionEvent, Along
from handrail.topics import RefusedError
from handrail.workspace import files


def waypoint_of(record: PlanRecord, segment: str) -> ResolvedWaypoint | None:
    """The waypoint that a segment leads to; None for the planner's own, such as `return`, and for motions to goals."""
    if record.trajectory is None:
        return None
    return next((waypoint for waypoint in record.trajectory.waypoints if waypoint.name == segment), None)


def left_to(record: PlanRecord, waypoint: str) -> list[str]:
    """The segments of a stroke that are left until the tool is at a waypoint, the planner's own among them; none: it is there, or
    the stroke began further on.

    :raises ActivityFailed: `refused` for a plan that is none of a stroke, a waypoint that is not there, and after a segment that
        was not gone to its end
    """
    id = record.plan.id
    if record.trajectory is None:
        raise ActivityFailed("refused", f"to: plan {id} ({record.plan.label}) is no stroke, and has no waypoints")
    order = [each.name for each in record.trajectory.waypoints]
    if waypoint not in order:
        raise ActivityFailed("refused", f"to: got {waypoint!r}; expected one of {', '.join(order)}")
    names = [segment.name for segment in record.plan.segments]
    if record.reached >= 0 and (record.ended is None or record.ended.outcome != "done"):
        stopped = names[record.reached]
        raise ActivityFailed(
            "refused", f"plan {id} was stopped in {stopped}, and does not go on from its middle; plan anew"
        )
    wanted = order[: order.index(waypoint) + 1]
    end = max((number + 1 for number, name in enumerate(names) if name in wanted), default=0)
    return names[record.reached + 1 : end]


def check(services: Services, record: PlanRecord, segments: Sequence[str]) -> None:
    """Raise ActivityFailed when the plan is stale (with the reason) or has no such segments."""
    names = [segment.name for segment in record.plan.segments]
    for name in segments:
        if name not in names:
            raise ActivityFailed(
                "refused", f"plan {record.plan.id} has no segment {name!r}; expected some of {', '.join(names)}"
            )
    compound = record.plan.compound
    if compound and compound not in files(compound_tasks.folders(services.description.folder)):
        raise ActivityFailed(
            "refused",
            f"plan {record.plan.id} moves legs, and {services.description.name} has no compound task {compound!r} to follow it "
            f"with; expected {compound}.yaml in its compound_tasks",
        )
    whole = not segments or names[0] in segments
    if why := services.plans.stale(record, start=whole):
        raise ActivityFailed("stale", f"the plan is stale: {why}")


def execute(
    services: Services, motion: Motion, record: PlanRecord, segments: Sequence[str], cancelled: threading.Event, *,
    still: Callable[[], str] = lambda: "",
) -> dict[str, Any]:  # fmt: skip
    """Run the segments (all, or those named) in order; stops after one that a guard ended.

    :param still: why they may not be run, beside the plan's own reasons, in words; empty while they may
    :return: see `ExecuteActivity.outputs`
    :raises ActivityFailed: `stale`, or what made a motion fail
    """
    check(services, record, segments)

    def fresh() -> str:
        why = services.plans.stale(record, start=False) or motion.strayed(record.plan.joints)
        return f"the plan is stale: {why}" if why else still()

    turned = 0.0
    record.executing = True
    try:
        for index, segment in enumerate(record.plan.segments):
            if segments and segment.name not in segments:
                continue
            try:
                action = record.plan.motion(segment)
                ended = motion.run(action, segment.ends, cancelled, what=segment.name, still=fresh)
            except MotionFailed as failed:
                if failed.started:
                    record.reached, record.ended = index, None
                raise ActivityFailed(failed.reason, str(failed)) from failed
            record.reached, record.ended = index, ended
            turned += note_push(services, record, segment.name, record.ended)
            if record.ended.outcome != "done":
                break
    finally:
        record.executing = False
    assert record.ended is not None  # a plan has segments, and `check` has found those named
    return {
        "outcome": record.ended.outcome,
        "segment": record.plan.segments[record.reached].name,
        "turned": turned,
        "turned_deg": math.degrees(turned),
    }


def note_push(services: Services, record: PlanRecord, segment: str, ended: ActionEvent) -> float:
    """After a segment along the entry's arc, note where the instance's joint must be now. Returns by how much it moved, rad."""
    if record.asked is not None and record.asked.along is not None:
        return _note_along(services, record.asked.along, ended)
    if record.instance is None or record.trajectory is None:
        return 0.0
    waypoint, entry = waypoint_of(record, segment), record.trajectory.entry
    if waypoint is None or entry is None or waypoint.to != "arc_end" or waypoint.joint != entry.joint:
        return 0.0
    joint = record.instance.resolve().joints[entry.joint]
    tip = record.instance.point_in_template(services.tip(np.array(ended.position), record.plan.arm))
    outputs = record.plan.outputs
    angle = angle_about(joint, waypoint.position, tip, near=outputs["end_angle"])
    after = joint_after_push(joint, entry, outputs["entry_angle"], angle)
    try:
        services.affordances.set_joint(record.instance.name, joint.name, after)
    except RefusedError as gone:
        raise ActivityFailed("stale", f"{record.instance.name} was removed while it was being used") from gone
    return after - joint.position


def _note_along(services: Services, along: Along, ended: ActionEvent) -> float:
    """What the tool held has gone with it, all the way if it was not stopped: else nobody knows how far."""
    if ended.outcome != "done":
        return 0.0
    try:
        instance = services.affordances.get(along.instance)
        now = instance.resolve().joints[along.joint].position
        services.affordances.set_joint(along.instance, along.joint, now + along.by)
    except RefusedError as gone:
        raise ActivityFailed("stale", f"{along.instance} was removed while it was being used") from gone
    return along.by


def fresh(services: Services, motion: Motion, record: PlanRecord, segments: Sequence[str]) -> Iterator[Precondition]:
    """That a plan can be executed, or gone on with: a precondition for each thing that may have made it stale."""
    under_way = record.executing
    whole = not segments or record.plan.segments[0].name in segments
    what = f"{record.plan.id} ({record.plan.label}) can be {'gone on with' if under_way else 'executed'}"
    causes = services.plans.causes(record, start=whole and not under_way)
    for cause in causes:
        yield Precondition(what, False, cause.words)
    if not causes:
        yield Precondition(what, True)
    if under_way:
        others = motion.strayed(record.plan.joints)
        yield Precondition(what, not others, others)


class ExecuteActivity(Activity):
    """Runs a plan. Done with `outcome` `done`, or the name of the guard that ended it in `segment`.

    A stroke can be gone in parts: as far as the waypoint `to`, from where it was gone to before.
    """

    arguments = {
        "plan": Argument(Kind.VALUE),
        "segments": Argument(Kind.NAMES, required=False, default=()),
        "to": Argument(Kind.TEXT, required=False, default=""),
    }
    outputs = frozenset({"outcome", "segment", "turned", "turned_deg"})

    @classmethod
    def problem(cls, given: Mapping[str, Any]) -> tuple[str, str]:
        """See Activity."""
        return ("to", "beside segments; expected one of both") if "to" in given and "segments" in given else ("", "")

    def run(self) -> dict[str, Any]:
        try:
            record = self.services.plans.get(str(self.values["plan"]))
        except RefusedError as refused:
            raise ActivityFailed("refused", str(refused)) from refused
        segments, to = self.values["segments"], self.values["to"]
        if to and not (segments := left_to(record, to)):
            check(self.services, record, [record.plan.segments[max(record.reached, 0)].name])
            return {"outcome": "done", "segment": to, "turned": 0.0, "turned_deg": 0.0}
        return execute(self.services, self.context.motion, record, segments, self.cancelled)

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        try:
            record = self.services.plans.get(str(self.values["plan"]))
        except RefusedError as refused:
            yield Precondition("there is the plan to execute", False, str(refused))
            return
        segments = self.values["segments"]
        if self.values["to"] and not record.executing:
            try:
                segments = left_to(record, self.values["to"])
            except ActivityFailed as failed:
                yield Precondition("the plan goes on from where it was gone to", False, str(failed))
                return
        yield from fresh(self.services, self.context.motion, record, segments)
        yield from super().preconditions()

    def cancel(self) -> None:
        super().cancel()
        self.context.motion.interrupt()
