"""What is wrong with a whole-body motion, found before the loop sees it: its compound task is read, and tried on the robot's model.

It needs pinocchio and numba, which the server otherwise does without (100 MB, a second or two): they are loaded with the first
whole-body motion, in a thread, so that nobody else waits.
"""

from __future__ import annotations

import importlib
import threading
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from daemon.serving.validation import check_all_finite, check_knots, check_points, check_quaternion, nearest
from handrail import compound_tasks
from handrail import messages as m
from handrail.config import ConfigError
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

if TYPE_CHECKING:
    from daemon.wbc.composition import CompoundTask
    from daemon.wbc.model import WholeBodyModel
    from daemon.wbc.tasks import Task

_LIBRARIES = ("daemon.wbc.composition", "handrail.robot.kinematics")


class WholeBodyDoor:
    """Checks the whole-body motions for one robot."""

    def __init__(self, description: RobotDescription):
        self._description = description
        self._loading: threading.Thread | None = None

    def open(self, wait_s: float) -> bool:
        """Load the libraries, and wait so long for that. True: they are there."""
        if self._loading is None:
            self._loading = threading.Thread(target=self._load, name="whole-body libraries", daemon=True)
            self._loading.start()
        self._loading.join(wait_s)
        return not self._loading.is_alive()

    def _load(self) -> None:
        for library in _LIBRARIES:
            importlib.import_module(library)
        from daemon.wbc.model import WholeBodyModel
        from handrail.robot.kinematics import Kinematics

        kinematics = Kinematics(self._description)
        self._fixed = WholeBodyModel.of(kinematics)
        self._free = WholeBodyModel.of(kinematics, free=True) if self._description.feet else self._fixed

    def checked(
        self, motion: m.WholeBody, ends: Sequence[m.EndCondition], position: np.ndarray, largest_payload: int
    ) -> m.WholeBody:
        """The motion with its compound as one JSON object, which the loop can read at once. `position` (n,) rad: where the
        robot is. Raises RefusedError. Only behind an open door."""
        from daemon.wbc import composition
        from daemon.wbc.standing import standing_on

        def model(compound: CompoundTask) -> WholeBodyModel:
            """That which it will run on."""
            its = self._free if standing_on(compound, self._description) else self._fixed
            its.place(position, np.zeros(len(position)))
            return its

        moved = set(motion.joints or self._description.joints)
        led = [joint for joint in self._description.joints if joint not in moved]
        try:
            compound = composition.find(
                motion.compound, compound_tasks.folders(self._description.folder), model, led, motion.frame
            )
        except ConfigError as error:
            at = f"line {error.line}" if error.line else motion.compound.splitlines()[0]
            raise refuse(str(error), "motion.compound", at, "a compound task that fits this robot") from error
        if not any(compound.levels):
            raise refuse("a compound task has tasks", "motion.compound", "levels: []", "at least one level with a task")
        tasks = {task.title: task for level in compound.levels for task in level}
        for number, reference in enumerate(motion.references):
            field = f"motion.references[{number}]"
            self._check_reference(reference, tasks, field, position, largest_payload)
            for joint in reference.joints if isinstance(reference, m.PostureKnots) else ():
                if joint not in moved:
                    raise refuse("the motion does not move it", f"{field}.joints", joint, "one of motion.joints")
            if any(other.task == reference.task for other in motion.references[:number]):
                raise refuse("a task has one reference", f"{field}.task", reference.task, "each task once")
        _check_ends(ends, compound)
        return msgspec.structs.replace(motion, compound=msgspec.json.encode(compound).decode())

    def _check_reference(
        self, reference: m.Reference, tasks: Mapping[str, Task], field: str, position: np.ndarray, largest_payload: int
    ) -> None:
        from daemon.wbc.tasks import SE3, CartPos, JPos, QuaternionOrientation

        task = tasks.get(reference.task)
        if task is None:
            raise refuse(
                "the compound has no such task", f"{field}.task", reference.task, nearest(reference.task, tasks)
            )
        framed = (CartPos, SE3) if isinstance(reference, m.FrameKnots) else (CartPos, QuaternionOrientation, SE3)
        wanted = (JPos,) if isinstance(reference, m.PostureKnots) else framed
        if not isinstance(task, wanted):
            names = " or ".join(kind.__name__ for kind in wanted)
            raise refuse(
                f"a {type(task).__name__} takes no such reference",
                f"{field}.task",
                reference.task,
                f"name of a {names}",
            )
        if isinstance(reference, m.PostureKnots):
            check_knots(reference, field, position, self._description, largest_payload=largest_payload)
        elif isinstance(reference, m.FrameKnots):
            check_points(reference, field, largest_payload=largest_payload)
        elif isinstance(reference, m.FixedPose):
            _check_goal(reference.pose, reference.shift, field, "pose")
        elif isinstance(reference, m.FrameLine):
            _check_goal(reference.goal, reference.shift, field, "goal")
        for name in ("duration", "speed", "turn", "stale"):
            check_all_finite(np.array(getattr(reference, name, 0.0)), f"{field}.{name}")


def _check_goal(pose: m.Pose | None, shift: m.Vector, field: str, name: str) -> None:
    check_all_finite(np.array(shift), f"{field}.shift")
    if pose is not None:
        check_all_finite(np.array(pose.position), f"{field}.{name}.position")
        check_quaternion(pose.orientation, f"{field}.{name}.orientation")
    if pose is not None and any(shift):
        raise refuse(
            "a reference goes somewhere, or by so much", f"{field}.shift", str(shift), f"no shift with a {name}"
        )


def _check_ends(ends: Sequence[m.EndCondition], compound: CompoundTask) -> None:
    """Conditions that would never be met here are no guards."""
    from daemon.wbc.tasks import SE3, CartPos

    led = {task.frame for level in compound.levels for task in level if isinstance(task, CartPos | SE3)}
    for number, end in enumerate(ends):
        if isinstance(end, m.DivergenceEnd):
            raise refuse(
                "whole-body control leads its joints by no more than a spring's reach: guard a frame instead",
                f"ends[{number}]",
                "divergence",
                "pose_error, force, contact, joint_limit or time",
            )
        if isinstance(end, m.PoseErrorEnd) and end.frame not in led:
            raise refuse(
                "no task of the compound brings this frame anywhere", f"ends[{number}].frame", end.frame,
                nearest(end.frame, led),
            )  # fmt: skip
