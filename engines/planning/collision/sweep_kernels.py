"""Compiled half of `sweep`: which pairs of bodies can come too near each other in a stretch of a motion, by balls and lever arms.

A stretch is all configurations whose coordinates are each within `excursion` of one reference. With θ the turn of a revolute joint
from the reference and r a point's distance from its axis there, the point moves by at most θ r; seen from a body before the joints
of a chain, by at most the sum of that over the chain (each joint's turn moves the point as the joints after it have left it by
as much as without them: turning changes no distance). Schwarzer, Saha, Latombe 2005 (Adaptive dynamic collision checking) bound the
lever arms for all configurations; these are those of the reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handrail.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@compiled
def near_in_stretch(
    joint_places: Array, body_places: Array, centres: Array, radii: Array, body_joints: Integers, support: Integers,
    column_joints: Integers, axes: Array, turns: NDArray[np.bool_], excursion: Array, pairs: Integers, shared: Integers,
    active: Integers, floors: Array, balls: Array, moved: Array, found: Integers, travel: Array,
) -> int:  # fmt: skip
    """How many of the `active` pairs' balls come within their floor in a stretch: their numbers in `found`, how far they can come
    nearer to each other than at the reference in `travel`.

    After a kinematics pass at the reference. Scratch: `balls` (bodies, 3), `moved` (bodies, joints + 1).

    :param joint_places: (joints, 12) in the world: rotation by columns, translation
    :param body_places: (bodies, 12)
    :param centres: (bodies, 3) m, of the balls in the bodies' frames
    :param support: [j, 0]: how many velocities move joint j; [j, 1:]: which, from the root on
    :param column_joints: (nv,) the joint that each velocity is of
    :param axes: (nv, 3) in the joint's frame
    :param turns: (nv,) whether revolute
    :param excursion: (nv,) rad or m
    :param shared: (pairs,) how many velocities move both bodies alike, from the root on
    :param floors: (pairs,) m
    """
    for body in range(centres.shape[0]):
        for a in range(3):
            balls[body, a] = body_places[body, 9 + a]
            for b in range(3):
                balls[body, a] += body_places[body, 3 * b + a] * centres[body, b]
        joint = body_joints[body]
        count = support[joint, 0]
        total = 0.0
        moved[body, count] = 0.0
        for k in range(count - 1, -1, -1):
            c = support[joint, 1 + k]
            if excursion[c] > 0.0:
                if turns[c]:
                    i = column_joints[c]
                    along, square = 0.0, 0.0
                    for a in range(3):
                        axis = 0.0
                        for b in range(3):
                            axis += joint_places[i, 3 * b + a] * axes[c, b]
                        away = balls[body, a] - joint_places[i, 9 + a]
                        along += away * axis
                        square += away * away
                    total += excursion[c] * (np.sqrt(max(square - along * along, 0.0)) + radii[body])
                else:
                    total += excursion[c]
            moved[body, k] = total
    near = 0
    for n in range(active.shape[0]):
        pair = active[n]
        a, b = pairs[pair, 0], pairs[pair, 1]
        reach = moved[a, shared[pair]] + moved[b, shared[pair]]
        apart = (balls[a, 0] - balls[b, 0]) ** 2 + (balls[a, 1] - balls[b, 1]) ** 2 + (balls[a, 2] - balls[b, 2]) ** 2
        limit = radii[a] + radii[b] + reach + floors[pair]
        if limit > 0.0 and apart < limit * limit:
            found[near] = pair
            travel[near] = reach
            near += 1
    return near
