"""Actions and behaviours: started, streamed to, paused, ended, and what the daemon tells of them."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, NonNegative, travels
from handrail.messages.end_conditions import EndCondition
from handrail.messages.motions import Motion, StepMotion


@travels(priority=2, remote=True)
class ActionEvent(Message):
    """A change in an action's life. `ended` carries the outcome and the robot in the cycle that ended it."""

    id: str
    state: Literal["running", "paused", "ended"]
    time_ns: int
    cycle: int
    step: str = ""
    """of a behaviour: the step that it is in, or was in when it ended"""
    outcome: str = ""
    """ended: `done` (trajectory finished), the name of the end condition that tripped, `cancelled`, `stopped`, `owner_lost`,
    `refused_by_limits`, `drive_fault`, `diverged`, `stale_state`, `controller_error` (a ControllerEvent has the traceback),
    `infeasible` (constraints exclude each other: `detail` names the one that blocks); of a behaviour, of its last step, or
    `step_refused`, `too_many_steps`"""
    detail: str = ""
    """what came about where; running, of a behaviour: how the step before ended"""
    position: list[float] = []
    """rad, measured in that cycle"""
    command: list[float] = []
    """rad, commanded in that cycle"""
    path_force: float = 0.0
    """N, the path-force integrator's last value"""
    speed: float = 1.0
    """share of the planned speed that it runs at, or comes to: its own times the robot's (SetSpeed)"""


@travels(priority=1, remote=False)
class StartAction(Message):
    """Run a motion with end conditions that the loop checks in every cycle. Ends in a hold at the last command.

    Refused (with field, value, expectation) when: not enabled, stopped, joints claimed by another running action, first knot
    further than 0.02 rad from what the robot is commanded, a knot beyond limits, non-finite numbers, expired.
    """

    id: Name
    owner: Name
    motion: Motion
    ends: list[EndCondition] = []
    expires_ns: int = 0
    """robot clock; 0: never"""
    hold_after_s: NonNegative = 0.0
    """lock-step: in the cycle that ends the action, hold simulated time for `owner`, at most this long (wall time)"""
    lease: int = 0
    """epoch of `owner`'s newest lease; counts only where somebody has taken a part that this moves (TakeLease)"""
    sequence: int = 0
    """likewise: number of the command, higher than of all before it under that lease"""


class GripperOrder(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Where a step sends a gripper, as CommandGripper does."""

    gripper: Name
    position: float
    """rad or m, of the driven joint"""
    velocity: NonNegative = 0.0
    """rad/s or m/s, at most; 0: its limit"""
    effort: NonNegative = 0.0
    """N·m or N, at most; 0: its limit"""


class Step(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """One action of a behaviour."""

    name: Name
    motion: StepMotion
    gripper: GripperOrder | None = None
    """sent off in the cycle in which the step begins; it follows that until its next order, whatever becomes of the behaviour, so
    that what it holds is not let go"""
    ends: list[EndCondition] = []
    then: dict[str, Name] = {}
    """how it ended → the step that follows, or `end`. How: `done`, an end condition's type (`contact`), or one by its number
    (`ends[1]`). Left out: after `done` the next one follows, after anything else the behaviour ends"""


@travels(priority=1, remote=False)
class StartBehaviour(Message):
    """Run actions in a chain, the first step first; one follows another in the cycle that ends it, without a round trip.

    To everybody it is one action: cancelled, paused and resumed by its `id`, with an ActionEvent at every step. Each step moves the
    same joints. Refused as StartAction is, with `steps[i]` before the field; what a step's end is not told to lead to, an
    operator's stop or cancellation say, ends the behaviour. Whole-body steps are made before the first one begins, which may be
    refused with NOT_READY: call again. A joint trajectory has to start within 0.02 rad of what the robot is
    commanded when its turn comes: else the behaviour ends with `step_refused`.
    """

    id: Name
    owner: Name
    steps: Annotated[list[Step], Meta(min_length=1, max_length=16)]
    most_steps: Annotated[int, Meta(ge=1, le=10_000)] = 100
    """that it may take; then it ends with `too_many_steps`"""
    expires_ns: int = 0
    """robot clock; 0: never"""
    hold_after_s: NonNegative = 0.0
    """as of StartAction, when the behaviour ends"""
    lease: int = 0
    sequence: int = 0
    """as of StartAction"""


@travels(priority=1, remote=False)
class StreamPose(Message):
    """Where a streamed reference of a running whole-body action is to be, in the frame that its task is relative to.

    What is not given stays as it was sent last. Between two of these it goes on at `velocity`. Refused when no such action runs,
    or nothing of it is streamed under this name.
    """

    id: Name
    """the action's"""
    task: Name
    position: tuple[float, float, float] | None = None
    """m"""
    orientation: tuple[float, float, float, float] | None = None
    """x y z w"""
    velocity: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """m/s, rad/s: linear, angular"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine. Another's action is left alone"""


@travels(priority=1, remote=False)
class StreamJoints(Message):
    """A sample of where the joints of a running JointStream are to be, or the next target of a JointTarget that is on its way.

    One to two hundred a second are a good rate of a stream.

    Answered as soon as it is on its way: the loop drops one that comes after a newer one, or after it expired. Counts as its
    owner's CheckIn. Refused when no such action runs, and when a number is not finite, beyond a limit, or missing.
    """

    id: Name
    """the action's"""
    sequence: Annotated[int, Meta(ge=1, lt=1 << 53)]
    """goes up by one with every sample"""
    positions: list[float]
    """rad, in the order of the motion's joints"""
    velocities: list[float] = []
    """rad/s; empty: 0"""
    expires_ns: int = 0
    """robot clock; 0: never"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine. Another's action is left alone"""


@travels(priority=1)
class CancelAction(Message):
    """End an action: slow down along its path, then hold."""

    id: Name
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine. Another's action is left alone"""


@travels(priority=1)
class PauseAction(Message):
    """Stop moving along the path, jerk-limited, and hold there."""

    id: Name
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine. Another's action is left alone"""


@travels(priority=1)
class ResumeAction(Message):
    """Go on along the path."""

    id: Name
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine. Another's action is left alone"""


@travels(priority=1, remote=True)
class SetSpeed(Message):
    """Run a motion, or all of them, at a share of the planned speed, from now on: in mid-motion, too, within the joints' limits.

    The path stays the same; what runs along it runs slower, the action's own time with it (TimeEnd, StallEnd, dither). Of a
    JointStream whoever streams says how fast it is. Refused when no such action runs; and over the link, from keys that are
    neither an operator's nor a developer's, unless it slows down, or is about an action of theirs.
    """

    share: Annotated[float, Meta(ge=0.1, le=1.0)]
    """of the speed as planned; an action runs at its own share times the robot's"""
    id: Annotated[str, Meta(max_length=128)] = ""
    """the action; empty: every one that there is and will be, until it is set anew"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine"""
    role: Annotated[str, Meta(max_length=32)] = ""
    """likewise: what that key may do"""
