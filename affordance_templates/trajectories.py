"""A template's trajectories with numbers: waypoints in its frame, joints moved as the waypoints before them moved them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from affordance_templates.features import Features
from affordance_templates.numbers import Names, Numbers, indexed
from affordance_templates.placement import Array, placed, rotation_of
from affordance_templates.template import (
    Entry,
    ResolvedTrajectory,
    ResolvedWaypoint,
    Stance,
    Sync,
    Tolerance,
)
from affordance_templates.template_schema import (
    EntryFile,
    Number,
    StanceFile,
    SyncFile,
    ToleranceFile,
    TrajectoryFile,
    Triple,
    WaypointFile,
)
from affordance_templates.tree import Tree
from handrail.config import ConfigError


def _usual(turns_freely: bool) -> Tolerance:
    """What a waypoint has that says none: 1 cm, 2°."""
    return _TURNING if turns_freely else _USUAL


_USUAL = Tolerance(np.full(3, 0.01), np.full(3, math.radians(2)))
_TURNING = Tolerance(np.full(3, 0.01), np.array([math.radians(2), math.radians(2), math.pi]))


@dataclass(frozen=True)
class Trajectories:
    """Of one template, parameters having values. Everything raises config.ConfigError."""

    numbers: Numbers
    names: Names
    tree: Tree
    features: Features
    files: Mapping[str, TrajectoryFile]

    def resolved(self, state: Mapping[str, float]) -> dict[str, ResolvedTrajectory]:
        """All of them, beginning with the joints at `state`, rad (m)."""
        found = {}
        for name, file in self.files.items():
            for row, names in self.numbers.repeated(f"trajectories.{name}", file.repeat, self.names):
                found[indexed(name, row)] = self._trajectory(name, indexed(name, row), file, names, state)
        return found

    def _trajectory(
        self, entry_name: str, name: str, file: TrajectoryFile, names: Names, state: Mapping[str, float]
    ) -> ResolvedTrajectory:
        field = f"trajectories.{entry_name}"
        entry = self._entry(f"{field}.entry", file.entry, names) if file.entry else None
        state = dict(state)
        waypoints: list[ResolvedWaypoint] = []
        for k, waypoint in enumerate(file.waypoints):
            where = f"{field}.waypoints[{k}]"
            if any(waypoint.name == other.name for other in waypoints):
                raise self.numbers.document.error(f"{where}.name", f"{waypoint.name!r} is there twice; expected one")
            before = waypoints[-1] if waypoints else None
            found = self._waypoint(where, waypoint, names, entry, state, before)
            if waypoint.stance is None and file.stance is not None:
                found = replace(found, stance=self._stance(f"{field}.stance", file.stance, names))
            waypoints.append(found)
        return ResolvedTrajectory(name, entry, tuple(waypoints), file.hand, file.side)

    def _entry(self, field: str, entry: EntryFile, names: Names) -> Entry:
        avoid: tuple[float, ...] = ()
        if entry.avoid is not None:
            repeated = self.numbers.repeated(f"{field}.avoid", entry.avoid.repeat, names)
            avoid = tuple(self.numbers.number(f"{field}.avoid.angle", entry.avoid.angle, each) for _, each in repeated)
        return Entry(
            joint=self.tree.joint_name(f"{field}.joint", entry.joint, names),
            span=self.numbers.positive(f"{field}.span", entry.span, names),
            avoid=avoid,
            clearance=self.numbers.number(f"{field}.clearance", entry.clearance, names),
            contact_offset=self.numbers.number(f"{field}.contact_offset", entry.contact_offset, names),
        )

    def _waypoint(
        self, field: str, file: WaypointFile, names: Names, entry: Entry | None, state: dict[str, float],
        before: ResolvedWaypoint | None,
    ) -> ResolvedWaypoint:  # fmt: skip
        """The next waypoint; `state` goes on to where it leaves the joints."""
        numbers = self.numbers
        joint, to = self._along(field, file, names, entry, state)
        if (file.until is None) != (file.approach != "guarded"):
            wanted = "the force in N that ends it" if file.approach == "guarded" else f"none: it is {file.approach}"
            raise numbers.document.error(f"{field}.until", f"expected {wanted}")
        pose, reference = self._pose(field, file, names, state, before)
        turns_freely = file.axis is not None and file.across is None
        force, path_force = file.force, file.path_force
        return ResolvedWaypoint(
            name=file.name,
            pose_in_template=pose,
            approach=file.approach,
            joint=joint,
            to=to,
            guard=None if file.guard is None else numbers.positive(f"{field}.guard", file.guard, names),
            until=None if file.until is None else numbers.positive(f"{field}.until", file.until, names),
            path_force=None
            if path_force is None
            else (
                numbers.positive(f"{field}.path_force.gain", path_force.gain, names),
                numbers.positive(f"{field}.path_force.limit", path_force.limit, names),
            ),
            force=None
            if force is None
            else pose[:3, :3]
            @ numbers.direction(f"{field}.force.direction", force.direction, names)
            * numbers.least(f"{field}.force.size", force.size, names),
            duration=numbers.least(f"{field}.duration", file.duration, names),
            speed=None if file.speed is None else numbers.positive(f"{field}.speed", file.speed, names),
            hand_pose=file.hand_pose,
            tool=numbers.vector(f"{field}.tool", file.tool, names),
            tolerance=_usual(turns_freely)
            if file.tolerance is None
            else self._tolerance(f"{field}.tolerance", file.tolerance, names, turns_freely),
            stance=None if file.stance is None else self._stance(f"{field}.stance", file.stance, names),
            reference=reference,
        )

    def _along(
        self, field: str, file: WaypointFile, names: Names, entry: Entry | None, state: dict[str, float]
    ) -> tuple[str, Any]:
        """The joint that the waypoint goes with and how far; `state` goes on unless the entry's planner finds where."""
        document = self.numbers.document
        if file.approach != "along":
            if file.joint:
                raise document.error(f"{field}.joint", f"expected none: it is {file.approach}, not along a joint")
            return "", 0.0
        joint = self.tree.joint_name(f"{field}.joint", file.joint, names)
        if file.to == "arc_end":
            if entry is None:
                raise document.error(
                    f"{field}.to", "arc_end, but the trajectory has no entry; expected one, or an angle"
                )
            return joint, "arc_end"
        by = self.numbers.number(f"{field}.to", file.to, names)
        if entry is None or entry.joint != joint:
            state[joint] = state.get(joint, 0.0) + by
        return joint, by

    def _pose(
        self, field: str, file: WaypointFile, names: Names, state: Mapping[str, float], before: ResolvedWaypoint | None
    ) -> tuple[Array, Array]:
        """(4, 4) where the waypoint is, and (4, 4) the frame that this is said in, both in the template's frame."""
        numbers = self.numbers
        posed = self.tree.at(state)
        own = (file.frame, file.position, file.axis, file.rpy)
        if file.approach == "along" and own == ("", None, None, None):
            if before is None:
                raise numbers.document.error(field, "goes along a joint from nowhere; expected a waypoint before it")
            joint = posed.joint(self.tree.joint_name(f"{field}.joint", file.joint, names))
            by = 0.0 if file.to == "arc_end" else numbers.number(f"{field}.to", file.to, names)
            moved = joint.displacement(by)
            return moved @ before.pose_in_template, moved @ before.reference
        base = np.eye(4)
        if file.frame:
            try:
                base = self.features.frame(file.frame, posed, names)
            except ConfigError:
                raise
            except ValueError as problem:
                raise numbers.document.error(f"{field}.frame", str(problem)) from problem
        position = np.zeros(3) if file.position is None else numbers.vector(f"{field}.position", file.position, names)
        return base @ placed(position, self._rotation(field, file, names)), base

    def _rotation(self, field: str, file: WaypointFile, names: Names) -> Array:
        numbers = self.numbers
        if file.axis is not None and file.rpy is not None:
            raise numbers.document.error(f"{field}.rpy", "there is an axis as well; expected one of both")
        if file.axis is not None:
            return numbers.pointing(field, "axis", file.axis, file.across, names)
        if file.across is not None:
            raise numbers.document.error(f"{field}.across", "there is no axis; expected both or neither")
        return np.eye(3) if file.rpy is None else rotation_of(numbers.vector(f"{field}.rpy", file.rpy, names))

    def _tolerance(self, field: str, file: ToleranceFile, names: Names, turns_freely: bool) -> Tolerance:
        position = self._three(f"{field}.position", file.position, names)
        rotation = np.minimum(self._three(f"{field}.rotation", file.rotation, names), math.pi)
        if turns_freely:
            rotation[2] = math.pi
        return Tolerance(position, rotation)

    def _three(self, field: str, given: Number | Triple, names: Names) -> Array:
        """(3,) of 0 or more: one number is meant for all three."""
        if isinstance(given, tuple):
            return np.array([self.numbers.least(f"{field}[{k}]", each, names) for k, each in enumerate(given)])
        return np.full(3, self.numbers.least(field, given, names))

    def _stance(self, field: str, file: StanceFile, names: Names) -> Stance:
        return Stance(
            self.numbers.vector(f"{field}.position", file.position, names),
            self.numbers.number(f"{field}.yaw", file.yaw, names),
        )


