"""The robot's drives as nodes on the bus: CiA 402 life, watchdog, quick stop, brake, and one answer to every frame.

All drives of the robot are rows of arrays (n,), in the description's order; their firmware is `hal.plant.actuator`. A drive
knows the host only from frames, and time only from its own clock: when frames stop coming it acts by itself.

===================== ================================================================= =================
state                 torque                                                            brake
===================== ================================================================= =================
operation enabled     as commanded, once a command came and the brake is released       open
quick stop active     for 0.25 s what the spring carried when it began                  open, then closed
                      − quick_stop_damping · velocity, then none
any other             none                                                              closed
===================== ================================================================= =================

Motors heat up with their current squared. Above the warning temperature a drive says so and takes torque away, so that its own
load does not take it to the limit where it faults.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from hal.drives.lifecycle import INTERNAL_LIMIT, WARNING, DriveError, State, transition
from hal.drives.parameters import ParameterResult
from hal.joint import JointCommand, Mode
from hal.plant.actuator import Actuators
from hal.plant.drive_parameters import DriveParameters
from handrail.robot.description import RobotDescription

STEP_NS = 1_000_000
"""one step of the plant"""
QUICK_STOP_NS = 250_000_000
"""how long a quick stop damps before the brake closes"""
BRAKE_RELEASE_NS = 50_000_000
"""from the first command to the open brake: the spring takes the load up meanwhile, so that nothing drops"""
AMBIENT = 25.0
"""°C"""
TEMPERATURE_WARNING, TEMPERATURE_LIMIT = 80.0, 95.0
"""°C, until somebody writes others"""
BUS_VOLTAGE, UNDERVOLTAGE = 48.0, 36.0
"""V: nominal, and where a drive faults"""
_RATED_RISE, _THERMAL_TIME_CONSTANT = 40.0, 600.0  # K at rated torque for ever; s
# A drive trips when the joint runs at more than this over its velocity limit for so long: a blow alone does not trip it.
_OVERSPEED_RATIO, _OVERSPEED_NS = 2.0, 5_000_000

_ENABLED, _QUICK_STOP, _FAULT = int(State.OPERATION_ENABLED), int(State.QUICK_STOP_ACTIVE), int(State.FAULT)
_WATCHDOG = int(DriveError.WATCHDOG)
_OVERTEMPERATURE, _OVERSPEED = int(DriveError.OVERTEMPERATURE), int(DriveError.OVERSPEED)
_UNDERVOLTAGE = int(DriveError.UNDERVOLTAGE)
_DAMPING, _IMPEDANCE = int(Mode.DAMPING), int(Mode.IMPEDANCE)
_WARNING, _INTERNAL_LIMIT = np.uint16(WARNING), np.uint16(INTERNAL_LIMIT)
_LEAST_DERATING = 1e-3
_NEVER = -1


class DriveNodes:
    """n drives. `state`, `error`, `temperature` (°C), `flags` and `brakes` (True: closed) are for reading."""

    def __init__(self, description: RobotDescription, actuators: Actuators):
        n = len(description.joints)
        self.actuators = actuators
        self.state = np.full(n, State.SWITCH_ON_DISABLED, np.uint8)
        self.error = np.zeros(n, np.uint8)
        self.temperature = np.full(n, AMBIENT)
        self.temperature_warning = np.full(n, TEMPERATURE_WARNING)
        """°C"""
        self.temperature_limit = np.full(n, TEMPERATURE_LIMIT)
        """°C"""
        self.flags = np.zeros(n, np.uint16)
        """statusword's bits 7, hotter than the warning temperature, and 11, a limit of the drive acts"""
        self.bus_voltage = np.full(n, BUS_VOLTAGE)
        """V, at the drives: whoever feeds them writes it"""
        self.brakes = np.ones(n, np.bool_)
        self.brakes_moved = True
        """set when a brake closed or opened; whoever moves the joints resets it"""
        self.now_ns = 0
        """the drives' own clock"""
        self._description = description
        self._controlword = np.zeros(n, np.uint8)
        self._heard = np.zeros(n, np.int64)
        self._interval = np.full(n, description.watchdog_cycles * description.period_ns, np.int64)
        self._first_command = np.full(n, _NEVER, np.int64)
        self._stopped = np.zeros(n, np.int64)
        self._fast = np.full(n, _NEVER, np.int64)
        self._overspeed = _OVERSPEED_RATIO * description.velocity_limit
        model = actuators.model
        self._heat = _RATED_RISE / (model.torque_limit / model.torque_per_current) ** 2
        actuators.set_limits(
            description.lower, description.upper, description.velocity_limit, description.quick_stop_damping
        )
        self._parameters = DriveParameters(self, description.joints)
        self._everyone = np.ones(n, np.bool_)
        self._default_cycles = np.full(n, description.watchdog_cycles, np.uint8)

    def __len__(self) -> int:
        return len(self.state)

    def control(self, controlwords: npt.NDArray[np.uint8], addressed: npt.NDArray[np.bool_] | None = None) -> None:
        """CiA 402 controlwords (n,), low byte, for the drives that they are `addressed` to (n,) (None: to all)."""
        addressed = self._everyone if addressed is None else addressed
        after = np.where(addressed, transition(self.state, controlwords, self._controlword), self.state)
        self._controlword[addressed] = controlwords[addressed]
        for row in np.flatnonzero(after != self.state):
            self._enter(int(row), State(self.state[row]), State(after[row]))

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
        a = self.actuators
        _take(
            self.now_ns,
            self._everyone if addressed is None else addressed,
            self._default_cycles if watchdog_cycles is None else watchdog_cycles,
            self._default_cycles,
            self._description.period_ns,
            (command.position, command.velocity, command.torque, command.stiffness, command.damping),
            command.mode,
            (a.position, a.velocity, a.torque, a.stiffness, a.damping),
            a.mode,
            self.state,
            self._heard,
            self._interval,
            self._first_command,
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
            actuators.mode[row], actuators.damping[row] = _DAMPING, 0.0
            actuators.powered[row] = True
            self._heard[row], self._first_command[row] = self.now_ns, _NEVER
        elif after is State.QUICK_STOP_ACTIVE:
            a = actuators
            self._stopped[row] = self.now_ns
            # It damps about the load that it carried: gravity or a tool's contact must not take the joint along meanwhile.
            a.mode[row], a.damping[row] = _IMPEDANCE, self._description.quick_stop_damping[row]
            a.torque[row], a.stiffness[row], a.velocity[row] = a.measured_torque[row], 0.0, 0.0
        else:
            actuators.powered[row] = False
            if not self.brakes[row]:
                self.brakes[row] = self.brakes_moved = True
        if before is State.SWITCH_ON_DISABLED and after is State.READY_TO_SWITCH_ON:
            # Until the drive is enabled anew, the host can read why it stopped.
            self.error[row] = DriveError.NONE

    def _stop_left_alone(self) -> None:
        """Of two drives that move their joints together, none does anything alone: where one is off, the other faults."""
        powered = self.actuators.powered
        for pitch, roll, _ in self.actuators.pairs:
            if powered[pitch] != powered[roll]:
                left = pitch if powered[pitch] else roll
                if not self.brakes[left]:
                    self.fail(left, DriveError.INTERNAL)

    def step(self, position: np.ndarray, velocity: np.ndarray, firmware_cycles: int) -> np.ndarray:
        """Go on by 1 ms for joints at `position` rad and `velocity` rad/s (n,). Returns the springs' torque N·m (n,).

        The array is the actuators' own, overwritten by the next step.
        """
        actuators = self.actuators
        if _live(
            self.now_ns, self.state, self.error, self._heard, self._interval, self._first_command, self._stopped,
            self._fast, self.brakes, actuators.powered, actuators.mode, actuators.damping, actuators.torque,
            actuators.stiffness, actuators.velocity, actuators.smooth, self._description.quick_stop_damping,
            actuators.measured_velocity, self._overspeed, actuators.measured_torque, actuators.current, self._heat,
            self.temperature, self.temperature_warning, self.temperature_limit, actuators.derating, self.bus_voltage,
            actuators.limited, self.flags,
        ):  # fmt: skip
            self.brakes_moved = True
        self._stop_left_alone()
        torque = actuators.step(position, velocity, firmware_cycles)
        self.now_ns += STEP_NS
        return torque


@njit(cache=True)
def _take(  # type: ignore[no-untyped-def]
    now, addressed, cycles, default_cycles, period, given, given_mode, taken, mode, state, heard, interval, first_command,
):  # fmt: skip
    """Copy set-points to the drives that are addressed and enabled, and feed their watchdogs."""
    for j in range(state.shape[0]):
        if not addressed[j] or state[j] != _ENABLED:
            continue
        for field in range(5):
            taken[field][j] = given[field][j]
        mode[j] = given_mode[j]
        heard[j] = now
        interval[j] = (cycles[j] if cycles[j] > 0 else default_cycles[j]) * period
        if first_command[j] == _NEVER:
            first_command[j] = now


@njit(cache=True)
def _live(  # type: ignore[no-untyped-def]
    now, state, error, heard, interval, first_command, stopped, fast, brakes, powered, mode, damping, goal, stiffness,
    goal_velocity, smooth, quick_stop_damping, velocity, overspeed, torque, current, heat, temperature, warm, hot, derating,
    voltage, limited, flags,
):  # fmt: skip
    """What every drive does by itself in a millisecond; writes the arrays. True when a brake opened or closed."""
    moved = False
    for j in range(state.shape[0]):
        excess = AMBIENT + heat[j] * current[j] ** 2 - temperature[j]
        temperature[j] += STEP_NS * 1e-9 / _THERMAL_TIME_CONSTANT * excess
        flags[j] = _INTERNAL_LIMIT if limited[j] and powered[j] else 0
        derating[j] = 1.0
        if temperature[j] > warm[j]:
            flags[j] |= _WARNING
            derating[j] = max((hot[j] - temperature[j]) / (hot[j] - warm[j]), _LEAST_DERATING)
        if abs(velocity[j]) <= overspeed[j]:
            fast[j] = _NEVER
        elif fast[j] == _NEVER:
            fast[j] = now
        tripped = 0
        if state[j] == _ENABLED:
            if temperature[j] > hot[j]:
                tripped = _OVERTEMPERATURE
            elif fast[j] != _NEVER and now - fast[j] >= _OVERSPEED_NS:
                tripped = _OVERSPEED
        if voltage[j] < UNDERVOLTAGE and state[j] != _FAULT:
            tripped = _UNDERVOLTAGE
        if tripped:
            state[j], error[j], powered[j] = _FAULT, tripped, False
            moved = moved or not brakes[j]
            brakes[j] = True
        if state[j] == _ENABLED:
            if now - heard[j] > interval[j]:
                state[j], error[j] = _QUICK_STOP, _WATCHDOG
                mode[j], damping[j] = _IMPEDANCE, quick_stop_damping[j]
                goal[j], stiffness[j], goal_velocity[j] = torque[j], 0.0, 0.0
                stopped[j] = now
            elif brakes[j] and first_command[j] != _NEVER and now - first_command[j] >= BRAKE_RELEASE_NS:
                brakes[j] = False
                moved = True
        elif state[j] == _QUICK_STOP and powered[j] and now - stopped[j] >= QUICK_STOP_NS:
            powered[j] = False
            moved = moved or not brakes[j]
            brakes[j] = True
        # A stop acts at once, and behind a closed brake nothing can jump.
        smooth[j] = state[j] == _ENABLED and not brakes[j]
    return moved
