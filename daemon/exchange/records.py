"""The records themselves: what a snapshot and a command hold, field by field, and the codes in them."""

from __future__ import annotations

import enum
from typing import Protocol
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hal.device import COMMANDED, MEASURED
from handrail.robot.description import RobotDescription

SLOTS = 4
"""Actions that may run at the same time, on different joints."""
MAX_JOINTS = 64
MAX_ENDS = 16
MAX_HOLDS = 8
"""Owners that may hold simulated time at once."""
MAX_LOADED = 16
"""Controllers that may be loaded by name at once."""
COMMAND_ROWS = ("position", "velocity", "torque", "stiffness", "damping")
"""Rows of the snapshot's `command`: rad, rad/s, N·m, N·m/rad, N·m·s/rad."""


class Flag(enum.IntFlag):
    """Bits of the snapshot's `flags`."""

    ENABLED = 1
    """every drive in operation enabled and a controller active on every joint, isolated limbs aside"""
    STOPPED = 2
    """the operator stop is latched"""
    ENABLING = 4
    """on the way to operation enabled"""
    HELD = 8
    """simulated time is held"""
    ISOLATED = 16
    """some limbs of an enabled robot are out of it: their joints have no claims"""


class ActionState(enum.IntEnum):
    EMPTY = 0
    RUNNING = 1
    PAUSED = 2
    ENDED = 3


@enum.unique
class Outcome(enum.IntEnum):
    """Why an action ended. The lower-case name is ActionEvent.outcome, but for CONDITION: there the end condition's tag is."""

    NONE = 0
    DONE = 1
    CANCELLED = 2
    STOPPED = 3
    OWNER_LOST = 4
    REFUSED_BY_LIMITS = 5
    DRIVE_FAULT = 6
    DIVERGED = 7
    CONDITION = 8
    """`condition` is the index in StartAction.ends"""
    STALE_STATE = 9
    """a joint that it moves has not been measured for `value` cycles"""
    CONTROLLER_ERROR = 10
    """its controller raised an exception, which a ControllerEvent tells"""
    STEP_REFUSED = 11
    """the behaviour's next step does not start where the robot is: `joint` is `value` rad off"""
    TOO_MANY_STEPS = 12
    """`value` steps of the behaviour have been taken"""
    INFEASIBLE = 13
    """constraints exclude each other; `detail` names the one that blocks"""
    TOO_CLOSE = 14
    """bodies came so near to each other, or to a region, that there was just room to brake; `detail` names them"""
    STREAM_LOST = 15
    """nothing had been streamed to it for `value` s"""
    BALANCE_LOST = 16
    """the robot fell"""


class ControllerState(enum.IntEnum):
    """ros2_control's words for a controller that was loaded by name; the lower-case name is ControllerInfo.state."""

    EMPTY = 0
    """nothing is loaded in this slot"""
    LOADING = 1
    """on the way from `load` or `configure` to what comes next, beside the loop"""
    UNCONFIGURED = 2
    """its kind is known; it has not been made, or has failed since"""
    INACTIVE = 3
    """made, rehearsed, ready to be switched on within a cycle"""
    ACTIVE = 4
    """updated in every cycle"""


@enum.unique
class Kind(enum.IntEnum):
    """What a command asks for. Stop and ClearStop don't come this way: they go to the stop socket, which is read first."""

    ENABLE = 1
    DISABLE = 2
    START = 3
    CANCEL = 4
    """`action`; the outcome is `cancelled`"""
    PAUSE = 5
    RESUME = 6
    LOSE_OWNER = 7
    """cancel every running action of `owner`; the outcome is `owner_lost`"""
    HOLD_TIME = 8
    """`owner`, `value` s of wall time at most (lock-step only)"""
    RELEASE_TIME = 9
    DEVICE = 10
    """`device` follows `device_values`; a gripper's enable column is the loop's business"""
    PREPARE = 16
    """make the controller of an encoded motion (payload), which takes a while; without payload: is that of `action` there?"""
    STREAM = 17
    """`action` takes a streamed reference (payload)"""
    RELAY = 11
    """`device` switches its relay: `device_values` are (1: close it, 1: though the robot is enabled)"""
    LOAD = 12
    """the payload is a LoadController as JSON, which the loop does not read"""
    CONFIGURE = 13
    """`controllers[1]` is made anew; the payload is a ConfigureController as JSON"""
    SWITCH = 14
    """the slots `controllers[0]` come and `controllers[1]` go (bit masks), in one cycle or not at all"""
    UNLOAD = 15
    """`controllers[1]` is forgotten"""
    BEHAVIOUR = 20
    """as START, with several steps in the payload"""
    BIND_KEEPALIVE = 21
    """`owner` must be heard every `value` s of the robot's clock from now on; 0: he need not any more"""
    KEEP_ALIVE = 22
    """`owner` was heard"""
    TARE = 23
    """the force-torque sensor `device` forgets its offset; asked again and again until the answer is another than TARING"""
    STREAM_JOINTS = 24
    """`action` takes a sample of joint references (payload: positions, velocities), of which `value` is the number"""
    SET_SPEED = 25
    """`action`, 0: every one, runs at the share `value` of its planned speed from now on"""


