"""Strict order, bounds, contacts: against dense linear algebra that shares no code with the kernels."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import lsq_linear

from daemon.wbc import kernels
from daemon.wbc.constraints import FlatContact, JointLimits, PointContact, Transmission
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.parameters import WbcError
from daemon.wbc.tasks import COM, SE3, CartPos, Given, JPos, QuaternionOrientation, Wrench
from tests.daemon.wbc.conftest import states

HAND, OTHER = "tool_right_tip", "tool_left_tip"


def upper_body(model, constraints=()) -> WholeBody:
    body = WholeBody(
        model,
        [
            [CartPos(frame=HAND, name="hand")],
            [QuaternionOrientation(frame=OTHER, name="other")],
            [COM(name="com", axes=("x", "y"))],
            [JPos(name="posture")],
        ],
        constraints,
    )
    body["hand"].pose(position=model.frame(HAND).translation + np.array([0.03, 0.02, 0.05]))
    return body


@pytest.mark.parametrize(
    ("robot", "frame"),
    [("talos_upper", HAND), ("panda", "panda_hand"), ("z1", "link06"), ("talos", "wrist_right_ft_tool_link")],
)
def test_levels_are_met_exactly_where_nothing_stands_in_their_way(model_of, robot, frame) -> None:
    model = model_of(robot)
    levels = [
        [CartPos(frame=frame, name="tip")],
        [QuaternionOrientation(frame=frame, name="turn", axes=("rx",))],
        [JPos()],
    ]
    body = WholeBody(model, levels)
    body["tip"].pose(position=model.frame(frame).translation + 0.03)
    exact = 0
    for position, velocity in states(model, 40):
        model.place(position, velocity)
        assert body.solve().solved
        for level, title in enumerate(("tip", "turn")):
            if body.exact(level):
                exact += 1
                assert np.abs(body.residual(title)).max() < 1e-9
    assert exact > 40


def test_what_a_lower_level_wants_is_nothing_to_a_higher_one(model_of) -> None:
    model = model_of("talos_upper")
    body = upper_body(model)
    for position, velocity in states(model, 30, seed=1):
        model.place(position, velocity)
        body["posture"].joints(position)
        body.solve()
        before = [body.residual(title).copy() for title in ("hand", "other", "com")]
        body["posture"].joints(position + 10.0)
        result = body.solve()
        assert np.abs(result.torque).max() > 100.0, "the posture does pull"
        for title, residual in zip(("hand", "other", "com"), before, strict=True):
            assert body.residual(title) == pytest.approx(residual, abs=1e-9)


def test_the_torque_makes_the_acceleration_that_it_says(model_of) -> None:
    model = model_of("talos_upper")
    body = upper_body(model, [JointLimits()])
    other = model.model.createData()
    for position, velocity in states(model, 20, seed=2):
        model.place(position, velocity)
        result = body.solve()
        assert pin.aba(model.model, other, model.q, model.v, result.torque) == pytest.approx(
            result.acceleration, abs=1e-6
        )


def test_the_rest_is_the_nearest_to_the_posture_in_the_mass_metric(model_of) -> None:
    model = model_of("talos_upper")
    body = WholeBody(model, [[CartPos(frame=HAND, name="hand")], [JPos(name="posture")]])
    body["hand"].pose(position=model.frame(HAND).translation + np.array([0.0, 0.03, 0.03]))
    for position, velocity in states(model, 10, seed=3):
        model.place(position, velocity)
        q_dd = body.solve().acceleration.copy()
        rows, wanted = np.zeros((3, model.nv)), np.zeros(3)
        body.task_rows(0, rows, wanted)
        mass, posture = model.mass_matrix, q_dd - body.residual("posture")
        kkt = np.block([[mass, rows.T], [rows, np.zeros((3, 3))]])
        expected = np.linalg.solve(kkt, np.concatenate((mass @ posture, wanted)))[: model.nv]
        assert q_dd == pytest.approx(expected, abs=1e-7)


def test_the_first_level_is_the_best_that_bounds_allow(model_of) -> None:
    model = model_of("talos_upper")
    body = WholeBody(
        model,
        [[SE3(frame=HAND, name="hand", stiffness=400.0)], [JPos()]],
        [JointLimits(torque=None, acceleration=10.0)],
    )
    body["hand"].pose(position=model.frame(HAND).translation + np.array([0.1, 0.1, 0.1]))
    bounded = compared = best_of_all = 0
    for position, velocity in states(model, 40, seed=4):
        model.place(position, velocity)
        result = body.solve()
        assert result.solved
        bounded += result.active > 0
        rows, wanted = np.zeros((6, model.nv)), np.zeros(6)
        body.task_rows(0, rows, wanted)
        scale = np.sqrt(np.einsum("ij,jk,ik->i", rows, np.linalg.inv(model.mass_matrix), rows))
        lower, upper = body.memory["bound"][:, : model.nv]
        assert (result.acceleration >= lower - 1e-7).all()
        assert (result.acceleration <= upper + 1e-7).all()
        best = lsq_linear(rows / scale[:, None], wanted / scale, (lower - 1e-9, upper + 1e-9), tol=1e-14)
        ours = np.linalg.norm((rows @ result.acceleration - wanted) / scale)
        gram = (rows / scale[:, None]) @ np.linalg.inv(model.mass_matrix) @ (rows / scale[:, None]).T
        if np.linalg.eigvalsh(gram)[0] < kernels.SINGULAR:
            continue  # it is damped
        compared += 1
        assert ours <= np.linalg.norm(best.fun) * 1.01 + 1e-4
        best_of_all += ours <= np.linalg.norm(best.fun) * (1.0 + 1e-4) + 1e-4
    assert min(bounded, compared) >= 20
    assert best_of_all >= compared - 1, "with next to all joints at a bound the search may end a little early"


def test_order_stays_strict_at_active_bounds(model_of) -> None:
    """The first level alone and with others below it: what it reaches is the same, whatever they want."""
    model = model_of("talos_upper")
    limits = [JointLimits(torque=0.6)]
    first = CartPos(frame=HAND, name="hand", stiffness=300.0)
    alone = WholeBody(model, [[first]], limits)
    crowded = WholeBody(
        model, [[first], [SE3(frame=OTHER, name="other", stiffness=500.0)], [JPos(name="posture")]], limits
    )
    reach = model.frame(HAND).translation + np.array([0.1, 0.05, 0.1])
    alone["hand"].pose(position=reach)
    crowded["hand"].pose(position=reach)
    crowded["other"].pose(position=model.frame(OTHER).translation + 0.2)
    bounded = 0
    for position, velocity in states(model, 40, seed=5):
        model.place(position, velocity)
        crowded["posture"].joints(position + 1.0)
        if not alone.solve().solved:
            continue
        result = crowded.solve()
        assert result.solved
        bounded += result.active > 0
        assert np.abs(result.torque).max() <= (0.6 * model.model.effortLimit).max() + 1e-6
        mine, theirs = (np.linalg.norm(_weighed(body, model)) for body in (crowded, alone))
        assert mine == pytest.approx(theirs, abs=1e-5, rel=1e-5)
    assert bounded >= 20


def _weighed(body: WholeBody, model) -> np.ndarray:
    rows, wanted = np.zeros((3, model.nv)), np.zeros(3)
    body.task_rows(0, rows, wanted)
    scale = np.sqrt(np.einsum("ij,jk,ik->i", rows, np.linalg.inv(model.mass_matrix), rows))
    return (rows @ body.result.acceleration - wanted) / scale


def test_weights_settle_a_quarrel_within_a_level(model_of) -> None:
    model = model_of("panda")
    here = np.zeros(model.nv)
    mass = model.mass_matrix

    def asked(weight: float) -> float:
        body = WholeBody(model, [[Given(name="up", rows=1, weight=weight), Given(name="down", rows=1)]])
        for title, wanted in (("up", 1.0), ("down", -1.0)):
            body[title].rows[:], body[title].wanted[:] = 0.0, wanted
            body[title].rows[0, 0] = 1.0
        assert body.solve().solved
        return float(body.result.acceleration[0])

    assert asked(1.0) == pytest.approx(0.0, abs=1e-9)
    # min w² (a − 1)² + (a + 1)²
    assert asked(2.0) == pytest.approx((4.0 - 1.0) / 5.0, abs=1e-9)
    assert mass.shape == (7, 7) and not here.any()


def test_a_free_robot_stands_on_its_feet_by_newtons_law(model_of) -> None:
    model = model_of("talos", free=True)
    feet = [
        FlatContact(frame=f"{side}_sole_link", name=side, friction=0.7, half_length=0.1, half_width=0.06)
        for side in ("left", "right")
    ]
    body = WholeBody(model, [[COM(name="com")], [JPos(name="posture")]], [*feet, JointLimits()])
    body["com"].pose(position=model.com + np.array([0.0, 0.01, 0.02]))
    result = body.solve()
    assert result.solved, result.why
    assert np.abs(body.residual("com")).max() < 1e-8
    total = sum(model.frame(f"{side}_sole_link").rotation @ body[side].force()[:3] for side in ("left", "right"))
    rows, wanted = np.zeros((3, 36 + 12)), np.zeros(3)
    body.task_rows(2, rows, wanted)
    gravity = np.array([0.0, 0.0, 9.81])
    com_acceleration = rows[:, :36] @ result.acceleration
    assert total == pytest.approx(model.mass * (com_acceleration + gravity), rel=1e-6)
    assert np.abs(result.torque[:6]).max() < 1e-7, "the base has no drives"
    for side in ("left", "right"):
        assert np.abs(body.residual(side)).max() < 1e-8, "the feet stay where they are"
        x, y, z, *moments = body[side].force()
        assert max(abs(x), abs(y)) <= 0.7 / np.sqrt(2) * z + 1e-6
        assert abs(moments[0]) <= 0.06 * z + 1e-6
        assert abs(moments[1]) <= 0.1 * z + 1e-6


def test_a_contact_is_the_dynamics_of_a_constrained_body(model_of) -> None:
    """The torque, in the dense equations of a body held at a point (Udwadia and Kalaba's), makes the same q̈ and force."""
    model = model_of("panda")
    tip = "panda_hand"
    body = WholeBody(
        model,
        [[Wrench(frame=tip, axes=("x", "y", "z"), force=(1.0, 2.0, -12.0))], [JPos(name="posture")]],
        [PointContact(frame=tip, name="wall", friction=0.8, damping=0.0)],
    )
    body["posture"].joints(model.q + 0.2)
    pushed = 0
    for position, _ in states(model, 10, seed=6):
        model.place(position, np.zeros(7))
        result = body.solve()
        assert result.solved, result.why
        assert np.abs(body.residual("wall")).max() < 1e-8
        jacobian = pin.computeFrameJacobian(
            model.model, model.model.createData(), model.q, model.frame_id(tip), pin.LOCAL
        )[:3]
        kkt = np.block([[model.mass_matrix, -jacobian.T], [jacobian, np.zeros((3, 3))]])
        expected = np.linalg.solve(kkt, np.concatenate((result.torque - model.bias, np.zeros(3))))
        assert result.acceleration == pytest.approx(expected[:7], abs=1e-6)
        assert body["wall"].force() == pytest.approx(expected[7:], abs=1e-6)
        pushed += body["wall"].force() == pytest.approx([-1.0, -2.0, 12.0], abs=1e-6)
    assert pushed == 10, "the wall pushes back as hard as it is to be pushed"


def test_a_wrench_without_contact_is_added_to_the_torques(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[Wrench(frame="panda_hand", force=(3.0, 0.0, -5.0))], [JPos()]])
    result = body.solve()
    jacobian = pin.computeFrameJacobian(
        model.model, model.model.createData(), model.q, model.frame_id("panda_hand"), pin.LOCAL_WORLD_ALIGNED
    )
    expected = model.mass_matrix @ result.acceleration + model.bias + jacobian[:3].T @ np.array([3.0, 0.0, -5.0])
    assert result.torque == pytest.approx(expected, abs=1e-8)


