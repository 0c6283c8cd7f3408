"""The rows of every kind of constraint: values against the checker's own measure, derivatives against finite differences."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.world import World
from engines.planning.ik import constraints as kinds
from engines.planning.ik.checker import Checker
from engines.planning.ik.nearness import Bodies
from engines.planning.ik.report import ANGLE_WEIGHT
from engines.planning.ik.rows import Rows, Workspace
from engines.planning.ik.table import table_of
from handrail.messages import Pose

HAND, OTHER, HEAD = "gripper_right_base_link", "gripper_left_base_link", "head_2_link"
TURNED = (0.1, -0.3, 0.5, float(np.sqrt(1 - 0.35)))
BOX = Pose(position=(0.1, -0.2, 0.3), orientation=TURNED)
LOOSE = {"lower": (-9.0, -9.0, -9.0), "upper": (9.0, 9.0, 9.0)}
FOOT = ((0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (-0.1, -0.05, 0.0), (-0.1, 0.05, 0.0))
BOUNDED = {"angle", "direction in a cone", "gaze"}
SMOOTH = {
    "position in the world": kinds.Position(frame=HAND, point=(0.1, 0.0, -0.1), box=BOX, **LOOSE),
    "position in a frame": kinds.Position(frame=HAND, in_frame=HEAD, box=BOX, **LOOSE),
    "orientation": kinds.Orientation(frame=HAND, target=TURNED),
    "orientation in a frame": kinds.Orientation(frame=HAND, in_frame=OTHER, target=TURNED),
    "angle": kinds.Orientation(frame=HAND, in_frame=OTHER, target=TURNED, angle=0.2),
    "pose": kinds.Pose(frame=HAND, in_frame=HEAD, target=BOX),
    "direction": kinds.Direction(frame=HAND, axis=(0.0, 0.3, -1.0), direction=(1.0, 0.2, 0.1), in_frame=OTHER),
    "direction in a cone": kinds.Direction(frame=HAND, axis=(0.0, 0.3, -1.0), direction=(1.0, 0.2, 0.1), cone=0.2),
    "gaze": kinds.Gaze(frame=HEAD, target=(0.0, 0.1, -0.1), in_frame=HAND, cone=0.1, origin=(0.1, 0.0, 0.1)),
    "distance of points": kinds.PointDistance(frame=HAND, other=OTHER, point=(0.1, 0.0, 0.0), upper=0.1),
    "centre of mass": kinds.CentreOfMass(in_frame="left_sole_link", **LOOSE),
    "balance on the ground": kinds.Balance(contacts={"": [(-0.1, -0.2, 0.0), (0.1, -0.2, 0.0), (0.0, 0.2, 0.0)]}),
    "balance on the feet": kinds.Balance(contacts={"left_sole_link": FOOT, "right_sole_link": FOOT}),
    "posture": kinds.Posture(coefficients={"arm_left_4_joint": 1.0, "arm_right_4_joint": -0.5}),
}


def rows_of(mechanism, constraint, reference):
    """q → (values, Jacobian), rows of angles in rad; a support's corners are in the order that they have at `reference`."""
    workspace = Workspace(mechanism)
    table = table_of(mechanism, [constraint], reference)
    near = [Bodies(mechanism, workspace.data, constraint.scene).within(constraint)] if table.bodies else []
    rows = Rows(workspace, table, near, np.arange(mechanism.nv))

    def linearised(q):
        count = rows.at(q)
        return rows.value[:count].copy(), rows.matrix[:count].copy()

    return linearised


def random_configuration(mechanism, standing, generator):
    step = np.zeros(mechanism.nv)
    step[mechanism.base :] = generator.uniform(-0.5, 0.5, mechanism.nv - mechanism.base)
    step[: mechanism.base] = generator.uniform(-0.3, 0.3, mechanism.base)
    return pin.integrate(mechanism.model, standing, step)


