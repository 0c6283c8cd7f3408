"""Which controller commands which joint: claims, whole switches, and the bump taken out of each.

A switch names the controllers that go and those that come; it happens in one cycle or not at all. Claims are exclusive per joint
and interface (position, velocity, torque, stiffness, damping); what nobody claims of an enabled robot, `hold` does, isolated
limbs aside, whose joints nobody commands. A controller
may command the references of another one instead of the robot: then the other one must be active, and is updated after it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Array, Controller, Ended, Gains, rows_of
from daemon.controllers.brake import Brake
from daemon.controllers.damp import Damp
from daemon.controllers.hold import Hold
from daemon.controllers.references import faded
from daemon.exchange import CONTROLLERS, Outcome, Rule
from daemon.safety.limits import effective_torque
from daemon.safety.rules import Trip, followed, unsafe
from daemon.state.robot_state import RobotState
from hal.joint import COMMANDED, JointCommand, Mode

FADE = 0.2
"""s in which the torque that a switch would have made jump is let go"""
_HOLD = CONTROLLERS.index(Hold.name)


class SwitchError(Exception):
    """A switch that can't be made. Nothing was switched."""


class ClaimError(SwitchError):
    """One joint's interface would have two controllers."""

    def __init__(self, joint: int):
        self.joint = joint
        super().__init__(f"joint {joint} is claimed by another active controller")


class ChainError(SwitchError):
    """`controller` commands references of one that would not be active, or that has none for `joint` (−1: for all of them)."""

    def __init__(self, controller: Controller, joint: int = -1):
        self.controller, self.joint = controller, joint
        super().__init__(f"{controller.name} commands references that are not there")


class ActivationError(SwitchError):
    """`controller` raised an exception, the cause of this one, when it should take over."""

    def __init__(self, controller: Controller):
        self.controller = controller
        super().__init__(f"{controller.name} can't be activated")


class CommandError(Exception):
    """A controller's command can't be written."""


