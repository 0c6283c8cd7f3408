"""Actions: a motion that an engine asked for, from its start to the one outcome that ends it.

What a motion does is its controller's business; here is its life. Everything that can end an action is looked at in every cycle,
before the controllers run: a guard that trips in a cycle takes the joints to `hold` in that cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daemon.actions.behaviours import Chain, frame_of
from daemon.actions.end_conditions import Place, first_met, force_frames
from daemon.controllers.base import Controller, MotionController, NotStandingError
from daemon.controllers.manager import ActivationError, ClaimError, ControllerManager
from daemon.controllers.references import SLOWEST
from daemon.controllers.registry import for_motion
from daemon.exchange import (
    SLOTS,
    ActionState,
    Answer,
    Command,
    JointSample,
    MotionCommand,
    Outcome,
    Rule,
    StepCommand,
    StreamedReference,
    TrajectoryMotion,
)
from daemon.safety.rules import expired, followed, unsafe
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand
from handrail.messages import EndCondition

START_TOLERANCE = 0.02
"""rad between a trajectory's first knot and what the robot is commanded"""


@dataclass
class Action:
    """One action; it stays in its slot after its end, until another needs the slot."""

    serial: int
    owner: int
    controller: MotionController
    ends: tuple[EndCondition, ...]
    hold_after: float
    """s of wall time to hold simulated time for, in the cycle that ends it; 0: not"""
    cycle: int
    """of the last change of state"""
    frames: tuple[str, ...]
    """where the external force is estimated while it runs; the first is its tool"""
    state: ActionState = ActionState.RUNNING
    outcome: Outcome = Outcome.NONE
    ending: Outcome = Outcome.NONE
    """set by a cancellation: what the outcome will be once the path stands"""
    running: float = 0.0
    """s that it has run as planned: pauses do not count, and at half the speed half of it does"""
    speed: float = 1.0
    """of its own, share of what is planned; the robot's comes on top"""
    places: dict[int, Place] = field(default_factory=dict)
    """what its end conditions remember"""
    chain: Chain | None = None
    """of a behaviour, whose present step's are controller, ends, running and places"""
    condition: int = -1
    joint: int = -1
    value: float = 0.0
    detail: str = ""

    @property
    def alive(self) -> bool:
        return self.state in (ActionState.RUNNING, ActionState.PAUSED)


@dataclass(frozen=True)
class Refusal:
    """Why a command was not accepted."""

    answer: Answer
    joint: int = -1
    value: float = 0.0


class Grippers(Protocol):
    """What steps of behaviours send off (daemon.devices.Devices)."""

    def refusal(self, row: int, values: NDArray[np.float64]) -> Refusal | None: ...
    def order(self, row: int, values: NDArray[np.float64]) -> Refusal | None: ...


