"""Limb FD. Typed messages of the family `limb_fd`, made from its description by `handrail drives types limb_fd`; do not
edit."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import can

from hal.drives.drive_parameters import DriveParameters, Readable, ReadWrite, WriteOnly
from hal.drives.lifecycle import DriveError, State
from hal.drives.parameters import Parameter, ParameterResult
from hal.drives.typed import NEXT, NOW, TypedMessage, decode_any
from hal.joint import Mode


class Controlword(IntEnum):
    DISABLE_VOLTAGE = 0
    QUICK_STOP = 2
    SHUTDOWN = 6
    SWITCH_ON = 7
    ENABLE_OPERATION = 15
    FAULT_RESET = 128


class Statusword(IntEnum):
    NOT_READY_TO_SWITCH_ON = 512
    FAULT = 520
    QUICK_STOP_ACTIVE = 535
    FAULT_REACTION_ACTIVE = 543
    READY_TO_SWITCH_ON = 545
    SWITCHED_ON = 563
    OPERATION_ENABLED = 567
    SWITCH_ON_DISABLED = 576


class Write(IntEnum):
    READ = 0
    WRITE = 1


@dataclass(kw_only=True)
class LimbControl(TypedMessage, family="limb_fd", message="LimbControl"):
    """Drive life of a limb: CiA 402 controlwords, low byte. Answered like a command. Host → drives: where their lives
    shall go."""

    limb: int = 0
    """0 to 7"""
    controlword: list[Controlword | int] = field(default_factory=lambda: [Controlword.DISABLE_VOLTAGE] * 7)
    sequence: int = NEXT
    """0 to 255; echoed in the answers"""


@dataclass(kw_only=True)
class LimbCommand(TypedMessage, family="limb_fd", message="LimbCommand"):
    """Set-points of a limb. A drive that is not in operation enabled answers and ignores them. Host → drives:
    set-points."""

    limb: int = 0
    """0 to 7"""
    position: list[float] = field(default_factory=lambda: [0.0] * 7)
    """rad, -4.096 to 4.095875, in steps of 0.000125"""
    velocity: list[float] = field(default_factory=lambda: [0.0] * 7)
    """rad/s, -32.768 to 32.767, in steps of 0.001"""
    torque: list[float] = field(default_factory=lambda: [0.0] * 7)
    """N·m, -655.36 to 655.34, in steps of 0.02"""
    stiffness: list[float] = field(default_factory=lambda: [0.0] * 7)
    """N·m/rad, 0, or 0.1 to 10000"""
    damping: list[float] = field(default_factory=lambda: [0.0] * 7)
    """N·m·s/rad, 0, or 0.001 to 1000"""
    sequence: int = NEXT
    """0 to 255; echoed in the answers. A command whose number does not go on from the last one's counts for nothing"""
    watchdog: int = 0
    """cycles, 0 to 255; host cycles without a valid command after which a drive quick-stops"""
    mode: list[Mode] = field(default_factory=lambda: [Mode.DAMPING] * 7)


@dataclass(kw_only=True)
class DriveStatus(TypedMessage, family="limb_fd", message="DriveStatus"):
    """State of a limb, an axis. Drive → host: answer of one drive."""

    limb: int = 0
    """0 to 7"""
    axis: int = 0
    """0 to 6"""
    position: float = 0.0
    """rad, -2147.483648 to 2147.483647, in steps of 1e-06"""
    velocity: float = 0.0
    """rad/s, -32.768 to 32.767, in steps of 0.001"""
    torque: float = 0.0
    """N·m, -655.36 to 655.34, in steps of 0.02; of the drive's spring"""
    statusword: Statusword | int = Statusword.NOT_READY_TO_SWITCH_ON
    """CiA 402"""
    temperature: float = 0.0
    """°C, 0 to 255, in steps of 1"""
    error: DriveError | int = DriveError.NONE
    sequence: int = 0
    """0 to 255; of the frame that this answers"""
    mode: Mode = Mode.DAMPING
    time: int = NOW
    """µs, 0 to 65535; of the drive's clock, when this was measured"""


@dataclass(kw_only=True)
class LimbStatus(TypedMessage, family="limb_fd", message="LimbStatus"):
    """State of all axes of a limb, sent by the limb's master instead of DriveStatus. Limb's master → host: answer for
    all axes."""

    limb: int = 0
    """0 to 7"""
    position: list[float] = field(default_factory=lambda: [0.0] * 7)
    """rad, -8.388608 to 8.388607, in steps of 1e-06"""
    velocity: list[float] = field(default_factory=lambda: [0.0] * 7)
    """rad/s, -32.768 to 32.767, in steps of 0.001"""
    torque: list[float] = field(default_factory=lambda: [0.0] * 7)
    """N·m, -655.36 to 655.34, in steps of 0.02"""
    state: list[State] = field(default_factory=lambda: [State.NOT_READY_TO_SWITCH_ON] * 7)
    warning: list[bool] = field(default_factory=lambda: [False] * 7)
    error: list[DriveError | int] = field(default_factory=lambda: [DriveError.NONE] * 7)
    sequence: int = 0
    """0 to 255; of the frame that this answers"""
    time: int = NOW
    """µs, 0 to 65535; of the master's clock, when this was measured"""
    temperature: float = 0.0
    """°C, 0 to 255, in steps of 1; of the limb's hottest drive"""
    limit: list[bool] = field(default_factory=lambda: [False] * 7)
    """a limit inside the drive acts"""


