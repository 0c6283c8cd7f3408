"""The robot's drives as nodes on the bus: CiA 402 life, watchdog, quick stop, brake, and one answer to every frame.

All drives of the robot are rows of arrays (n,), in the description's order; their firmware is `hal.plant.actuator`. A drive
knows the host only from frames, and time only from its own clock: when frames stop coming it acts by itself.

===================== ================================================================= =================
state                 torque                                                            brake
===================== ================================================================= =================
operation enabled     as commanded, once a command came and the brake is released       open
quick stop active     for 0.25 s what the spring carried when it began                  open, then closed
                      − quick_stop_damping · (velocity + 10/s · way since then),
                      then none
any other             none                                                              closed
===================== ================================================================= =================

Motors heat up with their current squared. Above the warning temperature a drive says so and takes torque away, so that its own
load does not take it to the limit where it faults.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.drives.lifecycle import DriveError, State
from hal.drives.parameters import ParameterResult
from hal.joint import JointCommand, Mode
from hal.plant import drive_kernels as kernel
from hal.plant.actuator import Actuators
from hal.plant.drive_kernels import AMBIENT, NEVER, STEP_NS, DriveMemory
from hal.plant.drive_parameters import DriveParameters
from handrail.robot.description import RobotDescription

TEMPERATURE_WARNING, TEMPERATURE_LIMIT = 80.0, 95.0
"""°C, until somebody writes others"""
BUS_VOLTAGE = 48.0
"""V, nominal"""
_RATED_RISE = 40.0  # K at rated torque for ever
_OVERSPEED_RATIO = 2.0
"""velocity at which a drive trips over its limit"""


class DriveNodes:
    """n drives. `state`, `error`, `temperature` (°C), `flags` and `brakes` (True: closed) are for reading."""

    def __init__(self, description: RobotDescription, actuators: Actuators):
        n = len(description.joints)
        self.actuators = actuators
        parts = DriveMemory(n, description.period_ns, description.watchdog_cycles)
        self.memory, values, times, marks = parts.memory, parts.values, parts.times, parts.marks
        self.state, self.error, self._next = marks[kernel.STATE], marks[kernel.ERROR], marks[kernel.NEXT]
        self.state[:] = State.SWITCH_ON_DISABLED
        self.temperature, self.bus_voltage = values[kernel.TEMPERATURE], values[kernel.VOLTAGE]
        """`bus_voltage`: V, at the drives: whoever feeds them writes it"""
        self.temperature_warning, self.temperature_limit = values[kernel.WARM], values[kernel.HOT]
        """°C"""
        self.temperature[:], self.bus_voltage[:] = AMBIENT, BUS_VOLTAGE
        self.temperature_warning[:], self.temperature_limit[:] = TEMPERATURE_WARNING, TEMPERATURE_LIMIT
        self.flags = parts.flags
        """statusword's bits 7, hotter than the warning temperature, and 11, a limit of the drive acts"""
        self.brakes = marks[kernel.BRAKED].view(np.bool_)
        self.brakes[:] = True
        self.brakes_moved = True
        """set when a brake closed or opened; whoever moves the joints resets it"""
        self.now_ns = 0
        """the drives' own clock"""
        self._heard, self._first_command = times[kernel.HEARD], times[kernel.FIRST_COMMAND]
        self._stopped = times[kernel.STOPPED]
        self._first_command[:] = times[kernel.FAST] = NEVER
        times[kernel.INTERVAL] = description.watchdog_cycles * description.period_ns
        model = actuators.model
        values[kernel.HEAT] = _RATED_RISE / (model.torque_limit / model.torque_per_current) ** 2
        values[kernel.OVERSPEED] = _OVERSPEED_RATIO * description.velocity_limit
        self._quick_stop_damping = values[kernel.QUICK_STOP_DAMPING]
        self._quick_stop_damping[:] = description.quick_stop_damping
        actuators.set_limits(
            description.lower, description.upper, description.velocity_limit, description.quick_stop_damping
        )
        self._parameters = DriveParameters(self, description.joints)
        self._everyone, self._usual_cycles = np.ones(n, np.bool_), np.zeros(n, np.uint8)

    def __len__(self) -> int:
        return len(self.state)

    def control(self, controlwords: npt.NDArray[np.uint8], addressed: npt.NDArray[np.bool_] | None = None) -> None:
        """CiA 402 controlwords (n,), low byte, for the drives that they are `addressed` to (n,) (None: to all)."""
        if kernel.climb(controlwords, self._everyone if addressed is None else addressed, self.memory):
            for row in np.flatnonzero(self._next != self.state):
                self._enter(int(row), State(self.state[row]), State(self._next[row]))

    def command(
        self,
        command: JointCommand,
        addressed: npt.NDArray[np.bool_] | None = None,
        watchdog_cycles: npt.NDArray[np.uint8] | None = None,
    ) -> None:
        """Set-points, which feed the watchdogs of the drives that they are `addressed` to (n,) (None: to all).

        `watchdog_cycles` (n,): host cycles that a drive goes on without another one (None, or 0: the description's). A drive
        that is not in operation enabled ignores set-points.
        """
        kernel.take(
            self.now_ns,
            command.table,
            command.mode,
            self._everyone if addressed is None else addressed,
            self._usual_cycles if watchdog_cycles is None else watchdog_cycles,
            self.memory,
            self.actuators.memory,
        )

    def switch_off(self) -> None:
        """Take every drive to switch on disabled at once: power off, brake closed."""
        for row in range(len(self)):
            self._enter(row, State(self.state[row]), State.SWITCH_ON_DISABLED)

    def fail(self, row: int, error: DriveError) -> None:
        """Let one drive fault (its brake closes): what tests and exercises do to it."""
        self.error[row] = error
        self._enter(row, State(self.state[row]), State.FAULT)

    def read_parameter(self, row: int, index: int) -> float:
        """One value of a drive's object dictionary (hal.drives.parameters). Raises KeyError for what it cannot read."""
        result, value = self._parameters.read(row, index)
        if result is not ParameterResult.OK:
            raise KeyError(f"parameter {index:#04x}: {result.name.lower()}")
        return value

    def write_parameter(self, row: int, index: int, value: float) -> ParameterResult:
        """Change one value of a drive's object dictionary; nothing changes unless the result is OK."""
        return self._parameters.write(row, index, value)

    def _enter(self, row: int, before: State, after: State) -> None:
        actuators = self.actuators
        self.state[row] = after
        if after is State.OPERATION_ENABLED:
            # The brake stays closed until the host has said what the drive shall do.
            actuators.mode[row], actuators.damping[row] = Mode.DAMPING, 0.0
            actuators.powered[row] = True
            self._heard[row], self._first_command[row] = self.now_ns, NEVER
        elif after is State.QUICK_STOP_ACTIVE:
            a = actuators
            self._stopped[row] = self.now_ns
            # It holds about the load that it carried: gravity or a tool's contact must not take the joint along meanwhile, nor what
            # comes on top of it, when a contact gives way say.
            a.mode[row], a.damping[row] = Mode.IMPEDANCE, self._quick_stop_damping[row]
            a.stiffness[row] = kernel.QUICK_STOP_RATE * self._quick_stop_damping[row]
            a.torque[row], a.position[row], a.velocity[row] = a.measured_torque[row], a.measured_position[row], 0.0
        else:
            actuators.powered[row] = False
            if not self.brakes[row]:
                self.brakes[row] = self.brakes_moved = True
        if before is State.SWITCH_ON_DISABLED and after is State.READY_TO_SWITCH_ON:
            # Until the drive is enabled anew, the host can read why it stopped.
            self.error[row] = DriveError.NONE

    def step(self, position: np.ndarray, velocity: np.ndarray, firmware_cycles: int) -> np.ndarray:
        """Go on by 1 ms for joints at `position` rad and `velocity` rad/s (n,). Returns the springs' torque N·m (n,).

        The array is the actuators' own, overwritten by the next step.
        """
        actuators = self.actuators
        if kernel.step(self.now_ns, firmware_cycles, position, velocity, self.memory, actuators.memory):
            self.brakes_moved = True
        self.now_ns += STEP_NS
        return actuators.spring_torque
