"""Approach, contact, press, retreat: the example's one call, no round trip, judged by the plant."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daemon.exchange import ActionState, Outcome
from daemon.serving.robot_info import robot_info
from hal.plant import scene
from handrail.behaviour_file import BehaviourFile

EXAMPLES = Path(__file__).parents[3] / "examples"


def test_the_example_presses_where_it_meets_the_wall_and_comes_back(in_plant, talos) -> None:
    robot = in_plant(scene.load(EXAMPLES / "wall.yaml"))
    start = robot.tip().translation
    steps = BehaviourFile(EXAMPLES / "press_wall.yaml").call("a", "o", robot_info(talos)).steps
    robot.post_behaviour(*steps)
    robot.run()
    told, forces = [], []
    for _ in range(3000):
        row = robot.snapshot()["actions"][0]
        if row["state"] == ActionState.ENDED:
            break
        told.append(int(row["step"]))
        forces.append(float(robot.force_on("wall")[0]))
        robot.run()
    assert Outcome(int(row["outcome"])) is Outcome.DONE
    assert list(dict.fromkeys(told)) == [0, 1, 2]
    robot.run(100)
    taken, true = np.array(told), np.array(forces)
    touched = int(np.argmax(true > 1.0))
    assert int(np.argmax(taken == 1)) - touched <= 3, "cycles from the touch to the press"
    pressed = true[taken == 1][-150:]
    assert abs(pressed - 20.0).max() < 2.0, f"N: {pressed.min():.2f} to {pressed.max():.2f}"
    assert true[touched + 5 :].max() < 30.0, "N, once the touch itself is over: nothing jumps from step to step"
    assert robot.force_on("wall")[0] == 0.0
    assert 0.0 > (robot.tip().translation - start)[0] > -0.06
