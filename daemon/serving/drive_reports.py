"""What is wrong with each joint's drive, in words: its own fault, or that it does not answer, and on which channel."""

from __future__ import annotations

import numpy as np

from hal.drives.lifecycle import NO_NUMBER, DriveError, State, decode_statusword
from handrail.messages import DriveStatus
from handrail.robot.description import RobotDescription

_SILENT_CYCLES = 10
"""without an answer, after which people are shown `unknown`; the loop goes on until hal.hardware.LOST_AFTER"""

_UNHEARD = "stopped by its watchdog: no command had come in time; was the loop late (`handrail daemon stats`)?"

_STATES = {state.value: state.name.lower() for state in State}
_ERRORS = {error.value: error.name.lower() for error in DriveError}


def drive_states(snapshot: np.ndarray | np.void) -> list[str]:
    """Each drive's CiA 402 state in words; `unknown` for one that does not answer."""
    states = decode_statusword(snapshot["status"]).tolist()
    silent = (snapshot["age"] > _SILENT_CYCLES).tolist()
    return ["unknown" if quiet else _STATES[state] for state, quiet in zip(states, silent, strict=True)]


def drive_marks(snapshot: np.ndarray | np.void) -> bytes:
    """The same at a glance: differs where `drive_states` does."""
    return (snapshot["status"] & 0x7F).tobytes() + (snapshot["age"] > _SILENT_CYCLES).tobytes()


def drive_statuses(snapshot: np.ndarray | None, description: RobotDescription) -> list[DriveStatus]:
    """Every drive, with its problem; None: no loop tells."""
    if snapshot is None:
        return [DriveStatus(joint=joint, state="unknown") for joint in description.joints]
    told = zip(description.joints, drive_states(snapshot), snapshot["error"], snapshot["temperature"], strict=True)
    problems = drive_problems(snapshot, description)
    return [
        DriveStatus(
            joint=joint, state=state, error=int(error), temperature=float(heat), problem=problems.get(joint, "")
        )
        for joint, state, error, heat in told
    ]


def drive_problems(snapshot: np.ndarray | np.void, description: RobotDescription) -> dict[str, str]:
    """Joint → what is wrong with its drive, for those with which something is."""
    silent = snapshot["age"] > _SILENT_CYCLES
    states = decode_statusword(snapshot["status"])
    faulty = ~silent & (states == State.FAULT)
    problems = {
        description.joints[row]: f"fault: {_name(int(snapshot['error'][row]))}" for row in np.flatnonzero(faulty)
    }
    unheard = ~silent & (states == State.QUICK_STOP_ACTIVE) & (snapshot["error"] == DriveError.WATCHDOG)
    problems |= {description.joints[row]: _UNHEARD for row in np.flatnonzero(unheard)}
    if not silent.any():
        return problems
    rows = {joint: row for row, joint in enumerate(description.joints)}
    for channel in description.channels:
        there = [joint for limb in description.limbs if limb.channel == channel.name for joint in limb.joints]
        quiet = [joint for joint in there if silent[rows[joint]]]
        alone = "" if len(quiet) < len(there) else ", nor from any other drive there: is the bus connected and powered?"
        for joint in quiet:
            if snapshot["error"][rows[joint]] == NO_NUMBER:
                problems[joint] = "what it measures is no finite number: its answers are refused"
            else:
                problems[joint] = f"no answer on channel {channel.name} ({channel.interface}){alone}"
    return problems


def _name(error: int) -> str:
    return _ERRORS.get(error, f"error {error}")
