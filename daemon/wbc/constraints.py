"""Constraints: what always holds, and every task gives way to. Equalities are met exactly, bounds are never exceeded.

They have no order among each other (Radford et al. 2015, §5.2.3); where they exclude each other, the result names the one that
blocks. Limits of state (positions, distances) are made bounds of acceleration by exponential control barriers, h ≥ 0 by
ḧ ≥ −2 κ ḣ − κ² h (Nguyen and Sreenath 2016): h then never falls below what the double pole −κ lets it, and not below 0 from
ḣ ≥ −κ h on.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from daemon.wbc import layout as at
from daemon.wbc.layout import Kind
from daemon.wbc.memory import Array
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.parameters import Entry, WbcError, entry, gains, joint_row, numbers
from daemon.wbc.tasks import Capsule, Plane, Vector, gap_entry


class Constraint(msgspec.Struct, tag_field="constraint", kw_only=True, forbid_unknown_fields=True):
    """What all constraints have. `name`: what a result calls it; by default its kind and frame."""

    name: str = ""

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        """As the kernels know it. Raises WbcError."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """What a result calls it."""
        return self.name or f"{type(self).__name__} {getattr(self, 'frame', '')}".strip()


class _Contact(Constraint, kw_only=True):
    frame: str
    """its z points out of what is touched, towards the robot"""
    point: Vector = (0.0, 0.0, 0.0)
    """m, in the frame"""
    friction: float = 0.6
    """coefficient; the pyramid lies inside the cone"""
    least_force: float = 0.0
    """N, along z; less would be letting go"""
    most_force: float = 1e5
    stiffness: float = 0.0
    """1/s², back to where it first touched; 0: only its acceleration is held"""
    damping: float = 20.0
    """1/s"""

    def _contact(self, model: WholeBodyModel, mask: int, friction: list[float]) -> list[Entry]:
        held = entry(Kind.POSE, model, count=mask.bit_count(), frame=self.frame, point=self.point, mask=mask)
        gains(held, self.stiffness, self.damping, mask)
        held.force_axes, held.force_frame = mask, self.frame
        here = model.frame(self.frame)
        held.parameters[at.REF_P : at.REF_P + 3] = here.act(np.asarray(self.point, float))
        held.parameters[at.REF_R : at.REF_R + 9] = here.rotation.ravel()
        held.finds_position = held.finds_orientation = True
        if not 0.0 <= self.least_force < self.most_force:
            raise WbcError(
                "most_force", f"got {self.most_force!r} N; expected more than least_force, {self.least_force!r} N"
            )
        if not (np.isfinite(self.friction) and self.friction >= 0.0):
            raise WbcError("friction", f"got {self.friction!r}; expected a number of at least 0")
        cone = entry(Kind.FRICTION, model, count=1 + 2 * len(friction))
        cone.force_of = self.frame
        cone.parameters[at.EXTRA], cone.parameters[at.EXTRA + 1] = self.least_force, self.most_force
        cone.parameters[at.EXTRA + 2 : at.EXTRA + 2 + len(friction)] = friction
        return [held, cone]


class PointContact(_Contact, tag="PointContact", kw_only=True):
    """A point of the robot stands: J q̈ + J̇ q̇ = −D ẋ − K x, three rows, and the force in the cone |f_x|, |f_y| ≤ μ / √2 f_z."""

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        return self._contact(model, 7, [self.friction / np.sqrt(2.0)] * 2)


class FlatContact(_Contact, tag="FlatContact", kw_only=True):
    """A face of the robot stands and does not turn: six rows, and the wrench in the cone of a rectangle.

    Besides the pyramid: the centre of pressure lies within, |m_x| ≤ b f_z, |m_y| ≤ a f_z, and |m_z| ≤ torsion · f_z, for half
    lengths a along x and b along y (Caron, Pham and Nakamura 2015, without the coupling of shear and torsion).
    """

    half_length: float = 0.05
    """m, along the frame's x"""
    half_width: float = 0.05
    torsion: float = 0.02
    """m: friction's moment about z over the normal force"""

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        for field in ("half_length", "half_width", "torsion"):
            if not getattr(self, field) > 0.0:
                raise WbcError(field, f"got {getattr(self, field)!r} m; expected more than 0")
        shear = self.friction / np.sqrt(2.0)
        return self._contact(model, 63, [shear, shear, self.half_width, self.half_length, self.torsion])


class Transmission(Constraint, tag="Transmission", kw_only=True):
    """Coupled joints: q_follower = ratio · q_leader + offset, kept by q̈_f − r q̈_l = K e + D ė.

    `driven` false: the follower has no drive of its own, and what it needs comes from the leader's, τ_l + r τ_f, which the
    leader's limit bounds (virtual work: Lagrange's multiplier of the coupling).
    """

    leader: str
    follower: str
    ratio: float = 1.0
    offset: float = 0.0
    """rad"""
    driven: bool = False
    stiffness: float = 400.0
    damping: float = 40.0

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        made = entry(Kind.TRANSMISSION, model, count=1)
        made.joint, made.base_joint = (
            joint_row(model, self.leader, "leader"),
            joint_row(model, self.follower, "follower"),
        )
        if made.joint == made.base_joint:
            raise WbcError("follower", f"got {self.follower!r}, the leader itself; expected another joint")
        made.slot = 0 if self.driven else 1
        gains(made, self.stiffness, self.damping, 1)
        made.parameters[at.EXTRA : at.EXTRA + 2] = numbers((self.ratio, self.offset), 2, "ratio")
        return [made]

    @property
    def title(self) -> str:
        return self.name or f"Transmission {self.leader} {self.follower}"


