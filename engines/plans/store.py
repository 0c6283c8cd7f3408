"""The plans that the engine has made: by id, with what they were made for and whether they may still be executed."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec

from affordance_templates.instance import Instance
from affordance_templates.template import ResolvedTrajectory
from engines.plans.freshness import Cause, Origin, World, causes
from handrail.messages import ActionEvent, PlanMotion, PlanPreview
from handrail.topics import refuse

if TYPE_CHECKING:
    from engines.planning.plan import Plan

_KEPT = 12
_ELSEWHERE = frozenset({"start_left", "others_moved", "base_moved"})
"""causes that the execution of the plan before it will take away"""


@dataclass
class PlanRecord:
    """A plan, the instance (as it was) and trajectory that it realises, what it was made from, and how far it was executed."""

    plan: Plan
    origin: Origin
    instance: Instance | None = None
    trajectory: ResolvedTrajectory | None = None
    """None: a motion to goals"""
    asked: PlanMotion | None = None
    """of a motion to goals"""
    after: str = ""
    """id of the plan from whose end it was planned; empty: from where the robot was"""
    edits: str = ""
    """id of the plan that it is another version of"""
    key_frame: str = ""
    """which key frame of that one it edits"""
    reached: int = -1
    """index of the segment that was started last, -1: none"""
    ended: ActionEvent | None = None
    """how that one ended"""
    executing: bool = False
    shown_fresh: bool = True
    """what clients were told last"""

    @property
    def finished(self) -> bool:
        """Whether it was executed to its end."""
        at_end = self.reached == len(self.plan.segments) - 1 and not self.executing
        return at_end and self.ended is not None and self.ended.outcome == "done"


class PlanStore:
    """Keeps the last plans. Every method may be called from any thread."""

    def __init__(
        self,
        instances: Callable[[], Iterable[Instance]],
        world: Callable[[], World | None],
        publish: Callable[[PlanPreview], None],
    ):
        """`instances`, `world`: as they are now; `world` is None before the daemon was heard."""
        self._instances, self._world, self._publish = instances, world, publish
        self._lock = threading.RLock()
        self._records: OrderedDict[str, PlanRecord] = OrderedDict()

    def add(self, record: PlanRecord) -> PlanPreview:
        """Keep a new plan and show it.

        A drag makes many edits of one key frame: the newest takes the others' place, but for one that was executed or planned on
        from, and the plan that is edited is kept like a new one.
        """
        with self._lock:
            if record.edits in self._records:
                self._records.move_to_end(record.edits)
                used = {id for each in self._records.values() for id in (each.edits, each.after)}
                same = [
                    id
                    for id, each in self._records.items()
                    if (each.edits, each.key_frame) == (record.edits, record.key_frame)
                ]
                for id in same:
                    if id not in used and self._records[id].reached < 0 and not self._records[id].executing:
                        del self._records[id]
            self._records[record.plan.id] = record
            while len(self._records) > _KEPT:
                self._records.popitem(last=False)
        preview = self.preview(record)
        record.shown_fresh = preview.fresh
        self._publish(preview)
        return preview

    def get(self, id: str) -> PlanRecord:
        """A plan by its id. Refused when there is none (any more)."""
        with self._lock:
            if id not in self._records:
                raise refuse(
                    "no such plan (only the last ones are kept)",
                    "id",
                    id,
                    f"one of: {', '.join(self._records) or 'none made yet'}",
                )
            return self._records[id]

    def causes(self, record: PlanRecord, *, start: bool = True) -> list[Cause]:
        """Why a plan can't be executed any more; empty when it can. `start`: from its beginning, which it can be once, and only
        from where the robot is.
        """
        if start and record.finished:
            return [Cause("executed", "it was executed already; plan anew")]
        now = {instance.name: instance for instance in self._instances()}
        found = causes(record.plan, record.origin, now, self._world(), start=start)
        before = self._records.get(record.after)
        if before is None or before.finished or not any(cause.code in _ELSEWHERE for cause in found):
            return found
        words = f"it begins where {record.after} ({before.plan.label}) ends, which was not executed"
        return [Cause("not_yet", words), *(cause for cause in found if cause.code not in _ELSEWHERE)]

    def end(self, id: str) -> World:
        """Where all joints are when a plan has been executed, and the base. Refused when there is no such plan."""
        record = self.get(id)
        joints = {joint: row for row, joint in enumerate(record.origin.joints)}
        position = record.origin.world.command.copy()
        position[[joints[joint] for joint in record.plan.joints]] = record.plan.segments[-1].positions[-1]
        base, there = record.origin.world.base, record.plan.base_at_end
        if base is not None and there is not None:
            base = msgspec.structs.replace(base, pose_in_world=there)
        return replace(record.origin.world, command=position, base=base)

    def stale(self, record: PlanRecord, *, start: bool = True) -> str:
        """The same in words; empty when the plan can be executed."""
        return "; ".join(cause.words for cause in self.causes(record, start=start))

    def preview(self, record: PlanRecord, *, ghost: bool = True) -> PlanPreview:
        """What clients see of it now. While it runs, the robot has left its start: that does not make it stale.

        `ghost`: with its knots, which are most of its bytes; who was told them once need not be told again.
        """
        why = self.causes(record, start=not record.executing)
        words, codes = "; ".join(cause.words for cause in why), [cause.code for cause in why]
        return record.plan.preview(not why, words, codes, ghost=ghost)

    def details(self, record: PlanRecord) -> PlanPreview:
        """All that is known of it."""
        plan = record.plan
        series = {name: measure.series() for name, measure in plan.measures.items()}
        return msgspec.structs.replace(self.preview(record), origin=record.origin.told(), measures=series)

    def previews(self) -> list[PlanPreview]:
        """All that are kept, oldest first; without a ghost those that nobody can execute any more."""
        with self._lock:
            records = list(self._records.values())
        return [self.preview(record, ghost=self._of_use(record)) for record in records]

    def _of_use(self, record: PlanRecord) -> bool:
        """Whether it can be executed, now or when the plan before it was."""
        return all(cause.code == "not_yet" for cause in self.causes(record, start=not record.executing))

    def instance_changed(self, name: str) -> None:
        """Tell of plans made from an instance that have become stale by it, or fresh again."""
        self._tell_changes(lambda record: any(name == instance.name for instance in record.origin.instances))

    def robot_rested(self) -> None:
        """Tell of plans that have become stale, or fresh again, by where the robot has come to rest."""
        self._tell_changes(lambda record: not record.executing)

    def _tell_changes(self, concerned: Callable[[PlanRecord], bool]) -> None:
        """Only what has changed, and without the ghost: a plan is large, and a link may be slow."""
        with self._lock:
            records = [record for record in self._records.values() if concerned(record)]
        for record in records:
            preview = self.preview(record, ghost=False)
            with self._lock:
                changed, record.shown_fresh = preview.fresh != record.shown_fresh, preview.fresh
            if changed:
                self._publish(preview)
