"""The robot as whole-body control sees it: one pass a cycle over a pinocchio model, and its results where kernels read them.

The pass (dynamics.py) gives everything at once: mass matrix, joint Jacobians, centroidal momentum, placements, bias forces,
velocities, drift accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from daemon.wbc import dynamics
from daemon.wbc.memory import Array, Integers, Memory
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.robot.model_memory import motions, placements

FREE_BASE = 6
"""velocities of a free base before those of the joints"""
VIEWS = dynamics.NAMES[: dynamics.STATE + 1]
"""What a pass leaves in memory, in the order of the kernels' table."""


class WholeBodyModel:
    """A pinocchio model of `joints` one-degree-of-freedom joints, on a fixed base or a free one, and the state it was last put in.

    Arrays are in the model's own order: `nv` velocities, a free base's six first (linear, angular, in the base's axes), then one a
    joint; `rows` says where each of `joints` is. Frames are in the world.
    """

    def __init__(self, model: pin.Model, joints: Sequence[str] | None = None):
        """Raises ValueError for a model with other joints than those, but for a free base."""
        self.model, self.data, self._other = model, model.createData(), model.createData()
        self.free = model.njoints > 1 and model.joints[1].nv == FREE_BASE
        first = 2 if self.free else 1
        others = [model.names[j] for j in range(first, model.njoints) if model.joints[j].nq != 1]
        if others:
            raise ValueError(f"joint {others[0]}: got one with several coordinates; expected revolute or prismatic")
        self.joints = tuple(joints if joints is not None else model.names[first:])
        if missing := set(model.names[first:]).symmetric_difference(self.joints):
            raise ValueError(f"joints: {sorted(missing)[0]} is not on both lists, the model's and the robot's")
        self.nv, self.nq = model.nv, model.nq
        self.base = FREE_BASE if self.free else 0
        """velocities before the first joint's"""
        self.rows: Integers = np.array([model.idx_vs[model.getJointId(name)] for name in self.joints], np.int64)
        self.mass = float(pin.computeTotalMass(model))
        """kg"""
        self.q, self.v = pin.neutral(model), np.zeros(self.nv)
        """the state as pinocchio takes it; `place` writes it"""
        self.roots = np.array([j for j in range(1, model.njoints) if model.parents[j] == 0], np.int64)
        self._frames: dict[str, int] = {}
        self.state = np.zeros((2, self.nv))
        """position and velocity (2, nv) as of the last pass; a free base has no position here"""
        self._pose, self._twist = self.q[:7], self.v[:6]
        self._memory, self._tree = self._lay_out(), dynamics.tree(model, self.rows)
        self._tree[0, dynamics.FIRST] = self.free
        self.support = np.ascontiguousarray(self._tree[:, dynamics.CHAIN :])
        """[j, 0]: how many velocities move joint j's body; [j, 1:]: which, from the root on"""
        self.update(self.q, self.v)

    @classmethod
    def of(cls, kinematics: Kinematics, *, free: bool = False) -> WholeBodyModel:
        """Of a robot with its joints in the description's order; what its grippers move stands where `kinematics` has it."""
        description: RobotDescription = kinematics.description
        model = pin.buildModelFromUrdf(str(description.urdf), pin.JointModelFreeFlyer()) if free else kinematics.model
        wanted = set(description.joints)
        lock = [j for j in range(2 if free else 1, model.njoints) if model.names[j] not in wanted]
        if lock:
            reference = pin.neutral(model)
            reference[model.nq - kinematics.model.nq :] = kinematics.configuration(description.home_position())
            model = pin.buildReducedModel(with_frames_of_one_name_each(model), lock, reference)
        return cls(model, description.joints)

    def place(
        self, position: Array, velocity: Array, base_pose: Array | None = None, base_twist: Array | None = None
    ) -> None:
        """Take a state and make the pass: `position`, `velocity` one a joint of `joints`, rad, rad/s.

        A free base's `base_pose` is x y z, quaternion x y z w; `base_twist` linear, angular, in the base's own axes.
        """
        pose = self._pose if base_pose is None else base_pose
        twist = self._twist if base_twist is None else base_twist
        dynamics.place(position, velocity, pose, twist, self._memory.table, self._tree)

    def update(self, q: Array, v: Array) -> None:
        """Take a state in pinocchio's own arrays, q (nq,), v (nv,), and make the pass."""
        self.place(q[self.rows + self.nq - self.nv], v[self.rows], q[:7], v[:6])

    def frame_id(self, name: str) -> int:
        """pinocchio's index of a frame, the link's where a joint has the same name; "" is the world. Raises KeyError."""
        if not name:
            return 0
        if name not in self._frames:
            if not self.model.existFrame(name):
                raise KeyError(name)
            link = self.model.existFrame(name, pin.BODY)
            self._frames[name] = self.model.getFrameId(name, pin.BODY) if link else self.model.getFrameId(name)
        return self._frames[name]

    def frame_on_joint(self, name: str) -> tuple[int, pin.SE3]:
        """(joint that carries the frame, 0: the world; the frame on it). Raises KeyError."""
        if not name:
            return 0, pin.SE3.Identity()
        frame = self.model.frames[self.frame_id(name)]
        return frame.parentJoint, frame.placement

    def frame(self, name: str) -> pin.SE3:
        """A frame in the world, as of the last pass. Raises KeyError."""
        joint, placement = self.frame_on_joint(name)
        return self.data.oMi[joint] * placement

    @property
    def com(self) -> Array:
        """(3,) m, the centre of mass in the world, as of the last pass."""
        return np.array(self.data.oYcrb[0].lever)

    @property
    def mass_matrix(self) -> Array:
        """(nv, nv), as of the last pass."""
        upper = np.triu(self.data.M)
        return upper + np.triu(upper, 1).T

    @property
    def bias(self) -> Array:
        """C(q, v) v + g(q), (nv,), as of the last pass."""
        return np.array(self.data.nle)

    def gravity_torque(self) -> Array:
        """g(q), (nv,), at the last pass's position; costs a pass of its own, into data that nobody else reads."""
        return np.array(pin.computeGeneralizedGravity(self.model, self._other, self.q))

    def share(self, memory: Memory) -> None:
        """Put views of all that a pass leaves behind under `VIEWS`."""
        memory.hold(self)
        for name in VIEWS:
            memory.put(name, self._memory[name])

    def _lay_out(self) -> Memory:
        """What a pass reads and writes. Raises RuntimeError for a pinocchio that lays its memory out otherwise than believed."""
        data, memory = self.data, Memory(dynamics.NAMES)
        memory.put("mass", data.M.T)
        memory.put("bias", data.nle.reshape(1, -1))
        memory.put("jacobian", data.J.T)
        memory.put("momentum", data.Ag.T)
        memory.put("placement", placements(data.oMi))
        memory.put("parent_placement", placements(data.liMi))
        memory.put("velocity", motions(data.v))
        memory.put("drift", motions(data.a_gf))
        memory.put("force", motions(data.f))
        memory.put("com", np.asarray(data.oYcrb[0].lever).reshape(1, 3))
        memory.put("state", self.state)
        memory.put("q", self.q.reshape(1, -1))
        memory.put("v", self.v.reshape(1, -1))
        memory.put("body", dynamics.bodies(self.model))
        memory.make("composite", self.model.njoints, dynamics.INERTIA_WIDTH)
        return memory


def with_frames_of_one_name_each(model: pin.Model) -> pin.Model:
    """A copy in which no other frame has a link's name: reducing a model looks frames up by name alone."""
    model = pin.Model(model)
    links = {frame.name for frame in model.frames if frame.type == pin.BODY}
    for frame in model.frames:
        if frame.type != pin.BODY and frame.name in links:
            frame.name += " joint"
    return model
