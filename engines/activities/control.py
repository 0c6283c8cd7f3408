"""`do: control`: whole-body control of an arm, of some joints, or of all: a compound task under its constraints, for as long as the
state lasts. So a robot stands on its feet, too (docs/balance.md)."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from affordance_templates.instance import Instance
from engines.activities.base import Activity, ActivityFailed, Argument, Kind
from engines.activities.waypoints import there_is
from engines.runs.motion import MotionFailed
from engines.runs.preconditions import Precondition
from handrail.behaviour_file import named, with_frames
from handrail.messages import (
    EndCondition,
    FixedPose,
    FrameKnots,
    FrameLine,
    Name,
    PoseStream,
    PostureKnots,
    Reference,
    StreamPose,
    Vector,
    WholeBody,
)
from handrail.topics import RefusedError, Unreachable


class Followed(PoseStream, tag="stream", kw_only=True, forbid_unknown_fields=True):
    """A task's frame goes with a point of an instance, wherever that is moved meanwhile; its orientation stays."""

    follow: Name
    point: Vector = (0.0, 0.0, 0.0)
    """m, in the template's frame"""


References = list[FixedPose | FrameLine | FrameKnots | PostureKnots | Followed]


class ControlActivity(Activity):
    """Runs a compound task with `joints`, else with those of `arm`, else with all, from where they are. Done with `outcome`:
    `done`, or the end condition that ended it. Fails with `not_standing` where it stands on a foot that does not hold.
    """

    arguments = {
        "compound": Argument(Kind.COMPOUND),
        "arm": Argument(Kind.ARM, required=False, default=""),
        "joints": Argument(Kind.TEXTS, required=False, default=()),
        "references": Argument(Kind.LIST, required=False, default=(), of=References),
        "ends": Argument(Kind.LIST, required=False, default=(), of=list[EndCondition]),
        "duration": Argument(Kind.NUMBER, required=False, default=0.0, unit="s"),
        "stiffness": Argument(Kind.NUMBER, required=False, default=0.5),
        "damping": Argument(Kind.NUMBER, required=False, default=1.0),
    }
    outputs = frozenset({"outcome"})

    @classmethod
    def problem(cls, given: Mapping[str, Any]) -> tuple[str, str]:
        ends = list(given.get("ends", ()))
        if "arm" in given or with_frames(ends, "") == ends:
            return "", ""
        return "ends", "one names no frame; expected `frame`, or an arm whose tip it is about"

    def run(self) -> dict[str, Any]:
        values, description = self.values, self.services.description
        arm = description.arms.get(values["arm"])
        frame, given = arm.tip if arm else "", values["compound"]
        try:
            joints = list(named(values["joints"], description)) or list(arm.joints if arm else ())
        except ValueError as problem:
            raise ActivityFailed("bad_argument", f"control: joints: {problem}") from problem
        try:
            references = msgspec.convert(list(values["references"]), References)
            ends = msgspec.convert(with_frames(list(values["ends"]), frame), list[EndCondition])
            motion = msgspec.convert(
                {
                    "compound": given if isinstance(given, str) else json.dumps(given),
                    "joints": joints,
                    "frame": frame,
                    **{name: values[name] for name in ("duration", "stiffness", "damping")},
                },
                WholeBody,
            )
        except msgspec.ValidationError as problem:
            raise ActivityFailed("bad_argument", f"control: {problem}") from problem
        followed = [reference for reference in references if isinstance(reference, Followed)]
        motion = msgspec.structs.replace(motion, references=[_sent(reference) for reference in references])
        self._places: dict[str, Vector] = {}
        what = given if isinstance(given, str) else str(given.get("name", "control"))
        try:
            ended = self.context.motion.run(
                motion,
                ends,
                self.cancelled,
                what=what,
                meanwhile=(lambda action: self._stream(action, followed)) if followed else None,
            )
        except MotionFailed as failed:
            raise ActivityFailed(failed.reason, str(failed)) from failed
        return {"outcome": ended.outcome}

    def _stream(self, action: str, followed: list[Followed]) -> None:
        """Tell the loop where what is followed has gone; what was removed stands where it was."""
        for reference in followed:
            with contextlib.suppress(
                RefusedError, Unreachable
            ):  # removed, the motion has just ended, or the daemon has
                here = _point(self.services.affordances.get(reference.follow), reference.point)
                if self._places.get(reference.task) != here:
                    self.services.daemon.call(StreamPose(id=action, task=reference.task, position=here))
                    self._places[reference.task] = here

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        for reference in self.values["references"]:
            if isinstance(reference, Mapping) and "follow" in reference:
                yield there_is(self.services, reference["follow"])
        yield from super().preconditions()

    def cancel(self) -> None:
        super().cancel()
        self.context.motion.interrupt()


def _sent(reference: FixedPose | FrameLine | FrameKnots | PostureKnots | Followed) -> Reference:
    """As the daemon takes it."""
    if not isinstance(reference, Followed):
        return reference
    return PoseStream(task=reference.task, stale=reference.stale, speed=reference.speed, turn=reference.turn)


def _point(instance: Instance, point: Vector) -> Vector:
    x, y, z = (np.array(instance.pose_in_world.position) + instance.rotation @ np.array(point)).tolist()
    return x, y, z
