"""What a hand carries goes along with it: its instance is attached to the arm's tip once the hand holds it, and stands again where
the hand has opened.
"""

from __future__ import annotations

from dataclasses import replace

from affordance_templates import attachments
from affordance_templates.instance import Instance
from affordance_templates.undoing import ROBOT
from engines.activities.base import Services
from handrail.messages import AttachInstance
from handrail.robot.description import Arm
from handrail.topics import RefusedError


def take(services: Services, instance: Instance, arm: Arm) -> Instance:
    """The instance is in the arm's hand from now on. Returns it as whoever goes along it counts on it: where it was, at its version
    now.

    Where it can't be attached (an operator holds it), people are told, and it stays as it is.
    """
    return _attached(services, instance, arm.tip)


def let_go(services: Services, arm: Arm, instance: Instance | None = None) -> Instance | None:
    """All that the arm's hand carried stands where it is now. Returns `instance` as `take` does."""
    for each in services.affordances.instances():
        if attachments.link(each.attached_to) == arm.tip:
            standing = _attached(services, each, "")
            if instance is not None and each.name == instance.name:
                instance = replace(instance, version=standing.version)
    return instance


def _attached(services: Services, instance: Instance, link: str) -> Instance:
    try:
        edit = services.affordances.attach(AttachInstance(name=instance.name, link=link, by=ROBOT))
    except RefusedError as refused:
        services.log(
            "warning", f"{instance.name} is not told to {'go along with ' + link if link else 'stand'}: {refused}"
        )
        return instance
    return instance if edit.instance is None else replace(instance, version=edit.instance.version)
