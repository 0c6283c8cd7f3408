"""Which joints a test means: a joint, a glob over joints, a limb, a group, or several of these."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase

from handrail.robot.description import RobotDescription


def joints_of(description: RobotDescription, names: str | Iterable[str]) -> list[str]:
    """Joints in the description's order. Raises ValueError for a name that means none, naming what there is."""
    limbs = {limb.name: limb.joints for limb in description.limbs}
    chosen: set[str] = set()
    for name in [names] if isinstance(names, str) else names:
        if name in limbs:
            chosen.update(limbs[name])
        elif name in description.groups:
            chosen.update(description.groups[name])
        elif found := [joint for joint in description.joints if fnmatchcase(joint, name)]:
            chosen.update(found)
        else:
            known = ", ".join([*limbs, *(group for group in description.groups if group not in limbs)])
            raise ValueError(
                f"joints: {name!r} is none of {description.name}; expected a joint, a glob over joints, or one of {known}"
            )
    return [joint for joint in description.joints if joint in chosen]
