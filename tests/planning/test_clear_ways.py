"""Motions judged all along, and ways around what is in the way: against coal at many samples, and a plate that samples miss."""

from __future__ import annotations

from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.connect import Budget, Connector
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import Obstacle, obstacles_of
from engines.planning.collision.sweep import Sweep, cubics, lines
from engines.planning.collision.world import World
from engines.planning.plan import Infeasible
from engines.planning.waiting import Cancelled

MARGINS = Margins(itself=0.01, objects=0.02)


class Robot:
    """TALOS' upper body with a world about it, its right arm moving."""

    def __init__(self, description, mechanism, ready, obstacles):
        self.mechanism, self.ready = mechanism, ready
        arm = description.arms["right"].joints
        self.world = World(self.mechanism, obstacles, description.allowed_collision_pairs, moving=arm)
        self.floors = MARGINS.floors(self.world)
        rows = [self.mechanism.row(joint) for joint in arm]
        self.columns = self.mechanism.coordinate[rows]
        self.lower, self.upper = self.mechanism.lower[rows], self.mechanism.upper[rows]
        self.sweep = Sweep(self.world)
        self._data, self._scratch = self.mechanism.model.createData(), self.world.geometry.createData()

    def random(self, generator):
        """A clear configuration."""
        while True:
            q = self.ready.copy()
            q[self.columns] = generator.uniform(self.lower, self.upper)
            if (self.distances(q) >= self.floors).all():
                return q

    def distances(self, q):
        """(pairs,) m, by coal over all pairs."""
        pin.forwardKinematics(self.mechanism.model, self._data, q)
        pin.updateGeometryPlacements(self.mechanism.model, self._data, self.world.geometry, self._scratch)
        pin.computeDistances(self.world.geometry, self._scratch)
        return np.array([found.min_distance for found in self._scratch.distanceResults])

    def along(self, rows, count):
        """(k, pairs) m at `count` samples of each straight stretch."""
        share = np.linspace(0.0, 1.0, count)[:, None]
        samples = np.vstack([a + share * (b - a) for a, b in pairwise(rows)])
        return np.array([self.distances(q) for q in samples])


@pytest.fixture(scope="module")
def at_wheel(description, mechanism, ready, wheel_at):
    return Robot(description, mechanism, ready, obstacles_of(wheel_at(np.array([0.55, -0.35, 0.30]), np.zeros(3))))


@pytest.fixture(scope="module")
def at_plate(description, mechanism, ready):
    """A plate of half a millimetre stands across the tool's way, edge to it."""
    across = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, -0.526), np.array([0.444, -0.258, 0.08]))
    plate = Obstacle("plate", coal.Box(0.06, 0.0005, 0.2), across)
    return Robot(description, mechanism, ready, [plate])


@pytest.fixture(scope="module")
def swing(at_plate):
    """Two clear configurations with the plate between them."""
    goal = at_plate.ready.copy()
    goal[at_plate.columns[at_plate.world.moving.index("torso_1_joint")]] = 0.9
    return at_plate.ready, goal


def test_what_is_said_of_a_motion_is_what_many_samples_show(at_wheel):
    generator = np.random.default_rng(4)
    clear = 0
    for _ in range(9):
        ends = np.array([at_wheel.random(generator), at_wheel.random(generator)])
        meeting = at_wheel.sweep.meeting(lines(ends), at_wheel.floors)
        if meeting is None:
            clear += 1
            assert (at_wheel.along(ends, 60) >= at_wheel.floors).all()
        else:
            there = at_wheel.distances(meeting.q)
            assert there[meeting.pair] == pytest.approx(meeting.distance, abs=1e-6)
            assert there[meeting.pair] < at_wheel.floors[meeting.pair] + 2e-4
    assert 2 <= clear <= 7, "both kinds must have been seen"


