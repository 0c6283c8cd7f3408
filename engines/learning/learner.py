"""Learns from each run of an engine, and says when the next one looks like those that failed."""

from __future__ import annotations

import datetime
import logging
import threading
from collections.abc import Callable, Iterable, Sequence

from affordance_templates.instance import Instance
from engines.learning.book import BookError, PastRun, RunBook
from engines.learning.facts import Facts, beforehand
from engines.learning.predictors import Predictor, predictors, warnings
from engines.programs.deployment import Deployed
from handrail.messages import RunState

_log = logging.getLogger(__name__)


class Learner:
    """One robot's. A book that can't be used is logged once and learning is off: no run ends because of it."""

    def __init__(self, robot: str, book: RunBook | None, instances: Callable[[], Iterable[Instance]]):
        """`instances`: as they are now."""
        self._robot, self._book, self._instances = robot, book, instances
        self._lock = threading.Lock()
        self._known: dict[str, Sequence[Predictor]] = {}

    def before(self, deployed: Deployed) -> list[str]:
        """Why a run of this, as the world is now, looks like failures; empty where nothing says so."""
        return self.warnings(deployed.program.name, beforehand(deployed, self._instances()))

    def watch(self, deployed: Deployed) -> RunWatch:
        """For a run that begins now."""
        return RunWatch(self, deployed, beforehand(deployed, self._instances()))

    def warnings(self, program: str, facts: Facts) -> list[str]:
        """What past runs of a program say of one with these facts."""
        with self._lock:
            found = self._known.get(program)
        if found is None:
            runs: list[PastRun] = []
            self._with_book(lambda book: runs.extend(book.runs(self._robot, program)))
            found = predictors(runs)
            with self._lock:
                self._known[program] = found
        return warnings(found, facts)

    def keep(self, state: RunState, duration_s: float, facts: Facts) -> None:
        """Write a run down that has ended."""
        past = PastRun(
            id=state.run,
            robot=self._robot,
            program=state.program,
            hash=state.hash,
            ended=datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds"),
            duration_s=duration_s,
            status=state.status,
            detail=state.detail,
            facts=facts,
        )
        self._with_book(lambda book: book.add(past))
        with self._lock:
            self._known.pop(state.program, None)

    def _with_book(self, do: Callable[[RunBook], object]) -> None:
        book = self._book
        if book is None:
            return
        try:
            do(book)
        except BookError as problem:
            _log.warning("nothing is learnt from runs any more: %s", problem)
            self._book = None


class RunWatch:
    """One run's: what was known when it began counts, whatever is moved later."""

    def __init__(self, learner: Learner, deployed: Deployed, begun: Facts):
        self._learner, self._program, self._begun = learner, deployed.program.name, begun

    def warnings(self, noted: Facts) -> list[str]:
        """Why it looks like failures, with what it has met by now."""
        return self._learner.warnings(self._program, {**self._begun, **noted})

    def ended(self, state: RunState, duration_s: float, noted: Facts) -> None:
        """It has, by whatever it met."""
        self._learner.keep(state, duration_s, {**self._begun, **noted})
