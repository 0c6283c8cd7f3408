"""A pinocchio model built anew: every joint with one coordinate, and standing on whichever of its frames is held.

What a URDF begins with (a pelvis) is not what stands still. Seen from a sole that is held, the same joints lead to the same links,
some of them passed the other way round: J(q)⁻¹ turns about −axis by q, so positions and limits stay what they are.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

_AXES = {
    True: ((1, pin.JointModelRX), (2, pin.JointModelRY), (3, pin.JointModelRZ)),
    False: ((1, pin.JointModelPX), (2, pin.JointModelPY), (3, pin.JointModelPZ)),
}


def turns_without_end(model: pin.Model) -> bool:
    """Whether some joint has a cosine and a sine in place of a position."""
    return any(joint.nq == 2 and joint.nv == 1 for joint in model.joints[1:])


def rebuilt(model: pin.Model, geometry: pin.GeometryModel, frame: str = "") -> tuple[pin.Model, pin.GeometryModel]:
    """The same robot, its joints named as they were: those that turn without end have a position with infinite limits.

    :param frame: that stands still where the world's origin is; empty: the URDF's root, as before
    :raises ValueError: a joint that neither turns nor slides
    """
    built, path = pin.Model(), list[int]()
    root, held = 0, pin.SE3.Identity()
    if frame:
        link = model.frames[model.getFrameId(frame, pin.BODY)]
        root, held = link.parentJoint, link.placement
    body = root
    while body:
        path.append(body)
        body = model.parents[body]
    number: dict[int, int] = {root: 0}
    """joint whose body → the built model's"""
    offset: dict[int, pin.SE3] = {root: held.inverse()}
    """where a joint's body was, in the frame of the joint that carries it now"""
    for joint in path:
        parent = model.parents[joint]
        number[parent] = _joined(built, model, joint, number[joint], offset[joint], -1.0)
        offset[parent] = model.jointPlacements[joint].inverse()
    for joint in range(1, model.njoints):
        if joint not in path:
            parent = model.parents[joint]
            place = offset[parent] * model.jointPlacements[joint]
            number[joint] = _joined(built, model, joint, number[parent], place, 1.0)
            offset[joint] = pin.SE3.Identity()
    for old, new in number.items():
        built.appendBodyToJoint(new, model.inertias[old], offset[old])
    for each in list(model.frames)[1:]:
        carried = offset[each.parentJoint] * each.placement
        built.addFrame(
            pin.Frame(each.name, number[each.parentJoint], each.parentFrame, carried, each.type, pin.Inertia.Zero()), False
        )  # fmt: skip
    built.name, built.gravity = model.name, model.gravity
    shapes = pin.GeometryModel()
    for each in geometry.geometryObjects:
        shape = each.copy()
        shape.parentJoint, shape.placement = number[each.parentJoint], offset[each.parentJoint] * each.placement
        shapes.addGeometryObject(shape)
    return built, shapes


def _joined(built: pin.Model, model: pin.Model, joint: int, parent: int, place: pin.SE3, sign: float) -> int:
    """The number of a joint like one of `model`'s, about its axis times `sign`."""
    one, q, v = model.joints[joint], model.idx_qs[joint], model.idx_vs[joint]
    if one.nv != 1:
        raise ValueError(f"joint {model.names[joint]}: got one of several degrees of freedom; expected one of one")
    motion = sign * np.asarray(one.createData().S).reshape(-1)
    turning = bool(motion[3:].any())
    axis = motion[3:] if turning else motion[:3]
    kinds = [kind for row, kind in _AXES[turning] if axis[row - 1] == 1.0]
    unaligned = pin.JointModelRevoluteUnaligned if turning else pin.JointModelPrismaticUnaligned
    made = kinds[0]() if kinds else unaligned(axis)
    low, high = (model.lowerPositionLimit[q], model.upperPositionLimit[q]) if one.nq == 1 else (-np.inf, np.inf)
    limits = (np.array([x], float) for x in (model.effortLimit[v], model.velocityLimit[v], low, high))
    number: int = built.addJoint(parent, made, place, model.names[joint], *limits)
    return number
