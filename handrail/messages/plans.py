"""Plans: made, shown, edited, executed."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, NonNegative, Pose, travels
from handrail.messages.goals import Along, Goal, KeyFrame
from handrail.messages.instances import InstanceState


class PlanSegment(msgspec.Struct, kw_only=True):
    """One stretch of a plan, executed by itself."""

    name: str
    times: list[float]
    positions: list[list[float]]
    """rad, knots × PlanPreview.joints; straight lines between them are the motion within 5 mrad"""


class PlanWorst(msgspec.Struct, kw_only=True):
    """The worst of a measure on the way to a waypoint."""

    value: float
    time: float
    """s from the plan's start"""
    about: str = ""
    """the joint, or the two bodies, that it is about"""


class PlanWaypoint(msgspec.Struct, kw_only=True):
    """How well a segment's end meets what was asked for, and what the way to it keeps at its worst. None: was not measured."""

    name: str
    """of its segment; or `key frame` and its number, where one is passed on the way"""
    time: float
    """s from the plan's start, when it is reached"""
    residual: float | None = None
    """m, from the tool's tip to its goal"""
    tilt: float | None = None
    """rad, between the tool and its wanted axis"""
    clearance: PlanWorst | None = None
    """m, and between which bodies; none: nothing can be near"""
    limit_margin: PlanWorst | None = None
    """rad, and which joint is so near its limit"""
    torque_share: PlanWorst | None = None
    """of its limit, by inverse dynamics with the expected contact force, and which joint works so hard"""
    force_limit: float | None = None
    """N, the most that it presses with on the way there, or at which it ends; None: nothing is to be touched"""


class PlanGave(msgspec.Struct, kw_only=True):
    """By how much a goal was missed that was allowed to give way (PlanMotion.relax, MakePlan.relax)."""

    goal: str
    """its place in the call, and what it is about"""
    what: str
    """x, y, z along the goal's own axes, angle, distance, or relation"""
    by: float
    unit: Literal["m", "rad"]


class PlanSeries(msgspec.Struct, kw_only=True):
    """A measure along a plan."""

    times: list[float]
    """s from the plan's start"""
    values: list[float]
    names: list[str] = []
    """the joints or pairs of bodies that the values are about"""
    which: list[int] = []
    """row of `names` for each value; empty: about nothing in particular"""


class PlanOrigin(msgspec.Struct, kw_only=True):
    """What a plan was made from, beside the versions of its instances."""

    time_ns: int
    """robot's clock when it was begun"""
    asked: dict[str, float | str]
    """what was asked for: instance, trajectory, arm, arc and entry_shift rad; of a motion goals, in words, arm, clearance m;
    `after` and `edits`: ids of plans"""
    run: str = ""
    """id of the run that made it; empty: a client asked"""
    instances: list[InstanceState] = []
    """as they were"""
    joints: dict[str, float] = {}
    """rad, every joint of the robot as it was commanded: the plan moves some, and counts on the others to stay"""
    base_in_world: Pose = msgspec.field(default_factory=Pose)


StaleCause = Literal[
    "executed",
    "not_yet",
    "instance_removed",
    "instance_moved",
    "instance_parameters",
    "instance_changed",
    "start_left",
    "others_moved",
    "base_moved",
    "base_unknown",
]


@travels(priority=3, reliable=False, superseded_by=("id",), remote=True)
class PlanPreview(Message):
    """What a client draws as a ghost, and whether the plan may still be executed: the summary of it.

    `origin`, `measures` and `tool` come only in the answer to GetPlan with `details`.
    """

    id: str
    label: str
    joints: list[str]
    segments: list[PlanSegment]
    made_from: dict[str, int]
    """instance → version"""
    fresh: bool
    stale_because: str = ""
    """all causes, in words"""
    stale_causes: list[StaleCause] = []
    """the same for programs, in the words' order"""
    clearance: float = 0.0
    """m, the smallest along the plan"""
    limit_margin: float = 0.0
    """rad, the smallest distance to a joint limit"""
    duration: float = 0.0
    """s"""
    arm: str = ""
    waypoints: list[PlanWaypoint] = []
    """one a segment, and one a key frame that is passed on it"""
    key_times: list[float] = []
    """s from the plan's start, when a motion passes each of its key frames (EditPlan)"""
    gave: list[PlanGave] = []
    """what was not kept, of what may give way, the worst first"""
    origin: PlanOrigin | None = None
    measures: dict[str, PlanSeries] = {}
    """clearance m, residual m, tilt rad, limit_margin rad, torque_share"""
    tool: list[list[float]] = []
    """m, the tip of the arm's tool in the world, one row a knot of all segments one after the other"""


@travels(priority=1, remote=True)
class GetPlan(Message):
    """A plan by its id."""

    id: Name
    details: bool = False
    """also what it was made from, what it keeps all along its way, and the tool's way: some 10 kB"""


