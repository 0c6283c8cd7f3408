"""What the loop does with a command from its mailbox, and the answer that the next snapshot carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from daemon.actions.motion_maker import MotionMaker
from daemon.actions.table import ActionTable, Refusal
from daemon.controllers.table import ControllerTable
from daemon.devices import Devices
from daemon.exchange import Answer, Command, CommandReader, Kind, MotionCommand, PreparedMotion, Rule, decode
from daemon.life import Life
from daemon.safety.rules import expired
from daemon.state.taring import Taring
from daemon.time_holds import TimeHolds
from hal.joint import JointCommand


class Orders:
    """Serves the mailbox, one command a call."""

    def __init__(
        self,
        mailbox: CommandReader,
        frames: Sequence[str],
        device_names: Sequence[str],
        life: Life,
        actions: ActionTable,
        controllers: ControllerTable,
        devices: Devices,
        holds: TimeHolds,
        maker: MotionMaker,
        taring: Taring,
    ):
        self._mailbox, self._frames, self._device_names = mailbox, frames, device_names
        self._life, self._actions, self._devices, self._holds = life, actions, devices, holds
        self._controllers, self._maker, self._taring = controllers, maker, taring
        self.answered = 0
        """serial of the command handled last"""
        self.answer = Refusal(Answer.NONE)

    def serve(self, last: JointCommand, time_ns: int) -> bool:
        """Do what the oldest command in the mailbox asks for. False when none waits."""
        mail = self._mailbox.take()
        if mail is None:
            return False
        self.answered = int(mail[0].reshape(())["serial"])
        try:
            command = decode(*mail, self._frames, self._device_names)
        except (ValueError, IndexError):
            # The server encodes what it has checked; whatever else lies here is not obeyed, not even in part.
            refusal: Refusal | None = Refusal(Answer.MALFORMED)
        else:
            refusal = self._do(command, last, time_ns)
        finally:
            self._mailbox.done()
        self.answer = refusal or Refusal(Answer.ACCEPTED)
        return True

    def _with_controllers(self, command: Command) -> Command | None:
        """The command with the controllers that were made for its motions; None: one of them is not there.

        Steps that are the same motion share one: only one of them runs at a time.
        """
        motions = (command.motion, *(step.motion for step in command.steps))
        serials = dict.fromkeys(motion.prepared for motion in motions if isinstance(motion, PreparedMotion))
        if not serials:
            return command
        made = {serial: self._maker.take(serial) for serial in serials}
        if None in made.values():
            return None

        def ready(motion: MotionCommand | None) -> Any:
            return replace(motion, controller=made[motion.prepared]) if isinstance(motion, PreparedMotion) else motion

        steps = tuple(replace(step, motion=ready(step.motion)) for step in command.steps)
        return replace(command, motion=ready(command.motion), steps=steps)

    def _do(self, command: Command, last: JointCommand, time_ns: int) -> Refusal | None:
        life, actions = self._life, self._actions
        match command.kind:
            case Kind.ENABLE:
                return life.enable()
            case Kind.DISABLE:
                life.disable()
            case Kind.START | Kind.BEHAVIOUR:
                # Whatever becomes of the start, its owner has done its thinking.
                self._holds.release(command.owner)
                if life.stopped:
                    return Refusal(Answer.STOP_LATCHED)
                if not life.enabled:
                    return Refusal(Answer.NOT_ENABLED)
                if life.keepalives.silent(command.owner):
                    return Refusal(Answer.KEEPALIVE_LOST)
                if life.guarded:
                    return Refusal(Answer.TOO_CLOSE)
                made = self._with_controllers(command)
                if made is None:
                    return Refusal(Answer.NOT_READY)
                refusal = actions.start(made, last, time_ns)
                if refusal is not None and refusal.answer is Answer.EXPIRED:
                    life.ledger.trip(Rule.EXPIRED, value=refusal.value)
                return refusal
            case Kind.PREPARE:
                if command.text:
                    return Refusal(self._maker.begin(command.serial, command.text, last.position))
                return Refusal(self._maker.look(command.action))
            case Kind.STREAM:
                assert command.reference is not None
                return actions.stream(command.action, command.reference)
            case Kind.STREAM_JOINTS:
                assert command.sample is not None
                if late := expired(command.expires_ns, time_ns):
                    life.ledger.trip(Rule.EXPIRED, value=late.value)
                    return Refusal(Answer.EXPIRED, value=late.value)
                return actions.sample(command.action, command.sample)
            case Kind.CANCEL:
                return actions.cancel(command.action)
            case Kind.PAUSE:
                return actions.pause(command.action)
            case Kind.RESUME:
                return actions.resume(command.action, last)
            case Kind.SET_SPEED:
                return actions.set_speed(command.action, command.value)
            case Kind.DEVICE:
                if life.stopped:
                    return Refusal(Answer.STOP_LATCHED)
                assert command.device_values is not None
                return self._devices.order(command.device, command.device_values)
            case Kind.RELAY:
                # A stop that is latched does not keep the power on.
                assert command.device_values is not None
                close, force = command.device_values[:2] > 0.5
                if not close and not force and (life.enabled or life.enabling):
                    return Refusal(Answer.ENABLED, command.device)
                return self._devices.switch(command.device, bool(close))
            case Kind.TARE:
                return self._taring.ask(command.device)
            case Kind.LOSE_OWNER:
                actions.lose_owner(command.owner)
                self._holds.release(command.owner)
            case Kind.BIND_KEEPALIVE:
                return life.bind_keepalive(command.owner, command.value, time_ns)
            case Kind.KEEP_ALIVE:
                return life.keep_alive(command.owner, time_ns)
            case Kind.HOLD_TIME:
                return None if self._holds.add(command.owner, command.value) else Refusal(Answer.TOO_MANY)
            case Kind.RELEASE_TIME:
                self._holds.release(command.owner)
            case Kind.LOAD:
                return self._controllers.load(command.text)
            case Kind.CONFIGURE:
                return self._controllers.configure(command.go, command.action, command.text)
            case Kind.UNLOAD:
                return self._controllers.unload(command.go, command.action)
            case Kind.SWITCH:
                if life.stopped:
                    return Refusal(Answer.STOP_LATCHED)
                if not life.enabled:
                    return Refusal(Answer.NOT_ENABLED)
                if life.guarded:
                    return Refusal(Answer.TOO_CLOSE)
                return self._controllers.switch(command.come, command.go, command.action, last)
        return None