def synchronised(
    numbers: Numbers, files: Mapping[str, SyncFile], trajectories: Mapping[str, ResolvedTrajectory]
) -> dict[str, Sync]:
    """The `sync` part of a file. Raises config.ConfigError: a hand in two trajectories, points that could not come in order."""
    return {name: _sync(numbers, name, file, trajectories) for name, file in files.items()}


def _sync(numbers: Numbers, name: str, file: SyncFile, trajectories: Mapping[str, ResolvedTrajectory]) -> Sync:
    field, document = f"sync.{name}", numbers.document
    hands: dict[str, str] = {}
    for k, trajectory in enumerate(file.trajectories):
        if trajectory not in trajectories:
            raise document.error(
                f"{field}.trajectories[{k}]", f"got {trajectory!r}; expected one of {', '.join(trajectories) or 'none'}"
            )
        hand = trajectories[trajectory].hand
        if hand in hands:
            raise document.error(
                f"{field}.trajectories[{k}]", f"{trajectory} is for {hand}, as is {hands[hand]}; expected another hand"
            )
        hands[hand] = trajectory
    points = []
    reached = dict.fromkeys(file.trajectories, -1)
    for k, point in enumerate(file.points):
        numbered: dict[str, int] = {}
        for i, text in enumerate(point):
            where = f"{field}.points[{k}][{i}]"
            trajectory, _, waypoint = text.rpartition(".")
            known = [each.name for each in trajectories[trajectory].waypoints] if trajectory in reached else []
            if waypoint not in known:
                expected = ", ".join(f"{each}.WAYPOINT" for each in file.trajectories)
                raise document.error(where, f"got {text!r}; expected a waypoint of {expected}")
            if trajectory in numbered:
                raise document.error(where, f"{trajectory} is there twice; expected one waypoint of it")
            if known.index(waypoint) <= reached[trajectory]:
                raise document.error(where, f"{text} comes before the point above it; expected points in order")
            numbered[trajectory] = reached[trajectory] = known.index(waypoint)
        points.append(numbered)
    return Sync(name, tuple(file.trajectories), tuple(points))
