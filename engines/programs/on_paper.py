"""A program played through with activities that are somebody's own, without an engine and a robot: for tests of programs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from engines.activities.base import Activity, Context
from engines.programs import library
from engines.programs.program import State
from engines.programs.statechart import Chart

_MOST_VISITS = 1000
_PATIENCE_S = 60.0

Fake = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""what an activity was given → what it found; raises engines.activities.base.ActivityFailed to fail"""


class _Fake(Activity):
    def __init__(self, work: Callable[[], Mapping[str, Any]], values: Mapping[str, Any]):
        super().__init__(cast(Context, SimpleNamespace(services=None)), values)
        self._work = work

    def run(self) -> dict[str, Any]:
        return dict(self._work())


class Played:
    """One run, from its beginning to its end. Time-outs do not come."""

    def __init__(self, program: str | Path, fakes: Mapping[str, Fake], **names: Any):
        """Raises ConfigError for an unsound program, ValueError where a fake is missing, TimeoutError where nothing follows.

        :param program: its name in the library, or its file
        :param fakes: by what `do` says
        :param names: resources, and parameters and variables that are not to have their defaults
        """
        found = library.load(str(program))
        needed = {state.file.do for state in found.states() if state.file.do and state.called is None}
        if missing := sorted(needed - fakes.keys()):
            raise ValueError(f"fakes: {missing[0]} is missing; expected all of {', '.join(sorted(needed))}")
        self.visits: list[str] = []
        """states that did something, in the order in which they were entered"""
        self.given: list[tuple[str, dict[str, Any]]] = []
        """state, what its activity was given"""
        lock = threading.Lock()

        def make(state: State, values: Mapping[str, Any]) -> Activity:
            given = {name: value for name, value in values.items() if name in state.file.with_}
            with lock:
                self.visits.append(state.id)
                self.given.append((state.id, given))
                if len(self.visits) > _MOST_VISITS:
                    raise RuntimeError(f"{found.name} goes on and on: {' '.join(self.visits[-6:])} ...")
            return _Fake(lambda: fakes[state.file.do](given), values)

        parameters = {name: parameter.default for name, parameter in found.parameters.items()}
        chart = Chart(found, {**found.variables, **parameters, **names}, make)
        chart.begin()
        while (end := chart.ended) is False:
            if not chart.step(_PATIENCE_S):
                raise TimeoutError(f"{found.name}: nothing follows in {', '.join(chart.active())}")
        assert isinstance(end, State)
        self.outcome, self.detail = str(end.file.outcome), chart.words(end.file.detail)
