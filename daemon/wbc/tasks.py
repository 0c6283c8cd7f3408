"""Tasks: what the robot shall do, as far as constraints and tasks of higher priority allow.

Each asks for the acceleration of something it measures, ẍ* = ẍ_d + D (ẋ_d − ẋ) + K (x_d − x), through J q̈ = ẍ* − J̇ q̇
(operational space: Khatib 1987; the names are those of Radford et al. 2015, table 4). K is in 1/s², D in 1/s, 2 sqrt(K) when it is
not given: critically damped. A task is a struct, the same from Python and from YAML; where there is no reference in it, it holds
what it finds when it starts. `weight` settles quarrels within a level: a residual counts as the kinetic energy that it stands for.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np
import pinocchio as pin

from daemon.wbc import layout as at
from daemon.wbc.layout import Kind
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.parameters import Entry, Gain, WbcError, axes_mask, entry, frame_on_joint, gains, joint_row, numbers

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x y z w"""
_LINEAR, _ANGULAR, _ALL = 7, 56, 63


class Task(msgspec.Struct, tag_field="task", kw_only=True, forbid_unknown_fields=True):
    """What all tasks have. `name`: under which its reference is set and its error read; by default its kind and frame."""

    name: str = ""
    weight: float = 1.0
    stiffness: Gain = 100.0
    """1/s², one or one an axis"""
    damping: Gain | None = None
    """1/s"""

    def entry(self, model: WholeBodyModel) -> Entry:
        """As the kernels know it. Raises WbcError."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """What it is called: `name`, or its kind and what it is about."""
        about = getattr(self, "frame", "")
        return self.name or f"{type(self).__name__} {about}".strip()


class JPos(Task, tag="JPos", kw_only=True):
    """Joint positions: q̈_j = q̈_d + d (q̇_d − q̇_j) + k (q_d − q_j) for `joints` (all where none are named).

    All joints in the last level, the usual posture: the nearest acceleration to that in the mass metric,
    min ½ (q̈ − q̈*)ᵀ M (q̈ − q̈*), within what is left (Gauss' principle: Udwadia and Kalaba
    1992); a free base's own wanted acceleration is then 0.
    """

    joints: tuple[str, ...] = ()
    position: dict[str, float] = {}
    """rad; a joint that is not named stays where it is at the start"""

    def entry(self, model: WholeBodyModel) -> Entry:
        rows = [joint_row(model, joint, f"joints[{i}]") for i, joint in enumerate(self.joints)] or list(model.rows)
        made = entry(Kind.POSTURE, model, count=len(rows), weight=self.weight)
        made.posture = np.zeros((6, model.nv))
        made.posture[0], made.given_joints = model.state[0], np.zeros(model.nv, bool)
        for joint, value in self.position.items():
            row = joint_row(model, joint, f"position.{joint}")
            if row not in rows:
                raise WbcError(f"position.{joint}", "is not among joints")
            made.posture[0, row], made.given_joints[row] = numbers((value,), 1, f"position.{joint}")[0], True
        stiffness = np.atleast_1d(np.asarray(self.stiffness, float))
        damping = 2.0 * np.sqrt(stiffness) if self.damping is None else np.atleast_1d(np.asarray(self.damping, float))
        for field, values in (("stiffness", stiffness), ("damping", damping)):
            if values.shape not in ((1,), (len(rows),)) or not np.isfinite(values).all() or (values < 0.0).any():
                raise WbcError(
                    field, f"got {getattr(self, field)!r}; expected one number of at least 0, or {len(rows)}"
                )
        made.posture[3, rows], made.posture[4, rows], made.posture[5, rows] = stiffness, damping, 1.0
        return made


class _Frame(Task, kw_only=True):
    frame: str
    relative_to: str = ""
    """frame in whose axes, and from whose origin, the reference counts; "": the world"""

    def _pose_entry(self, model: WholeBodyModel, mask: int, point: Vector = (0.0, 0.0, 0.0)) -> Entry:
        made = entry(
            Kind.POSE, model, count=mask.bit_count(), frame=self.frame, point=point, base=self.relative_to, mask=mask,
            weight=self.weight,
        )  # fmt: skip
        gains(made, self.stiffness, self.damping, mask)
        here = self._here(model, point)
        made.parameters[at.REF_P : at.REF_P + 3] = here.translation
        made.parameters[at.REF_R : at.REF_R + 9] = here.rotation.ravel()
        made.finds_position = getattr(self, "position", None) is None
        made.finds_orientation = getattr(self, "orientation", None) is None
        return made

    def _here(self, model: WholeBodyModel, point: Vector) -> pin.SE3:
        pose = model.frame(self.frame) * pin.SE3(np.eye(3), np.asarray(point, float))
        return model.frame(self.relative_to).actInv(pose)


class CartPos(_Frame, tag="CartPos", kw_only=True):
    """The position of a point of a frame in another frame: x = R_bᵀ (p_a − p_b).

    ẋ = R_bᵀ (v_a − v_b − ω_b × r); J̇ q̇ with Coriolis and centripetal parts of the moving frame, −ω_b × (ω_b × r) − 2 ω_b × ẋ.
    """

    point: Vector = (0.0, 0.0, 0.0)
    """m, in the frame"""
    axes: tuple[str, ...] = ("x", "y", "z")
    position: Vector | None = None
    """m"""

    def entry(self, model: WholeBodyModel) -> Entry:
        made = self._pose_entry(model, axes_mask(self.axes, _LINEAR), self.point)
        if self.position is not None:
            made.parameters[at.REF_P : at.REF_P + 3] = numbers(self.position, 3, "position")
        return made


class QuaternionOrientation(_Frame, tag="QuaternionOrientation", kw_only=True):
    """A frame's orientation in another: error log(R_d Rᵀ), a rotation vector about the other frame's axes; velocity ω.

    Up to half a turn it is the shortest way (Caccavale, Siciliano and Villani 1999 compare it with others).
    """

    axes: tuple[str, ...] = ("rx", "ry", "rz")
    orientation: Quaternion | None = None

    def entry(self, model: WholeBodyModel) -> Entry:
        made = self._pose_entry(model, axes_mask(self.axes, _ANGULAR))
        if self.orientation is not None:
            made.parameters[at.REF_R : at.REF_R + 9] = rotation(self.orientation).ravel()
        return made


class SE3(_Frame, tag="SE3", kw_only=True):
    """A frame's pose in another: CartPos and QuaternionOrientation in one, of a point of it."""

    point: Vector = (0.0, 0.0, 0.0)
    axes: tuple[str, ...] = ("x", "y", "z", "rx", "ry", "rz")
    position: Vector | None = None
    orientation: Quaternion | None = None

    def entry(self, model: WholeBodyModel) -> Entry:
        made = self._pose_entry(model, axes_mask(self.axes, _ALL), self.point)
        if self.position is not None:
            made.parameters[at.REF_P : at.REF_P + 3] = numbers(self.position, 3, "position")
        if self.orientation is not None:
            made.parameters[at.REF_R : at.REF_R + 9] = rotation(self.orientation).ravel()
        return made


