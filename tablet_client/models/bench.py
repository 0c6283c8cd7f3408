"""What the operator works on: the selected instance, its handle, parameters and waypoints, and what of them an arm can reach."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.placement import of_message, rotation_of, rpy_of, to_message
from affordance_templates.template import ResolvedTemplate
from handrail.config import ConfigError
from handrail.messages import GetReach, InstanceState, Message, Pose, Reach, WaypointReach
from tablet_client.models import handle, sliders
from tablet_client.models.edits import Edits
from tablet_client.models.view import Array, View
from tablet_client.models.world import World

_LASTS, _RENEWED = 10.0, 4.0  # s: how long what is reached is told, and when that is asked for anew
_IN_FRONT = 0.15  # m, to the robot's right: where a template is placed that nothing says more of


@dataclass(frozen=True)
class Waypoint:
    """A waypoint of the chosen trajectory, where it stands in the world."""

    name: str
    pose: Array
    """(4, 4)"""
    reach: WaypointReach | None


@dataclass(frozen=True)
class Target:
    """What an instance can go along with."""

    kind: str
    """`link`, `instance`, or `world`: nothing"""
    name: str
    now: bool
    """whether it does"""


class Bench:
    """The selected instance."""

    def __init__(self, world: World):
        self._world = world
        self.edits = Edits(world.instances.get)
        self.selected = ""
        self.wanted = ""
        """instance that is being placed, to be selected as soon as it is there"""
        self.fine = self.snap = False
        self.trajectory = self.arm = ""
        self.arms: tuple[str, ...] = ()
        self.tools: tuple[str, ...] = ()
        """the arms' tools, links of the robot that something can be attached to"""
        self.saved = ("", "")
        """what became of the last template that was to be saved: `saving`, `saved` or `not_saved`, and its file, or why not"""
        self.hot = ""
        """the part of the handle that a finger is on"""
        self._grip: handle.Grip | None = None
        self._looked: dict[str, dict[str, float]] = {}
        """instance → joint → where it is looked at, rad or m: nobody is told"""
        self._reach: Reach | None = None
        self._asked: tuple[str, ...] = ()
        self._asked_at = float("-inf")
        self._no_reach = ""
        """why the engine does not tell what is reached"""

    # ------------------------------------------------------------------------------------------------------ selection

    def select(self, name: str) -> None:
        """Work on an instance; empty: on none."""
        name = name if name in self._world.instances else ""
        if name != self.selected:
            self.release()
            self.edits.drop(self.selected)  # a slider that has gone does not say that it was let go
            self.selected, self.trajectory = name, ""
            self._reach, self._no_reach = None, ""

    @property
    def state(self) -> InstanceState | None:
        """The selected instance as it is shown."""
        return self.shown().get(self.selected)

    def shown(self) -> dict[str, InstanceState]:
        """All instances as they stand once what is on its way has arrived, joints where they are looked at."""
        found = {}
        for name, told in self._world.instances.items():
            state = self.edits.shown(told)
            looked = self._looked.get(name, {})
            found[name] = (
                msgspec.structs.replace(state, joint_state={**state.joint_state, **looked}) if looked else state
            )
        return found

    def held_by(self, name: str) -> str:
        """The other operator who holds an instance; empty: nobody, or a finger here."""
        told = self._world.instances.get(name)
        return "" if told is None or self.edits.held(name) else told.held_by

    @property
    def pose(self) -> Array | None:
        """(4, 4), the selected instance's."""
        state = self.state
        return None if state is None else of_message(state.pose_in_world)

    # --------------------------------------------------------------------------------------------------------- handle

    def grasp(self, view: View, x: float, y: float) -> str:
        """A finger comes down: the handle's part that it is on, empty: none."""
        pose = self.pose
        self.hot = "" if pose is None else handle.part_at(view, pose, x, y)
        self._grip = handle.Grip(self.hot, pose, x, y) if self.hot and pose is not None else None
        return self.hot

    def drag(self, view: View, x: float, y: float) -> None:
        """It moves."""
        if self._grip is not None and self.selected in self._world.instances:
            moved = self._grip.drag(view, x, y, fine=self.fine, snap=self.snap)
            self.edits.drag(self.selected, **_moved(self.hot, moved))

    def release(self) -> None:
        """It is lifted."""
        if self._grip is not None:
            self.edits.drop(self.selected)
        self._grip, self.hot = None, ""

    # -------------------------------------------------------------------------------------------------------- numbers

    @property
    def numbers(self) -> tuple[float, ...]:
        """Where the selected instance stands: mm, mm, mm, and degrees about the world's x, y, z (URDF's roll, pitch, yaw)."""
        pose = self.pose
        if pose is None:
            return ()
        return (*(1000 * pose[:3, 3]).tolist(), *np.degrees(rpy_of(pose[:3, :3])).tolist())

    def put(self, row: int, value: float) -> str:
        """One of `numbers` was typed in. Code of what is wrong with it; empty: nothing."""
        numbers = list(self.numbers)
        if not numbers or not math.isfinite(value):
            return "no_number"
        numbers[row] = value
        pose = np.eye(4)
        pose[:3, 3] = np.array(numbers[:3]) / 1000
        pose[:3, :3] = rotation_of(np.radians(numbers[3:]))
        self.edits.move(self.selected, **_moved("t" if row < 3 else "r", pose))
        return ""

    def nudge(self, part: str, steps: int) -> None:
        """By so many centimetres or 5°; millimetres or half degrees where it is to be fine."""
        pose = self.pose
        if pose is not None:
            unit = (handle.STEP if part[0] == "t" else handle.TURN) * (handle.FINE if self.fine else 1.0)
            self.edits.move(self.selected, **_moved(part, handle.shifted(pose, part, steps * unit)))

    # ----------------------------------------------------------------------------------------- parameters and joints

    @property
    def parameters(self) -> list[sliders.Slider]:
        """What can be changed of the selected instance."""
        state = self.state
        if state is None:
            return []
        schema = sliders.schema(state.template)
        values = {name: parameter.default for name, parameter in schema.items()} | state.parameters
        return [sliders.of_parameter(name, value, schema.get(name)) for name, value in values.items()]

    @property
    def joints(self) -> list[sliders.Slider]:
        """The selected instance's joints, where they are looked at: rad, m."""
        state, resolved = self.state, self.resolved
        if state is None or resolved is None:
            return []
        return [
            sliders.of_joint(name, state.joint_state.get(name, 0.0), joint) for name, joint in resolved.joints.items()
        ]

    def turn(self, parameter: str, value: float) -> None:
        """One of `parameters` is being changed."""
        if any(each.name == parameter for each in self.parameters):
            self.edits.turn(self.selected, parameter, value)

    def look_at(self, joint: str, position: float) -> None:
        """Show the selected instance with a joint somewhere; the robot believes what it did."""
        self._looked.setdefault(self.selected, {})[joint] = position

    def believe(self) -> None:
        """Tell the robot that its joints are where they are looked at."""
        looked = self._looked.pop(self.selected, {})
        if looked:
            self.edits.set_joints(self.selected, looked)

    def look_away(self) -> None:
        """Show it as the robot believes it to be."""
        self._looked.pop(self.selected, None)

    @property
    def looked(self) -> bool:
        """Whether the selected instance is shown otherwise than the robot believes."""
        return self.selected in self._looked

    # ---------------------------------------------------------------------------------------------------- attachments

    @property
    def targets(self) -> list[Target]:
        """What the selected instance can go along with: tools, other instances, and the world where it goes with something."""
        state = self.state
        if state is None:
            return []
        along = state.attachment
        found = [] if along is None else [Target("world", "", False)]
        found += [Target("link", link, along is not None and along.link == link) for link in self.tools]
        others = (name for name in self._world.instances if name != self.selected)
        return found + [Target("instance", name, along is not None and along.instance == name) for name in others]

    def attach(self, kind: str, name: str) -> None:
        """Have the selected instance go along with one of `targets`."""
        if any((each.kind, each.name) == (kind, name) for each in self.targets):
            self.edits.attach(
                self.selected, link=name if kind == "link" else "", instance=name if kind == "instance" else ""
            )

    # ------------------------------------------------------------------------------------------------------ waypoints

    @property
    def resolved(self) -> ResolvedTemplate | None:
        """The selected instance with numbers; None where this tablet has not its template."""
        state = self.state
        return None if state is None else _resolved(msgspec.json.encode(state))

    @property
    def trajectories(self) -> list[str]:
        """Of the selected instance."""
        resolved = self.resolved
        return list(resolved.trajectories) if resolved is not None else []

    @property
    def chosen(self) -> str:
        """The trajectory whose waypoints are shown."""
        names = self.trajectories
        return self.trajectory if self.trajectory in names else next(iter(names), "")

    @property
    def hand(self) -> str:
        """The arm that is to go along it."""
        first = "right" if "right" in self.arms else next(iter(self.arms), "")
        return self.arm if self.arm in self.arms else first

    @property
    def waypoints(self) -> list[Waypoint]:
        """Of the chosen trajectory, with what is known of their reach."""
        pose, resolved = self.pose, self.resolved
        if pose is None or resolved is None or not self.chosen:
            return []
        told = {each.name: each for each in self._reach.waypoints} if self._told() and self._reach else {}
        trajectory = resolved.trajectories[self.chosen]
        about = resolved.joints[trajectory.entry.joint] if trajectory.entry is not None else None
        found = []
        for each in trajectory.waypoints:
            reach = told.get(each.name)
            turned = np.eye(4) if about is None or reach is None else about.displacement(reach.turned)
            found.append(Waypoint(each.name, pose @ turned @ each.pose_in_template, reach))
        return found

    @property
    def reach_problem(self) -> str:
        """Why it is not told what can be reached; empty where it is, or is being found out."""
        return (self._reach.problem if self._told() and self._reach else "") or self._no_reach

    def take(self, reach: Reach) -> None:
        """News of what can be reached."""
        if (reach.instance, reach.trajectory, reach.arm) == (self.selected, self.chosen, self.hand):
            self._reach, self._no_reach = reach, ""

    def refused(self, why: str) -> None:
        """The engine does not tell it."""
        self._no_reach = why

    def _told(self) -> bool:
        reach = self._reach
        return reach is not None and (reach.instance, reach.trajectory, reach.arm) == (
            self.selected,
            self.chosen,
            self.hand,
        )

    # ---------------------------------------------------------------------------------------------------- from, to it

    def want(self, now: float) -> list[Message]:
        """What to send now: s, monotonic."""
        wanted = self.edits.want(now)
        if self.wanted in self._world.instances:
            self.select(self.wanted)
            self.wanted = ""
        if self.selected and self.selected not in self._world.instances:
            self.select("")
        about = (self.selected, self.chosen, self.hand)
        if all(about) and (about != self._asked or now - self._asked_at >= _RENEWED):
            self._asked, self._asked_at = about, now
            wanted.append(GetReach(instance=about[0], trajectory=about[1], arm=about[2], lasts=_LASTS))
        return wanted

    @property
    def watching(self) -> bool:
        """Whether to go on asking."""
        return bool(self.selected) or self.edits.waiting

    def detached(self) -> None:
        """The engine is gone: nothing that was asked or sent is on its way."""
        self.edits.clear()
        self._grip, self.hot = None, ""
        self._asked, self._asked_at = (), float("-inf")

    def add(self, template: str) -> str:
        """Place a template in front of the robot, or beside what is selected; its name."""
        taken, number = set(self._world.instances), 1
        while (name := f"{template}_{number}") in taken:
            number += 1
        beside = self.pose
        place = (0.6, -_IN_FRONT, 0.2) if beside is None else tuple((beside[:3, 3] + (0.0, 0.2, 0.0)).tolist())
        self.edits.place(name, template, Pose(position=place))
        return name

    def copy(self, name: str = "") -> str:
        """Place the selected instance once more, beside itself, with its parameters, under a name (empty: the next number)."""
        state, pose = self.state, self.pose
        if state is None or pose is None:
            return ""
        if not name:
            return self._copied(state, pose)
        self._place_as(name, state, pose)
        return name

    def _copied(self, state: InstanceState, pose: Array) -> str:
        stem, number = state.name.rstrip("0123456789").rstrip("_") or state.template, 1
        while (name := f"{stem}_{number}") in self._world.instances:
            number += 1
        self._place_as(name, state, pose)
        return name

    def _place_as(self, name: str, state: InstanceState, pose: Array) -> None:
        beside = pose.copy()
        beside[:3, 3] += beside[:3, 1] * 0.1
        self.edits.place(name, state.template, to_message(beside), dict(state.parameters))


def _moved(part: str, pose: Array) -> dict[str, Any]:
    """What a part of the handle (`t`: an arrow, `r`: a ring) changes: the other half of the pose may be somebody else's."""
    told = to_message(pose)
    return {"position": told.position} if part[0] == "t" else {"orientation": told.orientation}


@lru_cache(maxsize=32)
def _resolved(encoded: bytes) -> ResolvedTemplate | None:
    state = msgspec.json.decode(encoded, type=InstanceState)
    try:
        template = catalogue.load(state.template)
        return Instance(
            state.name, template, state.pose_in_world, state.parameters, state.joint_state, state.version
        ).resolve()
    except (ConfigError, ValueError):
        return None


def forget() -> None:
    """Templates are others now."""
    _resolved.cache_clear()
