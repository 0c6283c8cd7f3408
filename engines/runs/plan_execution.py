"""A plan executed by itself: it can be paused, resumed and stopped, and that acts on the motion."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import Future

from engines.activities.base import ActivityFailed, Services
from engines.activities.execute import check, execute
from engines.plans.store import PlanRecord
from engines.runs.job import Lender, MotionJob
from handrail.messages import PlanPreview
from handrail.topics import RefusedError, refuse

_log = logging.getLogger(__name__)


class PlanExecution(MotionJob):
    """A plan's segments, executed because an operator asked for it, without a program."""

    def __init__(self, services: Services, record: PlanRecord, segments: Sequence[str], lender: Lender | None = None):
        """`lender`: the paused run that it is beside. Raises ActivityFailed when the plan is stale, or has no such segments."""
        check(services, record, segments)
        super().__init__(services, f"execute {record.plan.id}", record.plan.joints, lender)
        self._record, self._segments = record, segments
        self.plan, self.ended = record.plan.id, Future[PlanPreview]()
        """done when nothing moves any more: RefusedError where it did not end as planned"""
        self._thread.start()

    @property
    def active(self) -> bool:
        return not self.ended.done()

    def _drive(self) -> None:
        label, problem = self._record.plan.label, ""
        try:
            self._borrow()
            ended = execute(self._services, self._motion, self._record, self._segments, self._cancelled)
        except RefusedError as refused:
            problem = str(refused)
            self._services.log("error", f"{label}: {problem}")
        except ActivityFailed as failed:
            problem = str(failed)
            self._services.log("info" if failed.reason == "cancelled" else "error", f"{label}: {failed}")
        except Exception as crash:  # noqa: BLE001
            _log.exception("%s crashed", label)
            problem = f"the engine's own error: {type(crash).__name__}: {crash}"
            self._services.log("error", f"{label}: {problem}")
        else:
            level = "info" if ended["outcome"] == "done" else "warning"
            self._services.log(level, f"{label}: {ended['outcome']} after {ended['segment']}")
        finally:
            self._give_back()
        if problem:
            self.ended.set_exception(refuse(problem))
        else:
            self.ended.set_result(self._services.plans.preview(self._record, ghost=False))