class COM(Task, tag="COM", kw_only=True):
    """The centre of mass in the world: J = the linear rows of the centroidal momentum matrix over the mass (Orin et al. 2013)."""

    axes: tuple[str, ...] = ("x", "y", "z")
    position: Vector | None = None
    over: tuple[str, ...] = ()
    """frames in the middle of which its x and y are to be, wherever those are: soles, say. See references.Over"""

    def entry(self, model: WholeBodyModel) -> Entry:
        for i, frame in enumerate(self.over):
            frame_on_joint(model, frame, f"over[{i}]")
        if self.over and self.position is not None:
            raise WbcError("over", "got a position, too; expected one of them")
        mask = axes_mask(self.axes, _LINEAR)
        made = entry(Kind.COM, model, count=mask.bit_count(), mask=mask, weight=self.weight)
        gains(made, self.stiffness, self.damping, mask)
        position = model.com if self.position is None else numbers(self.position, 3, "position")
        made.parameters[at.REF_P : at.REF_P + 3] = position
        made.finds_position = self.position is None
        return made


class Gaze(Task, tag="Gaze", kw_only=True):
    """An axis of a frame points at a point: its two turns across the axis follow the line of sight.

    With d the unit line of sight and ρ its length, it turns by ω_d = d × (ṗ_target − ṗ_eye) / ρ; error: the rotation vector from
    the axis to d, across the axis; ẋ = ω − ω_d, ω̇_d = (d × (p̈_target − p̈_eye) − 2 ρ̇ ω_d) / ρ. Turning about the axis stays free.
    """

    frame: str
    axis: Vector = (0.0, 0.0, 1.0)
    """in the frame; an optical frame looks along z"""
    target: Vector = (0.0, 0.0, 0.0)
    """m, in `target_frame`"""
    target_frame: str = ""
    """"": the world"""

    def entry(self, model: WholeBodyModel) -> Entry:
        made = entry(Kind.GAZE, model, count=2, frame=self.frame, base=self.target_frame, weight=self.weight)
        gains(made, self.stiffness, self.damping, 1)
        axis = numbers(self.axis, 3, "axis")
        if np.linalg.norm(axis) < 1e-9:
            raise WbcError("axis", f"got {self.axis!r}; expected a direction")
        _, placement = model.frame_on_joint(self.frame)
        axis = placement.rotation @ (axis / np.linalg.norm(axis))
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        across /= np.linalg.norm(across)
        made.parameters[at.EXTRA : at.EXTRA + 9] = np.concatenate((axis, across, np.cross(axis, across)))
        made.parameters[at.REF_P : at.REF_P + 3] = numbers(self.target, 3, "target")
        return made


