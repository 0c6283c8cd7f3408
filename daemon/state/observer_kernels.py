"""Compiled: what momentum observer and wrist sensors make of a cycle, on pinocchio's memory; the laws stand in observer.py."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numba import njit

from daemon.wbc import dynamics
from daemon.wbc.dynamics import (
    AXIS,
    BODY_WIDTH,
    FIRST,
    JOINT,
    ON_P,
    ON_R,
    PARENT,
    TURNS,
    put_force,
    put_placement,
    turned,
)
from daemon.wbc.memory import Array, Memory, fill, line, matrix, vector
from daemon.wbc.vectors import (
    FAST,
    add,
    by_columns,
    cross,
    dot,
    minus,
    nine,
    product,
    put,
    rotate,
    rotate_back,
    three,
    times,
)
from handrail.compiled import compiled
from handrail.robot.model_memory import motions, placements

NAMES = ("on_parent", "velocity", "drift", "force", "body", "gravity", "kept", "felt", "told", "offset", "wrench")
"""pinocchio's liMi, v, a_gf, f of the robot as it moves, gravity's acceleration in a_gf; `dynamics.bodies`; gravity (1, 3); KEPT;
of frames at which sensors are asked: FELT each; of all devices what they tell, and the sensors' offsets; the frames' wrenches"""
_ON_PARENT, _VELOCITY, _DRIFT, _FORCE, _BODY, _GRAVITY, _KEPT, _FELT, _TOLD, _OFFSET, _WRENCH = range(len(NAMES))
RESIDUAL, FIRST_POLE, LAST_VELOCITY, LAST_TORQUE, WANTED, KEPT = range(6)
"""Rows of what is kept, in the order of the model's velocities: torques behind both poles, behind the first; of the cycle before;
torques that the motion wants."""
SENSOR_JOINT, FRAME_JOINT, FRAME_P, DEVICE, GAIN, FELT = (BODY_WIDTH + place for place in (0, 1, 2, 5, 6, 7))
"""A sensor: what it carries as dynamics.bodies has it, on the sensor instead of on a joint; whose joint carries both; of the frame
that is asked about the joint, and where it is on that; the sensor's row among devices; how far a cycle's wrench counts, 0: not."""


def memory_of(model: pin.Model, data: pin.Data) -> Memory:
    """What `observe` reads and writes; the model's gravity may change."""
    memory = Memory(NAMES)
    memory.hold((model, data))
    memory.put("on_parent", placements(data.liMi))
    memory.put("velocity", motions(data.v))
    memory.put("drift", motions(data.a_gf))
    memory.put("force", motions(data.f))
    memory.put("body", dynamics.bodies(model))
    memory.put("gravity", model.gravity.linear.reshape(1, 3))
    memory.make("kept", KEPT, model.nv)
    for name in ("felt", "told", "offset", "wrench"):
        memory.make(name, 0, 6)
    return memory


def sensor_of(placement: pin.SE3, inertia: pin.Inertia, joint: int) -> Array:
    """(FELT,), of a sensor at `placement` on a joint, that carries `inertia`, in the joint's frame; about its own origin."""
    known = np.zeros(FELT)
    dynamics.put_body(known, placement, inertia)
    known[SENSOR_JOINT] = joint
    return known


