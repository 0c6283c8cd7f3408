"""A reach from the question to the verified plan, beside a valve: ``handrail bench reach`` (and a part of ``bench planning``).

TALOS' upper body, the valve's wheel in front of its right side. The right arm and the torso go from the home posture to places and
directions of the tool that random clear postures have. A plan counts from the question on: inverse kinematics with clearances, a
way that is certified all along (random trees where the straight one is not clear), time along it by toppra under velocity,
acceleration and torque limits, and the planner's own check. Then `verifier`, which shares nothing with any of it, judges each.
"""

from __future__ import annotations

import gc
import time
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from benchmarks.rows import Row
from engines.planning.collision.connect import Connector
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.collision.sweep import Sweep, lines
from engines.planning.collision.world import World
from engines.planning.ik.constraints import Direction, Position
from engines.planning.motion import Motion
from engines.planning.plan import Infeasible, Plan
from engines.planning.planners import Planners
from engines.planning.verifier import Verifier
from handrail.messages import Pose
from handrail.robot import library as robots

Array = NDArray[np.float64]

_GOALS, _WARM, _SEED = 100, 5, 2026
_WHEEL = (0.55, -0.35, 0.30)
"""m, in the world"""
_ROOM = 0.03
"""m that the postures from which goals are taken keep clear"""
_CONE = 0.1
"""rad, between the tool's direction and the one asked for"""
_CLEARANCE = 0.01


class Reaches:
    """The robot beside the valve, and goals that it can reach."""

    def __init__(self, goals: int):
        self.description = robots.load("talos_upper")
        self.planner = Planners(self.description).motions
        self.arm = self.description.arms["right"]
        mechanism = self.planner.mechanism
        wheel = Instance("wheel_1", catalogue.load("wheel"), Pose(position=_WHEEL))
        self.home = self.description.home_position("ready")
        allowed = self.description.allowed_collision_pairs
        self.world = World(mechanism, obstacles_of(wheel), allowed, moving=self.arm.joints)
        place = dict(zip(self.description.joints, self.home, strict=True))
        self.start = mechanism.configuration(np.array([place[joint] for joint in mechanism.joints]))
        self.questions: list[Motion] = []
        self.postures: list[Array] = []
        sweep, floors = Sweep(self.world), Margins(_ROOM, _ROOM).floors(self.world)
        rows = [mechanism.row(joint) for joint in self.arm.joints]
        generator, data = np.random.default_rng(_SEED), mechanism.model.createData()
        while len(self.questions) < goals:
            q = self.start.copy()
            q[mechanism.coordinate[rows]] = generator.uniform(
                mechanism.lower[rows] + 0.05, mechanism.upper[rows] - 0.05
            )
            if sweep.meeting(q[None, None], floors) is not None:
                continue
            pin.framesForwardKinematics(mechanism.model, data, q)
            tip = data.oMf[mechanism.frame_id(self.arm.tip)]
            direction = tuple((-tip.rotation[:, 2]).tolist())
            asked = [
                Position.at(self.arm.tip, tip.translation, name="place"),
                Direction(frame=self.arm.tip, axis=(0.0, 0.0, -1.0), direction=direction, cone=_CONE, name="direction"),
            ]
            self.questions.append(
                Motion(goals=asked, moving=self.arm.joints, obstacles=[wheel], arm="right", clearance=_CLEARANCE)
            )
            self.postures.append(q)

    def plan(self, number: int) -> Plan | None:
        """None where no plan was found."""
        try:
            return self.planner.plan(self.questions[number], self.home)
        except Infeasible:
            return None

    def sound(self, verifier: Verifier, number: int, plan: Plan) -> bool:
        """Whether the independent check has nothing to say against a plan."""
        end = plan.duration
        goals = [replace(goal, window=(end, end)) for goal in self.questions[number].goals]
        return not verifier.violations(
            plan,
            self.planner.limits_of(plan.joints, self.start),
            self.start,
            constraints=goals,
            torque=self.planner.torque_limit(plan.joints),
        )


def rows(goals: int = _GOALS) -> list[Row]:
    """Times of whole reaches, and of certifying the straight way to where they end. Half a minute."""
    reaches = Reaches(goals + _WARM)
    verifier = Verifier(reaches.world, margins=Margins(_CLEARANCE, _CLEARANCE))
    connector = Connector(reaches.world, margins=Margins(_CLEARANCE, _CLEARANCE))
    times: list[float] = []
    certain: list[float] = []
    sound: list[bool] = []
    for number in range(goals + _WARM):
        gc.collect()
        begin = time.perf_counter()
        plan = reaches.plan(number)
        spent = 1e3 * (time.perf_counter() - begin)
        straight = lines(np.array([reaches.start, reaches.postures[number]]))
        begin = time.perf_counter()
        connector.sweep.meeting(straight, connector.floors)
        if number < _WARM:
            continue
        certain.append(1e3 * (time.perf_counter() - begin))
        times.append(spent)
        if plan is not None:
            sound.append(reaches.sound(verifier, number, plan))
    median, late = float(np.median(times)), float(np.percentile(times, 95))
    found, kept = 100.0 * len(sound) / goals, 100.0 * float(np.mean(sound)) if sound else 0.0
    return [
        Row(name="reach beside the valve, median", value=median, unit="ms", goal="≤ 60", holds=median <= 60.0),
        Row(name="reach beside the valve, p95", value=late, unit="ms", goal="≤ 200", holds=late <= 200.0),
        Row(name="reach beside the valve, plans found", value=found, unit="%", goal="—", holds=True),
        Row(name="of these sound by the independent check", value=kept, unit="%", goal="100", holds=kept == 100.0),
        Row(
            name="certifying or refuting a straight way all along, median",
            value=float(np.median(certain)),
            unit="ms",
            goal="—",
            holds=True,
        ),
    ]