class Capsule(msgspec.Struct, forbid_unknown_fields=True):
    """All points within `radius` of a line from one point of a frame to another; a sphere where they are the same."""

    frame: str = ""
    """"": the world"""
    start: Vector = (0.0, 0.0, 0.0)
    end: Vector | None = None
    """m, in the frame; none: `start`"""
    radius: float = 0.0


class Plane(msgspec.Struct, forbid_unknown_fields=True):
    """A half space that is not to be entered, of a frame: what is allowed lies where `normal` points."""

    frame: str = ""
    point: Vector = (0.0, 0.0, 0.0)
    normal: Vector = (0.0, 0.0, 1.0)


def gap_entry(model: WholeBodyModel, body: Capsule, other: Capsule | None, plane: Plane | None, weight: float) -> Entry:
    """The distance of two capsules, or of a capsule and a plane. Raises WbcError."""
    if (other is None) == (plane is None):
        raise WbcError("from", "got both or none of a capsule and a plane; expected one of them")
    other_frame = other.frame if other is not None else plane.frame if plane is not None else ""
    made = entry(Kind.CLEARANCE, model, count=1, frame=body.frame, base=other_frame, weight=weight)
    p = made.parameters

    def local(frame: str, point: Vector, field: str) -> np.ndarray:
        return model.frame_on_joint(frame)[1].act(numbers(point, 3, field))

    ends = [local(body.frame, body.start, "body.start"), local(body.frame, body.end or body.start, "body.end")]
    radius = body.radius
    if other is not None:
        ends += [
            local(other.frame, other.start, "other.start"),
            local(other.frame, other.end or other.start, "other.end"),
        ]
        radius += other.radius
    elif plane is not None:
        normal = numbers(plane.normal, 3, "plane.normal")
        if np.linalg.norm(normal) < 1e-9:
            raise WbcError("plane.normal", f"got {plane.normal!r}; expected a direction")
        origin = local(plane.frame, plane.point, "plane.point")
        normal = model.frame_on_joint(plane.frame)[1].rotation @ (normal / np.linalg.norm(normal))
        ends += [origin, origin + normal]
        made.slot = 1
    p[at.EXTRA : at.EXTRA + 12] = np.concatenate(ends)
    p[at.EXTRA + 12] = radius
    return made


