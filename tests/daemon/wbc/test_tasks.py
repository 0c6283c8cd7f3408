"""Rows of every kind of task against motion: J q̈ + drift is the second derivative of what the task measures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from daemon.wbc import layout as at
from daemon.wbc.constraints import Balance, JointLimits, KeepOut
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.rows import nearest
from daemon.wbc.tasks import COM, SE3, Capsule, CartPos, Clearance, Gaze, JPos, Plane, QuaternionOrientation, Task
from daemon.wbc.vectors import rotation_of, rotation_vector
from tests.daemon.wbc.conftest import states

HAND, OTHER, HEAD = "tool_right_tip", "tool_left_tip", "rgbd_depth_optical_frame"
STEP = 1e-4


def second_derivative(model, measure: Callable[[], np.ndarray], q, v, a) -> np.ndarray:
    """Of what `measure` reads, along q + v t + a t² / 2, by central differences."""

    def along(t: float) -> np.ndarray:
        model.update(q + v * t + 0.5 * a * t * t, v + a * t)
        return np.asarray(measure())

    return (along(STEP) - 2.0 * along(0.0) + along(-STEP)) / STEP**2


@pytest.mark.parametrize(
    ("task", "measure"),
    [
        (CartPos(frame=HAND, point=(0.1, 0.0, -0.05)), lambda m: m.frame(HAND).act(np.array([0.1, 0.0, -0.05]))),
        (CartPos(frame=HAND, relative_to=OTHER), lambda m: m.frame(OTHER).actInv(m.frame(HAND).translation)),
        (CartPos(frame=HAND, axes=("x", "z")), lambda m: m.frame(HAND).translation[[0, 2]]),
        (COM(), lambda m: m.com),
    ],
)
def test_positions_accelerate_as_their_rows_say(model_of, task: Task, measure) -> None:
    model = model_of("talos_upper")
    task.stiffness, task.damping = 0.0, 0.0
    body = WholeBody(model, [[task], [JPos()]])
    rng = np.random.default_rng(0)
    for position, velocity in states(model, 5, seed=7):
        model.place(position, velocity)
        q, v, a = model.q.copy(), model.v.copy(), rng.standard_normal(model.nv)
        count = int(body.plan[0, at.COUNT])
        rows, wanted = np.zeros((count, model.nv)), np.zeros(count)
        body.task_rows(0, rows, wanted)
        assert rows @ a - wanted == pytest.approx(second_derivative(model, lambda: measure(model), q, v, a), abs=1e-5)


@pytest.mark.parametrize("relative_to", ["", OTHER])
def test_orientations_accelerate_as_their_rows_say(model_of, relative_to: str) -> None:
    model = model_of("talos_upper")
    body = WholeBody(model, [[QuaternionOrientation(frame=HAND, relative_to=relative_to, stiffness=0.0, damping=0.0)]])
    rng = np.random.default_rng(1)
    for position, velocity in states(model, 5, seed=8):
        model.place(position, velocity)
        q, v, a = model.q.copy(), model.v.copy(), rng.standard_normal(model.nv)
        rows, wanted = np.zeros((3, model.nv)), np.zeros(3)
        body.task_rows(0, rows, wanted)

        def turn(t: float, q=q, v=v, a=a) -> np.ndarray:
            model.update(q + v * t + 0.5 * a * t * t, v + a * t)
            return model.frame(relative_to).rotation.T @ model.frame(HAND).rotation

        ahead, back = (pin.log3(turn(s * STEP) @ turn(0.0).T) for s in (1.0, -1.0))
        assert rows @ a - wanted == pytest.approx((ahead + back) / STEP**2, abs=1e-4)


def test_a_gaze_follows_what_it_looks_at(model_of) -> None:
    """How it turns across its axis less how the line of sight turns: its derivative is what the rows say."""
    model = model_of("talos_upper")
    rng = np.random.default_rng(2)
    for position, velocity in states(model, 5, seed=9):
        model.place(position, velocity)
        eye = model.frame(HEAD)
        ahead = model.frame(OTHER).actInv(eye.act(np.array([0.0, 0.0, 0.7])))
        body = WholeBody(
            model, [[Gaze(frame=HEAD, target=tuple(ahead), target_frame=OTHER, stiffness=0.0, damping=0.0)]]
        )
        q, v, a = model.q.copy(), model.v.copy(), rng.standard_normal(model.nv)
        rows, wanted = np.zeros((2, model.nv)), np.zeros(2)
        body.task_rows(0, rows, wanted)
        assert np.abs(body["Gaze " + HEAD].error[:2]).max() < 1e-9
        across = body["Gaze " + HEAD].parameters[at.EXTRA + 3 : at.EXTRA + 9].reshape(2, 3)
        joint, _ = model.frame_on_joint(HEAD)

        def rate(t: float, q=q, v=v, a=a, joint=joint, across=across, ahead=ahead) -> np.ndarray:
            """Across the axis: the eye's turning less that of the line of sight."""

            def sight(dt: float) -> np.ndarray:
                u = t + dt
                model.update(q + v * u + 0.5 * a * u * u, v + a * u)
                line = model.frame(OTHER).act(ahead) - model.frame(HEAD).translation
                return line / np.linalg.norm(line)

            swing = np.cross(sight(0.0), (sight(STEP) - sight(-STEP)) / (2 * STEP))
            sight(0.0)
            turning = model.data.oMi[joint].rotation @ model.data.v[joint].angular
            return across @ model.data.oMi[joint].rotation.T @ (turning - swing)

        assert rows @ a - wanted == pytest.approx((rate(STEP) - rate(-STEP)) / (2 * STEP), abs=1e-4)


