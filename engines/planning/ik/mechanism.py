"""The robot as inverse kinematics sees it: a pinocchio model on a fixed or a free base, its joints, limits and bodies."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from handrail.robot.kinematics import Kinematics
from handrail.robot.rooting import rebuilt, turns_without_end

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FREE_BASE = 6
"""velocities of a free base, before those of the joints"""


class Mechanism:
    """A model that is only read: each solver has pinocchio data of its own, so that several may share one mechanism.

    A configuration q (nq,) is pinocchio's: a free base's x y z and quaternion x y z w first, then the joints. `joints` are those
    with one coordinate, in the model's order; joints that turn without end (two coordinates) move as well, but have neither limits
    nor a position to speak of.
    """

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel | None = None):
        """Raises ValueError for joints that are neither of one degree of freedom nor a free base."""
        self.model = model
        self.geometry = geometry if geometry is not None else pin.GeometryModel()
        self.free = model.njoints > 1 and model.joints[1].nv == FREE_BASE
        self.nq, self.nv = model.nq, model.nv
        self.base = FREE_BASE if self.free else 0
        ids = range(2 if self.free else 1, model.njoints)
        if others := [model.names[j] for j in ids if model.joints[j].nv != 1]:
            raise ValueError(f"joint {others[0]}: got one of several degrees of freedom; expected one of one")
        named = [j for j in ids if model.joints[j].nq == 1]
        self.joints = tuple(model.names[j] for j in named)
        self.q_rows: Integers = np.array([model.idx_qs[j] for j in named], np.int64)
        self.v_rows: Integers = np.array([model.idx_vs[j] for j in named], np.int64)
        self.lower, self.upper = np.full(self.nv, -np.inf), np.full(self.nv, np.inf)
        """(nv,) of each velocity's coordinate; infinite where there is none"""
        self.lower[self.v_rows] = model.lowerPositionLimit[self.q_rows]
        self.upper[self.v_rows] = model.upperPositionLimit[self.q_rows]
        self.coordinate: Integers = np.full(self.nv, -1, np.int64)
        """(nv,) where in q each velocity's coordinate is; -1 where there is none"""
        self.coordinate[self.v_rows] = self.q_rows
        self.support: Integers = np.zeros((model.njoints, self.nv + 1), np.int64)
        """[j, 0]: how many velocities move joint j's body; [j, 1:]: which, from the root on"""
        for j in range(1, model.njoints):
            chain = [c for i in model.supports[j] if i for c in range(model.idx_vs[i], model.idx_vs[i] + model.nvs[i])]
            self.support[j, 0], self.support[j, 1 : len(chain) + 1] = len(chain), chain
        self._prismatic = {model.idx_vs[j]: "JointModelP" in model.joints[j].shortname() for j in ids}
        self._frames: dict[str, int] = {}
        self._places: dict[str, tuple[int, Array]] = {}
        self._rows = dict(zip(self.joints, self.v_rows.tolist(), strict=True))

    @cached_property
    def whole_mass(self) -> tuple[float, Array]:
        """share, held (3,) m: the robot's centre of mass is share · pinocchio's + held, which leaves out what stands still."""
        still, moving = self.model.inertias[0], pin.computeTotalMass(self.model)
        whole = still.mass + moving
        return moving / whole, np.array(still.mass * still.lever / whole)

    @classmethod
    def of(cls, kinematics: Kinematics, *, free_base: bool = False) -> Mechanism:
        """Of a robot with its joints, bodies as convex hulls; what its grippers move stands where `kinematics` has it.

        Joints that turn without end have one coordinate here, and infinite limits. Raises ValueError for those under a free base.
        """
        description = kinematics.description
        moving = description.joints
        reference = kinematics.configuration(description.home_position())
        found = cls.from_urdf(str(description.urdf), moving, reference=reference, free_base=free_base)
        return cls(*rebuilt(found.model, found.geometry)) if turns_without_end(found.model) else found

    @classmethod
    def from_urdf(
        cls, urdf: str, joints: Iterable[str] = (), *, reference: Array | None = None, free_base: bool = False,
        packages: Sequence[str] = (),
    ) -> Mechanism:  # fmt: skip
        """Of a URDF whose other joints than those (none: all of them move) stand at `reference`, q on a fixed base.

        `packages`: folders to find package:// meshes in; bodies are read only if there are any, or paths in the URDF are absolute.
        """
        model = pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer()) if free_base else pin.buildModelFromUrdf(urdf)
        geometry = pin.buildGeomFromUrdf(model, urdf, pin.COLLISION, package_dirs=list(packages) or None)
        wanted = set(joints) or set(model.names)
        lock = [j for j in range(2 if free_base else 1, model.njoints) if model.names[j] not in wanted]
        if lock:
            at = pin.neutral(model)
            if reference is not None:
                at[model.nq - len(reference) :] = reference
            _one_name_each(model)
            whole = model
            model, geometry = pin.buildReducedModel(whole, geometry, lock, at)
            _as_carried(model, whole)
        for body in geometry.geometryObjects:
            if isinstance(body.geometry, coal.BVHModelBase):
                body.geometry.buildConvexHull(True, "Qt")
                body.geometry = body.geometry.convex
        return cls(model, geometry)

    def row(self, joint: str) -> int:
        """The velocity's index of a joint of `joints`. Raises ValueError."""
        if joint not in self._rows:
            raise ValueError(f"joint: got {joint!r}; expected {_near(joint, self.joints)}")
        return self._rows[joint]

    def named(self, field: str, joint: str) -> int:
        """As `row`, for a joint that a field of the question names. Raises ValueError."""
        try:
            return self.row(joint)
        except ValueError as problem:
            raise ValueError(f"{field}: {problem}") from None

    def weights(self, given: Mapping[str, float] | None) -> Array:
        """(nv,) a factor for each velocity, 1 where none is given for its joint. Raises ValueError."""
        found = np.ones(self.nv)
        for joint, weight in (given or {}).items():
            if not 0.0 < weight < np.inf:
                raise ValueError(f"weights[{joint!r}]: got {weight}; expected a finite number above 0")
            found[self.named("weights", joint)] = weight
        return found

    def frame_id(self, name: str) -> int:
        """pinocchio's index of a frame, the link's where a joint has the same name; "" is the world. Raises ValueError."""
        if not name:
            return 0
        if name not in self._frames:
            if not self.model.existFrame(name):
                known = [frame.name for frame in self.model.frames]
                raise ValueError(f"frame: got {name!r}; expected {_near(name, known)}")
            link = self.model.existFrame(name, pin.BODY)
            self._frames[name] = self.model.getFrameId(name, pin.BODY) if link else self.model.getFrameId(name)
        return self._frames[name]

    def place(self, name: str) -> tuple[int, Array]:
        """(joint that carries a frame, 0: the world; the frame on it (12,): rotation by columns, translation).

        Raises ValueError.
        """
        if name not in self._places:
            frame = self.model.frames[self.frame_id(name)]
            self._places[name] = (frame.parentJoint if name else 0, flat(frame.placement))
        return self._places[name]

    def joint_of(self, row: int) -> str:
        """The name of the joint that has a velocity's index."""
        return next(self.model.names[j] for j in range(self.model.njoints) if self.model.idx_vs[j] == row and j)

    def unit_of(self, row: int) -> str:
        """m for a prismatic joint, else rad."""
        return "m" if self._prismatic[row] else "rad"

    def points(self, q: Array, places: Sequence[tuple[int, Array]]) -> Array:
        """(k, 3) m in the world: the origins of frames on joints, as `place` gives them."""
        if not any(joint for joint, _ in places):
            return np.array([local[9:] for _, local in places])
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        return np.array([data.oMi[joint].act(local[9:]) for joint, local in places])

    def configuration(self, positions: Array, base: pin.SE3 | None = None) -> Array:
        """q (nq,) for positions of `joints`; a free base at `base`, or at the world's origin."""
        q = pin.neutral(self.model)
        q[self.q_rows] = positions
        if base is not None and self.free:
            q[:7] = pin.SE3ToXYZQUAT(base)
        return q

    def within_limits(self, q: Array) -> Array:
        """The nearest configuration within the limits."""
        q = np.array(q, dtype=float)
        q[self.q_rows] = np.minimum(np.maximum(q[self.q_rows], self.lower[self.v_rows]), self.upper[self.v_rows])
        return pin.normalize(self.model, q)

    def check_configuration(self, name: str, q: Array) -> Array:
        """q as an array. Raises ValueError naming it where its shape is wrong or it is not finite."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self.nq,):
            raise ValueError(f"{name}: got shape {q.shape}; expected ({self.nq},), a configuration")
        if not np.isfinite(q).all():
            row = int(np.flatnonzero(~np.isfinite(q))[0])
            raise ValueError(f"{name}: got {q[row]} in row {row}; expected finite numbers")
        return q


def flat(placement: pin.SE3) -> Array:
    """(12,): rotation by columns, translation."""
    return np.concatenate((placement.rotation.T.reshape(-1), placement.translation))


def _as_carried(reduced: pin.Model, whole: pin.Model) -> None:
    """What carries the frames of joints that were locked: pinocchio 4.1 says that each carries itself."""
    for number, frame in enumerate(reduced.frames):
        if number and frame.parentFrame == number:
            carrier = whole.frames[whole.frames[whole.getFrameId(frame.name)].parentFrame]
            frame.parentFrame = reduced.getFrameId(carrier.name)


def _one_name_each(model: pin.Model) -> None:
    """Leave no other frame with a link's name: reducing a model looks frames up by name alone."""
    links = {frame.name for frame in model.frames if frame.type == pin.BODY}
    for frame in model.frames:
        if frame.type != pin.BODY and frame.name in links:
            frame.name += " joint"


def _near(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, known, 3, 0.5)
    return f"one like {', '.join(close)}" if close else f"one of {', '.join(sorted(known)[:8])}, ..."
