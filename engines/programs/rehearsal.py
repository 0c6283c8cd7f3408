"""A task checked as a whole, before any of it moves: the program runs in a world of its own, where every motion goes as planned.

Where each planning state ends in a rehearsal is where that state looks first when the program runs: a plan of the whole "was used
as a seed to generate the subsequent smaller plans in the sequence" (Fallon et al. 2015, §7.1).

It is the same statechart with the same activities; only the robot, the operator (who takes the first option of every prompt) and
the instances are stand-ins. A joint that a stroke turns is believed to have turned, so that the next stroke is planned for where it
will be. What the robot would find out only by moving (contacts, guards, behaviours' ends) is taken to go as intended.
"""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from affordance_templates import attachments
from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from engines.activities import ACTIVITIES
from engines.activities.base import Activity, ActivityFailed, Context, Services
from engines.daemon_client import DaemonClient
from engines.plans.freshness import World
from engines.plans.store import PlanRecord, PlanStore
from engines.programs.deployment import Deployed
from engines.programs.program import State
from engines.programs.statechart import Chart
from engines.runs.clock import RunClock
from engines.runs.motion import Behaviour, Motion
from engines.runs.prompts import Prompts
from handrail import workspace
from handrail.behaviour_file import Robot
from handrail.messages import (
    ActionEvent,
    AnswerPrompt,
    AttachInstance,
    EndCondition,
    InstanceEdit,
    JointTrajectory,
    Prompt,
    PromptClosed,
    TaskCheck,
    TaskStep,
)
from handrail.messages import Motion as MotionMessage
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

Array = NDArray[np.float64]

MOST_STEPS = 400
"""activities after which a program counts as one without end"""
_IDLE_S = 5.0
"""wall time without an activity after which a program counts as waiting for what nobody brings"""


@dataclass(frozen=True)
class Rehearsed:
    """What came out."""

    check: TaskCheck
    ends: Mapping[str, Sequence[Array]]
    """state → (n,) rad each, where the plans that it made end, in their order"""


@dataclass
class _Stage:
    """The world of a rehearsal: stand-ins for the daemon's client and the affordance server, as activities use them."""

    world_now: World
    placed: dict[str, Instance]
    owner: str = "rehearsal"

    def world(self) -> World:
        return self.world_now

    def command(self) -> Array:
        return self.world_now.command.copy()

    def hold_time(self, seconds: float) -> None:
        """There is no time here."""

    def release_time(self) -> None:
        """There is no time here."""

    def get(self, name: str) -> Instance:
        if name not in self.placed:
            raise refuse("no such instance", "name", name, f"one of: {', '.join(self.placed) or 'none placed yet'}")
        return self.placed[name]

    def instances(self) -> list[Instance]:
        return list(self.placed.values())

    def set_joint(self, name: str, joint: str, position: float) -> Instance:
        old = self.get(name)
        self.placed[name] = replace(old, joint_state={**old.joint_state, joint: position})
        return self.placed[name]

    def attach(self, request: AttachInstance) -> InstanceEdit:
        """It is noted, and stays where it is: where the hand is nobody works out here."""
        old, to = self.get(request.name), attachments.asked(request)
        if to != old.attached_to:
            own = old.pose_in_world if to else None
            self.placed[old.name] = replace(old, attached_to=to, pose_in_parent=own, version=old.version + 1)
        return InstanceEdit(name=old.name, instance=self.placed[old.name].state())

    def go(self, rows: NDArray[np.int64], there: Array) -> None:
        """The robot has moved."""
        command = self.command()
        command[rows] = there
        self.world_now = replace(self.world_now, command=command)


class _Motion:
    """Goes to the end of everything at once; as activities use `engines.runs.motion.Motion`."""

    def __init__(self, stage: _Stage, description: RobotDescription):
        self._stage, self._description = stage, description
        self.ended: ActionEvent | None = None
        self.guessed = False
        """whether it was asked for something whose end is found out only by doing it"""
        self.by_hand = False

    def run(
        self, motion: MotionMessage, ends: Sequence[EndCondition], cancelled: threading.Event, *, what: str = "motion",
        still: Callable[[], str] = lambda: "", meanwhile: Callable[[str], None] | None = None, hoped: str = "done",
    ) -> ActionEvent:  # fmt: skip
        if isinstance(motion, JointTrajectory):
            self._stage.go(self._description.index(motion.joints), np.array(motion.positions[-1]))
        else:
            self.guessed = True
        return self._ended(hoped)

    def run_behaviour(
        self, behaviour: Behaviour, robot: Robot, cancelled: threading.Event, *, what: str = "behaviour"
    ) -> ActionEvent:
        self.guessed = True
        return self._ended(behaviour.hoped)

    def _ended(self, outcome: str = "done") -> ActionEvent:
        position = self._stage.command().tolist()
        self.ended = ActionEvent(
            id="rehearsal", state="ended", outcome=outcome, time_ns=0, cycle=0, position=position, command=position
        )
        return self.ended

    def interrupt(self) -> None:
        """Nothing is ever under way."""

    def strayed(self, besides: Collection[str]) -> str:
        """Nobody moves anything by hand."""
        return ""