@compiled(fastmath=FAST, error_model="numpy")
def observe(q, v, torque, gain, period, table, tree):  # type: ignore[no-untyped-def]
    """One cycle of the momentum observer: Newton-Euler with the acceleration since the last one, both poles; and of the sensors."""
    body, kept = matrix(table, _BODY), matrix(table, _KEPT)
    velocities, drifts, forces = matrix(table, _VELOCITY), matrix(table, _DRIFT), matrix(table, _FORCE)
    fill(velocities[0], 0.0)
    fill(drifts[0], 0.0)
    put(drifts[0], 0, times(-1.0, three(vector(table, _GRAVITY), 0)))
    for j in range(1, tree.shape[0]):
        known, parent, c = body[j], tree[j, PARENT], tree[j, FIRST]
        r, p, axis, turns = nine(known, ON_R), three(known, ON_P), three(known, AXIS), known[TURNS] > 0.0
        if turns:
            r = product(r, turned(axis, q[c]))
        else:
            p = add(p, rotate(r, times(q[c], axis)))
        put_placement(line(table, _ON_PARENT, j), r, p)
        linear, angular = three(velocities[parent], 0), three(velocities[parent], 3)
        linear, angular = rotate_back(r, add(linear, cross(angular, p))), rotate_back(r, angular)
        drift, spin = three(drifts[parent], 0), three(drifts[parent], 3)
        drift, spin = rotate_back(r, add(drift, cross(spin, p))), rotate_back(r, spin)
        own, more = times(v[c], axis), times((v[c] - kept[LAST_VELOCITY, c]) / period, axis)
        if turns:
            drift, spin = add(drift, cross(linear, own)), add(spin, add(cross(angular, own), more))
            angular = add(angular, own)
        else:
            drift = add(drift, add(cross(angular, own), more))
            linear = add(linear, own)
        put(velocities[j], 0, linear)
        put(velocities[j], 3, angular)
        put(drifts[j], 0, drift)
        put(drifts[j], 3, spin)
        put_force(forces[j], known, linear, angular, drift, spin)
    for j in range(tree.shape[0] - 1, 0, -1):
        known, parent, c = body[j], tree[j, PARENT], tree[j, FIRST]
        force, moment = three(forces[j], 0), three(forces[j], 3)
        wanted = dot(three(known, AXIS), moment if known[TURNS] > 0.0 else force)
        kept[WANTED, c] = wanted + known[dynamics.ARMATURE] * (v[c] - kept[LAST_VELOCITY, c]) / period
        if parent:
            force, moment = _lifted(line(table, _ON_PARENT, j), force, moment)
            above = forces[parent]
            put(above, 0, add(three(above, 0), force))
            put(above, 3, add(three(above, 3), moment))
        kept[LAST_VELOCITY, c] = v[c]
        i = tree[j, JOINT]
        if i >= 0:
            mean = 0.5 * (torque[i] + kept[LAST_TORQUE, c])
            kept[FIRST_POLE, c] += gain * (kept[WANTED, c] - mean - kept[FIRST_POLE, c])
            kept[RESIDUAL, c] += gain * (kept[FIRST_POLE, c] - kept[RESIDUAL, c])
            kept[LAST_TORQUE, c] = torque[i]
    felt, told = matrix(table, _FELT), matrix(table, _TOLD)
    offset, wrench = matrix(table, _OFFSET), matrix(table, _WRENCH)
    for k in range(felt.shape[0]):
        known = felt[k]
        if known[GAIN] > 0.0:
            device = int(known[DEVICE])
            _feel_at(known, told[device], offset[device], table, tree, known[GAIN], wrench[k])


@njit(fastmath=FAST, error_model="numpy")
def _lifted(on_parent, force, moment):  # type: ignore[no-untyped-def]
    """A wrench about a joint's origin, as one about its parent's."""
    r = by_columns(on_parent)
    force = rotate(r, force)
    return force, add(rotate(r, moment), cross(three(on_parent, 9), force))


@njit(fastmath=FAST, error_model="numpy")
def _beyond(known, told, offset, table):  # type: ignore[no-untyped-def]
    """Force and moment that something outside exerts beyond the sensor, on its joint: what keeps that moving, less what is told."""
    joint = int(known[SENSOR_JOINT])
    twist, drift, carried = line(table, _VELOCITY, joint), line(table, _DRIFT, joint), np.empty(6)
    put_force(carried, known, three(twist, 0), three(twist, 3), three(drift, 0), three(drift, 3))
    r = nine(known, ON_R)
    force = rotate(r, minus(three(told, 0), three(offset, 0)))
    moment = add(rotate(r, minus(three(told, 3), three(offset, 3))), cross(three(known, ON_P), force))
    return add(three(carried, 0), force), add(three(carried, 3), moment)


@compiled(fastmath=FAST, error_model="numpy")
def feel_beyond(known, told, offset, table, out):  # type: ignore[no-untyped-def]
    """`out` (6,) ← what something outside exerts on what is beyond the sensor, in its own axes, about its origin."""
    force, moment = _beyond(known, told, offset, table)
    r = nine(known, ON_R)
    put(out, 0, rotate_back(r, force))
    put(out, 3, rotate_back(r, minus(moment, cross(three(known, ON_P), force))))


@njit(fastmath=FAST, error_model="numpy")
def _feel_at(known, told, offset, table, tree, gain, wrench):  # type: ignore[no-untyped-def]
    """Move `wrench` (6,), about the frame's origin in the world's axes, by `gain` towards what the sensor feels."""
    force, moment = _beyond(known, told, offset, table)
    j = int(known[SENSOR_JOINT])
    while j:
        force, moment = _lifted(line(table, _ON_PARENT, j), force, moment)
        j = tree[j, PARENT]
    j, origin = int(known[FRAME_JOINT]), three(known, FRAME_P)
    while j:
        on_parent = line(table, _ON_PARENT, j)
        origin = add(three(on_parent, 9), rotate(by_columns(on_parent), origin))
        j = tree[j, PARENT]
    moment = minus(moment, cross(origin, force))
    for i in range(3):
        wrench[i] += gain * (force[i] - wrench[i])
        wrench[3 + i] += gain * (moment[i] - wrench[3 + i])
