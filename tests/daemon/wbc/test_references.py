"""References that move."""

import numpy as np
import pinocchio as pin
import pytest

from daemon.controllers.references import HermitePath, LinePath, PathClock
from daemon.wbc import layout as at
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.references import FrameTrajectory, JointTrajectory, Leashes, PointTrajectory, StreamedPose
from daemon.wbc.tasks import SE3, JPos

PERIOD = 0.002
HAND = "panda_hand"


def simulate(model, body: WholeBody, references, cycles: int, each=lambda cycle: None) -> list[float]:
    """Rigid joints under the solver's torques; how far the tasks were off, (6,) norms of the first one's error."""
    data, q, v = model.model.createData(), model.q.copy(), model.v.copy()
    errors = []
    for cycle in range(cycles):
        each(cycle)
        for reference in references:
            reference.advance()
        model.update(q, v)
        result = body.solve()
        assert result.solved, result.why
        errors.append(float(np.linalg.norm(next(iter(body.handles.values())).error)))
        v = v + PERIOD * pin.aba(model.model, data, q, v, result.torque)
        q = q + PERIOD * v
    model.update(q, v)
    return errors


def test_a_line_is_followed_with_its_velocity_and_acceleration_fed_forward(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    here = model.frame(HAND)
    goal = pin.SE3(here.rotation @ pin.exp3(np.array([0.0, 0.0, 0.4])), here.translation + np.array([0.05, 0.15, -0.1]))
    reference = FrameTrajectory(
        body["hand"], LinePath(here.rotation.copy(), here.translation.copy(), goal, 1.0), PERIOD
    )
    errors = simulate(model, body, [reference], 700)
    assert reference.clock.at_end
    assert max(errors) < 4e-3, "next to no lag"
    assert model.frame(HAND).translation == pytest.approx(goal.translation, abs=1e-3)


def test_joints_go_through_their_knots(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[JPos(name="joints")]])
    home = model.q.copy()
    knots = np.array([home, home + 0.2, home - 0.1])
    path = HermitePath(np.array([0.0, 0.5, 1.2]), knots, np.zeros((3, 7)))
    reference = JointTrajectory(body["joints"], path, 7, PERIOD)
    simulate(model, body, [reference], 800)
    assert model.q == pytest.approx(knots[-1], abs=2e-3)


def test_a_frame_goes_through_its_knots_with_their_velocities_and_does_not_turn(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    here, clock = model.frame(HAND), PathClock(1.2, PERIOD)
    off = np.array([[0.0, 0.0, 0.0], [0.05, 0.1, -0.1], [0.1, 0.0, 0.0]])
    rates = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    path = HermitePath(np.array([0.0, 0.6, 1.2]), here.translation + off, rates)
    reference = PointTrajectory(body["hand"], path, PERIOD, clock)
    leashes, places = Leashes(body, [body["hand"]], [reference], clock, 0.1, 0.5), []

    class Moved:
        def advance(self) -> None:
            leashes.advance()
            places.append(model.frame(HAND).translation - here.translation)

    errors = simulate(model, body, [Moved()], 800)
    assert max(errors) < 4e-3, "next to no lag"
    assert places[301] == pytest.approx(off[1], abs=4e-3)
    assert model.frame(HAND).translation - here.translation == pytest.approx(off[2], abs=1e-3)
    assert np.linalg.norm(pin.log3(here.rotation.T @ model.frame(HAND).rotation)) < 1e-3


def test_a_stream_is_followed_and_its_silence_is_a_stop(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    start = model.frame(HAND).translation.copy()
    stream = StreamedPose(body["hand"], PERIOD, stale=0.1)
    velocity = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])

    def send(cycle: int) -> None:
        if cycle < 300 and cycle % 10 == 0:  # 50 Hz
            stream.receive(start + velocity[:3] * cycle * PERIOD, None, velocity)
        if cycle == 305:
            stream.receive(np.full(3, np.nan))

    errors = simulate(model, body, [stream], 800, send)
    assert stream.silent
    assert max(errors) < 8e-3
    moved = model.frame(HAND).translation - start
    assert moved == pytest.approx([0.0, 0.1 * (0.58 + 0.1), 0.0], abs=3e-3), "0.58 s of stream, 0.1 s on its own"


def test_a_stream_that_stops_is_gone_on_with_in_orientation_too(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    start = model.frame(HAND)
    stream = StreamedPose(body["hand"], PERIOD, stale=0.2)
    velocity = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])

    def send(cycle: int) -> None:
        if cycle < 200 and cycle % 10 == 0:
            stream.receive(start.translation, pin.exp3(velocity[3:] * cycle * PERIOD) @ start.rotation, velocity)

    errors = simulate(model, body, [stream], 700, send)
    assert stream.silent
    assert max(errors) < 0.03
    turned = pin.log3(model.frame(HAND).rotation @ start.rotation.T)
    assert turned == pytest.approx([0.0, 0.0, 0.5 * (0.38 + 0.2)], abs=3e-3), "0.38 s of stream, 0.2 s on its own"