class ActionTable:
    """The actions of one robot: up to `SLOTS` at a time, each on joints of its own."""

    def __init__(self, manager: ControllerManager, robot: RobotState, grippers: Grippers):
        self._manager, self._robot, self._grippers = manager, robot, grippers
        self.slots: list[Action | None] = [None] * SLOTS
        self.cycle = 0
        self.speed = 1.0
        """of all actions, share of what is planned"""
        self._running: tuple[Action, ...] = ()
        self._force_frames: tuple[str, ...] = ()
        self._tips = [(arm.tip, frozenset(arm.joints)) for arm in robot.kinematics.description.arms.values()]

    def running(self) -> tuple[Action, ...]:
        """The actions that have not ended."""
        return self._running

    def force_frames(self) -> tuple[str, ...]:
        """Where running actions need the external force, the first action's tool first."""
        return self._force_frames

    # ------------------------------------------------------------------------------------------------- what is asked for

    def start(self, command: Command, last: JointCommand, time_ns: int) -> Refusal | None:
        """Start a motion from `last`, the command as last written. A refusal changes nothing."""
        motion = command.motion
        if motion is None or not np.isin(motion.joints, np.arange(len(self._robot.joints))).all():
            return Refusal(Answer.MALFORMED)
        if any(set(step.motion.joints) != set(motion.joints) for step in command.steps):
            return Refusal(Answer.MALFORMED)
        if late := expired(command.expires_ns, time_ns):
            return Refusal(Answer.EXPIRED, value=late.value)
        if (isolated := self._manager.isolated[motion.joints]).any():
            return Refusal(Answer.ISOLATED, int(motion.joints[int(np.argmax(isolated))]))
        for other in self.running():
            claimed = np.isin(motion.joints, other.controller.joints)
            if claimed.any():
                return Refusal(Answer.CLAIMED, int(motion.joints[int(np.argmax(claimed))]))
        first = command.steps[0] if command.steps else None
        if refusal := _starts_elsewhere(motion, last) or self._gripper_refuses(first):
            return refusal
        controller = for_motion(motion, self._manager.gains, self._robot.period)
        controller.clock.begin(self.speed, held=False)
        slot = self._free_slot()
        if slot is None:
            return Refusal(Answer.TOO_MANY)
        try:
            self._manager.switch([], [controller], last)
        except ClaimError as error:
            return Refusal(Answer.CLAIMED, error.joint)
        except ActivationError as error:
            why = error.__cause__
            return (
                Refusal(Answer.NOT_STANDING, why.foot)
                if isinstance(why, NotStandingError)
                else Refusal(Answer.NOT_ACTIVATED)
            )
        frames = [self._tool(controller), *force_frames(command.ends)]
        for step in command.steps:
            frames += [frame_of(step.motion), *force_frames(step.ends)]
        self.slots[slot] = Action(
            serial=command.serial,
            owner=command.owner,
            controller=controller,
            ends=command.ends,
            hold_after=command.value,
            cycle=self.cycle,
            frames=tuple(dict.fromkeys(frame for frame in frames if frame)),
            chain=Chain(command.steps, command.most_steps) if command.steps else None,
        )
        self._send_gripper(first)
        self._look_who_runs()
        return None

    def pause(self, serial: int) -> Refusal | None:
        """Slow down to a stand on the path."""
        action = self._find(serial)
        if action is None or action.ending is not Outcome.NONE:
            return Refusal(Answer.NO_SUCH_ACTION)
        action.controller.clock.hold()
        return None

    def resume(self, serial: int, last: JointCommand) -> Refusal | None:
        """Go on along the path, from `last`, or from where the joints were pushed to meanwhile."""
        action = self._find(serial)
        if action is None or action.ending is not Outcome.NONE:
            return Refusal(Answer.NO_SUCH_ACTION)
        if action.state is ActionState.PAUSED:
            action.controller.come_back(self._robot, last)
        action.controller.clock.go()
        return None

    def set_speed(self, serial: int, share: float) -> Refusal | None:
        """From now on one action, or of serial 0 all that there are and will be, at this share of the planned speed."""
        if not SLOWEST <= share <= 1.0:
            return Refusal(Answer.MALFORMED)
        if serial:
            action = self._find(serial)
            if action is None:
                return Refusal(Answer.NO_SUCH_ACTION)
            action.speed = share
            action.controller.clock.run_at(share * self.speed)
            return None
        self.speed = share
        for action in self.running():
            action.controller.clock.run_at(action.speed * share)
        return None

    def cancel(self, serial: int, outcome: Outcome = Outcome.CANCELLED) -> Refusal | None:
        """Slow down to a stand on the path, then end with `outcome`."""
        action = self._find(serial)
        if action is None:
            return Refusal(Answer.NO_SUCH_ACTION)
        action.controller.clock.hold()
        action.ending = outcome
        return None

    def stream(self, serial: int, reference: StreamedReference) -> Refusal | None:
        """A streamed reference for a running action."""
        action = self._find(serial)
        if action is None:
            return Refusal(Answer.NO_SUCH_ACTION)
        takes = action.controller.receive(reference.task, reference.position, reference.orientation, reference.velocity)
        return None if takes else Refusal(Answer.NO_SUCH_REFERENCE)

    def sample(self, serial: int, sample: JointSample) -> Refusal | None:
        """A sample of joint references for a running action."""
        action = self._find(serial)
        if action is None:
            return Refusal(Answer.NO_SUCH_ACTION)
        takes = action.controller.sample(sample.sequence, sample.position, sample.velocity)
        return None if takes else Refusal(Answer.NO_SUCH_REFERENCE)

    def lose_owner(self, owner: int) -> None:
        """Cancel whatever `owner` has running."""
        for action in self.running():
            if action.owner == owner:
                self.cancel(action.serial, Outcome.OWNER_LOST)

    # --------------------------------------------------------------------------------------------------- what comes about

    def check(self, last: JointCommand) -> list[Action]:
        """End what has to end in this cycle, and let `hold` take over from `last`. Returns what ended."""
        ended = []
        for action in self._running:
            clock, paused = action.controller.clock, action.state is ActionState.PAUSED
            if not paused:
                action.running += self._robot.period * clock.rate
            standing = clock.standing
            if self._has_to_end(action, last, standing):
                if not self._goes_on(action, last):
                    self._end(action, last)
                    ended.append(action)
            elif standing != paused:
                action.state = ActionState.PAUSED if standing else ActionState.RUNNING
                action.cycle, action.detail = self.cycle, action.controller.waiting
                if standing:
                    action.controller.stood(self._robot, last)
        return ended

    def refuse(self, joint: int, value: float = 0.0) -> list[Action]:
        """End the action that claims `joint`, since its command may not be written. Returns what ended.

        What commands its joints from now on is the caller's business.
        """
        ended = [action for action in self.running() if joint in action.controller.joints]
        for action in ended:
            action.outcome, action.joint, action.value = Outcome.REFUSED_BY_LIMITS, joint, value
            self._note_end(action)
        return ended

    def lose(self, controller: Controller) -> list[Action]:
        """End the action whose controller failed, or was ended, and has been replaced. Returns what ended."""
        ended = [action for action in self.running() if action.controller is controller]
        for action in ended:
            action.outcome, action.detail = controller.ended.outcome, controller.ended.detail
            self._note_end(action)
        return ended

    def end_all(self, outcome: Outcome, joint: int = -1) -> list[Action]:
        """End everything at once without a hold: the caller has taken the claims away. Returns what ended."""
        ended = list(self.running())
        for action in ended:
            action.outcome, action.joint = outcome, joint
            action.state, action.cycle = ActionState.ENDED, self.cycle
        self._look_who_runs()
        return ended

    def _has_to_end(self, action: Action, last: JointCommand, standing: bool) -> bool:
        controller = action.controller
        joints = controller.joints
        seen = followed(joints, last.position, self._robot.joints)
        if action.ends and (
            trip := first_met(action.ends, action.running, joints, seen, self._robot, action.places, controller.lag)
        ):
            action.outcome = Outcome.CONDITION
            action.condition, action.value, action.joint = trip.condition, trip.value, trip.joint
            return True
        if no := unsafe(seen):
            action.outcome = Outcome.STALE_STATE if no.rule is Rule.STALE else Outcome.DIVERGED
            action.joint, action.value = no.joint, no.value
            return True
        if action.ending is not Outcome.NONE and (standing or controller.clock.at_end):
            action.outcome = action.ending
            return True
        if why := controller.failure:
            action.outcome, action.detail = Outcome.INFEASIBLE, why
            return True
        if silence := controller.silence:
            action.outcome, action.value, action.detail = Outcome.STREAM_LOST, silence, ""
            return True
        if controller.done:
            action.outcome, action.detail = Outcome.DONE, controller.remark
            return True
        return False

    def _goes_on(self, action: Action, last: JointCommand) -> bool:
        """Let a behaviour's next step take over from `last` in this very cycle. False: there is none, or it may not start."""
        chain = action.chain
        if chain is None or action.ending is not Outcome.NONE:
            return False
        if (number := chain.following(action.outcome, action.condition)) is None:
            return False
        if chain.taken >= chain.most:
            action.outcome, action.joint, action.value = Outcome.TOO_MANY_STEPS, -1, float(chain.taken)
            return False
        step = chain.steps[number]
        refusal = _starts_elsewhere(step.motion, last)
        if refusal is None and (refusal := self._gripper_refuses(step)) is not None:
            action.detail = "its gripper does not answer"
        if refusal is None:
            held = action.controller.clock.held  # whoever paused it has paused what follows, too
            controller = for_motion(step.motion, self._manager.gains, self._robot.period)
            controller.clock.begin(action.speed * self.speed, held)
            try:
                self._manager.switch([action.controller], [controller], last)
            except (ClaimError, ActivationError) as error:
                refusal = Refusal(Answer.CLAIMED, error.joint if isinstance(error, ClaimError) else -1)
        if refusal is not None:
            joint = -1 if action.detail else refusal.joint  # a gripper's row is none of the joints'
            action.outcome, action.joint, action.value = Outcome.STEP_REFUSED, joint, refusal.value
            return False
        self._send_gripper(step)
        action.controller, action.ends, action.running, action.places = controller, step.ends, 0.0, {}
        action.cycle = self.cycle
        chain.go(number)
        return True

    def _gripper_refuses(self, step: StepCommand | None) -> Refusal | None:
        if step is None or step.order is None or step.gripper < 0:
            return None
        return self._grippers.refusal(step.gripper, step.order)

    def _send_gripper(self, step: StepCommand | None) -> None:
        if step is not None and step.order is not None and step.gripper >= 0:
            self._grippers.order(step.gripper, step.order)

    def _end(self, action: Action, last: JointCommand) -> None:
        self._note_end(action)
        self._manager.switch([action.controller], [], last)

    def _note_end(self, action: Action) -> None:
        action.state, action.cycle = ActionState.ENDED, self.cycle
        self._look_who_runs()

    def _look_who_runs(self) -> None:
        """After every start and end, so that no cycle has to look."""
        self._running = tuple(action for action in self.slots if action is not None and action.alive)
        self._force_frames = tuple(dict.fromkeys(frame for action in self._running for frame in action.frames))

    def _find(self, serial: int) -> Action | None:
        """The running action of this serial."""
        return next((action for action in self._running if action.serial == serial), None)

    def _free_slot(self) -> int | None:
        """An unused slot, or the one whose action ended longest ago, so that a late reader still finds the others."""
        ended = [
            (-1 if action is None else action.cycle, slot)
            for slot, action in enumerate(self.slots)
            if action is None or not action.alive
        ]
        return min(ended)[1] if ended else None

    def _tool(self, controller: MotionController) -> str:
        if controller.force_frame:
            return controller.force_frame
        names = self._robot.kinematics.description.joints
        claimed = {names[joint] for joint in controller.joints}
        return next((tip for tip, joints in self._tips if claimed <= joints), "")


def _starts_elsewhere(motion: MotionCommand, last: JointCommand) -> Refusal | None:
    """Why a motion may not start from `last`: a trajectory's first knot is somewhere else."""
    if not isinstance(motion, TrajectoryMotion):
        return None
    off = np.abs(motion.positions[0] - last.position[motion.joints])
    worst = int(np.argmax(off))
    if off[worst] <= START_TOLERANCE:
        return None
    return Refusal(Answer.START_OFF, int(motion.joints[worst]), float(off[worst]))
