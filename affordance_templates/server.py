"""The affordance server: which instances there are, at which version, kept on disk so that a restart loses none."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.template_file import Template
from handrail.config import ConfigError
from handrail.messages import InstanceState, MoveInstance, PlaceInstance, Pose, RemoveInstance, SetParameters
from handrail.topics import refuse


class _Saved(msgspec.Struct, kw_only=True):
    """The file: instances as they stand, and the last version of every name ever used."""

    instances: list[InstanceState] = []
    versions: dict[str, int] = {}


class AffordanceServer:
    """Holds the instances. Every method may be called from any thread; edits are written to disk before they are told.

    A name that was removed and is placed again goes on counting its versions, so a plan made from the old one stays stale.
    """

    def __init__(
        self,
        file: Path,
        *,
        changed: Callable[[InstanceState], None] = lambda state: None,
        find: Callable[[str], Template] = catalogue.load,
    ):
        """`changed` is told every instance's new state, also of its removal, from the thread that changed it."""
        self._file, self._changed, self._find = file, changed, find
        self._lock = threading.RLock()
        self._instances: dict[str, Instance] = {}
        self._versions: dict[str, int] = {}
        self._unusable: dict[str, InstanceState] = {}
        self.problems: list[str] = []
        """what could not be read when starting, for people"""
        self._load()

    # ------------------------------------------------------------------------------------------------------------- reading

    def get(self, name: str) -> Instance:
        """An instance as it stands. Refused when there is none of that name."""
        with self._lock:
            if name not in self._instances:
                raise refuse(
                    "no such instance", "name", name, f"one of: {', '.join(self._instances) or 'none placed yet'}"
                )
            return self._instances[name]

    def instances(self) -> list[Instance]:
        """All instances, oldest first."""
        with self._lock:
            return list(self._instances.values())

    def versions(self) -> dict[str, int]:
        """instance → version; one that is gone is not in it."""
        with self._lock:
            return {name: instance.version for name, instance in self._instances.items()}

    # ------------------------------------------------------------------------------------------------------------- editing

    def place(self, request: PlaceInstance) -> Instance:
        """Put a template into the world. Refused when the name is taken, or template, pose or parameters are wrong."""
        with self._lock:
            if request.name in self._instances:
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
            parameters = _checked_parameters(template, request.parameters)
            version = self._versions.get(request.name, 0) + 1
            instance = Instance(request.name, template, _checked_pose(request.pose_in_world), parameters, {}, version)
            self._unusable.pop(request.name, None)
            return self._put(_resolvable(instance))

    def move(self, request: MoveInstance) -> Instance:
        """Give an instance a new pose."""
        with self._lock:
            return self._edit(request.name, pose_in_world=_checked_pose(request.pose_in_world))

    def set_parameters(self, request: SetParameters) -> Instance:
        """Change the parameters named; the others stay."""
        with self._lock:
            old = self.get(request.name)
            return self._edit(
                request.name, parameters={**old.parameters, **_checked_parameters(old.template, request.parameters)}
            )

    def remove(self, request: RemoveInstance) -> None:
        """Take an instance away."""
        with self._lock:
            gone = self.get(request.name)
            left = {name: instance for name, instance in self._instances.items() if name != request.name}
            self._commit(left, self._versions)
            self._changed(gone.state(removed=True))

    def set_joint(self, name: str, joint: str, position: float) -> Instance:
        """Note where a joint is now believed to be, rad (prismatic: m). Not an edit: plans stay fresh."""
        with self._lock:
            old = self.get(name)
            if joint not in (joints := old.resolve().joints):
                raise refuse("no such joint", "joint", joint, f"one of: {', '.join(joints)}")
            if not math.isfinite(position):
                raise refuse("not a position", "position", position, "a finite number")
            return self._put(replace(old, joint_state={**old.joint_state, joint: position}))

    def _edit(self, name: str, **changes: object) -> Instance:
        old = self.get(name)
        return self._put(_resolvable(replace(old, version=old.version + 1, **changes)))  # type: ignore[arg-type]

    def _put(self, instance: Instance) -> Instance:
        self._commit({**self._instances, instance.name: instance}, {**self._versions, instance.name: instance.version})
        self._changed(instance.state())
        return instance

    def _commit(self, instances: dict[str, Instance], versions: dict[str, int]) -> None:
        """What holds from now on; where it can't be written (OSError), nothing has changed."""
        before = self._instances, self._versions
        self._instances, self._versions = instances, versions
        try:
            self._save()
        except OSError:
            self._instances, self._versions = before
            raise

    # ---------------------------------------------------------------------------------------------------------------- disk

    def _save(self) -> None:
        """Write all, whole: a crash leaves the old file or the new one."""
        states = [instance.state() for instance in self._instances.values()] + list(self._unusable.values())
        text = msgspec.json.format(msgspec.json.encode(_Saved(instances=states, versions=self._versions)))
        beside = self._file.with_suffix(".new")
        beside.write_bytes(text)
        os.replace(beside, self._file)

    def _load(self) -> None:
        try:
            saved = msgspec.json.decode(self._file.read_bytes(), type=_Saved)
        except FileNotFoundError:
            return
        except (msgspec.DecodeError, UnicodeDecodeError) as problem:
            aside = self._file.with_suffix(".unreadable")
            os.replace(self._file, aside)
            self.problems.append(
                f"{self._file}: not the instances' file ({problem}); put aside as {aside.name}, starting without any"
            )
            return
        self._versions = dict(saved.versions)
        for state in saved.instances:
            try:
                template = self._find(state.template)
                # A template that was edited meanwhile is an edit of the instance.
                version = state.version + (state.template_hash != template.hash)
                parameters = template.values(state.parameters)
                joints = template.resolve(parameters).joints
                joint_state = {joint: at for joint, at in state.joint_state.items() if joint in joints}
                instance = Instance(state.name, template, state.pose_in_world, parameters, joint_state, version)
                instance.resolve()
            except ValueError as problem:  # ConfigError among them
                self._unusable[state.name] = state
                self.problems.append(f"instance {state.name}: {problem}; kept on disk, not in the world")
                continue
            self._instances[state.name] = instance
            self._versions[state.name] = max(version, self._versions.get(state.name, 0))


def _resolvable(instance: Instance) -> Instance:
    try:
        instance.resolve()
    except ValueError as problem:
        raise refuse(
            "the template has no shape with these parameters", "parameters", dict(instance.parameters), str(problem)
        ) from problem
    return instance


def _checked_parameters(template: Template, given: Mapping[str, float]) -> dict[str, float]:
    for name, value in given.items():
        if problem := template.problem(name, value):
            raise refuse(
                f"parameter {name}: {problem}", f"parameters.{name}", value, problem.rpartition("expected ")[2]
            )
    return dict(given)


def _checked_pose(pose: Pose) -> Pose:
    """Finite, with a unit quaternion (one that is off by rounding is normalised)."""
    if not all(map(math.isfinite, (*pose.position, *pose.orientation))):
        raise refuse("the pose is not finite", "pose_in_world", pose, "finite numbers")
    norm = math.sqrt(sum(part * part for part in pose.orientation))
    if abs(norm - 1) > 1e-3:
        raise refuse(
            f"a quaternion of norm {norm:.4g}", "pose_in_world.orientation", pose.orientation, "norm 1 (x, y, z, w)"
        )
    x, y, z, w = (part / norm for part in pose.orientation)
    return Pose(position=pose.position, orientation=(x, y, z, w))
