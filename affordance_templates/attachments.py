"""What instances go along with: a link of the robot, as once they are grasped, or another instance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from affordance_templates.instance import Instance
from affordance_templates.placement import Array, inverse, of_message, to_message
from handrail.messages import AttachInstance, Pose

WORLD = ""
_LINK, _INSTANCE = "link:", "instance:"


def asked(call: AttachInstance) -> str:
    """What it is to go along with: `link:NAME`, `instance:NAME`, or empty for the world."""
    if call.instance:
        return _INSTANCE + call.instance
    return _LINK + call.link if call.link else WORLD


def link(to: str) -> str:
    """The robot's link; empty: it is none."""
    return to.removeprefix(_LINK) if to.startswith(_LINK) else ""


def instance(to: str) -> str:
    """The other instance; empty: it is none."""
    return to.removeprefix(_INSTANCE) if to.startswith(_INSTANCE) else ""


def in_words(to: str) -> str:
    """For people."""
    return to.replace(":", " ") or "the world"


def parent_in_world(one: Instance) -> Array | None:
    """(4, 4), where what it goes along with was when its place was last worked out; None: it stands in the world."""
    if not one.attached_to:
        return None
    return of_message(one.pose_in_world) @ inverse(of_message(one.own_pose))


def with_own_pose(one: Instance, own: Pose, to: str, parent: Array | None) -> Instance:
    """With another pose in the frame of what it goes along with, which is at `parent` (4, 4) in the world; None: the world."""
    if parent is None:
        return one.changed(pose_in_world=own, pose_in_parent=None, attached_to=WORLD)
    return one.changed(pose_in_world=to_message(parent @ of_message(own)), pose_in_parent=own, attached_to=to)


def seen_from(parent: Array | None, pose_in_world: Pose) -> Pose:
    """A pose in the world, in the frame of what is at `parent`."""
    return pose_in_world if parent is None else to_message(inverse(parent) @ of_message(pose_in_world))


def elsewhere(before: Pose, now: Pose) -> bool:
    """Whether it has moved by what anybody could see: 0.1 mm, or 0.1 mrad (1 - cos² of half of it)."""
    cosine = sum(a * b for a, b in zip(before.orientation, now.orientation, strict=True))
    return math.dist(before.position, now.position) > 1e-4 or 1 - cosine * cosine > 2.5e-9


def on(name: str, instances: Mapping[str, Instance]) -> list[str]:
    """Instances attached to one, by name."""
    return [each.name for each in instances.values() if instance(each.attached_to) == name]


def ancestors(name: str, instances: Mapping[str, Instance]) -> Iterator[str]:
    """What an instance goes along with, what that goes along with, and so on; a link last, as `link:NAME`."""
    seen = {name}
    to = instances[name].attached_to if name in instances else WORLD
    while to:
        above = instance(to)
        if not above:
            yield to
            return
        if above in seen:
            return
        seen.add(above)
        yield above
        to = instances[above].attached_to if above in instances else WORLD


def moved_along(name: str, instances: Mapping[str, Instance], *, edited: bool) -> list[Instance]:
    """All that go along with an instance, where they now are; `edited`: at new versions."""
    moved: list[Instance] = []
    waiting = [(instances[name], each) for each in on(name, instances)]
    while waiting:
        parent, child = waiting.pop(0)
        now = with_own_pose(
            instances[child], instances[child].own_pose, instances[child].attached_to, of_message(parent.pose_in_world)
        )
        moved.append(now.changed(version=now.version + edited))
        waiting += [(moved[-1], each) for each in on(child, instances) if each != name]
    return moved


def carried(instances: Iterable[Instance]) -> list[str]:
    """Names of those that the robot carries: attached to a link, or to what is. They are no obstacles to it."""
    known = {each.name: each for each in instances}
    return [name for name in known if any(link(above) for above in ancestors(name, known))]