def test_a_streamed_pose_far_away_is_gone_to_and_not_jumped_to(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    start = model.frame(HAND)
    stream = StreamedPose(body["hand"], PERIOD, speed=0.2, turn=0.5)
    goal = start.translation + np.array([0.0, 0.1, 0.0]), pin.exp3(np.array([0.0, 0.0, 0.3])) @ start.rotation
    quaternion = pin.Quaternion(goal[1]).coeffs()
    rates: list[tuple[float, float]] = []
    last = [start.translation.copy(), start.rotation.copy()]

    def send(cycle: int) -> None:
        if cycle == 0:
            stream.receive(goal[0], quaternion)
        position, rotation = body["hand"].reference
        turn = np.linalg.norm(pin.log3(rotation @ last[1].T))
        rates.append((float(np.linalg.norm(position - last[0])) / PERIOD, float(turn) / PERIOD))
        last[:] = position.copy(), rotation.copy()

    errors = simulate(model, body, [stream], 1200, send)
    assert max(rates) == pytest.approx((0.2, 0.5))
    assert max(errors) < 0.03
    assert model.frame(HAND).translation == pytest.approx(goal[0], abs=1e-3)
    assert np.linalg.norm(pin.log3(goal[1].T @ model.frame(HAND).rotation)) < 3e-3


def test_a_stream_stands_while_its_clock_stands(model_of) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    clock = PathClock(float("inf"), PERIOD)
    stream = StreamedPose(body["hand"], PERIOD, clock=clock)
    clock.hold()
    while not clock.standing:
        clock.advance()
    start = body["hand"].reference[0].copy()
    stream.receive(start + 0.1)
    for _ in range(50):
        stream.advance()
    assert body["hand"].reference[0] == pytest.approx(start)


@pytest.mark.parametrize("broken", [{"position": np.full(3, np.nan)}, {"velocity": np.full(6, np.inf)}])
def test_a_streamed_pose_that_is_not_finite_changes_nothing(model_of, broken) -> None:
    body = WholeBody(model_of("panda"), [[SE3(frame=HAND, name="hand")]])
    stream = StreamedPose(body["hand"], PERIOD)
    before = body["hand"].reference[0].copy()
    assert not stream.receive(**{"position": before + 0.1, **broken})
    stream.advance()
    assert body["hand"].reference[0] == pytest.approx(before)


def test_a_reference_out_of_reach_is_pulled_no_harder_than_from_within_it_and_is_given_back_as_it_was_wanted(
    model_of,
) -> None:
    model = model_of("panda")
    body = WholeBody(model, [[SE3(frame=HAND, name="hand")], [JPos()]])
    start, leashes = model.frame(HAND), Leashes(body, [body["hand"]], [], PathClock(1.0, PERIOD), 0.1, 0.5)
    body["hand"].pose(
        start.translation + np.array([0.0, 0.3, 0.0]), pin.exp3(np.array([0.0, 0.8, 0.0])) @ start.rotation
    )
    body.solve()
    for _ in range(3):
        leashes.advance()
        position, rotation = body["hand"].reference
        assert position - start.translation == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)
        assert pin.log3(rotation @ start.rotation.T) == pytest.approx([0.0, 0.5, 0.0], abs=1e-9)
        assert leashes.off(0) == pytest.approx([0.0, 0.3, 0.0]), "it is given back before it is taken in again"
        body.solve()


def test_references_on_leashes_move_as_each_of_them_does_by_itself(model_of) -> None:
    told = []
    for together in (False, True):
        model = model_of("panda")
        body = WholeBody(model, [[SE3(frame=HAND, name="hand"), SE3(frame="panda_link4", name="elbow")], [JPos()]])
        here, clock = model.frame(HAND), PathClock(0.5, PERIOD)
        goal = pin.SE3(
            here.rotation @ pin.exp3(np.array([0.0, 0.0, 0.1])), here.translation + np.array([0.02, 0.01, -0.02])
        )
        path = LinePath(here.rotation, here.translation, goal, 0.5)
        line = FrameTrajectory(body["hand"], path, PERIOD, clock if together else None)
        stream = StreamedPose(body["elbow"], PERIOD)
        leashes = Leashes(body, [body["hand"], body["elbow"]], [line, stream], clock, 0.1, 0.5)
        seen = []
        for cycle in range(100):
            if cycle % 10 == 0:
                stream.receive(model.frame("panda_link4").translation + np.array([0.0, 1e-4 * cycle, 0.0]))
            if together:
                leashes.advance()
            else:
                line.advance()
                stream.advance()
            seen.append(np.concatenate((body["hand"].parameters, body["elbow"].parameters)))
            body.solve()
        told.append(np.array(seen))
    assert np.abs(told[0] - told[1]).max() < 1e-12
    assert np.abs(np.diff(told[0][:, : at.REF_P + 3], axis=0)).max() > 1e-5, "they do move"
