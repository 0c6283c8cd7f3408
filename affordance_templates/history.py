"""What each operator did, to be taken back and done again without touching what others did meanwhile.

Every value that is written gets a mark of its own. A step knows the marks before and after it: it is taken back in those fields
that still bear its own mark, which then bear the one from before again. So a value is never mistaken for an equal one of somebody
else's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from affordance_templates.fields import Value
from handrail.messages import InstanceState

_KEPT = 100
"""steps an operator can go back"""


class Mark(msgspec.Struct, frozen=True):
    """One writing of a field."""

    number: int = 0
    """of all writings, counted from 1; 0: since before they were counted"""
    by: str = ""


class Change(msgspec.Struct, frozen=True):
    """What one step made of one field."""

    before: Value
    after: Value
    mark_before: Mark
    mark_after: Mark


class Whole(msgspec.Struct, frozen=True):
    """An instance as it was placed or taken away."""

    state: InstanceState
    marks: dict[str, Mark]


class Step(msgspec.Struct, frozen=True):
    """One thing that an operator did to one instance."""

    name: str
    kind: Literal["edit", "place", "remove"] = "edit"
    changes: dict[str, Change] = {}
    whole: Whole | None = None
    """of `place` and `remove`"""
    drag: int = 0
    """the hold that it was done under, 0: none; what is done under one hold is one step"""

    def joined(self, later: Step) -> Step:
        """This step and a later one of the same drag as one. Of a field that others wrote in between, the later one alone."""
        changes = dict(self.changes)
        for field, change in later.changes.items():
            mine = changes.get(field)
            unbroken = mine is not None and mine.mark_after == change.mark_before
            first = mine if mine is not None and unbroken else change
            changes[field] = Change(first.before, change.after, first.mark_before, change.mark_after)
        return msgspec.structs.replace(self, changes=changes)


class History(msgspec.Struct, frozen=True):
    """One operator's steps, oldest first."""

    done: tuple[Step, ...] = ()
    undone: tuple[Step, ...] = ()

    def with_step(self, step: Step) -> History:
        """After the operator did something: nothing that was taken back can be done again."""
        last = self.done[-1] if self.done else None
        if last is not None and step.drag and (last.drag, last.name, last.kind) == (step.drag, step.name, "edit"):
            return History((*self.done[:-1], last.joined(step)))
        return History((*self.done, step)[-_KEPT:])

    def undo(self, again: Step | None) -> History:
        """After the last step was taken back; `again`: what of it was, None: nothing."""
        return History(self.done[:-1], self.undone if again is None else (*self.undone, again))

    def redo(self, again: Step | None) -> History:
        """After the step that was taken back last was done again."""
        return History(self.done if again is None else (*self.done, again), self.undone[:-1])


def possible(
    step: Step, marks: Mapping[str, Mark], *, back: bool
) -> tuple[dict[str, tuple[Value, Mark]], dict[str, str]]:
    """(field → value and mark that it is to have, field → whose writing since keeps it) of an edit, undone (`back`) or redone."""
    able, kept = {}, {}
    for field, change in step.changes.items():
        expected = change.mark_after if back else change.mark_before
        now = marks.get(field, Mark())
        if now == expected:
            able[field] = (change.before, change.mark_before) if back else (change.after, change.mark_after)
        else:
            kept[field] = now.by
    return able, kept
