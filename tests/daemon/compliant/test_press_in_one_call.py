"""Approach, contact, press, retreat: one call, no round trip, judged by the plant."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.exchange import ActionState, Outcome
from handrail.messages import Compliance, CompliantMotion, ContactEnd, Step
from tests.daemon.compliant.conftest import TIP, InPlant, wall_before


def press_and_come_back(robot: InPlant) -> list[Step]:
    joints = list(robot.description.arms["right"].joints)

    def motion(duration: float, *axes: Compliance, by: float = 0.0) -> CompliantMotion:
        return CompliantMotion(frame=TIP, joints=joints, duration=duration, compliance=list(axes), shift=(by, 0.0, 0.0))

    return [
        Step(
            name="approach",
            motion=motion(2.0, by=0.06),
            ends=[ContactEnd(frame=TIP, threshold=5.0)],
            then={"contact": "press", "done": "retreat"},
        ),
        Step(name="press", motion=motion(1.2, Compliance(axis="x", force=20.0))),
        Step(name="retreat", motion=motion(0.8, by=-0.05)),
    ]


@pytest.mark.parametrize("there", [True, False])
def test_it_presses_where_it_meets_a_wall_and_comes_back_where_it_meets_none(in_plant, ready, there: bool) -> None:
    robot = in_plant(wall_before(ready, 0.02 if there else 0.5))
    start = robot.tip().translation
    robot.post_behaviour(*press_and_come_back(robot))
    robot.run()
    told, forces = [], []
    for _ in range(2500):
        row = robot.snapshot()["actions"][0]
        if row["state"] == ActionState.ENDED:
            break
        told.append(int(row["step"]))
        forces.append(float(robot.force_on("wall")[0]))
        robot.run()
    assert Outcome(int(row["outcome"])) is Outcome.DONE
    assert list(dict.fromkeys(told)) == ([0, 1, 2] if there else [0, 2])
    robot.run(100)
    if there:
        steps, true = np.array(told), np.array(forces)
        assert int(np.argmax(steps == 1)) - int(np.argmax(true > 1.0)) <= 3, "cycles from the touch to the press"
        pressed = true[steps == 1][-150:]
        assert abs(pressed - 20.0).max() < 2.0, f"N: {pressed.min():.2f} to {pressed.max():.2f}"
        after = int(np.argmax(true > 1.0)) + 5
        assert true[after:].max() < 30.0, "N, once the touch itself is over: nothing jumps from step to step"
        assert robot.force_on("wall")[0] == 0.0
        assert 0.0 > (robot.tip().translation - start)[0] > -0.06
    else:
        assert (robot.tip().translation - start)[0] == pytest.approx(0.01, abs=0.005)
