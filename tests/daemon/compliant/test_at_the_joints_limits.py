"""Lines that joints can't follow, judged by the plant: the line waits for them, and a joint in the way is named."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.controllers.joint_velocities import JointVelocities
from daemon.controllers.references import PathClock
from daemon.exchange import Answer, Outcome
from handrail.messages import CartesianImpedance, Pose
from tests.daemon.compliant.conftest import TIP, InPlant

TORSO = 2
"""of the arm's joints"""


class Watch:
    """What the plant's joints and the command do, as shares of the limits, while the tip goes along a line."""

    def __init__(self, bench: InPlant, rows: list[int], goal: np.ndarray):
        self._bench, self._rows = bench, rows
        self._start = bench.tip().translation
        way = goal - self._start
        self._along = way / np.linalg.norm(way)
        self.fastest = self.hardest = self.off = 0.0
        self._commanded = np.zeros(len(rows))

    def __call__(self) -> None:
        bench, rows, of = self._bench, self._rows, self._bench.description
        self.fastest = max(self.fastest, float((np.abs(bench.world.velocity[rows]) / of.velocity_limit[rows]).max()))
        commanded = bench.loop.written.velocity[rows].copy()
        change = np.abs(commanded - self._commanded) / bench.loop.robot.period / of.acceleration_limit[rows]
        self._commanded = commanded
        if commanded.any():  # not where its end stops it
            self.hardest = max(self.hardest, float(change.max()))
        away = bench.tip().translation - self._start
        self.off = max(self.off, float(np.linalg.norm(away - (away @ self._along) * self._along)))


@pytest.mark.parametrize(
    ("shift", "turn", "duration", "torso", "outcome"),
    [
        ((0.0, -0.1, 0.05), (1.42, -0.55, 1.35), 2.83, True, Outcome.DONE),
        ((-0.33, -0.16, 0.08), (-0.46, -0.35, 1.18), 1.48, True, Outcome.INFEASIBLE),
        ((-0.4, -0.2, 0.01), (-0.32, -1.84, -1.08), 1.99, True, Outcome.INFEASIBLE),
        ((0.6, 0.0, 0.1), (0.0, 0.0, 0.0), 1.5, False, Outcome.INFEASIBLE),
    ],
    ids=["past a limit", "into a limit", "turned into a limit", "beyond the arm's reach"],
)
def test_a_line_waits_for_joints_that_have_no_room_and_where_it_waits_in_vain_says_so(
    in_plant, shift, turn, duration, torso, outcome
) -> None:
    bench = in_plant()
    of, tip = bench.description, bench.loop.robot.commanded_frame(TIP)
    joints = list(of.arms["right"].joints)[0 if torso else TORSO :]
    rows = [of.joints.index(joint) for joint in joints]
    goal = tip.translation + np.array(shift)
    x, y, z, w = pin.Quaternion(tip.rotation @ pin.exp3(np.array(turn))).coeffs().tolist()
    place = Pose(position=(float(goal[0]), float(goal[1]), float(goal[2])), orientation=(x, y, z, w))
    watch = Watch(bench, rows, goal)
    assert (
        bench.start(CartesianImpedance(frame=TIP, joints=joints, goal_in_world=place, duration=duration))
        is Answer.ACCEPTED
    )
    assert bench.run_to_end(each=watch) is outcome
    assert not bench.world.drives.error.any()
    assert watch.fastest < 1.4, "of the velocity limit, in the plant; a drive trips at twice that"
    assert watch.hardest < 1.001, "of the acceleration limit, as commanded"
    assert watch.off < 0.04, "m that the tip really was off its line"
    written = bench.loop.written.position[rows]
    full = (written < of.lower[rows] + 0.005) | (written > of.upper[rows] - 0.005)
    detail = bytes(bench.snapshot()["actions"][0]["detail"]).rstrip(b"\0").decode()
    if outcome is Outcome.DONE:
        assert np.linalg.norm(bench.tip().translation - goal) < 0.005
        assert detail == ""
    elif full.any():
        assert detail.endswith(f"{', '.join(joints[row] for row in np.flatnonzero(full))} at the limit")
    else:
        assert detail.endswith("stretched or singular there")
    bench.run(200)
    assert np.abs(bench.world.velocity[rows]).max() < 0.05, "rad/s: it is held where it got to"


def test_a_joint_comes_to_a_stand_at_its_limit_while_others_take_over_no_faster_than_they_may(talos) -> None:
    rows = np.array([talos.joints.index(joint) for joint in talos.arms["right"].joints])
    velocities, period = JointVelocities(talos, rows, 0.002), 0.002
    position = 0.5 * (talos.lower[rows] + talos.upper[rows])
    jacobian = np.zeros((6, len(rows)))
    jacobian[0, :2] = 1.0, 0.5  # two joints along one line
    before, told = np.zeros(len(rows)), []
    for _ in range(3000):
        now = velocities.towards(np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0]), jacobian, position).copy()
        assert (np.abs(now) <= talos.velocity_limit[rows] + 1e-12).all()
        assert (np.abs(now - before) <= talos.acceleration_limit[rows] * period + 1e-12).all()
        position = position + now * period
        assert (position <= talos.upper[rows] + 1e-9).all()
        before = now
        told.append(jacobian[0] @ now)
    assert velocities.at_limits(position) == list(talos.arms["right"].joints)[:2]
    assert told[100] == pytest.approx(0.4, rel=0.01)
    assert told[-1] == pytest.approx(0.0, abs=1e-6)


def test_a_clock_that_is_waited_for_goes_on_at_its_share_of_the_rate() -> None:
    clock = PathClock(10.0, 0.002)
    clock.share = 0.5
    for _ in range(100):
        clock.advance()
    assert (clock.s, clock.pace, clock.rate) == (pytest.approx(0.1), 0.5, 1.0)
    clock.hold()
    clock.share = 0.0
    for _ in range(500):
        clock.advance()
    assert clock.standing
    assert clock.s == pytest.approx(0.1)