@enum.unique
class Answer(enum.IntEnum):
    """The loop's word on a command. `explain` says it for people."""

    NONE = 0
    ACCEPTED = 1
    NOT_ENABLED = 2
    STOP_LATCHED = 3
    CLAIMED = 4
    """`answer_joint` is claimed by another running action"""
    START_OFF = 5
    """the first knot of `answer_joint` is `answer_value` rad from what the robot is commanded"""
    EXPIRED = 6
    NO_SUCH_ACTION = 7
    TOO_MANY = 8
    """all action slots, or all holds, are taken"""
    DRIVE_FAULT = 9
    """the drive of `answer_joint` does not reach operation enabled"""
    MALFORMED = 10
    DEVICE_SILENT = 11
    """the device of row `answer_joint` does not answer"""
    PROTOCOL_MISMATCH = 12
    """the drive of `answer_joint` speaks version `answer_value` of its protocol"""
    ENABLED = 13
    PROTOCOL_UNKNOWN = 14
    """the drive of `answer_joint` does not say which version of its protocol it speaks"""
    CONTROLLER_STATE = 15
    """the controller in slot `answer_value` is not in a state in which that can be done"""
    CHAIN_BROKEN = 16
    """the controller in slot `answer_value` commands references of one that would not be active, or not on `answer_joint`"""
    NOT_ACTIVATED = 17
    """a controller raised an exception when it should take over"""
    ROSTER_CHANGED = 18
    """other controllers are loaded than the caller knew of"""
    KEEPALIVE_LOST = 22
    """the owner is bound by a keepalive, and has not answered it in time (or, of a keepalive, it binds nobody)"""
    ISOLATED = 19
    """the limb of `answer_joint` is out of the robot, since one of its drives failed"""
    NOT_READY = 20
    """the controller is still being made"""
    NO_SUCH_REFERENCE = 21
    TOO_CLOSE = 23
    """the guard has stopped the robot, and nobody has acknowledged it"""
    TARING = 24
    """the sensor of row `answer_joint` is being listened to"""
    MOVING = 25
    """`answer_joint` moves by `answer_value` rad/s"""
    TOUCHED = 26
    """the joints feel `answer_value` N on what the sensor of row `answer_joint` carries"""
    NOT_STANDING = 28
    """foot `answer_joint` of the description, which the motion stands on, does not hold"""
    TWISTED = 27
    """likewise N·m"""


@enum.unique
class Rule(enum.IntEnum):
    """The safety rules, the strongest first: rows of the snapshot's `safety`. daemon.safety.table says them for people."""

    OPERATOR_STOP = 0
    KEEPALIVE = 1
    """an owner who must answer every `limit` s had been silent for `value` s"""
    NO_COMMAND = 2
    """no set-point of `joint` could be written, not even to hold it"""
    PROTOCOL = 3
    """the drive of `joint` speaks another version of its protocol"""
    DRIVE_FAULT = 4
    """the drive of `joint` left operation enabled, or is silent"""
    BALANCE = 5
    """its capture point was `value` m outside the feet that hold; infinite: none does, or nobody knows"""
    SELF_COLLISION = 6
    """the link of row `joint` in `frame_names` was `value` m from that of row `other`"""
    WORKSPACE = 7
    """the link of row `joint` in `frame_names` was `value` m from region `other` of the robot's file"""
    NOT_FINITE = 8
    """a controller's set-point of `joint` was no finite number"""
    HELD_BACK = 9
    """the limits held `joint` back by `value` rad"""
    STALE = 10
    """the state of `joint` was `value` cycles old"""
    DIVERGED = 11
    """`joint` was `value` rad from its command"""
    OWNER_LOST = 12
    EXPIRED = 13
    """a command came `value` s after it expired"""
    POSITION = 14
    """these cut set-points, and nothing else: `value` was asked for, `limit` allowed"""
    VELOCITY = 15
    TORQUE = 16
    TORQUE_RATE = 17
    GAIN = 18


