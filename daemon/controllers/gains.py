"""Damping that fits a joint's stiffness and the inertia that it moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handrail.robot.kinematics import Kinematics


def joint_damping(kinematics: Kinematics, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Damping (n,) N·m·s/rad for the description's stiffness and damping ratio, for the posture `position` (n,) rad.

    D = 2 ζ sqrt(K I) per joint, with I the geometric mean of what the joint feels when the others are locked (M_ii) and when
    they are free (1 / (M⁻¹)_ii): between the two lie all couplings, so no joint is far from ζ whatever its neighbours do.
    """
    description = kinematics.description
    mass_matrix = kinematics.mass_matrix(position)
    locked = np.diag(mass_matrix)
    free = 1.0 / np.diag(np.linalg.inv(mass_matrix))
    inertia = np.sqrt(locked * free)
    return 2.0 * description.damping_ratio * np.sqrt(description.stiffness * inertia)
