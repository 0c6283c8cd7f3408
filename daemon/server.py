"""The process beside the loop: calls in, state out. Everything that may block or allocate lives here, not in the loop.

It sleeps until a call comes or the loop rings its doorbell; it may be killed and started anew while the robot moves.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec
import numpy as np
import zmq

from daemon import exchange
from daemon.controllers.roster import roster_file
from daemon.exchange import Kind
from daemon.exchange.ring import StateRingReader
from daemon.safety.report import safety_report
from daemon.serving.authority import check_speed, check_steering, owner_of
from daemon.serving.challenges import Challenges
from daemon.serving.controller_desk import ControllerDesk
from daemon.serving.device_reports import other_columns
from daemon.serving.drive_reports import drive_problems
from daemon.serving.happenings import Happenings
from daemon.serving.hardware_report import components
from daemon.serving.health import read_health
from daemon.serving.journal import Journal, Started
from daemon.serving.leases import Leases
from daemon.serving.loop_door import ANSWER_TIMEOUT_S, NO_LOOP, Answered, LoopDoor
from daemon.serving.owners import Owners
from daemon.serving.preparations import Preparations
from daemon.serving.reporter import Reporter
from daemon.serving.robot_info import robot_info
from daemon.serving.validation import (
    check_behaviour,
    check_gripper,
    check_joints,
    check_power,
    check_sensor,
    check_start,
    check_stream,
    joints_of,
)
from daemon.state.bus_watch import BusWatch
from daemon.timing import TimingReader, loop_timing
from handrail import messages as m
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime
from handrail.stop import NoAnswer, clear_stop, leave, stop_now
from handrail.topics import Publisher, RefusedError, Service, refuse

_ABOUT_DEVICES = (
    exchange.Answer.DEVICE_SILENT,
    exchange.Answer.ENABLED,
    exchange.Answer.TARING,
    exchange.Answer.TOUCHED,
    exchange.Answer.TWISTED,
)
"""answers that are about a device, not a joint"""
_STOP_TIMEOUT_S = 0.3
_TARING_S = 1.5
_STATUS_PERIOD_S = 0.2
_WATCH_PERIOD_S = 0.1
_RECONNECT_S = 0.3
_ABOUT_CONTROLLERS = (exchange.Answer.CONTROLLER_STATE, exchange.Answer.CHAIN_BROKEN, exchange.Answer.NOT_ACTIVATED)
_Steering = m.CancelAction | m.PauseAction | m.ResumeAction | m.StreamPose | m.StreamJoints


class Server:
    """Answers calls at `daemon.call`, publishes at `daemon.events`."""

    def __init__(
        self,
        description: RobotDescription,
        runtime: Runtime,
        clock: Literal["wall", "lockstep"],
        *,
        columns: Mapping[str, Sequence[str]] | None = None,
        context: zmq.Context | None = None,
    ):
        """`columns`: of devices whose family has no message of its own (daemon.serving.device_reports.other_columns)."""
        self._description, self._runtime, self._clock = description, runtime, clock
        frames = exchange.frame_names(description)
        self._frames = {frame: index for index, frame in enumerate(frames)}
        self._joints = {joint: index for index, joint in enumerate(description.joints)}
        self._devices = {device.name: row for row, device in enumerate(description.devices)}
        snapshot = exchange.snapshot_dtype(description)
        self._ring = StateRingReader(runtime.state_ring, snapshot)
        self._timing = TimingReader(runtime.timing)
        self._journal = Journal(runtime.folder / "actions.json")
        self._reporter = Reporter(description, clock, self._journal, columns)
        self._desk = ControllerDesk(description, roster_file(runtime))
        self._happenings = Happenings(description)
        self._owners = Owners()
        self._challenges = Challenges(runtime.folder / "keepalives.json")
        self._leases = Leases(description, runtime.folder / "leases.json")
        self._generation = 0
        self._door = LoopDoor(runtime, self._publish_news, self._words, self._log)
        self._preparations = Preparations(description, self._door, self._publish_news)
        self._bus = BusWatch(runtime, description.channels)
        self._publisher = Publisher(runtime.endpoint("daemon.events"), context=context)
        self._service = Service(runtime.endpoint("daemon.call"), m.DaemonCall, self._handle, context=context)
        self._poller = zmq.Poller()
        self._poller.register(self._service.socket, zmq.POLLIN)
        self._poller.register(self._door.doorbell.fileno(), zmq.POLLIN)
        self._next_status = self._next_watch = 0.0
        self._handlers: dict[type, Any] = {
            m.GetRobot: lambda _: robot_info(description),
            m.GetStatus: lambda _: self._status(),
            m.GetTiming: self._tell_timing,
            m.GetBase: lambda _: self._tell_base(),
            m.GetHardware: lambda _: self._hardware(),
            m.GetSafety: lambda _: self._safety(),
            m.GetControllers: lambda _: self._desk.list(self._with_roster()),
            m.LoadController: lambda call: self._ask_about_controllers(self._desk.load, call),
            m.ConfigureController: lambda call: self._ask_about_controllers(self._desk.configure, call),
            m.SwitchControllers: self._switch_controllers,
            m.UnloadController: lambda call: self._ask_about_controllers(self._desk.unload, call),
            m.Enable: lambda _: self._door.ask(Kind.ENABLE),
            m.Disable: lambda _: self._door.ask(Kind.DISABLE),
            m.Stop: self._stop,
            m.ClearStop: lambda _: self._tell_stop_socket(lambda: clear_stop(runtime, _STOP_TIMEOUT_S)),
            m.CheckIn: lambda call: self._owners.check_in(call.owner),
            m.TakeLease: self._take_lease,
            m.ReturnLease: lambda call: self._leases.give_back(call.owner, call.part, call.epoch),
            m.BindKeepalive: self._bind_keepalive,
            m.GetChallenge: self._get_challenge,
            m.KeepAlive: self._keep_alive,
            m.ReleaseKeepalive: self._release_keepalive,
            m.HoldTime: self._hold_time,
            m.ReleaseTime: self._release_time,
            m.StartAction: self._start,
            m.StartBehaviour: self._start,
            m.CancelAction: lambda call: self._door.ask(Kind.CANCEL, action=self._theirs(call).serial),
            m.PauseAction: lambda call: self._door.ask(Kind.PAUSE, action=self._theirs(call).serial),
            m.ResumeAction: lambda call: self._door.ask(Kind.RESUME, action=self._theirs(call).serial),
            m.SetSpeed: self._set_speed,
            m.StreamPose: self._stream,
            m.StreamJoints: self._stream_joints,
            m.CommandGripper: self._command_gripper,
            m.SwitchRelay: self._switch_relay,
            m.TareSensor: self._tare,
        }

    def take_over(self) -> None:
        """Give the subscribers of a server that died time to find this one, so that they hear how its actions end."""
        if self._journal.running():
            # ZeroMQ connects anew every 0.1 s (ZMQ_RECONNECT_IVL) and tells a publisher nothing that could be waited for.
            time.sleep(_RECONNECT_S)

    def step(self, timeout_s: float = _WATCH_PERIOD_S) -> None:
        """Sleep until something comes, at most `timeout_s`, and deal with all of it."""
        woken_by = dict(self._poller.poll(round(timeout_s * 1000)))
        self._door.doorbell.clear()
        self._publish_news()
        if self._service.socket in woken_by:  # else it may be read in vain, which costs as much as a message
            self._service.poll(0)
        now = time.monotonic()
        if now >= self._next_watch:
            self._next_watch = now + _WATCH_PERIOD_S
            self._watch(now)
        if self._reporter.changed() or now >= self._next_status:
            self._next_status = now + _STATUS_PERIOD_S
            self._publisher.send(self._status())

    def close(self) -> None:
        """Free the endpoints."""
        self._service.close()
        self._publisher.close()
        self._door.close()
        self._bus.close()

    # ---------------------------------------------------------------------------------------------- what the loop tells

    def _publish_news(self, awaited: int = 0) -> Answered | None:
        """Publish what the ring holds. The loop's (answer, joint, value) to command `awaited`, if it is among that."""
        snapshots = self._ring.read()
        if self._ring.generation != self._generation:
            if self._generation:
                self._lose_loop("the daemon's loop was started anew")
                self._latch_stop_again()
                self._slow_down_again()
            self._desk.begin_anew()
            self._generation = self._ring.generation
        for message in self._reporter.follow(snapshots):
            self._publisher.send(message)
        if (newest := self._reporter.snapshot) is not None:
            self._desk.look(newest)
            for event in (*self._desk.news(), *self._desk.deactivations(newest)):
                self._publisher.send(event)
        if awaited and (rows := np.flatnonzero(snapshots["answered"] == awaited)).size:
            row = snapshots[rows[0]]
            return int(row["answer"]), int(row["answer_joint"]), float(row["answer_value"])
        return None

    def _log(self, level: Literal["info", "warning", "error"], text: str) -> None:
        """A line for people, here and at their windows."""
        print(text, file=sys.stderr, flush=True)
        self._publisher.send(m.LogLine(source="daemon", level=level, text=text))

    def _lose_loop(self, why: str) -> None:
        self._happenings.begin_anew()
        self._publisher.send(m.LogLine(source="daemon", level="error", text=why))
        for event in self._reporter.lose_loop(why):
            self._publisher.send(event)

    def _latch_stop_again(self) -> None:
        """An operator stop that was latched when the loop died is latched in the new one too."""
        if (reason := self._reporter.latched()) is not None:
            leave(self._runtime.stop, f"STOP {reason}".rstrip())

    def _slow_down_again(self) -> None:
        """A loop that is started anew runs motions no faster than the one before was told to."""
        if self._reporter.snapshot is not None and 0.0 < (share := float(self._reporter.snapshot["speed"])) < 1.0:
            self._door.tell(Kind.SET_SPEED, value=share)

    def _watch(self, now: float) -> None:
        if not self._door.ring() and self._reporter.alive:
            self._lose_loop("the daemon's loop died; its drives quick-stop by their own watchdog")
        snapshot = self._reporter.snapshot
        if snapshot is not None and self._reporter.alive:
            for level, line in self._happenings.between(snapshot):
                self._log(level, line)
        self._owners.tick(
            now, int(snapshot["time_ns"]) * 1e-9 if snapshot is not None and self._reporter.alive else None
        )
        holders = {self._owners.number(lease.owner) for lease in self._leases.held()}
        for owner in self._owners.lost(self._reporter.running_owners() | holders):
            name = self._owners.name(owner)
            lost = self._leases.lose(name)
            what = ", ".join(["its action is ended", *(f"its lease on {lease.part} is lost" for lease in lost)])
            self._log("warning", f"{name} did not check in: {what}")
            self._door.tell(Kind.LOSE_OWNER, owner=owner)

    def _status(self) -> m.DaemonStatus:
        health, buses = read_health(self._runtime.folder), self._bus.states()
        status = self._reporter.status(self._owners.name, health, buses, self._desk.names())
        status.leases = self._leases.held()
        return status

    def _hardware(self) -> m.HardwareStatus:
        snapshot = self._reporter.snapshot if self._reporter.alive else None
        return m.HardwareStatus(components=list(components(snapshot, self._description, self._bus.states())))

    def _safety(self) -> m.SafetyReport:
        self._publish_news()
        if self._reporter.snapshot is None or not self._reporter.alive:
            raise refuse(NO_LOOP)
        snapshot = self._reporter.snapshot
        return safety_report(snapshot, self._description, drive_problems(snapshot, self._description))

    def _tell_timing(self, call: m.GetTiming) -> m.LoopTiming:
        self._publish_news()
        record = self._timing.read()
        if record is None or not self._reporter.alive:
            raise refuse(NO_LOOP)
        if call.reset:
            self._timing.begin_anew()
        description = self._description
        return loop_timing(record, self._clock, description.period_ns, description.stop_after_misses)

    def _tell_base(self) -> m.Base:
        self._publish_news()
        if self._reporter.snapshot is None or not self._reporter.alive:
            raise refuse(NO_LOOP)
        return exchange.base(self._reporter.snapshot, [foot.name for foot in self._description.feet])

    # -------------------------------------------------------------------------------------------------------- calls

    def _handle(self, call: Any) -> msgspec.Struct | None:
        return self._handlers[type(call)](call)

    def _words(self, answer: Answered) -> tuple[str, str, Any, str]:
        code, joint, value = answer
        named = self._description.joints
        if code in _ABOUT_DEVICES:
            named = tuple(device.name for device in self._description.devices)
        elif code == exchange.Answer.NOT_STANDING:
            named = tuple(foot.name for foot in self._description.feet)
        name = named[joint] if joint >= 0 else ""
        controller = self._desk.name_of(value) if code in _ABOUT_CONTROLLERS else ""
        return exchange.explain(exchange.Answer(code), name, value, self._reporter.drive_problem(name), controller)

    def _with_roster(self) -> np.ndarray:
        """The newest snapshot, once the roster that it is about has been written. RefusedError: there is none."""
        deadline = time.monotonic() + ANSWER_TIMEOUT_S
        while True:
            self._publish_news()
            snapshot = self._reporter.snapshot
            if snapshot is None or not self._reporter.alive:
                raise refuse(NO_LOOP)
            if self._desk.look(snapshot):
                return snapshot
            if (left := deadline - time.monotonic()) <= 0:
                raise refuse(f"the daemon's loop has not said in {ANSWER_TIMEOUT_S:g} s which controllers are loaded")
            self._door.doorbell.wait(left)

    def _ask_about_controllers(self, encode: Any, call: m.Message) -> None:
        self._with_roster()
        self._door.require(self._door.post(*encode(call, self._door.count())))

    def _start(self, call: m.StartAction | m.StartBehaviour) -> None:
        self._publish_news()  # judge it by the newest snapshot
        snapshot = self._reporter.snapshot
        if snapshot is None or not self._reporter.alive:
            raise refuse(NO_LOOP)
        if self._journal.named(call.id) is not None:
            raise refuse("an action of this id is running", "id", call.id, "an id of its own")
        moving = call.motion if isinstance(call, m.StartAction) else call.steps[0].motion
        joints = list(joints_of(moving, self._description))
        if isinstance(call, m.StartBehaviour):
            joints = [*joints, *dict.fromkeys(step.gripper.gripper for step in call.steps if step.gripper is not None)]
        self._leases.check(call.owner, joints, call.lease, call.sequence)
        owner = self._owners.number
        if isinstance(call, m.StartAction):
            check_start(call, self._description, self._frames, snapshot, self._door.floats)
            prepared = self._preparations.made([call], snapshot, self._generation).get(0, 0)
            serial = self._door.count()
            started = Started(serial, call.id, call.owner, call.ends, joints)
            header, payload = exchange.encode_start(
                call, serial, owner(call.owner), self._joints, self._frames, prepared, self._devices
            )
        else:
            orders = check_behaviour(call, self._description, self._frames, snapshot, self._door.floats)
            made = self._preparations.made(call.steps, snapshot, self._generation)
            serial = self._door.count()
            steps = [(step.name, step.ends) for step in call.steps]
            started = Started(serial, call.id, call.owner, [], joints, steps)
            header, payload = exchange.encode_behaviour(
                call, serial, owner(call.owner), self._joints, self._frames, self._devices, orders, made
            )
        self._owners.check_in(call.owner)
        self._journal.begin(started)
        answer = None
        try:
            answer = self._door.post(header, payload)
            self._door.require(answer)
        except RefusedError:
            if answer is not None or not self._reporter.alive:
                self._journal.ended(serial)
            else:
                # The caller is told that it does not run: make that true, whenever the loop comes to it.
                self._door.tell(Kind.CANCEL, action=serial)
            raise

    def _switch_controllers(self, call: m.SwitchControllers) -> None:
        self._with_roster()
        named = [entry for entry in self._desk.roster.loaded if entry.name in (*call.activate, *call.deactivate)]
        moved = [joint for entry in named for joint in entry.joints]
        self._leases.check(call.owner, moved, call.lease, call.sequence)
        self._ask_about_controllers(self._desk.switch, call)

    def _bind_keepalive(self, call: m.BindKeepalive) -> m.Challenge:
        self._challenges.allow(call.owner, call.by)
        self._door.ask(Kind.BIND_KEEPALIVE, owner=self._owners.number(call.owner), value=call.timeout_s)
        self._challenges.bind(call.owner, call.by)
        return m.Challenge(challenge=self._challenges.issue(call.owner))

    def _get_challenge(self, call: m.GetChallenge) -> m.Challenge:
        self._challenges.allow(call.owner, call.by)
        return m.Challenge(challenge=self._challenges.issue(call.owner))

    def _keep_alive(self, call: m.KeepAlive) -> m.Challenge:
        self._challenges.allow(call.owner, call.by)
        self._challenges.check(call.owner, call.answer)
        self._tell_keepalive(Kind.KEEP_ALIVE, call.owner)
        return m.Challenge(challenge=self._challenges.issue(call.owner))

    def _release_keepalive(self, call: m.ReleaseKeepalive) -> None:
        self._challenges.allow(call.owner, call.by)
        self._tell_keepalive(Kind.BIND_KEEPALIVE, call.owner)
        self._challenges.forget(call.owner)

    def _tell_keepalive(self, kind: Kind, owner: str) -> None:
        """As `_ask`. One that the loop knows nothing of has ended, and is nobody's any more; a loop that is busy ends none."""
        answer = self._door.post(exchange.encode_command(kind, self._door.count(), owner=self._owners.number(owner)))
        if answer is not None and answer[0] == exchange.Answer.KEEPALIVE_LOST:
            self._challenges.forget(owner)
        self._door.require(answer)

    def _take_lease(self, call: m.TakeLease) -> m.Lease:
        lease, ended = self._leases.take(call.owner, call.part, call.take_over)
        self._owners.check_in(call.owner)
        theirs = {one.owner for one in ended}
        for started in self._journal.running():
            if started.owner in theirs and self._leases.parts[call.part] & set(started.joints):
                self._door.tell(Kind.CANCEL, action=started.serial)
        return m.Lease(
            part=lease.part, owner=lease.owner, epoch=lease.epoch, sequence=self._leases.sequence(call.owner)
        )

    def _stream(self, call: m.StreamPose) -> None:
        check_stream(call)
        serial = self._theirs(call).serial
        self._door.require(self._door.post(*exchange.encode_stream(call, self._door.count(), serial)))

    def _stream_joints(self, call: m.StreamJoints) -> None:
        started = self._theirs(call)
        check_joints(call, started.joints, self._description)
        self._owners.check_in(started.owner)
        # Nobody waits for the loop's word: the next sample is on its way.
        self._door.leave(*exchange.encode_joints(call, self._door.count(), started.serial))

    def _command_gripper(self, call: m.CommandGripper) -> None:
        owner = owner_of(call.owner, call.by)
        self._leases.check(owner, [call.gripper], call.lease, call.sequence)
        row, values = check_gripper(call, self._description)
        header = exchange.encode_device(self._door.count(), row, values)
        self._door.require(self._door.post(header))

    def _switch_relay(self, call: m.SwitchRelay) -> None:
        row = check_power(call, self._description)
        header = exchange.encode_device(self._door.count(), row, (call.closed, call.force), Kind.RELAY)
        self._door.require(self._door.post(header))

    def _tare(self, call: m.TareSensor) -> m.Tared:
        row = check_sensor(call, self._description)
        answer = self._door.post_while(
            exchange.Answer.TARING,
            lambda: (exchange.encode_device(self._door.count(), row, (), Kind.TARE), None),
            time.monotonic() + _TARING_S,
        )
        self._door.require(answer)
        assert answer is not None
        return m.Tared(sensor=call.sensor, offset=answer[2])

    def _set_speed(self, call: m.SetSpeed) -> None:
        self._publish_news()
        started = self._running(call.id) if call.id else None
        serial, snapshot = started.serial if started else 0, self._reporter.snapshot
        if snapshot is None:
            raise refuse(NO_LOOP)
        shares = [slot["speed"] for slot in snapshot["actions"] if serial and slot["serial"] == serial]
        check_speed(call, float((shares or [snapshot["speed"]])[0]), started.owner if started else "")
        self._door.ask(Kind.SET_SPEED, action=serial, value=call.share)

    def _running(self, action: str) -> Started:
        """A running action. Raises RefusedError."""
        self._publish_news()
        started = self._journal.named(action)
        if started is None:
            raise refuse("no such action is running", "id", action, "the id of a running action")
        return started

    def _theirs(self, call: _Steering) -> Started:
        """The running action that a call is about, which is the caller's. Raises RefusedError."""
        started = self._running(call.id)
        check_steering(call.by, call.id, started.owner)
        return started

    def _hold_time(self, call: m.HoldTime) -> None:
        if not np.isfinite(call.limit_s):
            raise refuse("a hold ends by itself", "limit_s", call.limit_s, "a finite number of seconds")
        if self._clock == "lockstep":
            self._door.ask(Kind.HOLD_TIME, owner=self._owners.number(call.owner), value=call.limit_s)

    def _release_time(self, call: m.ReleaseTime) -> None:
        if self._clock == "lockstep":
            self._door.ask(Kind.RELEASE_TIME, owner=self._owners.number(call.owner))

    def _stop(self, call: m.Stop) -> None:
        self._tell_stop_socket(lambda: stop_now(self._runtime, call.reason or "a client", _STOP_TIMEOUT_S))

    def _tell_stop_socket(self, tell: Any) -> None:
        try:
            tell()
        except NoAnswer as error:
            raise refuse(str(error)) from error


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGTERM; prints `server ready` when it can. Returns 2 when the robot's files are no good."""
    parser = argparse.ArgumentParser(prog="python -m daemon.server", description="The process beside the loop.")
    parser.add_argument("--robot", required=True, help="name of a robot, or its folder")
    parser.add_argument("--clock", choices=("wall", "lockstep"), default="wall", help="as the loop's")
    parser.add_argument("--runtime", help="folder in which the robot's processes meet")
    given = parser.parse_args(arguments)
    try:
        description, place = robots.load(given.robot), Runtime.at(given.runtime)
        columns = other_columns(description)
    except ValueError as error:
        print(f"daemon.server: {error}", file=sys.stderr)
        return 2
    ending = False

    def end(_signal: int, _frame: object) -> None:
        nonlocal ending
        ending = True

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    server = Server(description, place, given.clock, columns=columns)
    try:
        server.take_over()
        print("server ready", flush=True)
        while not ending:
            server.step()
    finally:
        server.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
