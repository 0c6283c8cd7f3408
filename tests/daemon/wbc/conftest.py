"""Models of the robots, and states near a posture."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from daemon.wbc.model import WholeBodyModel
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

_made: dict[tuple[str, bool], WholeBodyModel] = {}


@pytest.fixture
def model_of() -> Callable[..., WholeBodyModel]:
    """The whole-body model of a robot, standing still at home."""

    def make(name: str, *, free: bool = False) -> WholeBodyModel:
        if (name, free) not in _made:
            _made[name, free] = WholeBodyModel.of(Kinematics(robots.load(name)), free=free)
        model = _made[name, free]
        description = robots.load(name)
        model.place(
            description.home_position(), np.zeros(len(model.joints)), np.array([0, 0, 0, 0, 0, 0, 1.0]), np.zeros(6)
        )
        return model

    return make


def states(
    model: WholeBodyModel, count: int, seed: int = 0, spread: float = 0.3
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Joint positions and velocities around where the model stands, within its limits."""
    rng = np.random.default_rng(seed)
    home = model.q[model.rows + model.nq - model.nv].copy()
    lower = model.model.lowerPositionLimit[model.rows + model.nq - model.nv]
    upper = model.model.upperPositionLimit[model.rows + model.nq - model.nv]
    for _ in range(count):
        position = np.clip(home + spread * rng.standard_normal(len(home)), lower + 0.02, upper - 0.02)
        yield position, 0.3 * rng.standard_normal(len(home))