@travels(priority=1, remote=True)
class MakePlan(Message):
    """Plan a template's trajectory for an arm from where the robot is now. Answered when the plan is there or found infeasible."""

    instance: Name
    trajectory: Name
    arm: str = "right"
    """empty: the first for which there is a plan, in the order of RankChoices, and there the place around the joint"""
    arc: float | None = None
    """rad, place around the template's joint of the arc's centre (a Choice's); none: the planner's choice"""
    after: str = ""
    """id of a plan: from where it ends; empty: from where the robot is commanded now"""
    seen: bool = False
    """whether to keep clear of what cameras see as well, as PlanMotion does; the tool only until it may touch the instance"""
    relax: Annotated[list[str], Meta(max_length=2)] = []
    """what may give way where there is no plan, the first one first, as little as it must: `tilt` (how the tool leans), `reach`
    (how far its tip is off). The plan tells what `gave`"""


@travels(priority=1, remote=True)
class CancelPlanning(Message):
    """End all planning that calls are waiting for (plans, choices, checks of tasks). Programs go on."""


@travels(priority=5, reliable=False, superseded_by=("what",), remote=True)
class PlanProgress(Message):
    """What a call that plans is doing."""

    what: str
    """the call, in a few words"""
    doing: str
    done: bool = False
    """it is answered"""


@travels(priority=1, remote=True)
class RankChoices(Message):
    """Which arm, trajectory and place around the joint can do how much of a behaviour at an instance. The best comes first."""

    instance: Name
    trajectory: str = ""
    """empty: all of the template's"""
    arms: list[Name] = []
    """none: all"""
    after: str = ""
    """id of a plan: from where it ends; empty: from where the robot is commanded now"""


class Choice(msgspec.Struct, kw_only=True):
    """One way to do a behaviour."""

    trajectory: str
    arm: str
    arc: float | None
    """rad about the template's joint, the arc's centre; none: the trajectory has no arc"""
    share: float
    """of the tool's goals over the whole arc, at every depth, that are reached, strong enough, and clear; from 0 to 1"""
    cost: float
    """rad, the arm's way from where it is to where the behaviour begins"""
    lacks: str = ""
    """what most of the rest misses"""
    joints: dict[str, float] = {}
    """rad, the arm where the behaviour begins"""


class Choices(Message):
    """Answer to RankChoices."""

    choices: list[Choice]
    """by share, then by cost"""


@travels(priority=1, remote=True)
class PlanMotion(Message):
    """Plan a motion to goals that keeps clear of all instances and of the robot itself. Answered when the plan is there or found
    infeasible; which constraint is missed, and by how much, is told.
    """

    goals: Annotated[list[Goal], Meta(max_length=32)] = []
    """all of them, where the motion ends; at least one, or `along`"""
    along: Along | None = None
    """in place of goals and key frames"""
    arm: str = ""
    """whose joints move, and whose tip is meant by a frame that is not named; empty: the robot's only one, or `joints` say it"""
    joints: list[Name] = []
    """joints and groups that may move, in place of the arm's; the others stay where they are"""
    through: Annotated[list[KeyFrame], Meta(max_length=16)] = []
    """on the way, in this order"""
    keep: Annotated[list[Goal], Meta(max_length=32)] = []
    """along the whole way"""
    after: str = ""
    """id of a plan: from where it ends; empty: from where the robot is commanded now"""
    clearance: NonNegative = 0.01
    """m, from every instance; of the robot from itself at least as much as the daemon's guard asks for"""
    ignore: list[Name] = []
    """instances that need not be kept clear of"""
    seen: bool = False
    """whether to keep clear of what cameras see as well, but for points on the robot and on instances; refused where none sees"""
    relax: Annotated[list[str], Meta(max_length=32)] = []
    """goals that may give way where there is no posture for all, the first one first and as little as possible: `goals[1]`, or
    `goals[0].position`, `goals[0].angle` alone. The plan tells what `gave`"""
    duration: NonNegative = 0.0
    """s, at least"""
    label: str = ""


@travels(priority=1, remote=True)
class EditPlan(Message):
    """Plan a motion anew, with what an operator dragged its ghost to as one key frame more, or in place of one that it has.

    The new plan keeps the edit, and so do plans that are edits of it. It begins where the robot is now, or where the plan before it
    ends. Refused for a stroke at a template, which has no key frames; and as superseded where a newer edit of the same plan comes
    while this one is being planned. Of edits of the same key frame of the same plan the newest is kept.
    """

    id: Name
    goals: Annotated[list[Goal], Meta(min_length=1, max_length=32)]
    """what must hold there"""
    time: NonNegative = 0.0
    """s from the plan's start: where a new key frame goes among those that there are"""
    frame: Annotated[int, Meta(ge=-1)] = -1
    """number of the key frame to change, from 0; as many as there are: the motion's end; -1: none, it is a new one"""


@travels(priority=1, remote=True)
class AwaitPlan(Message):
    """Answered with its PlanPreview when the plan that is being executed has ended; refused with why it ended otherwise."""

    id: Name


@travels(priority=1, remote=True)
class ExecutePlan(Message):
    """Run a plan's segments (all, or those named). Refused when it is stale, with the reason."""

    id: Name
    segments: list[Name] = []
