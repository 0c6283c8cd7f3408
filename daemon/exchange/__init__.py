"""What the daemon's loop and its server exchange: the snapshot that leaves each cycle, the commands that enter.

Both are fixed numpy records in shared memory, so that the loop never decodes a message. The server turns messages into commands
(`encode_start`, `encode_command`, ...) and snapshots into messages (`robot_state`, `action_event`, ...); the loop turns a command
into plain Python objects once (`decode`). Whoever carries them (daemon.ring, daemon.mailbox) satisfies the protocols in `records`.

Every command has a serial number that the server counts up. The loop handles at most one command a cycle and writes a snapshot
that answers it (`answered`, `answer`), so the server may wait for the loop's word before it answers its caller.
"""

from daemon.exchange.commands import (
    MOTION_CARTESIAN,
    MOTION_TRAJECTORY,
    CartesianMotion,
    Command,
    MotionCommand,
    TaskFrameMotion,
    TrajectoryMotion,
    decode,
    encode_command,
    encode_controllers,
    encode_device,
    encode_start,
)
from daemon.exchange.records import (
    COMMAND,
    COMMAND_ROWS,
    CONTROLLERS,
    LOADED_CODE,
    MAX_ENDS,
    MAX_HOLDS,
    MAX_JOINTS,
    MAX_LOADED,
    SAFETY,
    SLOTS,
    ActionState,
    Answer,
    CommandReader,
    ControllerState,
    Flag,
    Kind,
    Outcome,
    Rule,
    StateWriter,
    frame_names,
    snapshot_dtype,
)
from daemon.exchange.reports import (
    action_event,
    active_controllers,
    claimed_interfaces,
    explain,
    isolated_limbs,
    robot_state,
)

__all__ = [
    "COMMAND",
    "COMMAND_ROWS",
    "CONTROLLERS",
    "LOADED_CODE",
    "MAX_ENDS",
    "MAX_HOLDS",
    "MAX_JOINTS",
    "MAX_LOADED",
    "MOTION_CARTESIAN",
    "MOTION_TRAJECTORY",
    "SAFETY",
    "SLOTS",
    "ActionState",
    "Answer",
    "CartesianMotion",
    "Command",
    "CommandReader",
    "ControllerState",
    "Flag",
    "Kind",
    "MotionCommand",
    "Outcome",
    "Rule",
    "StateWriter",
    "TaskFrameMotion",
    "TrajectoryMotion",
    "action_event",
    "active_controllers",
    "claimed_interfaces",
    "decode",
    "encode_command",
    "encode_controllers",
    "encode_device",
    "encode_start",
    "explain",
    "frame_names",
    "isolated_limbs",
    "robot_state",
    "snapshot_dtype",
]
