"""A program's states as clients see them: a tree to light up, to set breakpoints in, and to run from."""

from __future__ import annotations

from engines.programs.deployment import Deployed
from handrail.messages import Outline, OutlineState


def outline(deployed: Deployed) -> Outline:
    """What clients learn of a deployed program's states."""
    program = deployed.program
    return Outline(
        deployment=deployed.id,
        program=program.name,
        title=program.title,
        hash=program.hash,
        states=[
            OutlineState(
                id=state.id,
                parent=state.parent.id if state.parent is not None else "",
                title=state.file.title,
                does=state.file.do,
                parallel=state.file.parallel,
                outcome=state.file.outcome if state.file.final else "",
                ways=[way.file.target or "" for way in state.transitions],
            )
            for state in program.states()
        ],
    )
