"""A robot's bodies as the guard sees them: convex, of few vertices, fitted once to the collision shapes of its URDF.

Each shape becomes some vertices of its convex hull, rounded by a radius so that the whole hull lies inside: at most `ROUNDING` m
where `_VERTICES` suffice. What a gripper moves counts as a part of the link that carries the gripper, in all places that it may
have. The fit takes a second or two, and is kept in the user's cache under a hash of all that it is made from.
"""

from __future__ import annotations

import fnmatch
import hashlib
import io
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.safety.braking import at_most
from daemon.safety.separation import AXIS, HALF_SPACE, PLACEMENT, REACH, SELF, Kept
from handrail.robot.guarding import ROUNDING, HalfSpace, KeepOut, Region
from handrail.robot.kinematics import Kinematics
from handrail.robot.urdf import cache_folder, cached

Array = NDArray[np.float64]

_VERSION = "2"
"""part of the cache's key: raise it when what is fitted changes"""
_VERTICES = 100
_CORNERS = 12
"""of a cylinder's ends"""
_NEAR_IN_TREE = 2
"""links at most so many joints apart overlap at their joints, or can't meet within the joints' limits: never watched"""
_POSTURES = 200
"""at random, over which inertia and weight are looked at for the most that they can be"""


@dataclass(frozen=True)
class Bodies:
    """The tables of `daemon.safety.separation.judge`, and what their rows are called."""

    names: tuple[str, ...]
    """(m,) the link of each body, or the region's name"""
    joints: Array
    tree: NDArray[np.int64]
    shapes: Array
    bodies: NDArray[np.int64]
    vertices: Array
    pairs: NDArray[np.int64]
    groups: NDArray[np.int64]
    margins: Array
    """(p,) m"""
    limits: Array
    """of braking in the worst posture (braking.at_most)"""

    def kept(self) -> Kept:
        """What `judge` knows and keeps, before its first call."""
        known = ("joints", "tree", "shapes", "bodies", "vertices", "pairs", "groups")
        return Kept({name: getattr(self, name) for name in known}, self.margins, self.limits.shape[1])

    def between(self, pair: int) -> NDArray[np.int64]:
        """Rows of the joints that move the bodies of a pair against each other."""
        one, other = (self._chain(int(self.bodies[body, 0])) for body in self.pairs[pair, :2])
        return np.array(sorted(int(self.tree[joint, 1]) for joint in one ^ other), np.int64)

    def _chain(self, joint: int) -> frozenset[int]:
        return frozenset(_chain(self.tree, joint))

    @classmethod
    def of(cls, kinematics: Kinematics) -> Bodies:
        """The bodies of a robot and the regions of its file."""
        description, model = kinematics.description, kinematics.model
        order = sorted(range(len(description.joints)), key=lambda row: model.getJointId(description.joints[row]))
        place = {model.getJointId(description.joints[row]): 1 + number for number, row in enumerate(order)} | {0: 0}
        tree = np.array([[-1, -1, 0], *([place[model.parents[joint]], -1, 0] for joint in place if joint)], np.int64)
        joints = np.zeros((len(tree), 16))
        joints[0, PLACEMENT] = np.r_[np.eye(3).ravel(), np.zeros(3)]
        for joint, number in place.items():
            if joint:
                fixed = model.jointPlacements[joint]
                joints[number, PLACEMENT] = np.r_[fixed.rotation.ravel(), fixed.translation]
                tree[number, 1] = order[number - 1]
                joints[number, AXIS], tree[number, 2] = _axis(model, joint)
        fitted = _fitted(kinematics)
        names, carriers = list(fitted["names"].tolist()), [place[int(joint)] for joint in fitted["joints"]]
        clouds = list(np.split(fitted["vertices"], fitted["ends"][:-1]))
        rounding = fitted["rounding"].tolist()
        guard, margins = description.guard, []
        pairs: list[tuple[int, ...]] = []
        if guard.self_collision:
            for a, b in _self_pairs(names, carriers, tree, description.allowed_collision_pairs):
                pairs.append((a, b, _base(tree, carriers[a], carriers[b]), SELF))
                margins.append(guard.margin)
        for region in guard.regions:
            carrier, points = _region(kinematics, place, region)
            own = len(names)
            for body in range(len(fitted["joints"])):
                if carriers[body] != carrier and any(fnmatch.fnmatch(names[body], p) for p in region.links):
                    kind = HALF_SPACE if isinstance(region, HalfSpace) else SELF
                    pairs.append((body, own, _base(tree, carriers[body], carrier), kind))
                    margins.append(region.margin)
            names.append(region.name)
            carriers.append(carrier)
            clouds.append(points)
            rounding.append(0.0)
        ends = np.cumsum([len(cloud) for cloud in clouds])
        bodies = np.column_stack((carriers, ends - [len(cloud) for cloud in clouds], ends)).astype(np.int64)
        shapes = np.array([_sphere(cloud, r) for cloud, r in zip(clouds, rounding, strict=True)])
        halves = {body for _, body, _, kind in pairs if kind == HALF_SPACE}
        for body in halves:  # a point; its normal comes behind
            bodies[body, 2] -= 1
            shapes[body] = np.r_[clouds[body][0], 0.0, 0.0]
        _reach(joints, tree, bodies, np.vstack(clouds), shapes)
        order, groups = _grouped(pairs, carriers)
        return cls(
            names=tuple(names),
            joints=joints,
            tree=tree,
            shapes=shapes,
            bodies=bodies,
            vertices=np.vstack(clouds),
            pairs=np.array(pairs, np.int64).reshape(-1, 4)[order],
            groups=np.array(groups, np.int64).reshape(-1, 5),
            margins=np.array(margins, float)[order],
            limits=at_most(kinematics, fitted["inertia"], fitted["weight"]),
        )