CONTROLLERS = (
    "",
    "hold",
    "joint_trajectory",
    "cartesian_impedance",
    "user",
    "compliant_motion",
    "whole_body",
    "brake",
    "joint_stream",
    "joint_target",
    "damp",
)
"""Names of the codes in the snapshot's `claims`; 0: nobody commands this."""
LOADED_CODE = 64
"""Likewise: from here on, the slots of the controllers that were loaded by name."""

_END = np.dtype(
    [("kind", "u1"), ("has_axis", "u1"), ("frame", "i2"), ("value", "f8"), ("within", "f8"), ("axis", "f8", 3)],
    align=True,
)

CONTROLLER_CHANGE = np.dtype(
    [
        (
            "why",
            "u1",
        ),  # Outcome that took it out of service, DONE: it was switched off; NONE: it is active, or was made anew
        ("joint", "i2"),  # that this was about, -1: none
        ("value", "f8"),  # rad off, or cycles old
        ("time_ns", "i8"),  # robot's clock, of its last change of state
        ("cycle", "i8"),
    ],
    align=True,
)

SAFETY = np.dtype(
    [
        ("holds", "u1"),  # the rule holds the robot (or cuts its command) now
        ("joint", "i2"),  # the joint (of guards: the link) that it was about when it tripped last, -1: none
        ("other", "i2"),  # of guards: what it came too near to
        ("times", "i8"),  # that it has tripped, since the loop's start
        ("time_ns", "i8"),  # robot's clock, when it tripped last
        ("value", "f8"),
        ("limit", "f8"),
    ],
    align=True,
)

COMMAND = np.dtype(
    [
        ("serial", "u8"),
        ("kind", "u4"),
        ("owner", "u4"),  # number that the server gives each owner, never 0
        ("action", "u8"),  # CANCEL, PAUSE, RESUME, SET_SPEED, STREAM…: of the START; START, PREPARE: of a PREPARE;
        # CONFIGURE, SWITCH, UNLOAD: roster meant
        ("value", "f8"),  # HOLD_TIME: limit s; START: hold_after_s; STREAM_JOINTS: sequence; SET_SPEED: share
        ("expires_ns", "i8"),
        ("motion", "u4"),
        ("joint_count", "u4"),
        ("knot_count", "u4"),
        ("end_count", "u4"),
        ("joints", "i2", MAX_JOINTS),
        ("frame", "i4"),  # index into frame_names(); path force or Cartesian motion; -1: none
        ("gain", "f8"),
        ("limit", "f8"),
        ("goal", "f8", 7),  # position m, quaternion x y z w
        ("duration", "f8"),
        ("stiffness", "f8", 2),
        ("ends", _END, MAX_ENDS),
        (
            "then",
            "i2",
            MAX_ENDS + 1,
        ),  # of a behaviour's step: row of the one that follows `done`, each of `ends`; -1: none
        ("step_count", "u4"),  # BEHAVIOUR
        ("most_steps", "u4"),
        ("device", "i4"),  # DEVICE, RELAY: row in RobotDescription.devices
        ("device_values", "f8", COMMANDED),
        ("controllers", "u4", 2),  # SWITCH, CONFIGURE, UNLOAD: bit masks of slots, those that come and those that go
        ("payload_length", "u8"),  # float64s that follow
    ],
    align=True,
)
"""A command's header. As float64 follow a trajectory's knots, times (k), positions (k·m), velocities (k·m); of a compliant motion
what `daemon.exchange.commands` says; of text, its bytes; of a behaviour, each step's header and its payload."""


