"""What a run tells as lines for people: that it begins, pauses and ends, and each state that it enters."""

from __future__ import annotations

from handrail.messages import RunState


class Spoken:
    """Of one engine's runs, one after the other."""

    def __init__(self) -> None:
        self._before: RunState | None = None

    def lines(self, state: RunState) -> list[str]:
        """What is new since the last state of the same run."""
        before = self._before if self._before is not None and self._before.run == state.run else None
        self._before = state
        was, found = [] if before is None else before.active, list[str]()
        if before is None or before.status != state.status:
            found.append(f"{state.status}: {state.detail}" if state.detail else state.status)
        entered = [each for each in state.active if each not in was]
        if state.status == "running" and entered:
            found.append(f"in {entered[-1]}")
        return found