def _axis(model: pin.Model, joint: int) -> tuple[Array, bool]:
    """(axis in the joint's frame, whether it slides along it)."""
    data = model.createData()
    column = pin.computeJointJacobian(model, data, pin.neutral(model), joint)[:, model.idx_vs[joint]]
    slides = not np.any(np.abs(column[3:]) > 0.5)
    return column[:3] if slides else column[3:], slides


def _chain(tree: NDArray[np.int64], joint: int) -> Iterator[int]:
    while joint > 0:
        yield joint
        joint = int(tree[joint, 0])


def _base(tree: NDArray[np.int64], one: int, other: int) -> int:
    """The last joint from which both hang."""
    chain = {*_chain(tree, one), 0}
    return next((joint for joint in _chain(tree, other) if joint in chain), 0)


def _self_pairs(
    names: list[str], carriers: list[int], tree: NDArray[np.int64], allowed: tuple[tuple[str, str], ...]
) -> Iterator[tuple[int, int]]:
    chains = [frozenset(_chain(tree, carrier)) for carrier in carriers]
    for b, second in enumerate(names):
        for a, first in enumerate(names[:b]):
            if len(chains[a] ^ chains[b]) > _NEAR_IN_TREE and not any(
                (fnmatch.fnmatch(first, one) and fnmatch.fnmatch(second, other))
                or (fnmatch.fnmatch(second, one) and fnmatch.fnmatch(first, other))
                for one, other in allowed
            ):
                yield a, b


def _grouped(pairs: list[tuple[int, ...]], carriers: list[int]) -> tuple[list[int], list[tuple[int, ...]]]:
    """The order in which pairs on the same two joints lie side by side; of each such group its joints, the last from which both
    hang, its first pair and the one behind its last."""
    on = [(carriers[a], carriers[b], base) for a, b, base, _ in pairs]
    order = sorted(range(len(pairs)), key=on.__getitem__)
    groups: list[tuple[int, ...]] = []
    first = 0
    for joints, members in itertools.groupby(order, key=on.__getitem__):
        groups.append((*joints, first, first := first + len(list(members))))
    return order, groups


def _region(kinematics: Kinematics, place: dict[int, int], region: Region) -> tuple[int, Array]:
    """(joint that carries it, its vertices in that joint's frame; of a half space, a point and the normal)."""
    frame = kinematics.model.frames[kinematics.frame_id(region.frame)]
    carrier = place.get(_driven(kinematics.model, place, frame.parentJoint), 0)
    if isinstance(region, HalfSpace):
        if carrier:
            raise ValueError(
                f"guard.regions: {region.name}: got frame {region.frame}, which joints move; expected a fixed one"
            )
        normal = frame.placement.rotation @ np.array(region.normal)
        return carrier, np.vstack((frame.placement.act(np.array(region.point)), normal / np.linalg.norm(normal)))
    return carrier, _box_of(region, frame.placement)


