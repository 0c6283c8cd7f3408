"""A task without a robot: its planners, its home posture, and the instances that a scene's objects would be placed as."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from engines.activities.base import Services
from engines.plans.freshness import World
from engines.programs import deployment
from engines.programs.program import Program
from engines.programs.rehearsal import Rehearsal
from handrail import config, workspace
from handrail.config import ConfigError
from handrail.messages import Deploy, Pose, TaskCheck
from handrail.robot import library as robots


class _Place(msgspec.Struct, kw_only=True):
    """The pose of a scene's object, as its file says it."""

    position: tuple[float, float, float]
    rpy_deg: tuple[float, float, float] | None = None
    orientation: tuple[float, float, float, float] | None = None

    def pose(self) -> Pose:
        if self.orientation is not None:
            return Pose(position=self.position, orientation=self.orientation)
        roll, pitch, yaw = (math.radians(angle) / 2 for angle in self.rpy_deg or (0.0, 0.0, 0.0))
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
        x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
        z, w = cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy
        return Pose(position=self.position, orientation=(x, y, z, w))


def instances_of(scene: str) -> list[Instance]:
    """An instance for each object of a scene whose kind is a template's name, its name and the parameters that both have.

    Where the objects of a simulated world are known, this is what an operator would place. Raises ConfigError.
    """
    known = workspace.files(workspace.search_path("scenes", "rtc_programs", "scenes"))
    file = Path(scene) if os.path.isfile(scene) else known.get(scene)
    if file is None:
        raise ConfigError(scene, None, "scene", f"no such scene; expected a file, or one of {', '.join(sorted(known))}")
    return list(_instances(config.read(file)))


def _instances(document: config.Document) -> Iterator[Instance]:
    objects = document.convert(dict[str, Any], "objects") or {}
    for name, given in objects.items():
        if not isinstance(given, Mapping) or given.get("kind") not in catalogue.files():
            continue
        template = catalogue.load(str(given["kind"]))
        place = document.convert(_Place, f"objects.{name}.pose_in_world")
        defaults = template.values({})
        parameters = {key: float(value) for key, value in given.items() if key in defaults}
        yield Instance(name, template, place.pose(), parameters)


class OfflineTask:
    """Rehearsals of one robot, from its home posture."""

    def __init__(self, robot: str, scene: str | None):
        """Raises ConfigError, ValueError."""
        from engines.planning.planners import Planners
        from engines.tip_poses import tip_poses

        self.description = robots.load(robot)
        self.instances = instances_of(scene) if scene else []
        home = self.description.home_position(next(iter(self.description.home)))
        self._world = World(0, home)
        self._services = Services(
            description=self.description,
            daemon=cast(Any, None),  # a rehearsal has its own
            affordances=cast(AffordanceServer, SimpleNamespace(instances=lambda: self.instances)),
            plans=cast(Any, None),
            prompts=cast(Any, None),
            planner=Planners(self.description),
            tip_pose=tip_poses(self.description),
            log=lambda *said: None,
        )

    def check(self, program: Program, bindings: Mapping[str, str], parameters: Mapping[str, Any]) -> TaskCheck:
        """Rehearse a program. What is not bound is, where only one thing fits. Raises RefusedError where it can't be deployed."""
        bound = {name: bindings[name] for name in bindings if name in program.resources}
        for name, resource in program.resources.items():
            fitting = deployment.fitting(resource, self.description, self.instances)
            if name not in bound and len(fitting) == 1:
                bound[name] = fitting[0]
        call = Deploy(program=program.name, bindings=bound, parameters=dict(parameters))
        deployed = deployment.deploy(call, program, self.description, self._services.affordances)
        return Rehearsal(deployed, self._services, self._world, self.instances).run().check
