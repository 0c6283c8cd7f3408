"""Snapshots, turned by the server into the messages that clients see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal

import numpy as np

from daemon.exchange.records import COMMAND_ROWS, CONTROLLERS, ActionState, Answer, Flag, Outcome
from daemon.state.base_state import PROBLEMS, BaseSource, Trouble
from handrail.messages import (
    FIRST_KNOT,
    NOT_READY,
    NOT_STANDING,
    ActionEvent,
    Base,
    EndCondition,
    Foot,
    Pose,
    RobotState,
)
from handrail.robot.description import RobotDescription

_NO_PROBLEMS: Mapping[str, str] = MappingProxyType({})
_NO_NAMES: Mapping[int, str] = MappingProxyType({})


def robot_state(snapshot: np.ndarray, feet: Sequence[str] = ()) -> RobotState:
    """The snapshot (shape ()) as the message that clients see. `feet`: the description's, by name."""
    force = snapshot["external_force"]
    return RobotState(
        time_ns=int(snapshot["time_ns"]),
        cycle=int(snapshot["cycle"]),
        position=snapshot["position"].tolist(),
        velocity=snapshot["velocity"].tolist(),
        torque=snapshot["torque"].tolist(),
        command=snapshot["command"][0].tolist(),
        external_force=(float(force[0]), float(force[1]), float(force[2])),
        base=None if snapshot["base_source"] == BaseSource.FIXED else base(snapshot, feet),
    )


def base(snapshot: np.ndarray, feet: Sequence[str] = ()) -> Base:
    """Where the robot's base is, and what its feet do."""
    source, sigma = BaseSource(int(snapshot["base_source"])), snapshot["base_sigma"].tolist()
    x, y, z, *orientation = snapshot["base_pose"].tolist()
    twist = snapshot["base_twist"].tolist()
    rows = zip(feet, snapshot["foot_contact"].tolist(), snapshot["foot_force"].tolist(), strict=True)
    return Base(
        time_ns=int(snapshot["time_ns"]),
        pose_in_world=Pose(position=(x, y, z), orientation=tuple(orientation)),
        linear_velocity=tuple(twist[:3]),
        angular_velocity=tuple(twist[3:]),
        position_deviation=sigma[0],
        orientation_deviation=sigma[1],
        source=source.name.lower(),  # type: ignore[arg-type]
        problem=PROBLEMS[Trouble(int(snapshot["base_trouble"]))],
        since_ns=int(snapshot["base_since_ns"]),
        feet=[Foot(name=name, holds=bool(holds), force=tuple(force)) for name, holds, force in rows],
    )


def active_controllers(
    snapshot: np.ndarray, joints: Sequence[str], loaded: Mapping[int, str] = _NO_NAMES
) -> dict[str, list[str]]:
    """Active controller → the joints of which it claims something. `loaded`: code → name of those that were loaded by name,
    without which they are left out."""
    names = {**{code: name for code, name in enumerate(CONTROLLERS) if name}, **loaded}
    claims = snapshot["claims"]
    found = {names[code]: (claims == code).any(axis=0) for code in np.unique(claims).tolist() if code in names}
    return {name: [joints[row] for row in np.flatnonzero(rows).tolist()] for name, rows in found.items()}


def claimed_interfaces(snapshot: np.ndarray, code: int) -> list[str]:
    """What a controller claims of at least one joint, of COMMAND_ROWS."""
    return [row for row, claimed in zip(COMMAND_ROWS, (snapshot["claims"] == code).any(axis=1), strict=True) if claimed]


def isolated_limbs(snapshot: np.ndarray, description: RobotDescription) -> list[str]:
    """Limbs of an enabled robot that are out of it: nobody commands their joints."""
    if Flag.ISOLATED not in Flag(int(snapshot["flags"])):
        return []
    out = set(description.limb_of_joint[(snapshot["claims"] == 0).all(axis=0)].tolist())
    return [limb.name for row, limb in enumerate(description.limbs) if row in out]


def how_it_went(change: np.ndarray | np.void, joints: Sequence[str]) -> str:
    """Why a controller that was active is inactive (CONTROLLER_CHANGE), and what to do; "": nothing took it out of service."""
    joint, value = (joints[int(change["joint"])] if change["joint"] >= 0 else "a joint"), float(change["value"])
    told = {
        Outcome.DONE: "switched off",
        Outcome.CANCELLED: "the robot was disabled: enable it, and switch it on again",
        Outcome.STOPPED: "the operator stop: clear it, enable the robot, and switch it on again",
        Outcome.OWNER_LOST: "a keepalive was not answered and every drive stopped: enable the robot, and switch it on again",
        Outcome.REFUSED_BY_LIMITS: f"{joint} could not even be held (handrail safety explain): enable the robot, and switch it on "
        "again",
        Outcome.DRIVE_FAULT: f"the drive of {joint} was lost, which ends every controller, and its limb is held by nobody until "
        "the robot is enabled again (handrail safety explain); then switch it on again",
        Outcome.STALE_STATE: f"{joint} had not been measured for {value:.0f} cycles: see to the bus (handrail hardware status), "
        "and switch it on again",
        Outcome.TOO_CLOSE: "bodies came too near to each other, or to a region (handrail safety explain): enable the robot, which "
        "acknowledges it, and switch it on again",
        Outcome.BALANCE_LOST: "the robot fell (handrail safety explain): stand it up, enable it, and switch it on again",
        Outcome.DIVERGED: f"{joint} was {value:.3f} rad from its command: see what holds the joint, and switch it on again",
        Outcome.CONTROLLER_ERROR: "the controller whose references it commands was taken out of service: see to that one, and "
        "switch both on again",
    }
    return told.get(Outcome(int(change["why"])), "")


