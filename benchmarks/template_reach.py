"""How often a drag's reachability is told: ``handrail bench template_reach`` (and a part of ``bench templates``).

TALOS' upper body, the lever valve's two trajectories of six waypoints for its right hand. The instance is dragged along a line at
0.3 m/s, 3 cm from one refresh to the next: where all of it is reached, and out to where some of it is not. A refresh is the
template expanded anew, a world with it, a posture for each of 12 waypoints, as `engines.reach` finds them; CPU time of one core.
What a refresh says of a waypoint is then held against a search from scratch, from many starts.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator

import numpy as np

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from benchmarks.rows import Row
from engines.planning.planners import Planners
from engines.reach.reachability import Question, Reachability
from handrail.messages import Pose
from handrail.robot import library as robots

_TRAJECTORIES = ("turn", "push")
_WAYS = {
    "at hand": ((0.50, -0.55, 0.10), (0.60, -0.15, 0.20)),
    "to out of reach": ((0.70, -0.40, 0.10), (1.20, 0.00, 0.30)),
}
"""m, from where to where, in the world"""
_STEP = 0.03
_LEAST_HZ = 10.0
_JUDGED = 4
"""every so many refreshes one is judged"""


class Drag:
    """A lever valve dragged to and fro."""

    def __init__(self, robot: str = "talos_upper"):
        self.description = robots.load(robot)
        self.planners = Planners(self.description)
        self.home = self.description.home_position("ready")
        self.template = catalogue.load("lever_valve")

    def places(self, way: str, rounds: int) -> Iterator[tuple[float, float, float]]:
        """There and back."""
        begin, end = (np.array(each) for each in _WAYS[way])
        steps = int(np.ceil(np.linalg.norm(end - begin) / _STEP))
        for _ in range(rounds):
            for step in (*range(steps), *range(steps, 0, -1)):
                x, y, z = (begin + (end - begin) * step / steps).tolist()
                yield x, y, z

    def questions(self, place: tuple[float, float, float]) -> list[Question]:
        """One a trajectory."""
        valve = Instance("valve", self.template, Pose(position=place))
        return [Question("valve", name, "right", 0.01, [valve], self.home) for name in _TRAJECTORIES]


def rows(rounds: int = 2) -> list[Row]:
    """Half a minute."""
    drag, found = Drag(), list[Row]()
    agree: list[bool] = []
    for way in _WAYS:
        reach, times, reached = Reachability(drag.planners, drag.description), list[float](), 0
        for number, place in enumerate(drag.places(way, rounds)):
            gc.collect()
            begin = time.process_time()
            questions = drag.questions(place)
            told = [each for question in questions for each in reach.quick(question)]
            times.append(time.process_time() - begin)
            reached += sum(each.state != "not" for each in told)
            if number % _JUDGED == 0:
                scratch = Reachability(drag.planners, drag.description)
                for question in questions:
                    scratch.quick(question)
                truth = [each for q in questions for each in scratch.settle(q, lambda: False) or ()]
                agree += [
                    (one.state == "not") == (other.state == "not") for one, other in zip(told, truth, strict=True)
                ]
        hertz, slow = 1.0 / float(np.median(times[1:])), 1.0 / float(np.percentile(times[1:], 95))
        share = 100.0 * reached / (12 * len(times))
        name = f"12 waypoints dragged {way} ({share:.0f} % reached)"
        found.append(
            Row(name=f"{name}, median", value=hertz, unit="Hz", goal=f"≥ {_LEAST_HZ:g}", holds=hertz >= _LEAST_HZ)
        )
        found.append(Row(name=f"{name}, slowest 5 %", value=slow, unit="Hz", goal="—", holds=True))
    right = 100.0 * float(np.mean(agree))
    found.append(
        Row(name="told as a search from scratch tells", value=right, unit="%", goal="≥ 95", holds=right >= 95.0)
    )
    return found