def test_a_curve_between_knots_is_judged_as_the_curve_that_it_is(at_wheel):
    generator = np.random.default_rng(6)
    times = np.array([0.0, 0.7, 1.5])
    for _ in range(4):
        rows = np.array([at_wheel.random(generator) for _ in times])
        rates = np.zeros_like(rows)
        rates[1, at_wheel.columns] = generator.uniform(-1.0, 1.0, len(at_wheel.columns))
        motion = cubics(times, rows, rates)
        share = np.linspace(0.0, 1.0, 60)[:, None]
        basis = np.stack([(1 - share) ** 3, 3 * share * (1 - share) ** 2, 3 * share**2 * (1 - share), share**3])
        samples = np.vstack([(basis * piece[:, None, :]).sum(axis=0) for piece in motion])
        met = np.array([(at_wheel.distances(q) < at_wheel.floors).any() for q in samples])
        meeting = at_wheel.sweep.meeting(motion, at_wheel.floors)
        assert not met.any() or meeting is not None


def test_a_plate_thinner_than_any_spacing_is_met(at_plate, swing):
    nothing = np.where(at_plate.world.of_itself, -np.inf, 0.0)
    coarse = at_plate.along(swing, 6)[:, ~at_plate.world.of_itself]
    assert (coarse > 0.0).all(), "samples alone must miss the plate for this to show anything"
    meeting = at_plate.sweep.meeting(lines(np.array(swing)), nothing)
    assert meeting is not None
    assert "plate" in meeting.between


def test_a_way_around_keeps_the_margins_between_its_rows_too(at_plate, swing):
    words = []
    way = Connector(at_plate.world, margins=MARGINS).way(*swing, progress=words.append)
    assert np.array_equal(way[0], swing[0])
    assert np.array_equal(way[-1], swing[1])
    assert (at_plate.along(way, 4) >= at_plate.floors).all()
    assert np.abs(np.diff(way, axis=0)).max() < 0.1
    assert {"straight way", "shortening the way"} <= set(words)
    assert np.array_equal(way, Connector(at_plate.world, margins=MARGINS).way(*swing)), (
        "the same question, another answer"
    )


def test_a_way_is_given_up_when_asked_to_or_when_the_budget_is_spent(at_plate, swing):
    asked = []

    def cancelled():
        asked.append(True)
        return len(asked) > 40

    with pytest.raises(Cancelled):
        Connector(at_plate.world, cancelled=cancelled).way(*swing)
    assert len(asked) < 50, "it must end soon after it was told to"
    with pytest.raises(Infeasible, match=r"\(\w+ and plate\) on the straight way") as caught:
        Connector(at_plate.world).way(*swing, budget=Budget(edges=1))
    assert 0.0 < caught.value.by < 0.1


def test_an_end_within_something_or_out_of_limits_is_told_by_its_name(at_wheel):
    floors, way = MARGINS.floors(at_wheel.world), Connector(at_wheel.world).way
    generator = np.random.default_rng(7)
    inside = at_wheel.ready.copy()
    while (at_wheel.distances(inside) >= floors).all():
        inside[at_wheel.columns] = generator.uniform(at_wheel.lower, at_wheel.upper)
    with pytest.raises(Infeasible, match=r"^goal: clearance \(.* and .*\) is .* m, at least 0.0[12] allowed"):
        way(at_wheel.ready, inside)
    beyond = at_wheel.ready.copy()
    beyond[at_wheel.columns[2]] = at_wheel.upper[2] + 0.3
    with pytest.raises(Infeasible, match=r"^start: joint limits \(arm_right_1_joint\), missed by 0.3 rad"):
        way(beyond, at_wheel.ready)
    other = at_wheel.ready.copy()
    other[at_wheel.mechanism.coordinate[at_wheel.mechanism.row("arm_left_2_joint")]] += 0.1
    with pytest.raises(ValueError, match="may not move"):
        way(at_wheel.ready, other)
    with pytest.raises(ValueError, match="goal: got nan"):
        way(at_wheel.ready, np.full_like(other, np.nan))


def test_what_may_touch_does_not_block(at_plate, swing):
    touching = (("tool_right", "plate"), ("arm_right_*_link", "plate"), ("wrist_right_*", "plate"))
    way = Connector(at_plate.world, margins=MARGINS, touching=touching).way(*swing)
    turn = at_plate.columns[at_plate.world.moving.index("torso_1_joint")]
    assert np.allclose(np.delete(way, turn, axis=1), np.delete(swing[0], turn)), "straight: only the torso turns"