@dataclass(kw_only=True)
class Sync(TypedMessage, family="limb_fd", message="Sync"):
    """The host's cycle begins; the last frame of a cycle. In lock-step simulated time steps by one host period. Host →
    all: the cycle is complete."""

    cycle: int = 0
    """0 to 4294967295; the host's cycle counter"""


@dataclass(kw_only=True)
class HoldTime(TypedMessage, family="limb_fd", message="HoldTime"):
    """Lock-step: the host lives but holds simulated time: neither step nor run free. Host → all: time stands."""

    cycle: int = 0
    """0 to 4294967295; the host's cycle counter"""


@dataclass(kw_only=True)
class ParameterRequest(TypedMessage, family="limb_fd", message="ParameterRequest"):
    """Read or write one parameter of a drive of a limb. Answered by ParameterReply. Host → drive: read or write a
    parameter."""

    limb: int = 0
    """0 to 7"""
    axis: int = 0
    """0 to 255"""
    index: Parameter | int = Parameter.PROTOCOL_VERSION
    """hal/drives/parameters.py"""
    write: Write = Write.READ
    sequence: int = NEXT
    """0 to 255; echoed in the reply"""
    value: float = 0.0
    """a finite number"""


@dataclass(kw_only=True)
class ParameterReply(TypedMessage, family="limb_fd", message="ParameterReply"):
    """What became of a ParameterRequest to a limb, an axis. Drive → host: what became of the request."""

    limb: int = 0
    """0 to 7"""
    axis: int = 0
    """0 to 6"""
    index: Parameter | int = Parameter.PROTOCOL_VERSION
    write: Write = Write.READ
    result: ParameterResult | int = ParameterResult.OK
    sequence: int = 0
    """0 to 255; of the request"""
    value: float = 0.0
    """a finite number; the parameter's value, after a write too"""


class Parameters(DriveParameters, family="limb_fd"):
    """One drive's parameters: reading an attribute asks the drive, assigning to it writes."""

    protocol_version = Readable(Parameter.PROTOCOL_VERSION)
    """version of the frames that the drive speaks"""
    firmware_version = Readable(Parameter.FIRMWARE_VERSION)
    """major · 1000 + minor"""
    serial = Readable(Parameter.SERIAL)
    """serial number, below 2^24"""
    torque_kp = ReadWrite(Parameter.TORQUE_KP)
    """proportional gain of the torque loop on the spring, seed 003 eq. 2; not while in operation"""
    torque_kd = ReadWrite(Parameter.TORQUE_KD)
    """s; derivative gain of the torque loop on the spring; not while in operation"""
    observer_hz = ReadWrite(Parameter.OBSERVER_HZ)
    """Hz; bandwidth of the disturbance observer's filter; 0: no observer; not while in operation"""
    position_kp = ReadWrite(Parameter.POSITION_KP)
    """N·m/rad; the drive's own position loop; not while in operation"""
    position_kd = ReadWrite(Parameter.POSITION_KD)
    """N·m·s/rad; the drive's own position loop; not while in operation"""
    position_ki = ReadWrite(Parameter.POSITION_KI)
    """N·m/(rad·s); the drive's own position loop; not while in operation"""
    current_limit = ReadWrite(Parameter.CURRENT_LIMIT)
    """A; of the motor"""
    torque_limit = ReadWrite(Parameter.TORQUE_LIMIT)
    """N·m; of the set-point, at the joint"""
    velocity_limit = ReadWrite(Parameter.VELOCITY_LIMIT)
    """rad/s; of the joint"""
    position_lower = ReadWrite(Parameter.POSITION_LOWER)
    """rad; the joint's lower end; not while in operation"""
    position_upper = ReadWrite(Parameter.POSITION_UPPER)
    """rad; the joint's upper end; not while in operation"""
    temperature_warning = ReadWrite(Parameter.TEMPERATURE_WARNING)
    """°C; of the motor, above which the statusword warns and torque is derated"""
    temperature_limit = ReadWrite(Parameter.TEMPERATURE_LIMIT)
    """°C; of the motor, above which the drive faults"""
    encoder_offset = ReadWrite(Parameter.ENCODER_OFFSET)
    """rad; added to the joint encoder's angle; not while in operation"""
    torque_offset = ReadWrite(Parameter.TORQUE_OFFSET)
    """N·m; added to the spring sensor's torque; not while in operation"""
    calibrate = WriteOnly(Parameter.CALIBRATE)
    """rad; the joint is at this position now: sets encoder_offset; not while in operation"""
    bus_voltage = Readable(Parameter.BUS_VOLTAGE)
    """V; at the drive"""
    motor_temperature = Readable(Parameter.MOTOR_TEMPERATURE)
    """°C; of the motor's winding"""
    motor_current = Readable(Parameter.MOTOR_CURRENT)
    """A; of the motor"""
    inject_error = WriteOnly(Parameter.INJECT_ERROR)
    """fault with this error (hal.drives.lifecycle.DriveError); emulated drives only"""


AnyMessage = LimbControl | LimbCommand | DriveStatus | LimbStatus | Sync | HoldTime | ParameterRequest | ParameterReply
MESSAGES = (LimbControl, LimbCommand, DriveStatus, LimbStatus, Sync, HoldTime, ParameterRequest, ParameterReply)


def decode(message: can.Message) -> AnyMessage | None:
    """What a frame says; None: its identifier is none of this family's. Raises FrameError for a damaged one."""
    return decode_any(MESSAGES, message)
