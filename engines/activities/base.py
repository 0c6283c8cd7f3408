"""What a program's state can do: an activity, with typed arguments that a program's file is checked against."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from engines.daemon_client import DaemonClient
from engines.learning.facts import RunNotes
from engines.nodes.keeper import NodeKeeper
from engines.plans.store import PlanStore
from engines.runs.motion import Motion
from engines.runs.preconditions import Precondition
from engines.runs.prompts import Prompts
from handrail.messages import Along, Base, Goal, KeyFrame, PlanMotion, PointCloud
from handrail.robot.description import RobotDescription

if TYPE_CHECKING:
    from engines.planning.collision.obstacles import Obstacle
    from engines.planning.collision.seen import Seen
    from engines.planning.plan import Plan
    from engines.planning.strokes.behaviour import Choice


class Kind(Enum):
    """What an argument takes, and so how its text in the file is read."""

    ARM = "arm"
    """the name of a resource of kind arm"""
    INSTANCE = "instance"
    """the name of a resource of kind instance"""
    BEHAVIOUR = "behaviour"
    """the name of a behaviour (handrail.behaviour_file)"""
    COMPOUND = "compound task"
    """the name of a compound task (docs/wbc.md), or a mapping with its constraints and levels; texts in it"""
    LIST = "list"
    """a list of mappings as `Argument.of` has them, with expressions where numbers stand"""
    NAME = "name"
    """a plain name"""
    NAMES = "names"
    """a list of plain names"""
    TEXTS = "texts"
    """a list of such words as TEXT takes"""
    CHOICE = "choice"
    """one of `Argument.choices`"""
    TEXT = "text"
    """words, with {expression} or {expression:format} in them"""
    NUMBER = "number"
    """a number, or an expression that has one"""
    VALUE = "value"
    """an expression: a variable's value, say"""
    GOALS = "goals"
    """a list of goals (handrail.messages.Goal); an instance in them is the name of a resource"""
    NODE = "node"
    """the name of a process node (docs/nodes.md)"""
    PORTS = "ports"
    """port → a value, in which every text is an expression"""
    PROGRAM = "program"
    """the name of a program of the library"""
    BINDINGS = "bindings"
    """a program's resource → one of this program"""
    ALONG = "joint to go with"
    """a handrail.messages.Along, its instance the name of a resource"""
    KEY_FRAMES = "key frames"
    """a list of handrail.messages.KeyFrame"""


@dataclass(frozen=True)
class Argument:
    """One argument of an activity."""

    kind: Kind
    required: bool = True
    default: Any = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    of: Any = None
    """LIST: a msgspec type"""


SHAPES: Mapping[Kind, Any] = {Kind.GOALS: list[Goal], Kind.KEY_FRAMES: list[KeyFrame], Kind.ALONG: Along}
"""of arguments that are written as the messages that they become"""


def goals_in(given: Sequence[Goal | KeyFrame] | Along) -> Iterator[Goal | Along]:
    """All that may name an instance, the goals of key frames among them."""
    for each in (given,) if isinstance(given, Along) else given:
        yield from each.goals if isinstance(each, KeyFrame) else (each,)


class ActivityFailed(Exception):
    """An activity could not do what it was asked. The program gets `error.execution` with `reason` (one word) and `message`."""

    def __init__(self, reason: str, message: str):
        self.reason = reason
        super().__init__(message)


class Planner(Protocol):
    """What the engine needs of `engines.planning.planners.Planners`."""

    def plan(
        self,
        instance: Instance,
        trajectory: str,
        arm: str,
        position: np.ndarray,
        *,
        arc: float | None = None,
        entry_shift: float = 0.0,
        others: Sequence[Instance] = (),
        seen: Sequence[Obstacle] = (),
        relax: Sequence[str] = (),
        base: Base | None = None,
        cancelled: Callable[[], bool] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Plan: ...

    def rank(
        self,
        instance: Instance,
        position: np.ndarray,
        *,
        trajectories: Sequence[str] = (),
        arms: Sequence[str] = (),
        others: Sequence[Instance] = (),
        base: Base | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> list[Choice]: ...

    def motion(
        self,
        call: PlanMotion,
        instances: Sequence[Instance],
        position: np.ndarray,
        *,
        seeds: Sequence[np.ndarray] = (),
        seen: Seen | None = None,
        base: Base | None = None,
        cancelled: Callable[[], bool] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Plan: ...

    def see(
        self, clouds: Sequence[PointCloud], time_ns: int, position: np.ndarray, instances: Sequence[Instance]
    ) -> Seen: ...


@dataclass(frozen=True)
class Services:
    """What the engine lends to every activity."""

    description: RobotDescription
    daemon: DaemonClient
    affordances: AffordanceServer
    plans: PlanStore
    prompts: Prompts
    planner: Planner
    tip_pose: Callable[[np.ndarray, str], tuple[np.ndarray, np.ndarray]]
    """joint positions (n,) rad, arm → position (3,) m and quaternion (4,) of its tool's tip in the world"""
    log: Callable[..., None]
    """(level, text, the node that it is of; none: the engine itself)"""
    """level, text: a line for people"""
    clouds: Callable[[], Sequence[PointCloud]] = tuple
    """the newest of each camera"""
    nodes: NodeKeeper = field(default_factory=NodeKeeper)
    outlasts: frozenset[str] = frozenset()
    """reasons of failures that a run waits out, paused, in place of telling its program"""

    def tip(self, position: np.ndarray, arm: str) -> np.ndarray:
        """(3,) m: an arm's tool tip in the world at joint positions (n,) rad."""
        return self.tip_pose(position, arm)[0]


@dataclass(frozen=True)
class Context:
    """The run that an activity belongs to."""

    services: Services
    run: str
    motion: Motion
    hold_s: float
    """wall time for which simulated time may wait for the engine while it computes (lock-step)"""
    seeds: Sequence[np.ndarray] = ()
    """(n,) rad each: where plans of this state ended when the program was rehearsed"""
    notes: RunNotes = field(default_factory=RunNotes)
    """what the run meets on its way"""


class Activity(ABC):
    """Work that a state does in a thread of its own. Made anew each time that the state is entered."""

    arguments: ClassVar[Mapping[str, Argument]] = {}
    outputs: ClassVar[frozenset[str]] = frozenset()
    """what `_event.data` has when it is done"""

    def __init__(self, context: Context, values: Mapping[str, Any]):
        """`values`: every argument's value, resources as the names that they are bound to."""
        self.context = context
        self.services = context.services
        self.values = values
        self.cancelled = threading.Event()

    @classmethod
    def outputs_of(cls, given: Mapping[str, Any]) -> frozenset[str]:
        """What `_event.data` has when it is done with these arguments, as the file gives them."""
        return cls.outputs

    @classmethod
    def problem(cls, given: Mapping[str, Any]) -> tuple[str, str]:
        """What is wrong with these arguments together, as the file gives them: which one, and why; empty when nothing is."""
        return "", ""

    @abstractmethod
    def run(self) -> dict[str, Any]:
        """Do it; returns the outputs. Raises ActivityFailed."""

    def preconditions(self) -> Iterator[Precondition]:
        """What has to hold so that it can begin, or once it has begun go on, after a pause: of its motion, that this is where it
        was left. Asked from another thread; on one that has not begun, too.
        """
        yield from self.context.motion.preconditions(self.cancelled)

    def cancel(self) -> None:
        """Called from another thread when the state is left before it is done; `run` must return soon."""
        self.cancelled.set()
