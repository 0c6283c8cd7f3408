"""What an operator can do about states that can't go on, in words."""

from __future__ import annotations

from collections.abc import Collection

from engines.programs.program import Program, State


def remedies(program: Program, stuck: Collection[str]) -> str:
    """'Move the robot back by hand; plan anew (run from planning_next); ...', for the states of these ids."""
    found = ["move the robot back by hand"]
    states = list(program.states())
    for state in (each for each in states if each.id in stuck):
        planning = [each.id for each in states if each.file.do == "plan" and _leads_to(each, state.id)]
        found += [f"plan anew (run from {id})" for id in planning]
        found.append(f"retry (run from {state.id})")
        if any(
            way.file.target and f"done.invoke.{state.id}" in (way.file.event or "").split() for way in state.transitions
        ):
            found.append(f"skip {state.id}")
    first, *others = found
    last = "or resume once more: the program goes its own way for what can't go on"
    return "; ".join([first.capitalize(), *others, last])


def _leads_to(state: State, id: str) -> bool:
    return any(id in str(way.file.target or "").split() for way in state.transitions)
