"""Motions that end at what they meet, judged by the plant: in the very cycle, and before the force grows much."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from daemon.exchange import Answer, Outcome
from handrail.messages import CartesianImpedance, ContactEnd, ForceEnd, Pose, StallEnd, TravelEnd
from tests.daemon.compliant.conftest import TIP, InPlant, wall_before

GAP = 0.02


def straight_on(robot: InPlant, by: float, duration: float) -> CartesianImpedance:
    """The stub goes along its own direction by `by` m."""
    arm, tip = robot.description.arms["right"], robot.loop.robot.commanded_frame(TIP)
    goal = tip.translation - by * tip.rotation[:, 2]
    return CartesianImpedance(
        frame=TIP,
        joints=list(arm.joints),
        goal_in_world=Pose(position=tuple(goal.tolist()), orientation=orientation_of(tip.rotation)),
        duration=duration,
    )


def orientation_of(rotation: np.ndarray) -> tuple[float, float, float, float]:
    x, y, z, w = pin.Quaternion(rotation).coeffs().tolist()
    return x, y, z, w


@pytest.mark.parametrize(("by", "within_cycles", "along_axis"), [("sensor", 3, True), ("joints", 25, False)])
def test_a_guarded_motion_stops_in_the_cycle_in_which_it_feels_the_wall(
    in_plant, talos, ready, by, within_cycles, along_axis
) -> None:
    robot = in_plant(wall_before(ready, GAP), talos if by == "sensor" else dataclasses.replace(talos, devices=()))
    limit = 8.0
    end = ForceEnd(frame=TIP, axis=(1.0, 0.0, 0.0), limit=limit)
    if not along_axis:
        end = ContactEnd(frame=TIP, threshold=limit)
    assert robot.start(straight_on(robot, 0.05, 1.6), (end,)) is Answer.ACCEPTED
    felt, true, written = [], [], []

    def note() -> None:
        felt.append(float(np.linalg.norm(robot.loop.robot.wrenches.get(TIP, np.zeros(6))[:3])))
        true.append(float(robot.force_on("wall")[0]))
        written.append(robot.loop.written.position.copy())

    assert robot.run_to_end(each=note) is Outcome.CONDITION
    tripped = len(felt) - 1
    assert felt[tripped] > limit * 0.9 > 0.8 * max(felt[:tripped]), "N: the first cycle that felt it"
    assert tripped - int(np.argmax(np.array(true) > 1.0)) <= within_cycles, "of the touch"
    assert (written[tripped] == written[tripped - 1]).all(), "it goes no further in that very cycle"
    assert (written[tripped - 1] != written[tripped - 2]).any(), "though it went on in the one before"
    robot.run(150, note)
    assert (written[-1] == written[tripped]).all()
    assert max(true[tripped:]) < 25.0, "N, in the plant"


def test_a_motion_goes_on_until_it_stalls_at_a_wall(in_plant, ready) -> None:
    robot = in_plant(wall_before(ready, GAP))
    end = StallEnd(frame=TIP, distance=0.002, within=0.4)
    began = robot.loop.cycles
    robot.start(straight_on(robot, 0.06, 1.6), (end,))
    assert robot.run_to_end() is Outcome.CONDITION
    assert 0.8 < (robot.loop.cycles - began) * robot.loop.robot.period < 1.55, "s"
    assert robot.world.contact_force["wall"] > 3.0


def test_a_motion_ends_when_it_has_gone_far_enough(in_plant) -> None:
    robot = in_plant()
    start = robot.tip().translation
    robot.start(straight_on(robot, 0.06, 0.8), (TravelEnd(frame=TIP, distance=0.02, axis=(1.0, 0.0, 0.0)),))
    assert robot.run_to_end() is Outcome.CONDITION
    assert robot.tip().translation[0] - start[0] == pytest.approx(0.02, abs=0.003)
