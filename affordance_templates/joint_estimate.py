"""What the tool's motion says about a template's joint.

Nothing measures the wheel. But a tool that went in between two spokes and was moved around the hinge has pushed the next spoke
ahead of it: where the tool stands in the end, there that spoke is, and friction keeps it there.
"""

from __future__ import annotations

import math

import numpy as np

from affordance_templates.template import Array, Entry, ResolvedJoint


def angle_about(joint: ResolvedJoint, reference: Array, point: Array, near: float = 0.0) -> float:
    """A point's angle about a joint's axis, rad.

    :param reference: (3,) m, a point at angle 0 (a waypoint's position), in the template's frame
    :param point: (3,) m, in the template's frame
    :param near: rad; of the angles that differ by full turns, the one nearest to this is returned
    :raises ValueError: where the reference lies on the axis
    """
    zero = reference - joint.origin
    zero = zero - joint.axis * float(joint.axis @ zero)
    if np.linalg.norm(zero) < 1e-9:
        raise ValueError(f"reference {reference.tolist()} lies on the axis of {joint.name}; expected a point beside it")
    arm = point - joint.origin
    angle = math.atan2(float(joint.axis @ np.cross(zero, arm)), float(zero @ arm))
    return near + (angle - near + math.pi) % (2 * math.pi) - math.pi


def joint_after_push(joint: ResolvedJoint, entry: Entry, entry_angle: float, tool_angle: float) -> float:
    """A joint's position after a tool went in at `entry_angle` and was moved, in the positive direction, to `tool_angle` (rad).

    The first obstacle ahead of the entry (they stand at `entry.avoid` + joint position) is touched as soon as the tool is within
    `entry.contact_offset` of it; from then on it is pushed. The joint never runs back: friction holds it.
    """
    if not entry.avoid:
        return joint.position
    ahead = min((obstacle + joint.position - entry_angle) % (2 * math.pi) for obstacle in entry.avoid)
    pushed = tool_angle + entry.contact_offset - (entry_angle + ahead)
    return joint.position + max(0.0, pushed)