@pytest.mark.parametrize(
    ("other", "plane"),
    [(Capsule(frame=OTHER, radius=0.03), None), (None, Plane(point=(0.0, 0.0, -0.3), normal=(0.1, 0.2, 1.0)))],
)
def test_a_distance_accelerates_as_its_row_says(model_of, other, plane) -> None:
    model = model_of("talos_upper")
    body = WholeBody(
        model,
        [[Clearance(body=Capsule(frame=HAND, radius=0.02), other=other, plane=plane, stiffness=0.0, damping=0.0)]],
    )
    rng = np.random.default_rng(3)
    rows, wanted = np.zeros((1, model.nv)), np.zeros(1)

    def distance() -> np.ndarray:
        body.task_rows(0, rows.copy(), wanted.copy())
        return body[f"Clearance {HAND}"].error[:1].copy()

    for position, velocity in states(model, 5, seed=10):
        model.place(position, velocity)
        q, v, a = model.q.copy(), model.v.copy(), rng.standard_normal(model.nv)
        body.task_rows(0, rows, wanted)
        kept, drift = rows.copy(), wanted.copy()
        assert kept @ a - drift == pytest.approx(second_derivative(model, distance, q, v, a), abs=1e-4)


def test_nearest_points_of_lines_are_the_nearest() -> None:
    rng = np.random.default_rng(4)
    shares = np.linspace(0.0, 1.0, 41)
    for _ in range(50):
        a0, a1, b0, b1 = rng.standard_normal((4, 3)) * rng.choice([0.0, 1.0], (4, 1))
        s, t = nearest(tuple(a0), tuple(a1), tuple(b0), tuple(b1))
        ours = np.linalg.norm(a0 + s * (a1 - a0) - b0 - t * (b1 - b0))
        u, w = np.meshgrid(shares, shares)
        points = a0 + u[..., None] * (a1 - a0) - b0 - w[..., None] * (b1 - b0)
        assert ours <= np.linalg.norm(points, axis=-1).min() + 1e-12


def test_a_rotation_vector_and_its_rotation_are_right_up_to_half_a_turn() -> None:
    rng = np.random.default_rng(5)
    for angle in (1e-10, 1e-4, 1.0, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-7):
        axis = rng.standard_normal(3)
        vector = angle * axis / np.linalg.norm(axis)
        assert rotation_vector(tuple(pin.exp3(vector).ravel())) == pytest.approx(vector, abs=1e-8)
        assert rotation_of(tuple(vector)) == pytest.approx(tuple(pin.exp3(vector).ravel()), abs=1e-12)


