"""A template placed in the world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from affordance_templates.placement import Array, of_message
from affordance_templates.template import ResolvedTemplate
from affordance_templates.template_file import Template
from handrail.messages import Attachment, InstanceState, Pose, Provenance


@dataclass(frozen=True)
class Instance:
    """What the operator placed, at one version of it. Editing makes a new one (see `affordance_templates.server`)."""

    name: str
    template: Template
    pose_in_world: Pose
    parameters: Mapping[str, float] = field(default_factory=dict)
    """only those that differ from the template's defaults need to be given; units as the template says"""
    joint_state: Mapping[str, float] = field(default_factory=dict)
    """joint → rad (prismatic: m), as believed; joints not named are at 0"""
    version: int = 1
    """goes up with every edit (see `InstanceState`)"""
    attached_to: str = ""
    """what it goes along with (`affordance_templates.attachments`); empty: it stands in the world"""
    pose_in_parent: Pose | None = None
    """in the frame of that; None: it stands in the world"""
    held_by: str = ""
    """the operator who drags it"""
    provenance: Provenance = field(default_factory=Provenance)

    @classmethod
    def of(cls, state: InstanceState, template: Template) -> Instance:
        """The instance that was told. Raises ValueError (config.ConfigError among it) where its template has no shape like that."""
        to = state.attachment
        instance = cls(
            attached_to="" if to is None else f"link:{to.link}" if to.link else f"instance:{to.instance}",
            pose_in_parent=None if to is None else to.pose,
            name=state.name,
            template=template,
            pose_in_world=state.pose_in_world,
            parameters=template.values(state.parameters),
            joint_state=dict(state.joint_state),
            version=state.version,
            held_by=state.held_by,
            provenance=state.provenance,
        )
        instance.resolve()
        return instance

    @property
    def own_pose(self) -> Pose:
        """In the frame of what it goes along with; else in the world."""
        return self.pose_in_world if self.pose_in_parent is None else self.pose_in_parent

    def changed(self, **changes: Any) -> Instance:
        """The instance with other values; a shape that is the same is not worked out again, as a drag is many changes."""
        new = replace(self, **changes)
        if not changes.keys() & {"template", "parameters", "joint_state"} and "_resolved" in vars(self):
            vars(new)["_resolved"] = self._resolved
        return new

    @cached_property
    def _resolved(self) -> ResolvedTemplate:
        return self.template.resolve(self.parameters, self.joint_state)

    def resolve(self) -> ResolvedTemplate:
        """Shapes, joints and trajectories with this instance's numbers, in the template's frame."""
        return self._resolved

    @cached_property
    def rotation(self) -> Array:
        """(3, 3): turns directions in the template's frame into the world's."""
        return of_message(self.pose_in_world)[:3, :3]

    def point_in_template(self, point_in_world: Array) -> Array:
        """(3,) m, a point of the world in the template's frame."""
        return self.rotation.T @ (np.asarray(point_in_world, float) - np.array(self.pose_in_world.position))

    def state(self, *, removed: bool = False) -> InstanceState:
        """The instance as others are told of it: every parameter and every joint has its value."""
        return InstanceState(
            name=self.name,
            template=self.template.name,
            template_hash=self.template.hash,
            version=self.version,
            pose_in_world=self.pose_in_world,
            parameters=self.template.values(self.parameters),
            joint_state={name: float(self.joint_state.get(name, 0.0)) for name in self.resolve().joints},
            removed=removed,
            held_by=self.held_by,
            provenance=self.provenance,
            attachment=self._attachment(),
        )

    def _attachment(self) -> Attachment | None:
        kind, _, name = self.attached_to.partition(":")
        return Attachment(**{kind: name}, pose=self.own_pose) if name else None
