"""Undo and redo, as the affordance server does them: each operator his own, and nothing of anybody else's."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec

from affordance_templates import attachments, checks, fields, history
from affordance_templates.fields import Value
from affordance_templates.history import History, Mark, Step, Whole
from affordance_templates.instance import Instance
from affordance_templates.instance_file import Kept
from affordance_templates.placement import Array
from affordance_templates.template_file import Template
from handrail.messages import InstanceEdit, InstanceState, RedoEdit, UndoEdit
from handrail.topics import refuse

LOCAL = "local"
"""the operator of calls that no link has signed: they come from the robot itself"""
ROBOT = "the robot"
"""who writes joints that its own motions have turned"""


class Undoing:
    """Part of `affordance_templates.server.AffordanceServer`."""

    _now: Kept
    _lock: threading.RLock
    _find: Callable[[str], Template]
    _changed: Callable[[InstanceState], None]

    if TYPE_CHECKING:  # the server has them

        def _commit(self, now: Kept) -> None: ...
        def _history(self, by: str) -> History: ...
        def _whole(self, instance: Instance) -> Whole: ...
        def _not_held(self, name: str, by: str) -> None: ...
        def _hangs(self, name: str, to: str) -> str: ...
        def _place_of(self, to: str) -> Array | None: ...
        def _told_gone(self, gone: Instance) -> None: ...
        def _with_values(self, old: Instance, values: Mapping[str, Value]) -> Instance: ...
        def _keep(
            self, now: Kept, old: Instance, new: Instance, marks: Mapping[str, Mark], moved: list[str], by: str
        ) -> Instance: ...

    def undo(self, request: UndoEdit) -> InstanceEdit:
        """Take back the operator's last step, but for fields that others have changed since. Refused when there is none."""
        return self._step(request.by or LOCAL, back=True)

    def redo(self, request: RedoEdit) -> InstanceEdit:
        """Do again what the operator took back last. Refused when there is none."""
        return self._step(request.by or LOCAL, back=False)

    def _step(self, by: str, *, back: bool) -> InstanceEdit:
        with self._lock:
            steps = self._history(by)
            if not (steps.done if back else steps.undone):
                raise refuse(f"nothing to {'undo' if back else 'redo'}: {by} has done nothing that is still known")
            step = steps.done[-1] if back else steps.undone[-1]
            after = steps.undo if back else steps.redo
            if step.kind == "edit":
                return self._edit_again(step, by, after, back=back)
            if (step.kind == "remove") == back:
                return self._place_again(step, by, after)
            return self._remove_again(step, by, after)

    def _edit_again(self, step: Step, by: str, after: Callable[[Step | None], History], *, back: bool) -> InstanceEdit:
        old = self._now.instances.get(step.name)
        if old is None:
            self._commit(self._now.with_history(by, after(None)))
            return InstanceEdit(
                name=step.name, instance=None, left={each: f"{step.name} is gone" for each in step.changes}
            )
        able, kept = history.possible(step, self._now.marks.get(step.name, {}), back=back)
        left = {each: f"{writer or 'somebody'} has changed it since" for each, writer in kept.items()}
        for each in [each for each in able if fields.value(old, each) is None]:
            del able[each]
            left[each] = f"the template {old.template.name} has it no more"
        self._whole_places_only(step, able, left, back=back)
        if set(able) & set(fields.WHERE):
            self._not_held(step.name, by)
        new = self._with_values(old, {each: one for each, (one, _) in able.items()})
        if problem := checks.shape(new):
            left |= dict.fromkeys(able, f"the template has no shape like that: {problem}")
            able, new = {}, old
        moved = [each for each, (one, _) in able.items() if fields.value(old, each) != one]
        again = msgspec.structs.replace(step, changes={each: step.changes[each] for each in able}, drag=0)
        marks = {**self._now.marks.get(step.name, {}), **{each: mark for each, (_, mark) in able.items()}}
        new = self._keep(self._now.with_history(by, after(again if able else None)), old, new, marks, moved, by)
        return InstanceEdit(name=step.name, instance=new.state(), fields=moved, left=left)

    def _whole_places_only(
        self, step: Step, able: dict[str, tuple[Value, Mark]], left: dict[str, str], *, back: bool
    ) -> None:
        """With another attachment position and orientation are said in another frame: all three go back, or none does."""
        attachment = step.changes.get(fields.ATTACHMENT)
        if attachment is None:
            return
        where = [each for each in fields.WHERE if each in step.changes]
        to = str(attachment.before if back else attachment.after)
        why = "" if set(where) <= able.keys() else "its place was changed since"
        if why := why or self._hangs(step.name, to):
            for each in where:
                if able.pop(each, None) is not None:
                    left[each] = why

    def _place_again(self, step: Step, by: str, after: Callable[[Step | None], History]) -> InstanceEdit:
        assert step.whole is not None
        there = self._now.instances.get(step.name)
        if there is not None:
            self._commit(self._now.with_history(by, after(None)))
            why = f"{there.provenance.placed_by or 'somebody'} has placed another {step.name} since"
            return InstanceEdit(name=step.name, instance=there.state(), left={"instance": why})
        state = step.whole.state
        try:
            again = Instance.of(state, self._find(state.template))
        except ValueError as problem:  # ConfigError among them
            raise refuse(f"{step.name} can't be placed again", "template", state.template, str(problem)) from problem
        marks, now = step.whole.marks, self._now
        if self._hangs(step.name, again.attached_to):  # it stands where it was
            again = again.changed(attached_to=attachments.WORLD, pose_in_parent=None)
            now = replace(now, written=now.written + 1)
            marks = {**marks, **dict.fromkeys(fields.WHERE, Mark(now.written, by))}
        elif again.attached_to:
            again = attachments.with_own_pose(
                again, again.own_pose, again.attached_to, self._place_of(again.attached_to)
            )
        again = again.changed(version=now.versions.get(step.name, 0) + 1, held_by="")
        self._commit(now.with_instance(again, marks).with_history(by, after(step)))
        self._changed(again.state())
        return InstanceEdit(name=step.name, instance=again.state(), fields=["instance"])

    def _remove_again(self, step: Step, by: str, after: Callable[[Step | None], History]) -> InstanceEdit:
        assert step.whole is not None
        there = self._now.instances.get(step.name)
        if there is None:
            self._commit(self._now.with_history(by, after(None)))
            return InstanceEdit(name=step.name, instance=None, left={"instance": "it is gone already"})
        marks = self._now.marks.get(step.name, {})
        others = {mark.by for each, mark in marks.items() if mark != step.whole.marks.get(each)} - {by, ROBOT}
        if others or there.provenance.placed_at != step.whole.state.provenance.placed_at:
            self._commit(self._now.with_history(by, after(None)))
            who = ", ".join(sorted(each or "somebody" for each in others or {there.provenance.placed_by}))
            return InstanceEdit(
                name=step.name, instance=there.state(), left={"instance": f"{who} has changed it since"}
            )
        if along := attachments.on(step.name, self._now.instances):
            self._commit(self._now.with_history(by, after(None)))
            why = f"{', '.join(along)} would have nothing to go along with"
            return InstanceEdit(name=step.name, instance=there.state(), left={"instance": why})
        self._not_held(step.name, by)
        step = msgspec.structs.replace(step, whole=self._whole(there))
        self._commit(self._now.without(step.name).with_history(by, after(step)))
        self._told_gone(there)
        return InstanceEdit(name=step.name, instance=None, fields=["instance"])