def run(model, body: WholeBody, cycles: int, period: float = 0.002) -> list[np.ndarray]:
    """Frictionless rigid joints under the solver's torques; the positions of each cycle."""
    data, seen = model.model.createData(), []
    q, v = model.q.copy(), model.v.copy()
    for _ in range(cycles):
        model.update(q, v)
        result = body.solve()
        assert result.solved, result.why
        v = v + period * pin.aba(model.model, data, q, v, result.torque)
        q = pin.integrate(model.model, q, period * v)
        seen.append(q.copy())
    model.update(q, v)
    return seen


def test_a_gaze_and_a_pose_relative_to_another_hand_are_reached(model_of) -> None:
    model = model_of("talos_upper")
    body = WholeBody(
        model,
        [
            [SE3(frame=HAND, relative_to=OTHER, name="hands")],
            [Gaze(frame=HEAD, target_frame=HAND, name="look")],
            [JPos()],
        ],
    )
    start = model.frame(OTHER).actInv(model.frame(HAND))
    body["hands"].pose(position=start.translation + np.array([0.05, 0.02, 0.0]))
    run(model, body, 600)
    apart = model.frame(OTHER).actInv(model.frame(HAND))
    assert apart.translation == pytest.approx(start.translation + np.array([0.05, 0.02, 0.0]), abs=1e-3)
    assert apart.rotation == pytest.approx(start.rotation, abs=2e-3)
    sight = model.frame(HEAD).actInv(model.frame(HAND).translation)
    assert np.arctan2(np.hypot(*sight[:2]), sight[2]) < 0.02


def test_limits_of_position_and_velocity_are_never_passed_on_the_way_to_a_goal_beyond_them(model_of) -> None:
    model = model_of("panda")
    limits = JointLimits(torque=None)  # braking for an end may ask for more than a drive has
    body = WholeBody(model, [[JPos(name="posture", stiffness=400.0)]], [limits])
    m = model.model
    body["posture"].joints(m.upperPositionLimit + 0.5)
    seen = np.array(run(model, body, 1500))
    velocity = np.diff(seen, axis=0) / 0.002
    assert (seen <= m.upperPositionLimit + 1e-3).all()
    assert (np.abs(seen[-1] - m.upperPositionLimit) < 5e-3).sum() >= 4, "they go there, and stand"
    assert (np.abs(velocity) <= m.velocityLimit * 1.01).all()


def test_a_hand_that_is_sent_through_a_plane_stops_before_it_and_elsewhere_goes_on(model_of) -> None:
    model = model_of("panda")
    height = model.frame("panda_hand").translation[2] - 0.1
    floor = KeepOut(body=Capsule(frame="panda_hand", radius=0.03), plane=Plane(point=(0.0, 0.0, height)), least=0.01)
    body = WholeBody(model, [[CartPos(frame="panda_hand", name="hand")], [JPos()]], [floor, JointLimits()])
    goal = model.frame("panda_hand").translation + np.array([0.0, 0.1, -0.4])
    body["hand"].pose(position=goal)
    lowest = []
    for _ in range(20):
        run(model, body, 50)
        lowest.append(model.frame("panda_hand").translation[2])
    assert min(lowest) >= height + 0.04 - 1e-3
    assert lowest[-1] == pytest.approx(height + 0.04, abs=5e-3)
    assert model.frame("panda_hand").translation[1] == pytest.approx(goal[1], abs=0.02)


def test_a_clearance_takes_part_again_after_a_solution_that_raised(model_of, monkeypatch) -> None:
    model = model_of("panda")
    away = Clearance(name="away", body=Capsule(frame="panda_hand"), plane=Plane(), least=0.0, reach=5.0)
    body = WholeBody(model, [[away], [JPos()]])

    def fail(status: int) -> None:
        raise ArithmeticError("on purpose")

    monkeypatch.setattr(body._feasibility, "solve", fail)
    model.place(np.full(7, np.nan), np.zeros(7))
    with pytest.raises(ArithmeticError):
        body.solve()
    assert body["away"].on


