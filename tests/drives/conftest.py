"""Robots made up for the drives' tests: any family, any number of limbs and devices."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from handrail.robot.description import Device, Limb


def network(limbs: dict[str, tuple[str, int]], devices: dict[str, str] | None = None, answer: str = "drives") -> Any:
    """What a protocol needs of a description: limb → (family, joints), device → family; channels can0 and can1 in turns."""
    made = [
        Limb(name, index, f"can{index % 2}", tuple(f"{name}_{axis}" for axis in range(count)), family, answer)  # type: ignore[arg-type]
        for index, (name, (family, count)) in enumerate(limbs.items())
    ]
    families = list((devices or {}).values())
    nodes = [
        Device(name, family, families[:row].count(family), f"can{row % 2}", "", "")
        for row, (name, family) in enumerate((devices or {}).items())
    ]
    channels = [SimpleNamespace(name=name, interface="handrail") for name in ("can0", "can1")]
    joints = tuple(joint for limb in made for joint in limb.joints)
    return SimpleNamespace(name="made_up", joints=joints, limbs=made, channels=channels, devices=nodes)


@pytest.fixture(scope="session")
def make_network() -> Callable[..., Any]:
    return network