def action_event(
    slot: np.ndarray | np.void,
    action_id: str,
    ends: Sequence[EndCondition],
    joints: Sequence[str],
    problems: Mapping[str, str] = _NO_PROBLEMS,
    steps: Sequence[tuple[str, Sequence[EndCondition]]] = (),
) -> ActionEvent:
    """A slot of a snapshot as an event; `action_id` and `ends` are those of the StartAction with the slot's serial.

    `problems`: joint → what is wrong with its drive (daemon.serving.drive_reports); `steps`: of a behaviour, name and ends of each.
    """
    state = ActionState(int(slot["state"]))
    step, before = int(slot["step"]), int(slot["before"])
    name = steps[step][0] if steps else ""
    if state is not ActionState.ENDED:
        word: Literal["running", "paused"] = "paused" if state is ActionState.PAUSED else "running"
        how = ""
        if steps and before >= 0:
            text, detail = _how_it_ended(slot, steps[before][1], joints, problems)
            how = f"{steps[before][0]}: {detail or text}"
        if waiting := bytes(slot["detail"]).decode(errors="replace"):
            how = f"{how} {waiting}".strip()
        return ActionEvent(
            id=action_id,
            state=word,
            time_ns=int(slot["time_ns"]),
            cycle=int(slot["cycle"]),
            step=name,
            detail=how,
            speed=float(slot["speed"]),
        )
    text, detail = _how_it_ended(slot, steps[step][1] if steps else ends, joints, problems)
    return ActionEvent(
        id=action_id,
        state="ended",
        step=name,
        outcome=text,
        detail=detail,
        time_ns=int(slot["time_ns"]),
        cycle=int(slot["cycle"]),
        position=slot["position"].tolist(),
        command=slot["command"].tolist(),
        path_force=float(slot["path_force"]),
        speed=float(slot["speed"]),
    )


def _how_it_ended(
    slot: np.ndarray | np.void, ends: Sequence[EndCondition], joints: Sequence[str], problems: Mapping[str, str]
) -> tuple[str, str]:
    """(outcome, detail) of an action, or of a behaviour's step, with these end conditions."""
    outcome = Outcome(int(slot["outcome"]))
    text = outcome.name.lower()
    detail = ""
    if outcome is Outcome.CONDITION:
        end = ends[int(slot["condition"])]
        text = str(end.__struct_config__.tag)
        detail = f"ends[{int(slot['condition'])}]: {text} reached {float(slot['value']):.4g}"
    elif outcome is Outcome.STEP_REFUSED and slot["joint"] >= 0:
        detail = f"the next step starts {float(slot['value']):.4g} rad from what the robot is commanded"
    elif outcome is Outcome.STREAM_LOST:
        detail = f"nothing had been streamed for {float(slot['value']):.2f} s"
    elif outcome is Outcome.TOO_MANY_STEPS:
        detail = f"{float(slot['value']):.0f} steps taken"
    if slot["joint"] >= 0:
        joint = joints[int(slot["joint"])]
        detail = f"{detail} at {joint}".strip()
        if outcome is Outcome.DRIVE_FAULT and joint in problems:
            detail = f"{detail}: {problems[joint]}"
    if said := bytes(slot["detail"]).decode(errors="replace"):
        detail = f"{detail} {said}".strip()
    return text, detail


NOT_ENABLED = ("the robot is not enabled: enable it first (Enable, or handrail enable)", "enabled", "false", "true")
"""message, field, value, expectation"""


