"""The torque of a robot that stands: its feet share what the ground bears so that no joint is asked for more than it must.

Seen from one sole, inverse dynamics put the whole contact wrench there. Here the feet share it, and of all ways to share it the
one with the least sum of squares of forces, and of moments over the soles' half lengths (minimum-norm contact forces; Righetti
et al. 2013, Optimal Distribution of Contact Forces with Inverse-dynamics Control). That is linear in the wrench, which is
linear in s̈ and ṡ² along a path, and so are torques. A controller may share otherwise: a motion that passes here can be
carried, in one way at least.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.timing.contact_forces import ease
from handrail.robot.description import RobotDescription

Array = NDArray[np.float64]


class StandingDynamics:
    """Of one robot on its feet, in place of `Kinematics` where a base is held: `gravity` and `inverse_dynamics`."""

    def __init__(self, description: RobotDescription, model: pin.Model, rows: NDArray[np.int64]):
        """`model`: seen from the first foot's sole, at the world's origin; `rows` (n,) of it, of the description's joints."""
        self.description, self._model, self._rows = description, model, rows
        self._data = model.createData()
        self._q = pin.neutral(model)
        self._feet = [(foot, model.getFrameId(foot.link)) for foot in description.feet]
        self._ease = [ease(foot) for foot in description.feet]
        self._held = model.inertias[0] * -model.gravity
        """on the sole that is held, by its own weight"""

    def gravity(self, position: Array) -> Array:
        """Torque (n,) N·m that holds the robot still at joint positions (n,) rad."""
        still = np.zeros((1, len(position)))
        return np.asarray(self.inverse_dynamics(position[None], still, still)[0])

    def inverse_dynamics(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """Torques (k, n) N·m, gravity included, through positions (k, n) rad at velocities, rad/s, and accelerations, rad/s²."""
        model, data, rows = self._model, self._data, self._rows
        velocity, acceleration = np.zeros(model.nv), np.zeros(model.nv)
        torques = np.empty(np.shape(positions))
        for number, position in enumerate(positions):
            self._q[rows] = position
            velocity[rows], acceleration[rows] = velocities[number], accelerations[number]
            needed = pin.rnea(model, data, self._q, velocity, acceleration).copy()
            whole = self._held.vector.copy()
            for joint in range(1, model.njoints):
                if model.parents[joint] == 0:
                    whole += data.liMi[joint].act(data.f[joint]).vector
            pin.computeJointJacobians(model, data, self._q)
            pin.updateFramePlacements(model, data)
            spread = [data.oMf[frame].toActionMatrixInverse().T for _, frame in self._feet]
            eased = [ease[:, None] * each.T for ease, each in zip(self._ease, spread, strict=True)]
            shared = np.linalg.solve(sum(a @ b for a, b in zip(spread, eased, strict=True)), whole)
            for (_, frame), each in zip(self._feet[1:], eased[1:], strict=True):
                jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
                needed -= jacobian.T @ (each @ shared)
            torques[number] = needed[rows]
        return torques