class JointLimits(Constraint, tag="JointLimits", kw_only=True):
    """Position, velocity, acceleration and torque of every joint.

    q̈ ≤ κ² (q_max − q) − 2 κ q̇ and q̈ ≤ κ (q̇_max − q̇), likewise below, never beyond ± `acceleration`; |τ| ≤ `torque` times rated.
    """

    position: bool = True
    velocity: bool = True
    torque: float | None = 1.0
    """times the rated torque; none: unbounded"""
    acceleration: float = 1e4
    """rad/s²"""
    margin: float = 0.0
    """rad, within the joints' ends"""
    rate: float = 20.0
    """κ, 1/s"""

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        for field in ("acceleration", "rate"):
            if not getattr(self, field) > 0.0:
                raise WbcError(field, f"got {getattr(self, field)!r}; expected more than 0")
        if self.torque is not None and not self.torque > 0.0:
            raise WbcError("torque", f"got {self.torque!r}; expected more than 0")
        return []

    def table(self, model: WholeBodyModel) -> Array:
        """(6, nv): lower, upper, velocity, acceleration, torque, κ, as the kernels take them."""
        m, first = model.model, model.base
        table = unlimited(model)
        if self.position:
            table[0, first:] = m.lowerPositionLimit[model.nq - model.nv + first :] + self.margin
            table[1, first:] = m.upperPositionLimit[model.nq - model.nv + first :] - self.margin
        if self.velocity:
            table[2, first:] = m.velocityLimit[first:]
        table[3, first:] = self.acceleration
        if self.torque is not None:
            table[4, first:] = self.torque * m.effortLimit[first:]
        table[5, first:] = self.rate
        return table


def unlimited(model: WholeBodyModel) -> Array:
    """The table of joints without limits."""
    table = np.full((6, model.nv), np.inf)
    table[0], table[5] = -np.inf, 1.0
    return table


class Balance(Constraint, tag="Balance", kw_only=True):
    """The robot does not tip over: over the convex `polygon`, x y (m, world, counter-clockwise), `margin` inside it.

    "zmp": the zero-moment point p = c − (c_z − z₀) / g · c̈ stays within it (Vukobratović; Kajita et al. 2003, for small c̈_z).
    "com": the centre of mass itself does, by a barrier on each edge, for slow motion.
    """

    polygon: tuple[tuple[float, float], ...]
    point: Literal["zmp", "com"] = "zmp"
    margin: float = 0.01
    """m"""
    floor: float = 0.0
    """m, z₀ in the world"""
    rate: float = 5.0
    """κ, 1/s, for "com" """

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        corners = np.asarray(self.polygon, float)
        if (
            corners.ndim != 2
            or corners.shape[1:] != (2,)
            or not 3 <= len(corners) <= 8
            or not np.isfinite(corners).all()
        ):
            raise WbcError("polygon", f"got {len(self.polygon)} corners; expected 3 to 8 of x y")
        along = np.roll(corners, -1, 0) - corners
        turns = along[:, 0] * np.roll(along, -1, 0)[:, 1] - along[:, 1] * np.roll(along, -1, 0)[:, 0]
        if (turns <= 0.0).any():
            raise WbcError("polygon", "got corners that are not convex and counter-clockwise; expected them so")
        made = entry(Kind.BALANCE, model, count=len(corners))
        made.slot = 0 if self.point == "zmp" else 1
        outward = np.column_stack((along[:, 1], -along[:, 0])) / np.linalg.norm(along, axis=1)[:, None]
        reach = np.einsum("ij,ij->i", outward, corners) - self.margin
        made.parameters[at.EXTRA], made.parameters[at.EXTRA + 1] = self.floor, self.rate
        edges = np.column_stack((outward, reach)).ravel()
        made.parameters[at.EXTRA + 2 : at.EXTRA + 2 + len(edges)] = edges
        return [made]


class KeepOut(Constraint, tag="KeepOut", kw_only=True):
    """A capsule of the robot never comes nearer than `least` to another, or to a plane: d̈ ≥ −2 κ ḋ − κ² (d − least)."""

    body: Capsule
    other: Capsule | None = None
    plane: Plane | None = None
    least: float = 0.01
    """m"""
    rate: float = 10.0
    """κ, 1/s"""

    def entries(self, model: WholeBodyModel) -> list[Entry]:
        if not self.rate > 0.0:
            raise WbcError("rate", f"got {self.rate!r}; expected more than 0")
        made = gap_entry(model, self.body, self.other, self.plane, 1.0)
        made.parameters[at.EXTRA + 13], made.parameters[at.EXTRA + 15] = self.least, self.rate
        return [made]

    @property
    def title(self) -> str:
        return self.name or f"KeepOut {self.body.frame}"


AnyConstraint = PointContact | FlatContact | Transmission | JointLimits | Balance | KeepOut
"""What a file may hold."""