class ControllerManager:
    """Runs the active controllers, one an interface of each joint, into one command."""

    def __init__(self, robot: RobotState, gains: Gains):
        n = len(robot.joints)
        self.robot, self.gains = robot, gains
        self.active: list[Controller] = []
        """in the order of their updates: who commands another one's references goes before it"""
        self.command = JointCommand(n)
        """this cycle's set-points, before the final limits"""
        self.claims = np.zeros((len(COMMANDED), n), np.uint8)
        """(5, n) who commands each interface (rows as in JointCommand.table): index into daemon.exchange.CONTROLLERS, or its
        `code`; 0: nobody"""
        self.changes = 0
        """how often who is active has changed"""
        self.failures: list[Controller] = []
        """what failed (`error` says why) or was ended by a rule (`error` is None, `ended` says why), and has been replaced;
        whoever has dealt with them clears it"""
        self.isolated = np.zeros(n, bool)
        """(n,) joints that nobody commands, though the robot is enabled"""
        self.fresh: NDArray[np.bool_] | None = None
        """(n,) joints whose next command has none before it: until now their brakes carried them. Whoever writes it clears this"""
        self._some_isolated = False
        self._rated_torque = robot.kinematics.description.torque_limit
        self._steps: list[tuple[Controller, JointCommand]] = []
        self._watched: list[Controller] = []
        self._failing: list[Controller] = []
        self._offset = np.zeros(n)
        self._since_switch = np.full(n, np.inf)
        self._switched = np.zeros(n, bool)
        self._settled = True
        """no switch is being smoothed"""

    @property
    def enabled(self) -> bool:
        """Every joint has a controller."""
        return bool(self.active)

    def enable(self) -> None:
        """Hold every joint where it is measured, from this cycle on: the drives have just come to life."""
        self._isolate(np.zeros_like(self.isolated))
        self.fresh = np.ones_like(self.isolated)
        hold = Hold(np.arange(len(self.robot.joints)), self.gains, self.robot.joints.position)
        # There is no torque to continue from: the brakes carried the robot until now. Nor is there a switch to smooth, though
        # one may have been begun in the cycle in which the robot was stopped.
        self._since_switch[:] = np.inf
        self._switched[:] = False
        self._settled = True
        if self.gains.integral is not None:
            self.gains.integral.forget(self.fresh)
        self._set([hold], np.full_like(self.claims, _HOLD))

    def release_all(self, why: Ended) -> None:
        """Take away every claim at once; nothing is commanded any more."""
        self._note(self.active, why)
        self._isolate(np.zeros_like(self.isolated))
        self._set([], np.zeros_like(self.claims))

    def isolate(self, joints: NDArray[np.bool_], last: JointCommand, why: Ended) -> None:
        """Take every claim away from these joints (n,); all the others are held, from `last` on."""
        self._note(self.active, why)
        self._isolate(joints)
        self.fresh = joints.copy()  # no command follows theirs
        self.switch(self.active, [], last)

    def damp(self, last: JointCommand, why: Ended) -> None:
        """Take every claim away, and damp what is not isolated."""
        self._note(self.active, why)
        self.switch(self.active, [Damp(np.flatnonzero(~self.isolated), self.gains)], last)

    def rejoin(self) -> None:
        """Hold the isolated joints where they are measured: their drives have just come back to life. The others notice nothing."""
        back, claims = self.isolated.copy(), self.claims.copy()
        self._isolate(np.zeros_like(back))
        self._since_switch[back], self._switched[back] = np.inf, False
        self.fresh, claims[:, back] = back, _HOLD
        if self.gains.integral is not None:
            self.gains.integral.forget(back)
        hold = Hold(np.flatnonzero(back), self.gains, self.robot.joints.position)
        self._set([*self.active, hold], claims)

    def switch(self, go: Sequence[Controller], come: Sequence[Controller], last: JointCommand) -> None:
        """End some controllers and start others, in this cycle; `hold` gets what is left over.

        `last` is the command as it was last written, from which the newcomers start. Raises ClaimError, ChainError or
        ActivationError, and changes nothing.
        """
        stay = [c for c in self.active if not isinstance(c, Hold) and not _among(c, go)]
        claims = _claims([*stay, *come], self.claims.shape)
        if self._some_isolated and (taken := claims.any(axis=0) & self.isolated).any():
            raise ClaimError(int(np.argmax(taken)))
        free = (claims == 0) & ~self.isolated
        to_hold = free.any(axis=0)
        fresh = sorted(come, key=_depth)
        if to_hold.any():
            fresh.insert(0, Hold(np.flatnonzero(to_hold), self.gains, self._hold_position(last), free))
            claims[free] = _HOLD
        for controller in fresh:
            try:
                controller.activate(self.robot, last if controller.onto is None else controller.onto.reference)
            except Exception as error:
                controller.error = error
                self.failures.append(controller)
                raise ActivationError(controller) from error
        gone = [controller for controller in self.active if _among(controller, go)]
        for controller in (*gone, *fresh):
            self._switched[controller.joints] = True
        for controller in gone:
            if controller.onto is not None:
                controller.onto.stand(controller.joints)
        # A joint that was held goes on being held at the same command: to its drive nothing happens.
        self._switched[((claims == _HOLD) & (self.claims == _HOLD)).all(axis=0)] = False
        self._settled = False
        self._set([*stay, *fresh], claims)

    def update(self, last: JointCommand) -> JointCommand:
        """This cycle's command from all active controllers; `last` is the command as it was last written.

        What a switch would make jump in the drives' torque, at the state measured now, is added as an offset that is let go
        over `FADE` seconds. A controller that raises an exception is replaced in this cycle, and before it runs one that was
        loaded by name and must not go on; `failures` then tells.
        """
        if self._watched:
            self._end_unsafe(last)
        self._run(self._steps)
        if self._failing:
            self._replace(last)
        if not self._settled:
            self._take_bumps(last)
            fading = np.flatnonzero(self._since_switch < FADE)
            self._add_offsets(fading)
            self._since_switch += self.robot.period
            self._settled = not len(fading)
        if self._some_isolated:
            self._follow_isolated()
        return self.command

    def fail(self, joint: int, last: JointCommand) -> bool:
        """Replace whoever commands `joint`: what it commands can't be written. False when nothing but `hold` does.

        What takes over has been run into `command`.
        """
        guilty = [c for c in self.active if joint in c.joints and c.onto is None and not isinstance(c, Hold)]
        for controller in guilty:
            self._blame(controller, CommandError(f"what it commands joint {joint} may not be written"))
        if guilty:
            anew = self._replace(last)
            self._take_bumps(last)
            self._add_offsets(np.flatnonzero(anew & (self._since_switch < FADE)))
        return bool(guilty)

    def brake(
        self,
        joints: NDArray[np.int64],
        position: Array,
        velocity: Array,
        duration: float,
        last: JointCommand,
        why: Ended,
    ) -> Brake | None:
        """Have whoever moves one of `joints` (rows) replaced by a brake of `duration` s from `position`,
        `velocity` (n,) rad, rad/s, run into `command`.

        None where they are all held or damped, or brake already.
        """
        moving = [
            c
            for c in self.active
            if c.onto is None and not isinstance(c, Hold | Brake | Damp) and np.isin(c.joints, joints).any()
        ]
        if not moving:
            return None
        go = [*moving, *(c for c in self.active if _rests_on(c, moving))]
        rows = np.unique(np.concatenate([c.joints for c in moving]))
        brake = Brake(rows, self.gains, position, velocity, duration)
        self._note(go, why)
        self.switch(go, [brake], last)
        self.failures += go
        self._run([(brake, self.command)])
        self._take_bumps(last)
        self._add_offsets(rows[self._since_switch[rows] < FADE])
        return brake

    def _isolate(self, joints: NDArray[np.bool_]) -> None:
        self.isolated[:], self._some_isolated = joints, bool(joints.any())

    def _follow_isolated(self) -> None:
        """The command of joints that nobody commands: where they are, and no torque. It is not written."""
        out, description = self.isolated, self.robot.kinematics.description
        self.command.table[:, out] = 0.0
        where = np.clip(self.robot.joints.position, description.lower, description.upper)
        self.command.position[out], self.command.mode[out] = where[out], Mode.DAMPING

    def _run(self, steps: Iterable[tuple[Controller, JointCommand]]) -> None:
        for controller, out in steps:
            try:
                controller.update(self.robot, out)
            except Exception as error:  # noqa: BLE001 - a user's code may raise anything, and the robot goes on
                self._blame(controller, error)
                if controller.onto is not None:
                    controller.onto.recall(controller.joints)  # it is updated after this one

    def _blame(self, controller: Controller, error: Exception) -> None:
        controller.error, controller.ended = error, Ended(Outcome.CONTROLLER_ERROR)
        self._failing.append(controller)

    def _replace(self, last: JointCommand) -> NDArray[np.bool_]:
        """Give what the failing controllers claim to their fallbacks, or to `hold`, and run those; (n,) what they command."""
        anew = np.zeros(self.claims.shape[1], bool)
        while self._failing:
            failed, self._failing = self._failing, []
            before = self.active
            self._hand_over(failed, last)
            steps = [step for step in self._steps if not _among(step[0], before)]
            self._run(steps)
            for controller, _ in steps:
                anew[controller.joints] = True
        return anew

    def _hand_over(self, failed: list[Controller], last: JointCommand) -> None:
        """Let the fallbacks of these, and of what commands their references, take over, or else `hold`."""
        resting = [c for c in self.active if _rests_on(c, failed) and not _among(c, failed)]
        self._note(resting, Ended(Outcome.CONTROLLER_ERROR))
        go = [*failed, *resting]
        come = [f for c in go for f in c.fallbacks if _may_take_over(f, c) and not _among(f, self.active)]
        try:
            self.switch(go, come, last)
        except (
            SwitchError
        ):  # a fallback that can't take over now: another claims one of its joints, or it failed itself
            self.switch(go, [], last)
        self.failures += failed

    def _end_unsafe(self, last: JointCommand) -> None:
        """Controllers that were loaded by name are under the rules about joints that end actions."""
        found = []
        for controller in self._watched:
            if no := self._unsafe(controller, last):
                outcome = Outcome.STALE_STATE if no.rule is Rule.STALE else Outcome.DIVERGED
                self._note([controller], Ended(outcome, no.joint, no.value))
                found.append(controller)
        if found:
            self._hand_over(found, last)

    def _unsafe(self, controller: Controller, last: JointCommand) -> Trip | None:
        joints, state = controller.joints, self.robot.joints
        no = unsafe(followed(joints, last.position, state))
        if no is None or no.rule is Rule.STALE:
            return no
        # Without a spring between joint and command it does not matter where that one is.
        tied = joints[last.stiffness[joints] > 0.0]
        return unsafe(followed(tied, last.position, state)) if len(tied) else None

    def _note(self, controllers: Iterable[Controller], why: Ended) -> None:
        for controller in controllers:
            controller.ended = why

    def _take_bumps(self, last: JointCommand) -> None:
        """What the switches of this cycle would make jump at the drives."""
        if self._switched.any():
            state = self.robot.joints
            before = effective_torque(last, state.position, state.velocity)
            after = effective_torque(self.command, state.position, state.velocity)
            self._offset[self._switched] = (before - after)[self._switched]
            self._since_switch[self._switched] = 0.0
            self._switched[:] = False

    def _add_offsets(self, joints: NDArray[np.int64]) -> None:
        if len(joints):
            self.command.torque[joints] += self._offset[joints] * faded(self._since_switch[joints], FADE)

    def _hold_position(self, last: JointCommand) -> Array:
        """(n,) rad where to hold joints: where they were commanded to be.

        One that comes from a softer controller may be far from its command: it is held no further from where it is than half
        of its rated torque bends its spring.
        """
        measured, stiffness = self.robot.joints.position, self.gains.stiffness
        reach = 0.5 * self._rated_torque / stiffness
        within_reach = np.clip(last.position, measured - reach, measured + reach)
        return np.where(last.stiffness < 0.5 * stiffness, within_reach, last.position)

    def _set(self, active: list[Controller], claims: NDArray[np.uint8]) -> None:
        self.active = sorted(active, key=_depth, reverse=True)
        self._steps = [(c, self.command if c.onto is None else c.onto.reference) for c in self.active]
        # Who commands another one's references goes with it: its joints are among that one's.
        self._watched = [c for c in self.active if c.code >= 0 and c.onto is None]
        self.claims[...] = claims
        self.changes += 1