def test_a_follower_without_a_drive_is_carried_by_its_leader(model_of) -> None:
    model = model_of("panda")
    leader, follower = "panda_joint5", "panda_joint6"
    body = WholeBody(
        model,
        [[CartPos(frame="panda_hand", name="hand")], [JPos()]],
        [Transmission(leader=leader, follower=follower, ratio=0.5, offset=1.6), JointLimits()],
    )
    result = body.solve()
    a, b = (int(model.rows[model.joints.index(name)]) for name in (leader, follower))
    assert result.acceleration[b] == pytest.approx(
        0.5 * result.acceleration[a] + 400.0 * (0.5 * model.state[0, a] + 1.6 - model.state[0, b]), abs=1e-7
    )
    full = model.mass_matrix @ result.acceleration + model.bias
    assert result.torque[b] == 0.0
    assert result.torque[a] == pytest.approx(full[a] + 0.5 * full[b])


def test_constraints_that_exclude_each_other_are_named_with_by_how_much(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[JPos()]], [JointLimits(torque=0.05, acceleration=1e-3)])
    result = body.solve()
    assert not result.solved
    needed = np.abs(model.bias) - 0.05 * model.model.effortLimit
    worst = model.joints[int(np.argmax(needed))]
    assert any(worst in blocked.constraint for blocked in result.blocked)
    assert "exclude each other" in result.why
    assert all(0.0 < blocked.amount < needed.max() + 0.1 for blocked in result.blocked)
    assert np.isfinite(result.torque).all()


