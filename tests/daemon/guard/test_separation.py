"""The guard's geometry, and what it promises, against coal's distances between the hulls of the URDF's meshes."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from daemon.exchange import Answer
from daemon.safety.bodies import Bodies
from daemon.safety.separation import COMMANDED, EXCUSING, MARGIN, MAX_TRIPS, judge
from hal.drives.protocol import LimbProtocol
from hal.joint import JointCommand, JointState
from handrail.messages import JointTrajectory
from handrail.robot import library as robots
from handrail.robot.guarding import Guarding, HalfSpace, KeepOut
from handrail.robot.kinematics import Kinematics
from tests.daemon.loop.conftest import Bench

Q = st.lists(st.floats(0.0, 1.0), min_size=18, max_size=18)


class Judged:
    """`judge` for one robot, every pair with the same margin."""

    def __init__(self, kinematics: Kinematics, margin: float):
        self.kinematics, self.bodies = kinematics, Bodies.of(kinematics)
        n = len(kinematics.description.joints)
        self.command, self.last, self.state = JointCommand(n), JointCommand(n), JointState(n)
        self.command.stiffness[:] = kinematics.description.stiffness
        self.period = kinematics.description.period_ns * 1e-9
        self.margin = margin
        self.forget()

    def forget(self) -> None:
        """As if it had never been asked."""
        self.kept = self.bodies.kept()
        self.kept.memory[:, MARGIN] = self.margin

    @property
    def trips(self) -> np.ndarray:
        return self.kept.trips

    def __call__(self, position: np.ndarray, velocity: np.ndarray, *, excuse: bool = False) -> tuple[int, float]:
        self.command.position[:], self.last.position[:] = position, position - velocity * self.period
        self.state.position[:] = position
        told = (self.command.table, self.last.table, self.state.table, self.bodies.limits)
        return judge(*told, self.kept.table, self.period, EXCUSING if excuse else COMMANDED)[:2]


class Hulls:
    """coal's distances of the watched pairs of a robot."""

    def __init__(self, kinematics: Kinematics, bodies: Bodies):
        self._kinematics = kinematics
        urdf = str(kinematics.description.urdf)
        self._geometry = pin.buildGeomFromUrdf(kinematics.model, urdf, pin.COLLISION)
        for body in self._geometry.geometryObjects:
            if isinstance(body.geometry, coal.BVHModelBase):
                body.geometry.buildConvexHull(True, "Qt")
                body.geometry = body.geometry.convex
        for a, b in bodies.pairs[:, :2].tolist():
            self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._data = self._geometry.createData()

    def __call__(self, position: np.ndarray) -> np.ndarray:
        q = self._kinematics.configuration(position)
        pin.computeDistances(self._kinematics.model, self._kinematics.data, self._geometry, self._data, q)
        return np.array([result.min_distance for result in self._data.distanceResults])


@pytest.fixture(scope="module")
def talos() -> Kinematics:
    return Kinematics(robots.load("talos_upper"))


@pytest.fixture(scope="module")
def hulls(talos: Kinematics) -> Hulls:
    return Hulls(talos, Bodies.of(talos))


def posture(kinematics: Kinematics, share: list[float]) -> np.ndarray:
    description = kinematics.description
    return description.lower + np.array(share) * (description.upper - description.lower)


@given(q=Q)
@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_distances_are_those_of_the_hulls_and_never_more(talos: Kinematics, hulls: Hulls, q: list[float]) -> None:
    position, still = posture(talos, q), np.zeros(18)
    judged, truth = Judged(talos, 9.0), hulls(position)
    for pair in range(len(truth)):
        judged.forget()
        judged.kept.memory[:, MARGIN] = -9.0
        judged.kept.memory[pair, MARGIN] = 9.0
        assert judged(position, still)[0] == 1
        rounded = judged.bodies.shapes[judged.bodies.pairs[pair, :2], 4].sum()
        if truth[pair] > 0.0:
            assert truth[pair] - rounded - 0.003 <= judged.trips[0, 1] <= truth[pair] + 1e-5
        else:
            assert judged.trips[0, 1] <= 1e-5


@given(q=Q, v=st.lists(st.floats(-1.0, 1.0), min_size=18, max_size=18), share=st.sampled_from([0.05, 0.2, 0.5]))
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_who_passes_keeps_the_margin_on_the_whole_way_of_braking(
    talos: Kinematics, hulls: Hulls, q: list[float], v: list[float], share: float
) -> None:
    position, velocity = posture(talos, q), share * np.array(v) * talos.description.velocity_limit
    judged = Judged(talos, 0.01)
    found, duration = judged(position, velocity)
    if found == MAX_TRIPS:
        return  # it stopped looking
    passed = np.ones(len(judged.bodies.pairs), bool)
    passed[judged.trips[:found, 0].astype(int)] = False
    for s in np.linspace(0.0, 0.5 * duration, 6):
        assert hulls(position + s * velocity)[passed].min() >= 0.01 - 1e-5