def _claims(controllers: Sequence[Controller], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """(5, n) what these claim of the robot. Raises ClaimError, ChainError."""
    of_robot = np.zeros(shape, np.uint8)
    of_controller: dict[int, NDArray[np.uint8]] = {}
    for controller in controllers:
        table, interfaces, onto = of_robot, controller.interfaces, controller.onto
        if onto is not None:
            if not _among(onto, controllers):
                raise ChainError(controller)
            strange = ~np.isin(controller.joints, onto.joints)
            if strange.any():
                raise ChainError(controller, int(controller.joints[int(np.argmax(strange))]))
            table = of_controller.setdefault(id(onto), np.zeros(shape, np.uint8))
            interfaces = tuple(name for name in interfaces if name in onto.references)
        place = np.ix_(rows_of(interfaces), controller.joints)
        taken = table[place].any(axis=0)
        if taken.any():
            raise ClaimError(int(controller.joints[int(np.argmax(taken))]))
        table[place] = controller.code if controller.code >= 0 else CONTROLLERS.index(controller.name)
    return of_robot


def _depth(controller: Controller) -> int:
    """How many controllers stand between this one and the robot."""
    return 0 if controller.onto is None else 1 + _depth(controller.onto)


def _rests_on(controller: Controller, others: Collection[Controller]) -> bool:
    """Whether it commands the references of one of `others`, or of one that does."""
    onto = controller.onto
    return onto is not None and (_among(onto, others) or _rests_on(onto, others))


def _may_take_over(fallback: Controller, ended: Controller) -> bool:
    """Not what has failed itself, nor what would be as blind."""
    blind = ended.ended.outcome is Outcome.STALE_STATE and ended.ended.joint in fallback.joints
    return fallback.error is None and not blind


def _among(controller: Controller, others: Iterable[Controller]) -> bool:
    return any(controller is other for other in others)