def test_equalities_that_contradict_are_named(model_of) -> None:
    model = model_of("panda")
    couple = dict(leader="panda_joint1", follower="panda_joint2", driven=True)
    constraints = [Transmission(name="here", offset=0.0, **couple), Transmission(name="there", offset=0.5, **couple)]
    result = WholeBody(model, [[JPos()]], constraints).solve()
    assert not result.solved
    assert "there contradicts" in result.why


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nothing_that_is_no_number_comes_out(model_of, value) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[CartPos(frame="panda_hand", name="hand")], [JPos(name="posture")]], [JointLimits()])
    good = body.solve().torque.copy()
    position, velocity = model.state[0].copy(), np.zeros(model.nv)
    for broken in ("position", "velocity", "reference", "gain"):
        model.place(position, velocity)
        p = body["hand"].parameters
        kept = p.copy()
        if broken == "position":
            model.place(np.where(np.arange(7) == 3, value, position), velocity)
        elif broken == "velocity":
            model.place(position, np.where(np.arange(7) == 3, value, velocity))
        elif broken == "reference":
            body["hand"].pose(position=(value, 0.0, 0.0))
        else:
            p[48] = value
        result = body.solve()
        assert not result.solved, broken
        assert result.why
        assert np.isfinite(result.torque).all() and np.isfinite(result.acceleration).all()
        assert (np.abs(result.torque) <= model.model.effortLimit + 1e-9).all()
        p[:] = kept
        model.place(position, velocity)
        assert body.solve().solved
        assert body.result.torque == pytest.approx(good, abs=1e-6)


