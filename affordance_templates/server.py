"""The affordance server: which instances there are, at which version, edited by several operators, kept on disk."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from affordance_templates import attachments, catalogue, checks, fields, instance_file
from affordance_templates.fields import Value
from affordance_templates.history import Change, History, Mark, Step, Whole
from affordance_templates.holds import HOLD_S, Holds
from affordance_templates.instance import Instance
from affordance_templates.instance_file import Kept
from affordance_templates.placement import Array, of_message
from affordance_templates.template_file import Template
from affordance_templates.undoing import LOCAL, ROBOT, Undoing
from handrail.config import ConfigError
from handrail.messages import (
    AttachInstance,
    EditInstance,
    HoldInstance,
    InstanceEdit,
    InstanceState,
    MoveInstance,
    PlaceInstance,
    Provenance,
    ReleaseInstance,
    RemoveInstance,
    SetParameters,
)
from handrail.topics import refuse


class AffordanceServer(Undoing):
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
        self.link_in_world: Callable[[str], Array | None] = lambda link: None
        """a link of the robot → (4, 4) where it is, by the measured joints; None: there is none, or it is not known"""
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
                raise refuse(
                    f"the template can't be used: {problem.problem}",
                    "template",
                    request.template,
                    "a template that is sound",
                ) from problem
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
            if along := attachments.on(gone.name, self._now.instances):
                raise refuse(
                    f"{', '.join(along)} would have nothing to go along with",
                    "name",
                    gone.name,
                    f"an instance that nothing is attached to: attach {along[0]} to something else, or remove it, first",
                )
            step = Step(gone.name, "remove", whole=self._whole(gone))
            self._commit(self._now.without(gone.name).with_history(by, self._history(by).with_step(step)))
            self._told_gone(gone)

    def set_joint(self, name: str, joint: str, position: float) -> Instance:
        """Note where a joint is now believed to be, rad (prismatic: m). Not an edit: plans stay fresh."""
        with self._lock:
            old = self.get(name)
            checks.joint(old, joint, position)
            number, one = self._now.written + 1, fields.joint(joint)
            now = fields.with_values(old, {one: (position,)}, None)
            marks = {**self._now.marks.get(name, {}), one: Mark(number, ROBOT)}
            self._commit(replace(self._now.with_instance(now, marks), written=number))
            self._changed(now.state())
            return now

    # --------------------------------------------------------------------------------------------------------- attachments

    def attach(self, request: AttachInstance) -> InstanceEdit:
        """Have an instance go along with a link, another instance, or the world. Refused where it would go along with itself."""
        with self._lock:
            if attachments.link(self.get(request.name).attached_to):
                self.follow()  # the link may have moved since
            by, old = request.by or LOCAL, self.get(request.name)
            to = attachments.asked(request)
            if request.link and request.instance:
                raise refuse("a link and an instance", "instance", request.instance, "one of both")
            if why := self._hangs(old.name, to):
                raise refuse(
                    f"{old.name} can't be attached to {attachments.in_words(to)}: {why}", *self._expected(old, request)
                )
            self._not_held(old.name, by)
            self._holds.renew(old.name, by)
            if to == old.attached_to:
                return InstanceEdit(name=old.name, instance=old.state())
            pose = attachments.seen_from(self._place_of(to), old.pose_in_world)
            where: dict[str, Value] = {
                "position": pose.position,
                "orientation": pose.orientation,
                fields.ATTACHMENT: to,
            }
            return self._write(old, where, by, base=None)

    def follow(self) -> bool:
        """Have what the robot carries be where its links are now, if that is known. No edit, and not on disk. True: it carries
        something.
        """
        with self._lock:
            on_links = [each for each in self._now.instances.values() if attachments.link(each.attached_to)]
            for one in on_links:
                place = self.link_in_world(attachments.link(one.attached_to))
                if place is None:
                    continue
                now = attachments.with_own_pose(one, one.own_pose, one.attached_to, place)
                if not attachments.elsewhere(one.pose_in_world, now.pose_in_world):
                    continue
                there = {**self._now.instances, now.name: now}
                moved = [now, *attachments.moved_along(now.name, there, edited=False)]
                self._now = replace(self._now, instances={**there, **{each.name: each for each in moved}})
                for each in moved:
                    self._changed(each.state())
            return bool(on_links)

    def _hangs(self, name: str, to: str) -> str:
        """Why an instance can't be attached to something; empty: it can."""
        if (link := attachments.link(to)) and self.link_in_world(link) is None:
            return f"the robot has no link {link}, or has not told where it is"
        other, there = attachments.instance(to), self._now.instances
        if other and other not in there:
            return f"{other} is not there"
        if other and name in (other, *attachments.ancestors(other, there)):
            return "it would go along with itself"
        return ""

    def _expected(self, old: Instance, request: AttachInstance) -> tuple[str, str, str]:
        if request.link:
            return "link", request.link, "a link of the robot's model, with the robot up"
        others = [name for name in self._now.instances if not self._hangs(old.name, f"instance:{name}")]
        return "instance", request.instance, f"one of: {', '.join(others) or 'no other is there'}"

    def _place_of(self, to: str) -> Array | None:
        """(4, 4) in the world of what something is attached to; None: the world. `_hangs` has found that it is there."""
        if link := attachments.link(to):
            return self.link_in_world(link)
        return of_message(self._now.instances[attachments.instance(to)].pose_in_world) if to else None

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
        return self._write(old, asked, by, request.base)

    def _write(self, old: Instance, asked: Mapping[str, Value], by: str, base: int | None) -> InstanceEdit:
        marks = self._now.marks.get(old.name, {})
        now_are = {each: fields.value(old, each) for each in asked}
        # A value that somebody else has written already is his until it is written again: then an undo of his leaves it. Numbers
        # that stay the same on another parent mean another place.
        whole = fields.ATTACHMENT in asked
        written = {
            each: one
            for each, one in asked.items()
            if whole or now_are[each] != one or marks.get(each, Mark()).by != by
        }
        if not written:
            return InstanceEdit(name=old.name, instance=old.state())
        moved = [each for each, one in written.items() if now_are[each] != one]
        new = checks.resolvable(self._with_values(old, written))
        mark = Mark(self._now.written + 1, by)
        changes = {
            each: Change(_known(now_are[each]), one, marks.get(each, Mark()), mark) for each, one in written.items()
        }
        step = Step(old.name, changes=changes, drag=self._holds.number(old.name, by))
        overwrote = self._overwritten(old.name, moved, by, base)
        now = replace(self._now, written=mark.number).with_history(by, self._history(by).with_step(step))
        new = self._keep(now, old, new, {**marks, **dict.fromkeys(written, mark)}, moved, by)
        return InstanceEdit(name=old.name, instance=new.state(), fields=moved, overwrote=overwrote)

    def _with_values(self, old: Instance, values: Mapping[str, Value]) -> Instance:
        to = str(values.get(fields.ATTACHMENT, old.attached_to))
        parent = attachments.parent_in_world(old) if to == old.attached_to else self._place_of(to)
        return fields.with_values(old, values, parent)

    def _keep(
        self, now: Kept, old: Instance, new: Instance, marks: Mapping[str, Mark], moved: list[str], by: str
    ) -> Instance:
        """Commit an edited instance, with what goes along with it, and tell of them; `moved`: fields with another value."""
        if moved:
            provenance = msgspec.structs.replace(old.provenance, edited_by=by, edited_at=self._utc())
            new = new.changed(version=old.version + 1, provenance=provenance)
        now = now.with_instance(new, marks)
        along = []
        if set(moved) & set(fields.POSE):
            along = attachments.moved_along(new.name, now.instances, edited=True)
        for each in along:
            now = now.with_instance(each, now.marks.get(each.name, {}))
        self._commit(now)
        self._touched.setdefault(new.name, {}).update(dict.fromkeys(moved, (new.version, by)))
        for each in [new, *along] if moved else []:
            self._changed(each.state())
        return new

    def _overwritten(self, name: str, written: list[str], by: str, base: int | None) -> dict[str, str]:
        found = {}
        for each in written:
            version, writer = self._touched.get(name, {}).get(each, (0, by))
            if base is not None and version > base and writer != by:
                found[each] = writer
        return found

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
