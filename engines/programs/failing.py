"""What becomes of a program when what a state does has failed: whether it has a way on, or ends by it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from engines.programs.check import takes
from engines.programs.program import State

FAILED = "error.execution"
"""the event of it"""


def ends(state: State, states: Mapping[str, State], tries_again: Callable[[State], bool]) -> bool:
    """Whether a failure of what `state` does would end the whole program as failed, or leave it where nothing goes on.

    Every way out for a failure counts, whatever its guard: that is known only once it has failed. One that the operator is asked
    about is no end.

    :param states: id → state, of the program and of those that it runs
    :param tries_again: whether what a state does (a program that it runs) would be begun anew instead
    """
    if tries_again(state):
        return False
    own = (each for each in state.lineage() if each.scope == state.scope)
    ways = [way.file for each in own for way in each.transitions if takes(way, FAILED)]
    return all(not way.autonomy and _fails(state, way.target, states, tries_again) for way in ways)


def _fails(state: State, target: str | None, states: Mapping[str, State], tries_again: Callable[[State], bool]) -> bool:
    """Whether a way out of `state` leads to the end of its program as failed, and that to the end of all."""
    goals = [states[id] for id in (target or "").split()]
    at_top = [each for each in goals if each.file.final and (each.parent is None or each.parent.called is not None)]
    if not goals or at_top != goals or any(each.file.outcome == "succeeded" for each in goals):
        return False
    return not state.scope or ends(states[state.scope], states, tries_again)