def test_passing_through_a_singularity_is_no_jump(model_of) -> None:
    """The arm is stretched and bent back: torques change in proportion to the step, at every scale of steps."""
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame="panda_hand", name="hand")], [JPos()]])
    body["hand"].pose(position=model.frame("panda_hand").translation + np.array([0.05, 0.0, 0.05]))
    straight = model.state[0].copy()
    elbow, singular = 3, 0

    def jumps(steps: int) -> float:
        nonlocal singular
        torques = []
        for u in np.linspace(-1.0, 1.0, steps):
            position = straight.copy()
            position[elbow] = -0.2 + 0.3 * u
            model.place(position, np.zeros(7))
            torques.append(body.solve().torque.copy())
            singular += not body.exact(0)
        return float(np.abs(np.diff(torques, axis=0)).max())

    coarse, fine = jumps(4000), jumps(32000)
    assert singular > 100
    assert fine < 0.3 * coarse


def test_rows_of_a_level_that_has_no_freedom_left_cost_nothing_and_change_nothing(model_of) -> None:
    model = model_of("panda")
    few = WholeBody(model, [[SE3(frame="panda_hand")], [JPos(name="posture")]])
    many = WholeBody(model, [[SE3(frame="panda_hand")], [JPos(name="first")], [COM()], [JPos(name="posture")]])
    assert many.solve().torque == pytest.approx(few.solve().torque, abs=1e-7)


