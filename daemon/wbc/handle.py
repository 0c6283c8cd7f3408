"""A task while it runs: its reference, whether it is on, what is left of its error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from daemon.wbc import layout as at
from daemon.wbc.layout import Kind
from daemon.wbc.memory import Array, Integers
from daemon.wbc.parameters import Entry
from daemon.wbc.tasks import Quaternion, rotation

if TYPE_CHECKING:
    from daemon.wbc.hierarchy import WholeBody


class Handle:
    """One task of a WholeBody. What is written here counts from the next cycle on. `number`: in the plan."""

    def __init__(self, body: WholeBody, number: int, made: Entry):
        self._body, self.number, self._kind, self._entry = body, number, made.kind, made
        memory = body.memory
        self.parameters: Array = memory["parameters"][number]
        """of the kernels: see layout.py"""
        slot = int(body.plan[number, at.SLOT])
        self.posture: Array = (
            memory["posture"][6 * slot : 6 * slot + 6] if made.posture is not None else np.zeros((6, 0))
        )
        """(6, nv), of a JPos: position, velocity, acceleration, stiffness, damping, 1 where it counts, in the model's order"""
        given = memory["given"][slot : slot + made.count] if made.given is not None else np.zeros((0, 1))
        self.rows, self.wanted = given[:, :-1], given[:, -1]
        """of a Given: J (rows, nv + nf), a (rows,)"""

    @property
    def on(self) -> bool:
        """It takes part."""
        return bool(self._body.plan[self.number, at.ON])

    @on.setter
    def on(self, value: bool) -> None:
        self._body.plan[self.number, at.ON] = value

    @property
    def error(self) -> Array:
        """(6,) what was left at the start of the last cycle that came as far as this task: reference minus measured, on its axes;
        of a Clearance the distance beyond `least`."""
        return self.parameters[at.ERROR : at.ERROR + 6]

    @property
    def reference(self) -> tuple[Array, Array]:
        """Position (3,) m and rotation (3, 3) that the task is to bring its frame to: views."""
        p = self.parameters
        return p[at.REF_P : at.REF_P + 3], p[at.REF_R : at.REF_R + 9].reshape(3, 3)

    def pose(
        self,
        position: Array | tuple[float, ...] | None = None,
        orientation: Array | Quaternion | None = None,
        velocity: Array | None = None,
        acceleration: Array | None = None,
    ) -> None:
        """Position (3,) m, orientation x y z w or (3, 3), velocity and acceleration (6,) linear, angular; none: as it is."""
        p = self.parameters
        if position is not None:
            p[at.REF_P : at.REF_P + 3] = position
        if orientation is not None:
            turned = np.asarray(orientation, float)
            p[at.REF_R : at.REF_R + 9] = (rotation(tuple(turned)) if turned.shape == (4,) else turned).ravel()
        if velocity is not None:
            p[at.REF_V : at.REF_V + 6] = velocity
        if acceleration is not None:
            p[at.REF_A : at.REF_A + 6] = acceleration

    @property
    def joint_rows(self) -> Integers:
        """Columns of `posture` of the model's `joints` (n,)."""
        return self._body.model.rows

    def joints(self, position: Array, velocity: Array | None = None, acceleration: Array | None = None) -> None:
        """Of a JPos: (n,) in the order of the model's `joints`."""
        rows = self._body.model.rows
        self.posture[0, rows] = position
        if velocity is not None:
            self.posture[1, rows] = velocity
        if acceleration is not None:
            self.posture[2, rows] = acceleration

    def wrench(self, wanted: Array, measured: Array | None = None) -> None:
        """Of a Wrench: (6,) force N and moment N·m that the robot is to exert, and does."""
        self.parameters[at.REF_V : at.REF_V + 6] = wanted
        self.parameters[at.REF_A : at.REF_A + 6] = wanted if measured is None else measured

    def force(self) -> Array:
        """Of a contact or a Wrench: what the world exerts there on the robot, its coordinates of the last solution."""
        first = int(self._body.plan[self.number, at.FORCE_FIRST])
        return self._body.result.force[first : first + self._entry.force_axes.bit_count()]

    def residual(self) -> Array:
        """J x − a of the last solution (count,), in the task's own units; a posture's as q̈ − q̈*."""
        body = self._body
        plan = body.plan[self.number]
        x = np.concatenate((body.result.acceleration, body.result.force[: int(body.sizes[at.NF])]))
        if self._kind == Kind.POSTURE and plan[at.COUNT] == 0:
            p, state = self.posture, body.model.state
            wanted = p[2] + p[4] * (p[1] - state[1]) + p[3] * (p[0] - state[0])
            return (x[: body.model.nv] - wanted)[p[5] > 0.0]
        rows, wanted = np.zeros((plan[at.COUNT], len(x))), np.zeros(plan[at.COUNT])
        body.task_rows(self.number, rows, wanted)
        return rows @ x - wanted

    def __repr__(self) -> str:
        return f"Handle({self._kind.name} {self.number}, on={self.on})"
