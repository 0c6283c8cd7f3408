"""The plans that the engine has made: by id, with what they were made for and whether they may still be executed."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from affordance_templates.instance import Instance
from affordance_templates.template import ResolvedTrajectory
from handrail.messages import ActionEvent, PlanPreview
from handrail.topics import refuse

if TYPE_CHECKING:
    from engines.planning.plan import Plan

_KEPT = 12


@dataclass
class PlanRecord:
    """A plan, the instance (as it was) and trajectory that it realises, and how far it was executed."""

    plan: Plan
    instance: Instance
    trajectory: ResolvedTrajectory
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
        rows: Callable[[tuple[str, ...]], np.ndarray],
        versions: Callable[[], Mapping[str, int]],
        command: Callable[[], np.ndarray | None],
        publish: Callable[[PlanPreview], None],
    ):
        """`rows`: joints → their rows in the robot's arrays; `versions`, `command`: as they are now."""
        self._rows, self._versions, self._command, self._publish = rows, versions, command, publish
        self._lock = threading.RLock()
        self._records: OrderedDict[str, PlanRecord] = OrderedDict()

    def add(self, record: PlanRecord) -> PlanPreview:
        """Keep a new plan and show it."""
        with self._lock:
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

    def stale(self, record: PlanRecord, *, start: bool = True) -> str:
        """Why a plan can't be executed any more, in words; empty when it can. `start`: from its beginning, which it can be once,
        and only from where the robot is.
        """
        if start and record.finished:
            return "it was executed already; plan anew"
        command = self._command() if start else None
        return record.plan.stale(self._versions(), None if command is None else command[self._rows(record.plan.joints)])

    def preview(self, record: PlanRecord) -> PlanPreview:
        """What clients see of it now. While it runs, the robot has left its start: that does not make it stale."""
        why = self.stale(record, start=not record.executing)
        return record.plan.preview(not why, why)

    def previews(self) -> list[PlanPreview]:
        """All that are kept, oldest first."""
        with self._lock:
            records = list(self._records.values())
        return [self.preview(record) for record in records]

    def instance_changed(self, name: str) -> None:
        """Show those plans made from an instance again that have become stale by it: a plan is large, and a link may be slow."""
        with self._lock:
            records = [record for record in self._records.values() if name in record.plan.made_from]
        for record in records:
            preview = self.preview(record)
            if preview.fresh != record.shown_fresh:
                record.shown_fresh = preview.fresh
                self._publish(preview)
