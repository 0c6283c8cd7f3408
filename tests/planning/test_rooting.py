"""A robot's model seen from another of its frames: the same links in the same places, the same limits, the same mass."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from engines.planning.ik.mechanism import Mechanism
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from handrail.robot.rooting import rebuilt

SOLE = "right_sole_link"


@pytest.fixture(scope="module")
def whole() -> Mechanism:
    return Mechanism.of(Kinematics(robots.load("talos")))


@pytest.fixture(scope="module")
def rooted(whole) -> Mechanism:
    return Mechanism(*rebuilt(whole.model, whole.geometry, SOLE))


@pytest.fixture
def posed(whole, rooted) -> tuple[pin.Data, pin.Data, np.ndarray]:
    """Both models' data at the same positions of all joints, and the second's configuration."""
    pin.seed(7)
    q = pin.randomConfiguration(whole.model)
    same = rooted.configuration(
        np.array([q[whole.coordinate[whole.row(joint)]] for joint in rooted.joints]),
    )
    one, other = whole.model.createData(), rooted.model.createData()
    pin.framesForwardKinematics(whole.model, one, q)
    pin.framesForwardKinematics(rooted.model, other, same)
    return one, other, same


def test_every_frame_is_where_it_was_as_seen_from_the_new_root(whole, rooted, posed):
    one, other, _ = posed
    sole = one.oMf[whole.frame_id(SOLE)]
    for frame in whole.model.frames[1:]:
        before = sole.actInv(one.oMf[whole.model.getFrameId(frame.name, frame.type)])
        now = other.oMf[rooted.model.getFrameId(frame.name, frame.type)]
        assert np.abs(before.homogeneous - now.homogeneous).max() < 1e-12, frame.name


def test_every_body_is_where_it_was(whole, rooted, posed):
    one, other, _ = posed
    sole = one.oMf[whole.frame_id(SOLE)]
    before, now = whole.geometry.createData(), rooted.geometry.createData()
    pin.updateGeometryPlacements(whole.model, one, whole.geometry, before)
    pin.updateGeometryPlacements(rooted.model, other, rooted.geometry, now)
    off = [np.abs(sole.actInv(a).homogeneous - b.homogeneous).max() for a, b in zip(before.oMg, now.oMg, strict=True)]
    assert max(off) < 1e-12


def _mass(mechanism: Mechanism, data: pin.Data, q: np.ndarray) -> tuple[float, np.ndarray]:
    """kg and m: pinocchio leaves out what stands still, and here it counts."""
    held, moving = mechanism.model.inertias[0], pin.centerOfMass(mechanism.model, data, q)
    mass = held.mass + data.mass[0]
    return mass, (held.mass * held.lever + data.mass[0] * moving) / mass


def test_no_mass_is_lost_and_limits_are_their_joints(whole, rooted, posed):
    one, other, q = posed
    back = whole.configuration(np.array([q[rooted.coordinate[rooted.row(joint)]] for joint in whole.joints]))
    sole = pin.SE3(one.oMf[whole.frame_id(SOLE)])
    (before, there), (now, here) = _mass(whole, one, back), _mass(rooted, other, q)
    assert now == pytest.approx(before)
    assert np.abs(sole.actInv(there) - here).max() < 1e-12
    for joint in whole.joints:
        a, b = whole.row(joint), rooted.row(joint)
        assert (whole.lower[a], whole.upper[a]) == (rooted.lower[b], rooted.upper[b])