class _Operator(Prompts):
    """Takes the first option."""

    def __init__(self) -> None:
        super().__init__(_nobody)

    def ask(self, prompt: Prompt) -> None:
        super().ask(prompt)
        self.answer(AnswerPrompt(id=prompt.id, answer=prompt.options[0], by="rehearsal"))


def _nobody(_: Prompt | PromptClosed) -> None:
    pass


@dataclass
class Rehearsal:
    """One rehearsal of a deployed program, from a world as it is."""

    deployed: Deployed
    services: Services
    """the engine's: its planner, description and tip are used, its daemon and instances are not touched"""
    world: World
    instances: Sequence[Instance]
    cancelled: threading.Event = field(default_factory=threading.Event)
    _steps: list[TaskStep] = field(default_factory=list)
    _ends: dict[str, list[Array]] = field(default_factory=dict)
    _busy: int = 0
    _failed: str = ""
    """id of the state that could not do what it is for"""
    _made: int = 0

    def run(self) -> Rehearsed:
        """Go through the program until it ends, or until a motion is infeasible."""
        stage = _Stage(self.world, {each.name: each for each in self.instances})
        plans = PlanStore(stage.instances, stage.world, lambda preview: None)
        services = replace(
            self.services, daemon=cast(DaemonClient, stage), affordances=cast(AffordanceServer, stage), plans=plans,
            prompts=_Operator(), log=lambda *said: None,
        )  # fmt: skip
        motion = cast(Motion, _Motion(stage, self.services.description))
        context = Context(services, f"rehearsal-{uuid.uuid4().hex[:8]}", motion, 0.0)
        program = self.deployed.program
        clock = RunClock()
        chart = Chart(
            program, self.deployed.names(), lambda state, values: self._activity(context, state, values), clock=clock
        )
        chart.begin()
        stopped = False
        while (end := chart.ended) is False:
            if not stopped and (self._failed or self.cancelled.is_set() or self._made >= MOST_STEPS):
                chart.stop()
                stopped = True
            if not chart.step(_IDLE_S) and not self._busy and not clock.skip():
                chart.stop()
                stopped = True
                self._failed = " / ".join(chart.active()) or program.name
                self._note(self._failed, "wait", problem="it waits for something that nobody brings")
        detail = chart.words(end.file.detail) if isinstance(end, State) else ""
        outcome = str(end.file.outcome) if isinstance(end, State) else "stopped"
        return Rehearsed(self._told(outcome, detail), self._ends)

    def _told(self, outcome: str, detail: str) -> TaskCheck:
        problem = next((step for step in self._steps if step.problem), None)
        if self.cancelled.is_set():
            detail = "the check was cancelled"
        elif problem is not None:
            detail = f"{problem.state}: {problem.problem}"
        elif self._made >= MOST_STEPS:
            detail = f"it goes on after {MOST_STEPS} activities"
        return TaskCheck(
            program=self.deployed.program.name,
            hash=self.deployed.program.hash,
            feasible=outcome == "succeeded" and problem is None and not self.cancelled.is_set(),
            first_infeasible=problem.state if problem else "",
            outcome=outcome,
            detail=detail,
            steps=self._steps,
        )

    def _note(self, state: str, activity: str, **more: Any) -> None:
        self._steps.append(TaskStep(state=state, activity=activity, **more))

    def _activity(self, context: Context, state: State, values: Mapping[str, Any]) -> Activity:
        self._made += 1
        workspace.pin(self.deployed.folder)  # for this thread, which is the activity's own
        return _Watched(ACTIVITIES[state.file.do](context, values), self, state.id)


class _Watched(Activity):
    """An activity of which the rehearsal notes how it went."""

    def __init__(self, activity: Activity, rehearsal: Rehearsal, state: str):
        super().__init__(activity.context, activity.values)
        self._activity, self._rehearsal, self._state = activity, rehearsal, state
        self.cancelled = activity.cancelled

    def run(self) -> dict[str, Any]:
        rehearsal = self._rehearsal
        rehearsal._busy += 1
        kind = next(name for name, activity in ACTIVITIES.items() if activity is type(self._activity))
        try:
            outputs = self._activity.run()
        except ActivityFailed as failed:
            rehearsal._failed = rehearsal._failed or self._state
            rehearsal._note(self._state, kind, problem=str(failed))
            raise
        else:
            self._tell(kind, outputs)
            return outputs
        finally:
            rehearsal._busy -= 1

    def _tell(self, kind: str, outputs: Mapping[str, Any]) -> None:
        rehearsal, motion = self._rehearsal, cast(_Motion, self.context.motion)
        if kind == "plan":
            plans = self.services.plans
            record: PlanRecord = plans.get(outputs["plan"])
            rehearsal._ends.setdefault(self._state, []).append(plans.end(record.plan.id).command)
            plan = record.plan
            rehearsal._note(
                self._state, kind, what=plan.label, clearance=plan.clearance, limit_margin=plan.limit_margin,
                duration=plan.duration,
            )  # fmt: skip
        elif motion.guessed:
            rehearsal._note(self._state, kind, what=str(self.values.get("behaviour", "")), unknown=True)
        motion.guessed = False

    def cancel(self) -> None:
        self._activity.cancel()