class Clearance(Task, tag="Clearance", kw_only=True):
    """Keeps a capsule of the robot away from another, or from a plane, where it comes near: one direction, one sense.

    d = |p_a − p_b| − r at the nearest points, J = nᵀ (J_a − J_b), n from b to a: d̈ = K (reach − d) − D min(ḋ, 0). Beyond `reach`
    it asks for nothing and holds no freedom; it takes over without a jump, wholly from half way to `least` on. Its share s is
    3u² − 2u³, and the robot does what lies between doing with it and without it (after Lee, Mansard and Park 2012). So it springs
    back, and a fast hand comes nearer than `least` for a moment; what must never be entered is a constraint: constraints.KeepOut.
    """

    body: Capsule
    other: Capsule | None = None
    plane: Plane | None = None
    least: float = 0.02
    """m"""
    reach: float = 0.10
    """m"""

    def entry(self, model: WholeBodyModel) -> Entry:
        if not 0.0 <= self.least < self.reach:
            raise WbcError("reach", f"got {self.reach!r}; expected more than least, {self.least!r}")
        made = gap_entry(model, self.body, self.other, self.plane, self.weight)
        gains(made, self.stiffness, self.damping, 1)
        made.parameters[at.EXTRA + 13], made.parameters[at.EXTRA + 14] = self.least, self.reach
        return made

    @property
    def title(self) -> str:
        return self.name or f"Clearance {self.body.frame}"


class Wrench(Task, tag="Wrench", kw_only=True):
    """Force and moment that a frame exerts on what it touches: w* = w_d + K (w_d − w_measured), w_measured where somebody tells it.

    At a frame of a contact constraint it asks for that contact's force, in the frame's axes. Elsewhere its force joins the
    dynamics, τ = M q̈ + h + Jᵀ w, in the axes of `relative_to`: what is there is taken to push back as much. `stiffness` is the
    gain K, 0: open loop.
    """

    frame: str
    relative_to: str = ""
    axes: tuple[str, ...] = ("x", "y", "z")
    force: Vector = (0.0, 0.0, 0.0)
    """N"""
    moment: Vector = (0.0, 0.0, 0.0)
    """N·m"""
    stiffness: Gain = 0.0

    def entry(self, model: WholeBodyModel) -> Entry:
        mask = axes_mask(self.axes, _ALL)
        made = entry(
            Kind.WRENCH,
            model,
            count=mask.bit_count(),
            frame=self.frame,
            base=self.relative_to,
            mask=mask,
            weight=self.weight,
        )
        gains(made, self.stiffness, 0.0, mask)
        made.force_axes, made.force_of = mask, self.frame
        made.parameters[at.REF_V : at.REF_V + 3] = numbers(self.force, 3, "force")
        made.parameters[at.REF_V + 3 : at.REF_V + 6] = numbers(self.moment, 3, "moment")
        made.parameters[at.REF_A : at.REF_A + 6] = made.parameters[at.REF_V : at.REF_V + 6]
        return made


class Given(Task, tag="Given", kw_only=True):
    """Rows that the caller computes: J x = a with x = (q̈, f), `rows` of them; for tasks of one's own.

    Their handle's `rows` (rows, nv + nf) and `wanted` (rows,) are to be written before each cycle.
    """

    rows: int

    def entry(self, model: WholeBodyModel) -> Entry:
        if self.rows < 1:
            raise WbcError("rows", f"got {self.rows!r}; expected at least 1")
        made = entry(Kind.GIVEN, model, count=self.rows, weight=self.weight)
        made.given = np.zeros((self.rows, 1))
        return made


AnyTask = JPos | CartPos | QuaternionOrientation | SE3 | COM | Gaze | Clearance | Wrench
"""What a file may hold."""
Side = Literal["zmp", "com"]


def rotation(orientation: Quaternion) -> np.ndarray:
    """(3, 3) of a quaternion x y z w of any length but 0. Raises WbcError."""
    x = numbers(orientation, 4, "orientation")
    if np.linalg.norm(x) < 1e-9:
        raise WbcError("orientation", f"got {orientation!r}; expected a quaternion x y z w")
    return pin.Quaternion(x[3], x[0], x[1], x[2]).normalized().matrix()