def snapshot_dtype(description: RobotDescription) -> np.dtype:
    """The record that the loop writes in every cycle, for one robot."""
    n, channels, devices = len(description.joints), len(description.channels), len(description.devices)
    feet = len(description.feet)
    action = np.dtype(
        [
            ("serial", "u8"),  # of the START; 0: never used
            ("owner", "u4"),
            ("state", "u1"),
            ("outcome", "u1"),
            ("condition", "i2"),
            ("joint", "i2"),  # the joint that it was about, -1: none
            ("value", "f8"),  # the number that tripped: s, m, N, rad or a share
            ("detail", "S160"),  # UTF-8: what else there is to say of its end
            ("cycle", "i8"),  # of the last change of state
            ("time_ns", "i8"),
            ("step", "i2"),  # of a behaviour: the one that it is in
            ("before", "i2"),  # the one before, which ended with `outcome`; -1: none
            ("steps_taken", "u4"),  # 0: no behaviour
            ("path_force", "f8"),  # N
            ("progress", "f8"),  # s along the path
            ("speed", "f8"),  # share of what is planned that it runs at, or comes to
            ("position", "f8", n),  # rad, measured in the cycle of the last change of state
            ("command", "f8", n),  # rad, what was written in that cycle
        ],
        align=True,
    )
    return np.dtype(
        [
            # What the loop counts (daemon.exchange.snapshot writes it as one, as it does with the blocks below).
            ("cycle", "i8"),
            ("time_ns", "i8"),  # robot's clock
            ("misses", "i8"),  # periods skipped
            ("stale_replies", "i8"),
            ("crc_errors", "i8"),
            ("limited", "i8"),  # cycles in which the final limits changed a command
            ("work_ns", "i8"),  # of this cycle, until its frames were sent
            ("late_ns", "i8"),
            ("flags", "i8"),
            # hal.joint.JointState.memory
            ("position", "f8", n),
            ("velocity", "f8", n),
            ("torque", "f8", n),
            ("temperature", "f8", n),
            ("age", "i8", n),  # cycles ago that the command was sent which the drive's last valid reply answers
            ("measured_ns", "i8", n),  # on the clock of whoever runs the bus
            ("status", "u2", n),  # CiA 402 statusword
            ("error", "u1", n),
            ("sequence", "u1", n),
            # hal.joint.JointCommand.memory, as written
            ("command", "f8", (len(COMMAND_ROWS), n)),
            ("mode", "u1", n),
            # hal.device.DeviceState.memory
            ("device_values", "f8", (devices, MEASURED)),  # hal.device's measured columns
            ("device_age", "i8", devices),  # cycles since the device's last valid frame
            ("device_measured_ns", "i8", devices),
            # daemon.state.base_state.BaseState.memory
            ("base_pose", "f8", 7),  # position m, quaternion x y z w, in the world
            ("base_twist", "f8", 6),  # m/s, rad/s, the base's own axes
            ("base_sigma", "f8", 2),  # m, rad
            ("foot_force", "f8", (feet, 3)),  # N, world axes
            ("base_since_ns", "i8"),  # robot's clock
            ("base_source", "i8"),  # BaseSource
            ("base_trouble", "i8"),  # Trouble
            ("foot_contact", "i8", feet),  # 1: it holds
            # What each drive said of itself; NaN: not yet.
            ("protocol_version", "f8", n),
            ("firmware_version", "f8", n),
            ("claims", "u1", (len(COMMAND_ROWS), n)),  # who commands it: index into CONTROLLERS, or LOADED_CODE + slot
            ("controller_states", "u1", MAX_LOADED),
            ("controller_changes", CONTROLLER_CHANGE, MAX_LOADED),  # how each came to its state
            ("speed", "f8"),  # share of what is planned that every action runs at
            ("roster", "i8"),  # which list of loaded controllers (daemon.controllers.roster) these states are about
            ("external_force", "f8", 3),
            ("stop_reason", "S256"),  # UTF-8
            ("safety", SAFETY, len(Rule)),
            ("holds", "u4", MAX_HOLDS),  # owners that hold simulated time, 0: none
            ("answered", "u8"),  # serial of the last command handled
            ("answer", "u1"),
            ("answer_joint", "i2"),
            ("answer_value", "f8"),
            ("actions", action, SLOTS),
            ("frames_sent", "i8", channels),
            ("frames_received", "i8", channels),
            ("busy_ns", "i8", channels),  # bus time in use since the start, both directions
        ],
        align=True,
    )


def frame_names(description: RobotDescription) -> tuple[str, ...]:
    """Frames that a command may name: the URDF's links in the file's order, then the arms' tools and tips that are no links.

    Loop and server make the same table, so an index says it all and the server needs no pinocchio.
    """
    names = [link.attrib["name"] for link in ElementTree.parse(description.urdf).getroot().iter("link")]
    for arm in description.arms.values():
        names += [frame for frame in (arm.tool, arm.tip) if frame not in names]
    return tuple(names)


class StateWriter(Protocol):
    """The loop's end of the ring (daemon.exchange.ring.StateRingWriter)."""

    record: np.ndarray
    """snapshot_dtype, shape (): filled by the loop"""

    def publish(self) -> int:
        """Let readers see a copy of `record`; never blocks."""


class CommandReader(Protocol):
    """The loop's end of the mailbox (daemon.exchange.mailbox.MailboxReader)."""

    def take(self) -> tuple[np.ndarray, NDArray[np.float64]] | None:
        """(header COMMAND shape (1,), payload) of the oldest waiting command, valid until `done`; None when none waits."""

    def done(self) -> None:
        """Give the command taken last back."""