def test_what_can_not_be_is_refused_by_name(model_of) -> None:
    model = model_of("panda")
    for levels, constraints, message in (
        ([[CartPos(frame="panda_hnd")]], [], "levels[0][0].frame: no frame 'panda_hnd'; expected one like panda_hand"),
        ([[CartPos(frame="panda_hand", axes=("q",))]], [], "axes: got 'q'; expected some of x y z"),
        ([[CartPos(frame="panda_hand", stiffness=-1.0)]], [], "stiffness: got -1.0"),
        ([[CartPos(frame="panda_hand"), CartPos(frame="panda_hand")]], [], "got this name twice"),
        ([[JPos(position={"nobody": 0.0})]], [], "no joint 'nobody'"),
        ([], [JointLimits(), JointLimits()], "at most one"),
    ):
        with pytest.raises(WbcError, match=r".") as refused:
            WholeBody(model, levels, constraints)
        assert message in str(refused.value)


def test_references_that_nobody_gave_start_anew_where_the_robot_is_now(model_of) -> None:
    """As when they are made there, to the last digit; what was given stays."""
    model = model_of("panda")
    home = model.q.copy()

    def make() -> WholeBody:
        levels = [
            [CartPos(frame="panda_hand", name="hand", axes=("x", "y"))],
            [SE3(frame="panda_link4", relative_to="panda_hand", name="elbow", orientation=(0.0, 0.0, 0.6, 0.8))],
            [COM(name="com")],
            [JPos(name="posture", position={"panda_joint2": 0.1})],
        ]
        return WholeBody(model, levels, [PointContact(frame="panda_link7", name="touch", stiffness=10.0)])

    body = make()
    model.place(home + 0.2, np.zeros(7))
    fresh = make()
    assert not np.array_equal(body.memory["parameters"], fresh.memory["parameters"])
    body.start_here()
    assert np.array_equal(body.memory["parameters"], fresh.memory["parameters"])
    assert np.array_equal(body.memory["posture"], fresh.memory["posture"])


def test_joints_that_others_lead_go_as_told_and_those_left_do_the_tasks_beside_them(model_of) -> None:
    """Judged by dense algebra: what the free joints do is the nearest to their posture among all that meets the hand."""
    model = model_of("talos_upper")
    led = [joint for joint in model.joints if not joint.startswith("arm_right")]
    rows, free = (
        np.array([model.rows[model.joints.index(joint)] for joint in names])
        for names in (led, [joint for joint in model.joints if joint not in led])
    )
    hand, posture = CartPos(frame=HAND, name="hand"), JPos(name="posture", stiffness=50.0)
    body = WholeBody(model, [[hand], [posture]], [JointLimits(torque=0.5)], led)
    rng = np.random.default_rng(4)
    for position, velocity in states(model, 20, seed=4, spread=0.1):
        model.place(position, 0.1 * velocity)
        body["hand"].pose(position=model.frame(HAND).translation + 0.01)
        body["posture"].joints(position)
        theirs = rng.standard_normal(len(led))
        body.lead(theirs)
        result = body.solve()
        assert result.solved
        assert result.acceleration[rows] == pytest.approx(theirs, abs=1e-9)
        if not body.exact(0) or result.active:
            continue
        assert np.abs(body.residual("hand")).max() < 1e-9
        jacobian, wanted = np.zeros((3, model.nv)), np.zeros(3)
        body.task_rows(body["hand"].number, jacobian, wanted)
        mass = model.mass_matrix[np.ix_(free, free)]
        own = -2.0 * np.sqrt(50.0) * model.state[1][free]
        left = np.linalg.solve(mass, jacobian[:, free].T)
        missing = wanted - jacobian[:, rows] @ theirs - jacobian[:, free] @ own
        nearest = own + left @ np.linalg.solve(jacobian[:, free] @ left, missing)
        assert result.acceleration[free] == pytest.approx(nearest, abs=1e-6)


@pytest.mark.parametrize(
    ("levels", "constraints", "field"),
    [
        ([[CartPos(frame=OTHER)]], [], "levels[0][0].frame"),
        ([[JPos(joints=("head_1_joint",))]], [], "levels[0][0].joints"),
        ([[JPos()]], [PointContact(frame=OTHER)], "constraints[0].frame"),
        ([[JPos()]], [Transmission(leader="head_1_joint", follower="head_2_joint")], "constraints[0].follower"),
    ],
)
def test_a_task_that_only_joints_of_others_could_do_is_refused(model_of, levels, constraints, field) -> None:
    model = model_of("talos_upper")
    led = [joint for joint in model.joints if not joint.startswith("arm_right")]
    with pytest.raises(WbcError) as caught:
        WholeBody(model, levels, constraints, led)
    assert caught.value.field == field