def numeric(mechanism, rows, q, h=1e-6):
    columns = []
    for k in range(mechanism.nv):
        step = np.zeros(mechanism.nv)
        step[k] = h
        ahead, behind = (rows(pin.integrate(mechanism.model, q, sign * step))[0] for sign in (1, -1))
        columns.append((ahead - behind) / (2 * h))
    return np.column_stack(columns)


@pytest.mark.parametrize("name", SMOOTH)
def test_the_derivative_of_every_kind_is_that_of_its_value(name, humanoid, standing):
    generator = np.random.default_rng(7)
    rows = rows_of(humanoid, SMOOTH[name], standing)
    for _ in range(3):
        q = random_configuration(humanoid, standing, generator)
        jacobian = rows(q)[1]
        exact = slice(0, 1) if name in BOUNDED else slice(None)  # the other sides of a cone turn with the first
        assert np.abs(jacobian - numeric(humanoid, rows, q))[exact].max() < 1e-6
        assert np.abs(jacobian).max() > 0.01


@pytest.mark.parametrize("name", SMOOTH)
def test_the_value_of_every_kind_is_what_the_checker_measures(name, humanoid, standing):
    generator = np.random.default_rng(8)
    constraint, checker = SMOOTH[name], Checker(humanoid)
    for _ in range(10):
        q = random_configuration(humanoid, standing, generator)
        value = rows_of(humanoid, constraint, q)(q)[0]
        measured = [m for m in checker.measures([constraint], q) if m.constraint == constraint.label]
        if name.startswith("balance"):
            table = table_of(humanoid, [constraint], q)
            assert (value - table.lower).min() == pytest.approx(measured[0].value, abs=1e-9)
            continue
        lengths = [m.value for m in measured if m.unit == "m"]
        assert np.allclose(value[: len(lengths)], lengths, atol=1e-9)
        if angles := [m.value for m in measured if m.unit == "rad"]:
            size = np.max if name in BOUNDED else np.linalg.norm
            assert size(value[len(lengths) :]) == pytest.approx(abs(angles[0]), abs=1e-9)


def test_the_derivative_of_a_clearance_is_that_of_the_distance(upper, ready):
    box = Obstacle("box", coal.Box(0.3, 0.3, 0.3), pin.SE3(np.eye(3), np.array([0.5, -0.3, 0.1])))
    scene = World(upper, [box], with_self=False)
    constraint = kinds.Clearance(scene=scene, at_least=0.05)
    rows = rows_of(upper, constraint, ready)
    generator, compared = np.random.default_rng(3), 0
    for _ in range(40):
        q = random_configuration(upper, ready, generator)
        value, jacobian = rows(q)
        if not len(value) or value.min() < 1e-3:
            continue
        nearest = int(value.argmin())
        step = generator.normal(size=upper.nv) * 1e-5
        pair = [rows(pin.integrate(upper.model, q, sign * step))[0] for sign in (1, -1)]
        change = (pair[0].min() - pair[1].min()) / 2
        assert change == pytest.approx(float(jacobian[nearest] @ step), abs=2e-7)
        compared += 1
    assert compared > 10


def test_an_exact_orientation_is_pulled_back_from_any_angle_up_to_half_a_turn(upper, ready, placed):
    hand = placed(upper, ready, "tool_left_tip")
    for angle in (1e-9, 0.5, 3.0, np.pi - 1e-6, np.pi):
        target = pin.Quaternion(hand.rotation @ pin.exp3(angle * np.array([0.6, 0.0, 0.8]))).coeffs()
        constraint = kinds.Orientation(frame="tool_left_tip", target=tuple(map(float, target)))
        value, jacobian = rows_of(upper, constraint, ready)(ready)
        assert np.linalg.norm(value) == pytest.approx(angle, abs=1e-6)
        assert np.isfinite(jacobian).all()


def test_an_angle_counts_as_its_weight_says(upper, ready):
    table = table_of(upper, [kinds.Pose(frame="tool_left_tip", target=Pose())], ready)
    assert table.weight.tolist() == [1.0] * 3 + [ANGLE_WEIGHT] * 3