def test_a_clearance_takes_part_only_near_and_then_pushes_away_smoothly(model_of) -> None:
    model = model_of("panda")
    hand = model.frame("panda_hand").translation
    ball = Capsule(start=(hand[0], hand[1], hand[2] - 0.25), radius=0.05)
    away = Clearance(
        name="away", body=Capsule(frame="panda_hand", radius=0.05), other=ball, least=0.02, reach=0.12, stiffness=400.0
    )
    body = WholeBody(model, [[away], [CartPos(frame="panda_hand", name="hand", stiffness=25.0)], [JPos()]])
    plain = WholeBody(model, [[CartPos(frame="panda_hand", name="hand", stiffness=25.0)], [JPos()]])
    assert body.solve().torque == pytest.approx(plain.solve().torque, abs=1e-9), "far away it asks for nothing"
    body["hand"].pose(position=hand + np.array([0.0, 0.01, -0.25]))
    torques = []
    data, q, v = model.model.createData(), model.q.copy(), model.v.copy()
    nearest_yet = np.inf
    for _ in range(1500):
        model.update(q, v)
        torques.append(body.solve().torque.copy())
        v = v + 0.002 * pin.aba(model.model, data, q, v, torques[-1])
        q = q + 0.002 * v
        nearest_yet = min(nearest_yet, body["away"].error[0])
    assert -0.02 < nearest_yet < 0.1, "it came near, and never touched"
    assert body["away"].error[0] > 0.0, "and stands no nearer than least"
    assert np.abs(np.diff(torques, axis=0))[5:].max() < 2.0, "N·m a cycle"


@pytest.mark.parametrize("point", ["zmp", "com"])
def test_balance_keeps_a_standing_robot_over_its_polygon(model_of, point) -> None:
    from daemon.wbc.constraints import FlatContact

    model = model_of("talos", free=True)
    feet = [model.frame(f"{side}_sole_link").translation for side in ("left", "right")]
    back, front = feet[0][0] - 0.08, feet[0][0] + 0.08
    polygon = ((back, feet[1][1]), (front, feet[1][1]), (front, feet[0][1]), (back, feet[0][1]))
    constraints = [
        FlatContact(frame=f"{side}_sole_link", name=side, half_length=0.1, half_width=0.06)
        for side in ("left", "right")
    ]
    balance = Balance(polygon=polygon, point=point, floor=feet[0][2], margin=0.01)
    body = WholeBody(model, [[COM(name="com", stiffness=40.0)], [JPos()]], [*constraints, balance, JointLimits()])
    body["com"].pose(position=model.com + np.array([0.3, 0.0, 0.0]))
    result = body.solve()
    assert result.solved, result.why
    assert result.active > 0
    rows, wanted = np.zeros((3, int(body.sizes[at.N]))), np.zeros(3)
    body.task_rows(2, rows, wanted)
    acceleration = (rows[:, : model.nv] @ result.acceleration)[0]
    height = model.com[2] - feet[0][2]
    if point == "zmp":
        assert model.com[0] - height / 9.81 * acceleration >= back + 0.01 - 1e-6
    else:
        assert acceleration <= 25.0 * (front - 0.01 - model.com[0]) + 1e-6


def test_a_broken_state_near_something_is_told_like_any_other(model_of) -> None:
    model = model_of("panda")
    away = Clearance(name="away", body=Capsule(frame="panda_hand"), plane=Plane(), least=0.0, reach=5.0)
    body = WholeBody(model, [[away], [JPos()]], [JointLimits()])
    assert body.solve().solved
    model.place(np.full(7, np.nan), np.zeros(7))
    result = body.solve()
    assert not result.solved
    assert np.isfinite(result.torque).all()