def _box_of(region: KeepOut, placement: pin.SE3) -> Array:
    inside = pin.SE3(pin.rpy.rpyToMatrix(*region.rpy), np.array(region.position))
    return _placed(_corners(np.array(region.size) / 2), placement * inside)


def _corners(half: Array) -> Array:
    return np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half


def _placed(points: Array, placement: pin.SE3) -> Array:
    return np.asarray(points @ placement.rotation.T + placement.translation, np.float64)


def _sphere(points: Array, rounding: float) -> Array:
    """(5,) a sphere around a body, and its rounding."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.r_[middle, np.linalg.norm(points - middle, axis=1).max() + rounding, rounding]


def _reach(joints: Array, tree: NDArray[np.int64], bodies: NDArray[np.int64], vertices: Array, shapes: Array) -> None:
    for joint in reversed(range(len(tree))):  # the joints that one carries come after it
        for body in np.flatnonzero(bodies[:, 0] == joint):
            far = np.linalg.norm(vertices[bodies[body, 1] : bodies[body, 2]], axis=1).max() + shapes[body, 4]
            joints[joint, REACH] = max(joints[joint, REACH], far)
        if (parent := tree[joint, 0]) >= 0:
            slack = 1.0 if tree[joint, 2] else 0.0  # m that a sliding joint may move on
            beyond = np.linalg.norm(joints[joint, 9:12]) + slack + joints[joint, REACH]
            joints[parent, REACH] = max(joints[parent, REACH], beyond)


# ------------------------------------------------------------------------------------------------------------------ the fit


def _fitted(kinematics: Kinematics) -> dict[str, Any]:
    name = f"bodies-{kinematics.description.name}-{_key(kinematics)}.npz"
    if not (cache_folder() / name).exists():
        packed = io.BytesIO()
        np.savez(packed, **_fit(kinematics))
        cached(packed.getvalue(), name)
    with np.load(cache_folder() / name) as found:
        return dict(found)


def _key(kinematics: Kinematics) -> str:
    description = kinematics.description
    digest = hashlib.sha256(_VERSION.encode() + description.urdf.read_bytes())
    for mesh in ElementTree.parse(description.urdf).getroot().iterfind("./link/collision/geometry/mesh"):
        stat = Path(mesh.get("filename", "")).stat()
        digest.update(f"{mesh.get('filename')} {stat.st_size} {stat.st_mtime_ns}".encode())
    limits = np.concatenate((description.lower, description.upper))
    digest.update(repr((description.joints, description.device_limits)).encode() + limits.tobytes())
    return digest.hexdigest()[:16]


def _fit(kinematics: Kinematics) -> dict[str, Any]:
    model, description = kinematics.model, kinematics.description
    driven = {model.getJointId(joint) for joint in description.joints} | {0}
    geometry = pin.buildGeomFromUrdf(model, str(description.urdf), pin.COLLISION)
    names, joints, clouds, rounding = [], [], [], []
    for body in geometry.geometryObjects:
        carrier = _driven(model, driven, body.parentJoint)
        points, round_off = _points(body.geometry)
        placed = [_placed(points, place * body.placement) for place in _places(kinematics, carrier, body.parentJoint)]
        kept, left = _simplified(np.vstack(placed))
        names.append(model.frames[body.parentFrame].name)
        joints.append(carrier)
        clouds.append(kept)
        rounding.append(round_off + left)
    random = np.random.default_rng(1)
    postures = [
        description.home_position(next(iter(description.home))),
        *random.uniform(description.lower, description.upper, (_POSTURES, len(description.joints))),
    ]
    return {
        "names": np.array(names),
        "joints": np.array(joints),
        "ends": np.cumsum([len(cloud) for cloud in clouds]),
        "vertices": np.vstack(clouds),
        "rounding": np.array(rounding),
        "inertia": np.max([np.abs(kinematics.mass_matrix(posture)) for posture in postures], axis=0),
        "weight": np.max([np.abs(kinematics.gravity(posture)) for posture in postures], axis=0),
    }


def _driven(model: pin.Model, driven: set[int] | dict[int, int], joint: int) -> int:
    while joint not in driven:
        joint = model.parents[joint]
    return joint


def _places(kinematics: Kinematics, carrier: int, joint: int) -> Iterator[pin.SE3]:
    """Where a joint may be in the frame of the one that carries it: in one place, or wherever a gripper moves it."""
    model, data, description = kinematics.model, kinematics.data, kinematics.description
    shares = (0.0,) if joint == carrier else (0.0, 0.25, 0.5, 0.75, 1.0)
    for share in shares:
        q = pin.neutral(model)
        grip = {
            name: lower + share * (upper - lower) for name, (lower, upper, _, _) in description.device_limits.items()
        }
        follow = {name: m.multiplier * grip.get(m.joint, 0.0) + m.offset for name, m in description.mimics.items()}
        for name, position in {**grip, **follow}.items():
            if model.existJointName(name):
                q[model.idx_qs[model.getJointId(name)]] = position
        pin.forwardKinematics(model, data, q)
        yield data.oMi[carrier].inverse() * data.oMi[joint]


def _points(shape: coal.CollisionGeometry) -> tuple[Array, float]:
    """Points (k, 3) m whose hull, rounded by so many m, holds a shape."""
    match shape:
        case coal.Sphere():
            return np.zeros((1, 3)), shape.radius
        case coal.Capsule():
            return np.array([[0, 0, -shape.halfLength], [0, 0, shape.halfLength]]), shape.radius
        case coal.Box():
            return _corners(np.asarray(shape.halfSide)), 0.0
        case coal.Cylinder():
            angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
            out = shape.radius / np.cos(np.pi / _CORNERS)
            ring = np.column_stack((out * np.cos(angles), out * np.sin(angles)))
            return np.vstack([np.c_[ring, np.full(_CORNERS, z)] for z in (-shape.halfLength, shape.halfLength)]), 0.0
        case coal.BVHModelBase():
            return np.array([shape.vertex(i) for i in range(shape.num_vertices)]), 0.0
        case coal.ConvexBase():
            return np.array([shape.point(i) for i in range(shape.num_points)]), 0.0
    raise ValueError(f"collision shape {type(shape).__name__}; expected a mesh, box, cylinder, capsule or sphere")


def _simplified(points: Array) -> tuple[Array, float]:
    """(some of the points (k, 3), the rounding, m, with which their hull holds all of them)."""
    if len(points) <= 2 * _CORNERS:
        return points, 0.0
    from scipy.spatial import ConvexHull  # only where there is something to fit

    corners = points[ConvexHull(points).vertices]
    kept = sorted({int(np.argmax(corners @ axis)) for axis in np.vstack((np.eye(3), -np.eye(3), _corners(np.ones(3))))})
    hull = ConvexHull(corners[kept], incremental=True)
    while True:
        # How far out of the hull, by the planes of its faces: no more than the distance, which is asked for at the end.
        out = (corners @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        worst = int(np.argmax(out))
        if out[worst] <= 0.8 * ROUNDING or len(kept) >= _VERTICES:
            break
        kept.append(worst)
        hull.add_points(corners[worst : worst + 1])
    hull.close()
    triangles = corners[kept][ConvexHull(corners[kept]).simplices]
    return corners[kept], float(np.max(_to_triangles(corners[out > 1e-9], triangles), initial=0.0)) + 1e-6


def _to_triangles(points: Array, triangles: Array) -> Array:
    """(k,) m from points (k, 3) to the closest of triangles (t, 3, 3)."""
    here, far = points[:, None, :], np.full((len(points), len(triangles)), np.inf)
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-18)
    height = np.einsum("ktc,tc->kt", here - a, normal)
    within = np.ones(far.shape, bool)
    for one, other in ((a, b), (b, c), (c, a)):
        along, off = other - one, here - one
        share = np.einsum("ktc,tc->kt", off, along) / np.maximum(np.sum(along**2, axis=1), 1e-18)
        np.minimum(far, np.linalg.norm(off - np.clip(share, 0.0, 1.0)[..., None] * along, axis=2), out=far)
        within &= np.einsum("ktc,tc->kt", off, np.cross(normal, along)) >= 0.0
    return np.asarray(np.where(within, np.minimum(far, np.abs(height)), far).min(axis=1), np.float64)
