"""The control loop: one process, one cycle, to be read from top to bottom.

    python -m daemon.loop --robot talos_upper --clock lockstep|wall --runtime DIR

Wall clock: cycles start at absolute deadlines; one that overruns skips whole periods and keeps phase. Lock-step: the plant steps
when this process's Sync arrives, and the next cycle starts when the drives have answered, unless somebody holds time.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterable

from daemon import exchange
from daemon.actions.table import Action, ActionTable
from daemon.controllers.base import Gains
from daemon.controllers.gains import joint_damping
from daemon.controllers.manager import ControllerManager
from daemon.controllers.outer_integral import OuterIntegral
from daemon.controllers.roster import roster_file
from daemon.controllers.table import ControllerTable
from daemon.controllers.workshop import SWITCH_INTERVAL_S
from daemon.devices import Devices
from daemon.exchange import Rule
from daemon.exchange.doorbell import Doorbell, PacedBell, loop_doorbell, server_doorbell
from daemon.exchange.ring import StateRingWriter
from daemon.exchange.snapshot import SnapshotWriter
from daemon.inputs import Inputs
from daemon.life import Life
from daemon.orders import Orders
from daemon.safety.last_word import LastWord
from daemon.state.bus_watch import NODE
from daemon.state.robot_state import RobotState
from daemon.state.taring import Taring
from daemon.time_holds import TimeHolds
from daemon.timing import TimingWriter
from daemon.warm_up import warm_up
from hal.can.port import BusLost, HubPort, open_port
from hal.core_pair import CorePair
from hal.drives.protocol import LimbProtocol
from hal.hardware import Goal, Hardware
from hal.joint import JointCommand
from hal.realtime import RealTime, sleep_then_spin_until
from handrail.config import ConfigError
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime

REPLY_TIMEOUT_S = 5.0
"""wall time after which a plant in lock-step that does not answer counts as gone: then every drive is lost"""
MEETING_S = 3.0
"""wall time that the loop waits for its drives' first answers before it says that it is ready; without them it refuses to enable"""
BEAT_S = 0.1
"""wall time between two looks around while the loop waits, and between two HoldTime frames"""
PRIORITY, CPUS = 80, (1,)
"""under the wall clock: of SCHED_FIFO, above the plant's, and on the other core"""