def explain(
    answer: Answer, joint: str, value: float, problem: str = "", controller: str = ""
) -> tuple[str, str, str, str]:
    """(message, field, value, expectation) of a command that the loop did not accept.

    `joint`: that of `answer_joint`, or the device, or ""; `problem`: what is wrong with its drive, if anything; `controller`: the
    one in slot `answer_value`.
    """
    told = {
        Answer.ENABLED: (
            f"the robot is enabled: Disable first, or `force` it; the drives lose their power when {joint} opens its relay",
            "enabled",
            "true",
            "false",
        ),
        Answer.NOT_ENABLED: NOT_ENABLED,
        Answer.STOP_LATCHED: (
            "the operator stop is latched: clear it first (ClearStop, or handrail stop --clear)",
            "stopped",
            "true",
            "false",
        ),
        Answer.CLAIMED: (
            f"{joint} is claimed by a running action or an active controller",
            "joints",
            joint,
            "joints that nobody else claims",
        ),
        Answer.CONTROLLER_STATE: (
            f"the state of controller {controller} does not allow that (handrail controllers list): what is inactive can be "
            "activated, what is active deactivated; what is neither active nor needed by an active one, configured and unloaded",
            "state",
            controller,
            "another state",
        ),
        Answer.CHAIN_BROKEN: (
            f"controller {controller} commands another one's references, which is not active or has none "
            f"for {joint or 'it'}: activate both in one switch, deactivate both in one switch",
            "onto",
            controller,
            "a controller with references for all its joints, active after the switch",
        ),
        Answer.NOT_ACTIVATED: (
            f"{controller or 'its controller'} raised an exception when it should take over; nothing was switched "
            "(handrail controllers list, or the ControllerEvent, has the traceback)",
            "state",
            controller,
            "a controller that can be activated",
        ),
        Answer.ROSTER_CHANGED: (
            "controllers were loaded, configured or unloaded meanwhile: look again (handrail controllers list)",
            "roster",
            "old",
            "the present one",
        ),
        Answer.START_OFF: (
            f"the trajectory does not start where the robot is commanded to be: plan again ({joint})",
            FIRST_KNOT,
            f"{value:.4f} rad off",
            "within 0.02 rad of the command",
        ),
        Answer.EXPIRED: ("the command came after it expired", "expires_ns", f"{value:.3f} s ago", "in the future"),
        Answer.NO_SUCH_ACTION: ("no such action is running", "id", "", "a running action"),
        Answer.TOO_MANY: ("too many at once: end one first", "count", "", "a free slot"),
        Answer.DRIVE_FAULT: (
            f"the drive of {joint} does not enable{problem and ': '}{problem}",
            "drive",
            joint,
            "a drive without fault",
        ),
        Answer.KEEPALIVE_LOST: (
            "the owner's keepalive was not answered in time, or there is none: answer it, or bind it anew",
            "owner",
            "",
            "one who answers in time",
        ),
        Answer.ISOLATED: (
            f"the limb of {joint} is out of the robot, since a drive of it failed{problem and ': '}{problem}; remove the cause, "
            f"then Enable (`handrail safety explain`)",
            "motion.joints",
            joint,
            "joints of limbs that are not isolated",
        ),
        Answer.PROTOCOL_MISMATCH: (
            f"the drive of {joint} speaks another version of its protocol: update its firmware, or Handrail "
            f"(`handrail drives info` lists what each drive says of itself)",
            "protocol_version",
            f"{value:g}",
            "the version of its family (hal/drives)",
        ),
        Answer.PROTOCOL_UNKNOWN: (
            f"the drive of {joint} does not say which version of its protocol it speaks: update its firmware, or give a family "
            f"whose drives answer no parameter requests no protocol_version (docs/drives.md); it is asked again all the while",
            "protocol_version",
            "no answer",
            "an answer to a ParameterRequest for it",
        ),
        Answer.DEVICE_SILENT: (f"{joint} does not answer", "device", joint, "a device that answers"),
        Answer.NOT_READY: (
            "the controller is still being made: the first one of an installation is compiled, which takes a minute or two "
            "(`make setup` does it ahead); call again",
            "motion",
            NOT_READY,
            "a controller that is ready",
        ),
        Answer.NOT_STANDING: (
            f"the {joint} foot does not hold, on which the motion stands (handrail daemon base): call again once it does",
            "motion.compound",
            NOT_STANDING,
            "feet that all hold",
        ),
        Answer.NO_SUCH_REFERENCE: (
            "nothing of this action is streamed under that name, or the pose is not finite",
            "task",
            "",
            "the name of a task with a streamed reference",
        ),
        Answer.TOO_CLOSE: (
            "the guard has stopped a motion before bodies met, or a region: see what (`handrail safety explain`), Enable to "
            "acknowledge it, then move away",
            "guard",
            "stopped",
            "acknowledged",
        ),
        Answer.TARING: (
            f"the robot's clock goes too slowly: {joint} is still being listened to; call again",
            "sensor",
            joint,
            "0.4 s of the robot's time",
        ),
        Answer.MOVING: (
            f"the robot moves: a sensor is tared while all of it stands ({joint})",
            "velocity",
            f"{value:.3f} rad/s",
            "at most 0.05 rad/s of every joint",
        ),
        Answer.TOUCHED: (
            f"something touches what {joint} carries, as the joints feel it: let it go first",
            "force",
            f"{value:.1f} N",
            "at most 5 N",
        ),
        Answer.TWISTED: (
            f"something twists what {joint} carries, as the joints feel it: let it go first",
            "torque",
            f"{value:.2f} N·m",
            "at most 1 N·m",
        ),
        Answer.MALFORMED: ("the loop could not read the command", "command", "", "a well-formed command"),
    }
    return told.get(answer, (f"the loop answered {answer.name.lower()}", "", "", ""))
