"""The affordance server: which instances there are, at which version, edited by several operators, kept on disk."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec

from affordance_templates import catalogue, checks, fields, history, instance_file
from affordance_templates.fields import Value
from affordance_templates.history import Change, History, Mark, Step, Whole
from affordance_templates.holds import HOLD_S, Holds
from affordance_templates.instance import Instance
from affordance_templates.instance_file import Kept
from affordance_templates.template_file import Template
from handrail.config import ConfigError
from handrail.messages import (
    EditInstance,
    HoldInstance,
    InstanceEdit,
    InstanceState,
    MoveInstance,
    PlaceInstance,
    Provenance,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    SetParameters,
    UndoEdit,
)
from handrail.topics import refuse

LOCAL = "local"
"""the operator of calls that no link has signed: they come from the robot itself"""
ROBOT = "the robot"
"""who writes joints that its own motions have turned"""


class AffordanceServer:
    """Holds the instances. Every method may be called from any thread; edits are written to disk before they are told.

    Operators are known by the name that the link has written on their calls. A name that was removed and is placed again goes on
    counting its versions, so a plan made from the old one stays stale.
    """

    def __init__(
        self,
        file: Path,
        *,
        changed: Callable[[InstanceState], None] = lambda state: None,
        find: Callable[[str], Template] = catalogue.load,
        clock: Callable[[], float] = time.monotonic,
        utc: Callable[[], float] = time.time,
    ):
        """`changed` is told every instance's new state, also of its removal, from the thread that changed it, in order.

        `clock`: s, by which holds end; `utc`: s since 1970.
        """
        self._file, self._changed, self._find, self._utc = file, changed, find, utc
        self._lock = threading.RLock()
        self._holds = Holds(clock)
        self._touched: dict[str, dict[str, tuple[int, str]]] = {}
        """instance → field → version at which it got its value, and from whom; since the start"""
        self._now, self.problems = instance_file.read(file, find)
        """`problems`: what could not be read when starting, for people"""

    # ------------------------------------------------------------------------------------------------------------- reading

    def get(self, name: str) -> Instance:
        """An instance as it stands. Refused when there is none of that name."""
        with self._lock:
            there = self._now.instances
            if name not in there:
                raise refuse("no such instance", "name", name, f"one of: {', '.join(there) or 'none placed yet'}")
            return there[name]

    def instances(self) -> list[Instance]:
        """All instances, oldest first."""
        with self._lock:
            return list(self._now.instances.values())

    def versions(self) -> dict[str, int]:
        """instance → version; one that is gone is not in it."""
        with self._lock:
            return {name: instance.version for name, instance in self._now.instances.items()}

    # ------------------------------------------------------------------------------------------------------------- editing

    def place(self, request: PlaceInstance) -> Instance:
        """Put a template into the world. Refused when the name is taken, or template, pose or parameters are wrong."""
        with self._lock:
            by = request.by or LOCAL
            if request.name in self._now.instances:
                raise refuse(
                    "an instance of that name is there already: move it, or remove it first",
                    "name",
                    request.name,
                    "a new name",
                )
            try:
                template = self._find(request.template)
            except ConfigError as problem:
                raise refuse("the template can't be used", "template", request.template, str(problem)) from problem
            instance = Instance(
                name=request.name,
                template=template,
                pose_in_world=checks.pose(request.pose_in_world),
                parameters=checks.parameters(template, request.parameters),
                version=self._now.versions.get(request.name, 0) + 1,
                provenance=Provenance(placed_by=by, placed_at=self._utc(), source=request.source),
            )
            checks.resolvable(instance)
            number = self._now.written + 1
            marks = {each: Mark(number, by) for each in fields.names(instance)}
            step = Step(instance.name, "place", whole=Whole(instance.state(), marks))
            now = replace(self._now.with_instance(instance, marks), written=number)
            self._commit(now.with_history(by, self._history(by).with_step(step)))
            self._touched.pop(request.name, None)
            self._changed(instance.state())
            return instance

    def move(self, request: MoveInstance) -> Instance:
        """Give an instance a new pose; of position and orientation only what differs is an edit."""
        with self._lock:
            pose, there = checks.pose(request.pose_in_world), self.get(request.name).pose_in_world
            edit = EditInstance(
                name=request.name,
                position=None if pose.position == there.position else pose.position,
                orientation=None if pose.orientation == there.orientation else pose.orientation,
                by=request.by,
            )
            self._edit(edit)
            return self.get(request.name)

    def set_parameters(self, request: SetParameters) -> Instance:
        """Change the parameters named; the others stay."""
        with self._lock:
            self._edit(EditInstance(name=request.name, parameters=request.parameters, by=request.by))
            return self.get(request.name)

    def edit(self, request: EditInstance) -> InstanceEdit:
        """Change the fields named; the others stay, whoever changes them meanwhile. See EditInstance."""
        with self._lock:
            return self._edit(request)

    def remove(self, request: RemoveInstance) -> None:
        """Take an instance away. Refused while another operator holds it."""
        with self._lock:
            by, gone = request.by or LOCAL, self.get(request.name)
            self._not_held(request.name, by)
            step = Step(gone.name, "remove", whole=self._whole(gone))
            self._commit(self._now.without(gone.name).with_history(by, self._history(by).with_step(step)))
            self._told_gone(gone)

    def set_joint(self, name: str, joint: str, position: float) -> Instance:
        """Note where a joint is now believed to be, rad (prismatic: m). Not an edit: plans stay fresh."""
        with self._lock:
            old = self.get(name)
            checks.joint(old, joint, position)
            number, one = self._now.written + 1, fields.joint(joint)
            now = fields.with_values(old, {one: (position,)})
            marks = {**self._now.marks.get(name, {}), one: Mark(number, ROBOT)}
            self._commit(replace(self._now.with_instance(now, marks), written=number))
            self._changed(now.state())
            return now

    # -------------------------------------------------------------------------------------------------------- undo and redo

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
        if set(able) & set(fields.POSE):
            self._not_held(step.name, by)
        new = fields.with_values(old, {each: one for each, (one, _) in able.items()})
        if problem := checks.shape(new):
            left |= dict.fromkeys(able, f"the template has no shape like that: {problem}")
            able, new = {}, old
        moved = [each for each, (one, _) in able.items() if fields.value(old, each) != one]
        again = msgspec.structs.replace(step, changes={each: step.changes[each] for each in able}, drag=0)
        marks = {**self._now.marks.get(step.name, {}), **{each: mark for each, (_, mark) in able.items()}}
        new = self._edited(old, new, by) if moved else old
        now = self._now.with_instance(new, marks).with_history(by, after(again if able else None))
        self._commit(now)
        self._touch(new, moved, by)
        if moved:
            self._changed(new.state())
        return InstanceEdit(name=step.name, instance=new.state(), fields=moved, left=left)

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
        again = replace(again, version=self._now.versions.get(step.name, 0) + 1, held_by="")
        self._commit(self._now.with_instance(again, step.whole.marks).with_history(by, after(step)))
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
        self._not_held(step.name, by)
        step = msgspec.structs.replace(step, whole=self._whole(there))
        self._commit(self._now.without(step.name).with_history(by, after(step)))
        self._told_gone(there)
        return InstanceEdit(name=step.name, instance=None, fields=["instance"])

    # --------------------------------------------------------------------------------------------------------------- holds

    def hold(self, request: HoldInstance) -> Instance:
        """Take or renew a hold: nobody else may move the instance. Refused while somebody else has one."""
        with self._lock:
            by, there = request.by or LOCAL, self.get(request.name)
            if not self._holds.take(request.name, by):
                self._not_held(request.name, by)
            return self._shown_held(there)

    def release(self, request: ReleaseInstance) -> Instance:
        """Let go of an instance."""
        with self._lock:
            there = self.get(request.name)
            if not self._holds.end(request.name, request.by or LOCAL):
                return there
            return self._shown_held(there)

    def end_holds(self) -> float | None:
        """Tell of the holds that have ended by themselves; s until the next one may, None: there is none."""
        with self._lock:
            for name in self._holds.expired():
                if name in self._now.instances:
                    self._shown_held(self._now.instances[name])
            return self._holds.next_end_s

    def _shown_held(self, instance: Instance) -> Instance:
        holder = self._holds.holder(instance.name)
        if instance.held_by == holder:
            return instance
        shown = instance.changed(held_by=holder)
        # Not on disk: who starts anew has let go.
        self._now = replace(self._now, instances={**self._now.instances, instance.name: shown})
        self._changed(shown.state())
        return shown

    def _not_held(self, name: str, by: str) -> None:
        holder = self._holds.holder(name)
        if holder and holder != by:
            raise refuse(
                f"{name} is held by {holder}, who is moving it",
                "name",
                name,
                f"to wait until it is let go, or {holder} has been silent for {HOLD_S:g} s",
            )

    # --------------------------------------------------------------------------------------------------------------- inside

    def _edit(self, request: EditInstance) -> InstanceEdit:
        by, old = request.by or LOCAL, self.get(request.name)
        asked = checks.edit(old, request)
        if set(asked) & set(fields.POSE):
            self._not_held(old.name, by)
        self._holds.renew(old.name, by)
        marks = self._now.marks.get(old.name, {})
        now_are = {each: fields.value(old, each) for each in asked}
        # A value that somebody else has written already is his until it is written again: then an undo of his leaves it.
        written = {each: one for each, one in asked.items() if now_are[each] != one or marks.get(each, Mark()).by != by}
        if not written:
            return InstanceEdit(name=old.name, instance=old.state())
        moved = [each for each, one in written.items() if now_are[each] != one]
        new = fields.with_values(old, written)
        checks.resolvable(new)
        if moved:
            new = self._edited(old, new, by)
        mark = Mark(self._now.written + 1, by)
        changes = {
            each: Change(_known(now_are[each]), one, marks.get(each, Mark()), mark) for each, one in written.items()
        }
        step = Step(old.name, changes=changes, drag=self._holds.number(old.name, by))
        now = self._now.with_instance(new, {**marks, **dict.fromkeys(written, mark)})
        overwrote = self._overwritten(old.name, moved, by, request.base)
        self._commit(replace(now, written=mark.number).with_history(by, self._history(by).with_step(step)))
        self._touch(new, moved, by)
        if moved:
            self._changed(new.state())
        return InstanceEdit(name=old.name, instance=new.state(), fields=moved, overwrote=overwrote)

    def _edited(self, old: Instance, new: Instance, by: str) -> Instance:
        provenance = msgspec.structs.replace(old.provenance, edited_by=by, edited_at=self._utc())
        return new.changed(version=old.version + 1, provenance=provenance)

    def _overwritten(self, name: str, written: list[str], by: str, base: int | None) -> dict[str, str]:
        found = {}
        for each in written:
            version, writer = self._touched.get(name, {}).get(each, (0, by))
            if base is not None and version > base and writer != by:
                found[each] = writer
        return found

    def _touch(self, instance: Instance, moved: list[str], by: str) -> None:
        self._touched.setdefault(instance.name, {}).update(dict.fromkeys(moved, (instance.version, by)))

    def _history(self, by: str) -> History:
        return self._now.histories.get(by, History())

    def _whole(self, instance: Instance) -> Whole:
        return Whole(instance.state(), dict(self._now.marks.get(instance.name, {})))

    def _told_gone(self, gone: Instance) -> None:
        self._holds.forget(gone.name)
        self._touched.pop(gone.name, None)
        self._changed(msgspec.structs.replace(gone.state(removed=True), held_by=""))

    def _commit(self, now: Kept) -> None:
        """What holds from now on; where it can't be written (OSError), nothing has changed."""
        instance_file.write(self._file, now)
        self._now = now


def _known(value: Value | None) -> Value:
    assert value is not None  # `checks.edit` has refused fields that are not there
    return value