class Loop:
    """The daemon's cycle, and the parts that it moves."""

    def __init__(
        self,
        hardware: Hardware,
        kinematics: Kinematics,
        lockstep: bool,
        runtime: Runtime,
        core: CorePair | None = None,
        inputs: Inputs | None = None,
    ):
        """`core`: shared with the plant, with which the loop takes turns in lock-step; None: wherever the kernel wants. `inputs`:
        all that it takes in beside the bus; None: as it comes."""
        self.inputs = inputs = inputs or Inputs(runtime)
        description = kinematics.description
        n, period = len(description.joints), description.period_ns * 1e-9
        damping = joint_damping(kinematics, description.home_position())
        integral = OuterIntegral(description.integral, period) if description.integral else None
        gains = Gains(*hardware.representable_gains(description.stiffness, damping), integral)
        self.hardware, self.lockstep, self.period_ns, self.core = hardware, lockstep, description.period_ns, core
        self.robot = RobotState(kinematics, hardware.state, period, hardware.devices)
        self.manager = ControllerManager(self.robot, gains)
        self.workshop = inputs.workshop(kinematics, gains, hardware.state, period, roster_file(runtime))
        self.controllers = ControllerTable(self.manager, self.workshop)
        self.devices = Devices(description, hardware.devices, hardware.device_command)
        self.taring = Taring(self.robot)
        self.actions = ActionTable(self.manager, self.robot, self.devices)
        self.life = Life(hardware, self.manager, self.actions, self.devices, description)
        self.holds = TimeHolds(lockstep)
        self.last_word = LastWord(self.manager, self.robot, self.life.ledger, hardware.largest_command())
        self.written, self._next = JointCommand(n), JointCommand(n)

        self.stop_socket, hardware.waits_on = inputs.stops, inputs.waits_on
        self.doorbell, self.server = Doorbell(loop_doorbell(runtime.folder)), PacedBell(server_doorbell(runtime.folder))
        frames, device_names = exchange.frame_names(description), [device.name for device in description.devices]
        maker = inputs.maker(kinematics, gains, period, lockstep)
        served = (self.life, self.actions, self.controllers, self.devices, self.holds, maker, self.taring)
        self.orders = Orders(inputs.mailbox, frames, device_names, *served)
        ring = StateRingWriter(runtime.state_ring, exchange.snapshot_dtype(description))
        who = (self.manager, self.life, self.actions, self.controllers, self.orders)
        self.snapshot = SnapshotWriter(ring, hardware, self.robot, *who)
        self.timing = TimingWriter(runtime.timing)
        self.time_ns = -self.period_ns
        self.cycles = self.misses = self.work_ns = self.late_ns = 0
        self.ready = self.ending = False
        self._meets_until = 0.0

    def cycle(self) -> None:
        """One period of the robot's time."""
        began = time.perf_counter_ns()
        self.cycles += 1
        self.actions.cycle = self.controllers.cycle = self.cycles
        self.serve_stop()
        self.read_bus()
        if self.lockstep:
            began = time.perf_counter_ns()  # until here it waited for the plant: that is no work
        self.robot.update(self.written)
        self.robot.estimate_base(self.time_ns)
        self.controllers.collect(self.time_ns)
        self.orders.serve(self.written, self.time_ns)
        self.life.update(self.written, self.time_ns)
        self.devices.update()
        self.robot.estimate_forces(self.taring.with_its_frame(self.actions.force_frames()))
        self.taring.update(enabled=self.life.enabled)
        self.after_end(self.actions.check(self.written))
        command = self.run_controllers()
        self.hardware.write(command, self.cycles)
        self.work_ns = time.perf_counter_ns() - began
        self.timing.count(self.work_ns, None if self.lockstep else self.late_ns)
        self.publish()

    def serve_stop(self) -> bool:
        """The operator stop comes first, whatever else goes on. True when one came."""
        if not self.stop_socket.waiting():
            return False
        stopped = False
        for request in self.stop_socket.requests():
            if request.stop:
                self.life.stop(request.reason)
                self.holds.release_all()  # the drives must hear of it: time goes on
                stopped = True
            else:
                self.life.clear_stop()
        return stopped

    def read_bus(self) -> None:
        """Take in the drives' replies; in lock-step, wait for them."""
        gives_up = time.monotonic() + (REPLY_TIMEOUT_S if self.hardware.first_silent() < 0 else BEAT_S)
        while not self.hardware.read(BEAT_S if self.lockstep else 0.0):
            self.serve_stop()
            if not self.inputs.waits_on(not self.ending and time.monotonic() < gives_up):
                self.hardware.give_up()
                break
        if self.lockstep:  # the plant's clock, which goes on while no daemon runs
            self.time_ns = max(
                self.time_ns + self.period_ns, self.hardware.bus_time_ns // self.period_ns * self.period_ns
            )

    def run_controllers(self) -> JointCommand | None:
        """This cycle's command within the limits, or None where nobody commands the robot."""
        if self.manager.enabled:
            wanted = self.manager.update(self.written)
            while (bad := self.within_limits(wanted)) >= 0:
                self.life.ledger.trip(Rule.NOT_FINITE, bad)
                if not self.refuse(bad, self.written):
                    break
            if self.manager.failures:
                self.after_failures()
            if bad < 0:
                return self.written
            self.life.quick_stop(bad)
        self.written.follow(self.hardware.state)
        return None

    def within_limits(self, wanted: JointCommand) -> int:
        """The last word: `written` is what is written, and what the next cycle calls the previous command.

        A joint's row where there is no command for it that could be written, else −1.
        """
        command, previous = self._next, self.written
        if (fresh := self.manager.fresh) is not None:  # no command before: the brakes carried these joints
            previous.table[:, fresh], self.manager.fresh = wanted.table[:, fresh], None
            self.last_word.guard.begin()
        changed, _, joint = self.last_word.say(command, wanted, previous, self.hardware.state)
        if changed < 0:
            return joint
        if changed and (off := self.last_word.held_back(command, wanted)) is not None:
            self.refuse(off[0], command, off[1])
        self.written, self._next = command, previous
        return -1

    def refuse(self, joint: int, last: JointCommand, value: float = 0.0) -> bool:
        """The command of a joint may not be written: another controller takes it over, from `last`. False: there is none."""
        self.after_end(self.actions.refuse(joint, value))
        return self.manager.fail(joint, last)

    def after_failures(self) -> None:
        """Controllers have failed, or a rule ended them, and were replaced: their actions end, and people hear of it."""
        for controller in self.manager.failures:
            self.after_end(self.actions.lose(controller))
            if controller.error is None:
                self.life.ledger.note_end(controller.ended)
            else:
                self.controllers.fail(controller)
        self.manager.failures.clear()

    def after_end(self, ended: Iterable[Action]) -> None:
        """Note why; in lock-step an owner may have asked for time to think at its action's end."""
        for action in ended:
            self.life.ledger.note_end(action)
            if action.hold_after > 0.0:
                self.holds.add(action.owner, action.hold_after)

    def publish(self) -> None:
        """The snapshot leaves; the server hears of it when something happened, or after a while."""
        held = self.holds.active()
        numbers = (self.cycles, self.time_ns, self.misses, self.last_word.limited, self.work_ns, self.late_ns)
        self.server.tell(self.snapshot.publish(self.written, held, *numbers))

    # ------------------------------------------------------------------------------------------------- from cycle to cycle

    def run(self) -> None:
        """Run until `end`. Raises BusLost."""
        self._meets_until = time.monotonic() + MEETING_S
        if self.lockstep:
            self.run_lockstep()
            return
        for warning in RealTime(priority=PRIORITY, cpus=CPUS).warnings:
            print(f"daemon loop: {warning}", file=sys.stderr, flush=True)
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self.run_wall()

    def tell_ready(self) -> None:
        """Whoever hears it may enable the robot: every drive has answered, or has had long enough for it."""
        if self.hardware.first_silent() < 0 or time.monotonic() > self._meets_until:
            self.ready = True
            print("loop ready", flush=True)

    def run_lockstep(self) -> None:
        """Cycles as fast as the plant answers, robot time counted in periods."""
        while not self.ending:
            self.cycle()
            if not self.ready:
                self.tell_ready()
            self.wait_while_held()
            if self.core is not None:
                self.core.look()

    def wait_while_held(self) -> None:
        """Between two cycles, as long as somebody holds time: only stop socket and mailbox are served."""
        next_beat = time.monotonic()
        while self.holds.active() and not self.ending:
            if (now := time.monotonic()) >= next_beat:
                self.hardware.hold_time(self.cycles)
                next_beat = now + BEAT_S
            wait = min(next_beat - now, self.holds.remaining())
            select.select([self.stop_socket.fileno(), self.doorbell.fileno()], [], [], wait)
            self.doorbell.clear()
            if self.serve_stop():
                return  # a hold that waits in the mailbox must not come between the stop and the drives
            while self.orders.serve(self.written, self.time_ns):
                self.publish()

    def run_wall(self) -> None:
        """Cycles at absolute deadlines, half a millisecond off the plant's, robot time is the monotonic clock's."""
        period = self.period_ns
        deadline = (time.monotonic_ns() // period + 2) * period + 500_000
        while not self.ending:
            sleep_then_spin_until(deadline)
            self.time_ns, self.late_ns = deadline, time.monotonic_ns() - deadline
            self.cycle()
            if not self.ready:
                self.tell_ready()
            deadline += period
            if (over := time.monotonic_ns() - deadline) > 0:
                skipped = over // period + 1
                self.skip(skipped)
                deadline += skipped * period

    def skip(self, periods: int) -> None:
        """So many periods have gone by without a cycle."""
        self.misses += periods
        self.life.missed(self.timing.missed(periods))

    def end(self, *_: object) -> None:
        """Finish after the present cycle (a signal handler)."""
        self.ending = True

    def close(self) -> None:
        """Quick-stop what is in operation, and leave."""
        if self.life.enabled:
            self.hardware.goal = Goal.QUICK_STOP
            with contextlib.suppress(BusLost):  # then the drives' own watchdogs do it
                self.hardware.write(None, self.cycles)
        if self.core is not None:
            self.core.close()
        for part in (self.hardware, self.stop_socket, self.doorbell, self.server, self.workshop):
            part.close()


def main(arguments: list[str] | None = None) -> int:
    """Run the loop until SIGTERM. Returns 1 when there is no bus (any more), 2 when the robot's files are no good."""
    parser = argparse.ArgumentParser(prog="python -m daemon.loop", description="Handrail's control loop.")
    parser.add_argument("--robot", required=True, help="name of a robot, or its folder")
    parser.add_argument("--clock", choices=("wall", "lockstep"), required=True)
    parser.add_argument("--runtime", help="folder in which the robot's processes meet")
    parser.add_argument(
        "--tape", action="store_true", help="write down all that goes in and out (daemon.replay.recorder)"
    )
    given = parser.parse_args(arguments)
    try:
        description, runtime = robots.load(given.robot), Runtime.at(given.runtime)
        kinematics, protocol = Kinematics(description), LimbProtocol(description)
        warm_up(kinematics)
        port, lockstep = open_port(description, runtime, name=NODE), given.clock == "lockstep"
        core = None
        if lockstep and isinstance(port, HubPort):
            port.take_turns()
            core = CorePair(port.hub_process)
        make: Callable[..., Loop] = Loop
        if given.tape:
            from daemon.replay.taping import tape_loop

            port, make = tape_loop(description, given.clock, runtime, port)
        loop = make(Hardware(description, port, protocol), kinematics, lockstep, runtime, core)
        signal.signal(signal.SIGTERM, loop.end)
        signal.signal(signal.SIGINT, loop.end)
        try:
            loop.run()
        finally:
            loop.close()
    except (BusLost, ConfigError, ValueError) as error:
        print(f"daemon loop: {error}", file=sys.stderr, flush=True)
        return 1 if isinstance(error, BusLost) else 2
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # everything is closed; taking the interpreter apart can cost a second on a busy machine
