"""Where the robot's links are, by the joints that it measures."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from affordance_templates.placement import Array, of_message
from handrail.messages import Base
from handrail.robot.description import RobotDescription

if TYPE_CHECKING:
    from handrail.robot.kinematics import Kinematics

Measured = Callable[[], tuple[np.ndarray, Base | None] | None]
"""→ (n,) rad of all joints, and the base (None: it is fixed); None: nobody has told"""


class LinkPoses:
    """Of one robot; may be asked from any thread. The model is read with the first question."""

    def __init__(self, description: RobotDescription, measured: Measured):
        self._description, self._measured = description, measured
        self._kinematics: Kinematics | None = None
        self._lock = threading.Lock()

    def __call__(self, link: str) -> Array | None:
        """(4, 4), where a frame of the robot's model is in the world; None: there is no such frame, or it is not known."""
        now = self._measured()
        if now is None:
            return None
        position, base = now
        if base is not None and base.source == "none":
            return None
        with self._lock:
            if self._kinematics is None:
                from handrail.robot.kinematics import Kinematics

                self._kinematics = Kinematics(self._description)
            try:
                placed = self._kinematics.frame(position, link).homogeneous
            except KeyError:
                return None
        return placed if base is None else of_message(base.pose_in_world) @ placed
