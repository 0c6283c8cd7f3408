"""What holds on every robot and for everything that is asked of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon.wbc import layout as at
from daemon.wbc.constraints import FlatContact, JointLimits
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.tasks import COM, SE3, CartPos, JPos, QuaternionOrientation
from tests.daemon.wbc.conftest import states

FRAMES = {
    "talos_upper": ("tool_right_tip", "tool_left_tip", "rgbd_depth_optical_frame"),
    "panda": ("panda_hand", "panda_link5"),
    "z1": ("link06", "link04"),
    "talos": ("wrist_right_ft_tool_link", "left_sole_link", "torso_2_link"),
}


def crowded(model, robot: str, rng, *, free: bool = False) -> WholeBody:
    """Some tasks in a random order, some sharing a level, references anywhere, gains and limits of every size."""
    tasks = [
        kind(
            frame=frame,
            name=f"{kind.__name__} {frame}",
            stiffness=float(10 ** rng.uniform(0, 3.5)),
            weight=float(rng.uniform(0.2, 3)),
        )
        for frame in FRAMES[robot]
        for kind in (CartPos, QuaternionOrientation, SE3)
        if rng.random() < 0.6
    ]
    tasks.append(COM(name="com"))
    rng.shuffle(tasks)
    levels, at_task = [], 0
    while at_task < len(tasks):
        count = int(rng.integers(1, 3))
        levels.append(tasks[at_task : at_task + count])
        at_task += count
    feet = [FlatContact(frame=f"{side}_sole_link", name=side) for side in ("left", "right")] if free else []
    limits = JointLimits(torque=float(rng.uniform(0.4, 1.5)), rate=float(rng.uniform(5, 40)), acceleration=200.0)
    body = WholeBody(model, [*levels, [JPos(name="posture")]], [*feet, limits])
    for task in tasks:
        body[task.name].pose(position=rng.uniform(-1, 1, 3), orientation=rng.standard_normal(4))
    return body


@pytest.mark.parametrize(("robot", "free"), [("talos_upper", False), ("panda", False), ("z1", False), ("talos", True)])
def test_bounds_hold_and_what_comes_out_is_finite_whatever_is_asked(model_of, robot: str, free: bool) -> None:
    rng = np.random.default_rng(11)
    solved = bounded = 0
    for _ in range(4):
        model = model_of(robot, free=free)
        body = crowded(model, robot, rng, free=free)
        nv = model.nv
        for position, velocity in states(model, 12, seed=int(rng.integers(1 << 30)), spread=0.4):
            model.place(position, velocity)
            result = body.solve()
            assert np.isfinite(result.torque).all()
            assert np.isfinite(result.acceleration).all()
            assert np.isfinite(result.force).all()
            assert result.solved or result.why
            if not result.solved:
                continue
            solved += 1
            bounded += result.active > 0
            value, (lower, upper) = body.memory["value"][0], body.memory["bound"]
            tolerance = 1e-6 * (1.0 + np.abs(value))
            assert (value >= lower - tolerance)[: 2 * nv].all()
            assert (value <= upper + tolerance)[: 2 * nv].all()
            assert (np.abs(result.torque) <= body.memory["limits"][4] + 1e-5).all()
            if free:
                assert np.abs(result.torque[:6]).max() < 1e-6
                assert np.abs(body.residual("left")).max() < 1e-6
    assert solved > 40
    assert bounded > 10


def test_a_level_is_the_same_whatever_is_put_below_it_on_every_robot(model_of) -> None:
    rng = np.random.default_rng(12)
    compared = same = 0
    for robot, frames in FRAMES.items():
        model = model_of(robot)
        limits = [JointLimits(torque=None, acceleration=30.0)]
        first = SE3(frame=frames[0], name="first", stiffness=200.0)
        alone = WholeBody(model, [[first]], limits)
        below = [[CartPos(frame=frame, name=frame, stiffness=400.0)] for frame in frames[1:]]
        full = WholeBody(model, [[first], *below, [COM()], [JPos(name="posture")]], limits)
        goal = model.frame(frames[0]).translation + 0.2
        for body in (alone, full):
            body["first"].pose(position=goal)
        for position, velocity in states(model, 15, seed=int(rng.integers(1 << 30)), spread=0.4):
            model.place(position, velocity)
            full["posture"].joints(position + 1.0)
            if not (alone.solve().solved and full.solve().solved):
                continue
            compared += 1
            norms = []
            for body in (alone, full):
                rows, wanted = np.zeros((6, model.nv)), np.zeros(6)
                body.task_rows(0, rows, wanted)
                scale = np.sqrt(np.einsum("ij,jk,ik->i", rows, np.linalg.inv(model.mass_matrix), rows))
                norms.append(np.linalg.norm((rows @ body.result.acceleration - wanted) / scale))
            assert norms[1] == pytest.approx(norms[0], rel=0.02, abs=1e-4), robot
            same += norms[1] == pytest.approx(norms[0], rel=1e-5, abs=1e-5)
    assert compared == 60
    assert same >= 57, "where next to all joints are at a bound the search may end a little early"


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    position=st.lists(st.floats(allow_nan=True, allow_infinity=True, width=64), min_size=7, max_size=7),
    velocity=st.lists(st.floats(-1e3, 1e3), min_size=7, max_size=7),
    goal=st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
)
def test_no_state_and_no_reference_makes_a_torque_beyond_the_drives(model_of, position, velocity, goal) -> None:
    model = model_of("panda")
    body = _panda(model)
    body["hand"].pose(position=goal)
    model.place(np.array(position), np.array(velocity))
    result = body.solve()
    assert np.isfinite(result.torque).all()
    if result.solved:
        assert (np.abs(result.torque) <= model.model.effortLimit * (1 + 1e-6)).all()


_bodies: dict[int, WholeBody] = {}


def _panda(model) -> WholeBody:
    if id(model) not in _bodies:
        _bodies[id(model)] = WholeBody(model, [[CartPos(frame="panda_hand", name="hand")], [JPos()]], [JointLimits()])
    return _bodies[id(model)]


def test_on_a_path_the_torque_is_continuous_with_bounds_coming_and_going(model_of) -> None:
    """At a quarter of the step, the largest change of torque is about a quarter."""
    model = model_of("talos_upper")
    body = WholeBody(
        model, [[CartPos(frame="tool_right_tip", name="hand", stiffness=300.0)], [JPos()]], [JointLimits(torque=0.5)]
    )
    body["hand"].pose(position=model.frame("tool_right_tip").translation + np.array([0.05, 0.1, 0.1]))
    home = model.q.copy()
    rng = np.random.default_rng(13)
    hz, phase = rng.uniform(0.3, 1.0, model.nv), rng.uniform(0, 2 * np.pi, model.nv)

    def largest_step(period: float) -> tuple[float, int]:
        torques, switches, before = [], 0, -1
        for t in np.arange(0.0, 0.6, period):
            model.update(
                home + 0.15 * np.sin(2 * np.pi * hz * t + phase), 0.9 * hz * np.cos(2 * np.pi * hz * t + phase)
            )
            result = body.solve()
            assert result.solved, result.why
            torques.append(result.torque.copy())
            switches += before != (before := int(body.sizes[at.ACTIVE_COUNT]))
        return float(np.abs(np.diff(torques, axis=0)).max()), switches

    coarse, _ = largest_step(1e-3)
    fine, switches = largest_step(2.5e-4)
    assert switches > 5
    assert fine < 0.5 * coarse