def test_a_pair_that_is_near_when_it_is_excused_may_part_but_not_close(talos: Kinematics) -> None:
    position = talos.description.home_position()
    way = np.zeros(18)
    way[talos.description.index("arm_left_3_joint")] = -1.0  # the hand to the leg
    judged = Judged(talos, 0.01)
    reached = next(s for s in np.linspace(0.0, 1.5, 300) if judged(position + s * way, 0.0 * way)[0])
    near = position + reached * way
    assert judged(near, 0.0 * way)[0] >= 1, "it is not excused: not even standing"
    judged(near, 0.0 * way, excuse=True)
    assert judged(near, 0.0 * way)[0] == 0
    assert judged(near, -0.1 * way)[0] == 0
    assert judged(near, 0.1 * way)[0] >= 1
    assert judged(near - 0.1 * way, 0.0 * way)[0] == 0, "it has gone away, and is excused no longer"
    assert judged(near, 0.0 * way)[0] >= 1


def test_what_is_remembered_of_a_pair_changes_no_verdict(talos: Kinematics) -> None:
    random, margin = np.random.default_rng(3), 0.08
    judged, afresh = Judged(talos, margin), Judged(talos, margin)
    position, tripped, passed_over = talos.description.home_position(), 0, 0
    for step in np.repeat([0.003, 0.03, 0.3], 60):
        position = position + random.normal(0.0, step, 18)
        afresh.forget()
        found, truth = judged(position, np.zeros(18))[0], afresh(position, np.zeros(18))[0]
        assert found == truth
        assert judged.trips[:found, 0].tolist() == afresh.trips[:found, 0].tolist()
        assert np.abs(judged.trips[:found, 1] - afresh.trips[:found, 1]).max(initial=0.0) < 1e-5
        tripped += found
        passed_over += int((judged.kept.room > 0.0).sum())
    assert tripped > 100
    assert passed_over > 0, "some pairs were known to be far enough"


def test_regions_are_kept_by_the_links_that_they_name() -> None:
    description = robots.load("talos_upper")
    tip = Kinematics(description).frame(description.home_position(), "tool_right_tip").translation
    table = HalfSpace(name="t", frame="base_link", point=(0, 0, tip[2] - 0.1), normal=(0, 0, 3), links=("tool_right",))
    place = (float(tip[0]), float(tip[1]), float(tip[2]) - 0.3)
    box = KeepOut(name="b", frame="base_link", position=place, size=(0.2, 0.2, 0.4), margin=0.05, links=("tool_right",))
    for region, gap in ((table, 0.1), (box, 0.1)):
        guarding = Guarding(self_collision=False, regions=(region,))
        kinematics = Kinematics(replace(description, guard=guarding))
        judged = Judged(kinematics, 9.0)
        assert len(judged.bodies.pairs) == 1
        assert judged(description.home_position(), np.zeros(18))[0] == 1
        assert judged.trips[0, 1] == pytest.approx(gap, abs=0.03), "the stub is a little lower than its tip's middle"
        assert judged.bodies.margins.tolist() == [region.margin]


# Shares of the way from lower to upper limits at which the left hand is in the chest, and both hands are where the other one is.
IN_CHEST = {"arm_left": [0.13, 0.15, 0.32, 0.15, 0.5, 0.5, 0.5]}
TOGETHER = {"arm_left": [0.24, 0.13, 0.5, 0.21, 0.5, 0.5, 0.5], "arm_right": [0.82, 0.73, 0.54, 0.31, 0.48, 0.5, 0.5]}


@given(
    goal=st.fixed_dictionaries(
        {
            group: st.lists(st.floats(0.0, 1.0), min_size=size, max_size=size)
            for group, size in (("arm_left", 7), ("arm_right", 7), ("torso", 2))
        }
    ),
    hurry=st.floats(0.5, 1.0),
)
@example(goal=IN_CHEST, hurry=0.6)
@example(goal=TOGETHER, hurry=0.8)
@settings(max_examples=1, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_way_is_commanded_no_watched_pair_ever_meets(
    talos: Kinematics, hulls: Hulls, goal: dict[str, list[float]], hurry: float
) -> None:
    description, folder = talos.description, Path(tempfile.mkdtemp(prefix="hr"))
    bench = Bench(folder, description, talos, LimbProtocol(description))
    try:
        bench.enable()
        longest = 0.0
        for group, share in goal.items():
            rows = description.index(description.groups[group])
            start, lower, upper = bench.loop.written.position[rows], description.lower[rows], description.upper[rows]
            way = lower + np.array(share) * (upper - lower) - start
            duration = max(1.9 * float(np.max(np.abs(way) / description.velocity_limit[rows])) / hurry, 0.1)
            longest = max(longest, duration)
            u = np.linspace(0.0, 1.0, 30)
            path, slope = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / duration
            motion = JointTrajectory(
                joints=list(description.groups[group]),
                times=(u * duration).tolist(),
                positions=(start + path[:, None] * way).tolist(),
                velocities=(slope[:, None] * way).tolist(),
            )
            assert bench.start(motion) in (Answer.ACCEPTED, Answer.TOO_CLOSE)
        for _ in range(min(round(longest / 0.04), 40) + 6):
            bench.run(20)
            assert hulls(bench.drives.state.position).min() > 0.0
        assert hulls(bench.loop.written.position).min() > 0.005
    finally:
        bench.loop.close()
        shutil.rmtree(folder)
