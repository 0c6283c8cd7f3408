"""What is wrong with a StartAction (or a device's command), found before the loop sees it: shapes, numbers, limits, names, start.

What only the loop can know in the cycle that starts the action (claims, a stop a moment ago) the loop checks itself.
"""

from __future__ import annotations

import contextlib
import difflib
import math
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import msgspec
import numpy as np

from daemon.controllers.roster import Loaded, Roster
from daemon.exchange import COMMAND, CONTROLLERS, MAX_ENDS, Flag
from daemon.exchange.reports import NOT_ENABLED
from handrail.messages import (
    FIRST_KNOT,
    CartesianImpedance,
    CommandGripper,
    Compliance,
    CompliantMotion,
    ContactEnd,
    Dither,
    EndCondition,
    ForceEnd,
    FrameKnots,
    GripperAtEnd,
    GripperHoldsEnd,
    GripperOrder,
    JointStream,
    JointTarget,
    JointTrajectory,
    LoadController,
    Motion,
    PoseErrorEnd,
    PostureKnots,
    StallEnd,
    StartAction,
    StartBehaviour,
    StepMotion,
    StreamJoints,
    StreamPose,
    SwitchRelay,
    TareSensor,
    TravelEnd,
    WholeBody,
)
from handrail.robot.description import RobotDescription
from handrail.topics import RefusedError, refuse

START_TOLERANCE = 0.02
"""rad from what the robot is commanded to the first knot"""
OVERSHOOT_POSITION = 5e-3
"""rad beyond a limit that the cubic between two knots may reach: the loop's final limits cut it"""
OVERSHOOT_VELOCITY = 0.05
"""share of the limit, likewise"""
FASTEST_DITHER = (0.25, 1.0)
"""m/s, rad/s of a dither's own motion"""


def check_start(
    message: StartAction,
    description: RobotDescription,
    frames: Collection[str],
    snapshot: np.ndarray,
    largest_payload: int,
) -> None:
    """Raise RefusedError unless the action may be given to the loop.

    `frames`: names that may be commanded; `snapshot`: the newest (exchange.snapshot_dtype, shape ()); `largest_payload`: room in
    the mailbox, in numbers.
    """
    _check_call(message, snapshot)
    if isinstance(message.motion, JointStream):
        _rows(message.motion.joints, description)
        for field in ("bridge", "expiry", "speed"):
            _check_finite(getattr(message.motion, field), f"motion.{field}")
        _check_ends(message.ends, description, frames)
        return
    _check_action(message.motion, message.ends, description, frames, snapshot, largest_payload)
    if isinstance(message.motion, JointTrajectory):
        _check_first_knot(message.motion, snapshot["command"][0][_rows(message.motion.joints, description)])


def check_behaviour(
    message: StartBehaviour,
    description: RobotDescription,
    frames: Collection[str],
    snapshot: np.ndarray,
    largest_payload: int,
) -> dict[int, tuple[float, float, float]]:
    """Raise RefusedError unless the behaviour may be given to the loop; as `check_start`, with the step before the field.

    Returns what its steps order grippers: row of the step → position, velocity, effort.
    """
    _check_call(message, snapshot)
    names = [step.name for step in message.steps]
    orders = {}
    numbers = 0
    for number, step in enumerate(message.steps):
        place = f"steps[{number}]"
        with within(place):
            _check_action(step.motion, step.ends, description, frames, snapshot, largest_payload)
            if number == 0 and isinstance(step.motion, JointTrajectory):
                _check_first_knot(step.motion, snapshot["command"][0][_rows(step.motion.joints, description)])
            if step.gripper is not None:
                orders[number] = _check_order(step.gripper, description)
        if step.name in [*names[:number], "end"]:
            raise refuse("a step is called like another", f"{place}.name", step.name, "a name of its own, not `end`")
        moved = joints_of(step.motion, description)
        if set(moved) != set(joints_of(message.steps[0].motion, description)):
            field, expected = f"{place}.motion.joints", "those of steps[0]"
            raise refuse("each step moves the same joints", field, ", ".join(moved), expected)
        kinds = {str(end.__struct_config__.tag) for end in step.ends}
        ways = {"done", *kinds, *(f"ends[{row}]" for row in range(len(step.ends)))}
        for how, to in step.then.items():
            if how not in ways:
                raise refuse("the step can't end so", f"{place}.then", how, f"one of {', '.join(sorted(ways))}")
            if to not in names and to != "end":
                raise refuse("no such step", f"{place}.then.{how}", to, f"end, {', '.join(names)}")
        numbers += COMMAND.itemsize // 8 + _numbers(step.motion)
    if numbers > largest_payload:
        raise refuse("the behaviour is too long", "steps", f"{numbers} numbers", f"at most {largest_payload}")
    return orders


@contextlib.contextmanager
def within(place: str) -> Iterator[None]:
    """What is refused inside is about a part of the call: `place` stands before its field, where there is one."""
    try:
        yield
    except RefusedError as error:
        found = error.refusal
        raise refuse(found.message, f"{place}.{found.field}".lstrip("."), found.value, found.expected) from error


def joints_of(motion: Motion, description: RobotDescription) -> Sequence[str]:
    """The joints that it moves; a whole-body motion that names none moves all."""
    return motion.joints or (description.joints if isinstance(motion, WholeBody) else [])


def _check_order(order: GripperOrder, description: RobotDescription) -> tuple[float, float, float]:
    with within("gripper"):
        return check_gripper(CommandGripper(**msgspec.structs.asdict(order)), description)[1]


def _numbers(motion: StepMotion) -> int:
    """At most so many of the payload."""
    return len(motion.times) * (1 + 2 * len(motion.joints)) if isinstance(motion, JointTrajectory) else 64


def _check_call(message: StartAction | StartBehaviour, snapshot: np.ndarray) -> None:
    _check_state(snapshot)
    if not 0 <= message.expires_ns < 1 << 63:
        raise refuse("no time of the robot's clock", "expires_ns", message.expires_ns, "0 to 2⁶³ − 1 ns")
    if 0 < message.expires_ns < int(snapshot["time_ns"]):
        late = (int(snapshot["time_ns"]) - message.expires_ns) / 1e9
        raise refuse("the command has expired", "expires_ns", f"{late:.3f} s ago", "a time to come, or 0")
    _check_finite(message.hold_after_s, "hold_after_s")


def _check_action(
    motion: StepMotion,
    ends: Sequence[EndCondition],
    description: RobotDescription,
    frames: Collection[str],
    snapshot: np.ndarray,
    largest_payload: int,
) -> None:
    if isinstance(motion, WholeBody):
        if motion.joints:
            _rows(motion.joints, description)
        _check_finite(motion.duration, "motion.duration")  # the rest: daemon.serving.whole_body_door
        _check_ends(ends, description, frames)
        return
    rows = _rows(motion.joints, description)
    if isinstance(motion, JointTrajectory):
        commanded = snapshot["command"][0][rows]
        _check_trajectory(motion, rows, commanded, description, frames=frames, largest_payload=largest_payload)
    elif isinstance(motion, JointTarget):
        _check_finite(motion.speed, "motion.speed")
        _check_numbers(
            motion.positions, "motion.positions", motion.joints, description.lower[rows], description.upper[rows]
        )
    elif isinstance(motion, CompliantMotion):
        _check_compliant(motion, frames)
    else:
        _check_cartesian(motion, frames)
    _check_ends(ends, description, frames)


def _check_ends(ends: Sequence[EndCondition], description: RobotDescription, frames: Collection[str]) -> None:
    if len(ends) > MAX_ENDS:
        raise refuse("too many end conditions", "ends", len(ends), f"at most {MAX_ENDS}")
    for number, end in enumerate(ends):
        _check_end(end, f"ends[{number}]", frames)
        if isinstance(end, GripperHoldsEnd | GripperAtEnd):
            _device(end.gripper, "gripper", "gripper", description, f"ends[{number}].gripper")


def check_stream(message: StreamPose) -> None:
    """Raise RefusedError unless the loop may be given this streamed reference."""
    if message.position is not None:
        check_all_finite(np.array(message.position), "position")
    if message.orientation is not None:
        check_quaternion(message.orientation, "orientation")
    check_all_finite(np.array(message.velocity), "velocity")


def check_joints(message: StreamJoints, joints: Sequence[str], description: RobotDescription) -> None:
    """Raise RefusedError unless the loop may be given this sample for a motion of `joints`."""
    rows = description.index(tuple(joints))
    fastest = description.velocity_limit[rows]
    limits = (description.lower[rows], description.upper[rows]), (-fastest, fastest)
    for field, unit, (lowest, highest) in zip(("positions", "velocities"), ("rad", "rad/s"), limits, strict=True):
        values = getattr(message, field)
        if values or field == "positions":
            _check_numbers(values, field, joints, lowest, highest, unit)


def _check_numbers(
    numbers: Sequence[float],
    field: str,
    joints: Sequence[str],
    lowest: np.ndarray,
    highest: np.ndarray,
    unit: str = "rad",
) -> None:
    values = np.array(numbers, float)
    if len(values) != len(joints):
        raise refuse("one number a joint", field, f"{len(values)} numbers", f"{len(joints)}: {', '.join(joints)}")
    check_all_finite(values, field)
    if (beyond := np.flatnonzero((values < lowest - 1e-6) | (values > highest + 1e-6))).size:
        row = int(beyond[0])
        expected = f"{lowest[row]:g} to {highest[row]:g} {unit}"
        raise refuse(f"beyond the limits of {joints[row]}", f"{field}[{row}]", f"{values[row]:g}", expected)


def check_gripper(message: CommandGripper, description: RobotDescription) -> tuple[int, tuple[float, float, float]]:
    """(row in description.devices, position, velocity and effort to command). Raises RefusedError unless it can be done.

    Whether the robot is enabled and the gripper answers is the loop's to say.
    """
    row = _device(message.gripper, "gripper", "gripper", description)
    lower, upper, fastest, strongest = description.device_limits[description.devices[row].joint]
    for field, highest in (("velocity", fastest), ("effort", strongest)):
        value = getattr(message, field)
        _check_finite(value, field)
        if value > highest:
            raise refuse(f"beyond the limit of {message.gripper}", field, f"{value:g}", f"at most {highest:g}")
    _check_finite(message.position, "position")
    if not lower - 1e-6 <= message.position <= upper + 1e-6:
        raise refuse(
            f"beyond the limits of {message.gripper}", "position", f"{message.position:g}", f"{lower:g} to {upper:g}"
        )
    return row, (message.position, message.velocity or fastest, message.effort or strongest)


def check_power(message: SwitchRelay, description: RobotDescription) -> int:
    """Row in description.devices of the supply whose relay is meant. Raises RefusedError where there is none of that name.

    Whether the robot is enabled and the supply answers is the loop's to say.
    """
    return _device(message.power, "power", "power supply", description)


def check_sensor(message: TareSensor, description: RobotDescription) -> int:
    """Row in description.devices of the sensor to be tared. Raises RefusedError where there is none of that name."""
    return _device(message.sensor, "force_torque", "force-torque sensor", description, "sensor")


def check_load(
    message: LoadController,
    description: RobotDescription,
    roster: Roster,
    kinds: Collection[str],
    size: int,
    largest: int,
) -> None:
    """Raise RefusedError unless the workshop may be given this to load.

    `kinds`: that there are; `size`: of the message as JSON, bytes, of which there may be `largest`.
    """
    names = [entry.name for entry in roster.loaded]
    if message.name in (*names, *CONTROLLERS):
        raise refuse("a controller of this name is there already", "name", message.name, "a name of its own")
    if message.kind not in kinds:
        raise refuse("there is no such kind of controller", "kind", message.kind, nearest(message.kind, kinds))
    _rows(message.joints, description, "joints", "a controller claims")
    if size > largest:
        raise refuse("its parameters are too long", "parameters", f"{size} bytes", f"at most {largest}")
    if message.onto:
        onto = check_loaded(message.onto, "onto", roster)
        if not onto.references:
            able = [entry.name for entry in roster.loaded if entry.references]
            raise refuse("that one has no references", "onto", message.onto, f"one of {able}, or none")
        for place, joint in enumerate(message.joints):
            if joint not in onto.joints:
                raise refuse(
                    f"{message.onto} has no references for it",
                    f"joints[{place}]",
                    joint,
                    f"of {', '.join(onto.joints)}",
                )
    for place, name in enumerate(message.fallback):
        check_loaded(name, f"fallback[{place}]", roster)


def check_loaded(name: str, field: str, roster: Roster) -> Loaded:
    """The loaded controller of this name. Raises RefusedError where there is none."""
    for entry in roster.loaded:
        if entry.name == name:
            return entry
    names = [entry.name for entry in roster.loaded]
    raise refuse("no such controller is loaded", field, name, nearest(name, names) if names else "a loaded controller")


def _device(name: str, family: str, what: str, description: RobotDescription, field: str = "") -> int:
    """Row of a device of this family; `field`: of the message, left out it is called like the family."""
    known = {device.name: row for row, device in enumerate(description.devices) if device.family == family}
    if name not in known:
        expected = nearest(name, known) if known else f"a robot with a {what}"
        raise refuse(f"{description.name} has no such {what}", field or family, name, expected)
    return known[name]


def _check_state(snapshot: np.ndarray) -> None:
    flags = Flag(int(snapshot["flags"]))
    if Flag.STOPPED in flags:
        reason = bytes(snapshot["stop_reason"]).decode(errors="replace")
        raise refuse(
            f"the operator stop is latched ({reason}): ClearStop (or handrail stop --clear), then Enable",
            "stopped",
            "true",
            "false",
        )
    if Flag.ENABLED not in flags:
        raise refuse(*NOT_ENABLED)


def _rows(
    joints: Sequence[str], description: RobotDescription, within: str = "motion.joints", who: str = "an action moves"
) -> np.ndarray:
    if not joints:
        raise refuse(f"{who} at least one joint", within, "[]", "names of joints")
    for column, joint in enumerate(joints):
        field = f"{within}[{column}]"
        if joint not in description.joints:
            raise refuse(f"{description.name} has no such joint", field, joint, nearest(joint, description.joints))
        if joint in joints[:column]:
            raise refuse("a joint is named twice", field, joint, "each joint once")
    return description.index(tuple(joints))


def _check_trajectory(
    motion: JointTrajectory,
    rows: np.ndarray,
    commanded: np.ndarray,
    description: RobotDescription,
    *,
    frames: Collection[str],
    largest_payload: int,
) -> None:
    _check_path(motion, rows, commanded, description, at="motion", largest_payload=largest_payload)
    if motion.path_force is not None:
        _check_frame(motion.path_force.frame, "motion.path_force.frame", frames)
        _check_finite(motion.path_force.gain, "motion.path_force.gain")
        _check_finite(motion.path_force.limit, "motion.path_force.limit")


def check_knots(
    knots: PostureKnots, at: str, commanded: np.ndarray, description: RobotDescription, *, largest_payload: int
) -> None:
    """Raise RefusedError unless these knots of field `at` are within limits; `commanded`: (n,) rad, of all joints."""
    rows = _rows(knots.joints, description, f"{at}.joints")
    _check_path(knots, rows, commanded[rows], description, at=at, largest_payload=largest_payload)


def check_points(points: FrameKnots, at: str, *, largest_payload: int) -> None:
    """Raise RefusedError unless the knots of field `at` can be a frame's way."""
    times = _times(points.times, 3, at, largest_payload)
    _table(points.positions, f"{at}.positions", len(times), 3)
    _table(points.velocities, f"{at}.velocities", len(times), 3)


def _check_path(
    motion: JointTrajectory | PostureKnots,
    rows: np.ndarray,
    commanded: np.ndarray,
    description: RobotDescription,
    *,
    at: str,
    largest_payload: int,
) -> None:
    joints = len(motion.joints)
    times = _times(motion.times, joints, at, largest_payload)
    knots = len(times)
    positions = _table(motion.positions, f"{at}.positions", knots, joints)
    velocities = _table(motion.velocities, f"{at}.velocities", knots, joints)
    # A robot that stands a little beyond a limit (it sank there while its drives were stopped) may come back.
    lower, upper = np.minimum(description.lower[rows], commanded), np.maximum(description.upper[rows], commanded)
    fastest = description.velocity_limit[rows]
    slack = 1e-6  # of a planner's arithmetic
    place: dict[str, Any] = {"field": f"{at}.positions", "joints": motion.joints, "unit": "rad"}
    speed_place: dict[str, Any] = {"field": f"{at}.velocities", "joints": motion.joints, "unit": "rad/s"}
    _check_within(positions, lower - slack, upper + slack, **place)
    _check_within(velocities, -fastest - slack, fastest + slack, **speed_place)
    low, high, speed = hermite_extremes(times, positions, velocities)
    _check_between(low < lower - OVERSHOOT_POSITION, low, lower, **place)
    _check_between(high > upper + OVERSHOOT_POSITION, high, upper, **place)
    _check_between(speed > fastest * (1 + OVERSHOOT_VELOCITY), speed, fastest, **speed_place)


def hermite_extremes(
    times: np.ndarray, positions: np.ndarray, velocities: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest position (rad) and largest speed (rad/s) of the cubic Hermite spline between its knots.

    `times` (k,) s, `positions` and `velocities` (k, m); each result (k − 1, m). With s = (t − t₀)/h the spline's derivative by s
    is a s² + b s + c, so that the extremes lie at the ends and at its roots, those of speed at −b/2a.
    """
    h = np.diff(times)[:, None]
    p0, p1, v0, v1 = positions[:-1], positions[1:], h * velocities[:-1], h * velocities[1:]
    a = 6 * (p0 - p1) + 3 * (v0 + v1)
    b = -6 * (p0 - p1) - 4 * v0 - 2 * v1
    c = v0
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))
        straight = np.abs(a) < 1e-12
        corners = [np.where(straight, -c / b, (-b + sign * root) / (2 * a)) for sign in (1.0, -1.0)]
        fastest = -b / (2 * a)
    inner = [np.clip(np.nan_to_num(s, nan=0.0, posinf=0.0, neginf=0.0), 0.0, 1.0) for s in (*corners, fastest)]
    reached = [p0, p1] + [p0 + s * (c + s * (b / 2 + s * a / 3)) for s in inner[:2]]
    speeds = [np.abs(v0), np.abs(v1), np.abs(c + inner[2] * (b + inner[2] * a))]
    return np.minimum.reduce(reached), np.maximum.reduce(reached), np.maximum.reduce(speeds) / h


def _check_first_knot(motion: JointTrajectory, commanded: np.ndarray) -> None:
    off = np.abs(np.array(motion.positions[0]) - commanded)
    worst = int(off.argmax())
    if off[worst] > START_TOLERANCE:
        raise refuse(
            f"the trajectory does not start where {motion.joints[worst]} is commanded to be: plan again from there",
            f"{FIRST_KNOT}[{worst}]",
            f"{motion.positions[0][worst]:.4f} rad",
            f"within {START_TOLERANCE} of {commanded[worst]:.4f}",
        )


def check_quaternion(orientation: Sequence[float], field: str) -> None:
    """Raise RefusedError unless it is a unit quaternion."""
    quaternion = np.array(orientation)
    check_all_finite(quaternion, field)
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > 1e-3:
        raise refuse("no unit quaternion", field, f"norm {norm:.4g}", "norm 1")


def _check_compliant(motion: CompliantMotion, frames: Collection[str]) -> None:
    _check_cartesian(motion, frames)
    check_all_finite(np.array(motion.shift), "motion.shift")
    if motion.goal_in_world is not None and any(motion.shift):
        raise refuse(
            "one of goal_in_world and shift", "motion.shift", list(motion.shift), "0, 0, 0 with a goal_in_world"
        )
    check_quaternion(motion.axes, "motion.axes")
    _check_axes(motion.compliance, "motion.compliance")
    _check_axes(motion.dither, "motion.dither")
    for number, soft in enumerate(motion.compliance):
        own = motion.stiffness[soft.axis.startswith("r")]
        if 0.0 < soft.stiffness >= own:
            field = f"motion.compliance[{number}].stiffness"
            raise refuse("no softer than the motion's own spring", field, soft.stiffness, f"less than {own:g}")
    for number, swing in enumerate(motion.dither):
        field, linear = f"motion.dither[{number}]", not swing.axis.startswith("r")
        fastest, unit = (FASTEST_DITHER[0], "m/s") if linear else (FASTEST_DITHER[1], "rad/s")
        speed = 2.0 * math.pi * swing.amplitude * swing.frequency
        if speed > fastest:
            raise refuse(
                "it swings too fast", f"{field}.frequency", f"{speed:.3g} {unit}", f"at most {fastest:g} {unit}"
            )


def _check_axes(listed: Sequence[Compliance | Dither], field: str) -> None:
    named = [axis.axis for axis in listed]
    for number, axis in enumerate(listed):
        for name in axis.__struct_fields__[1:]:
            _check_finite(getattr(axis, name), f"{field}[{number}].{name}")
        if axis.axis in named[:number]:
            raise refuse("an axis is named twice", f"{field}[{number}].axis", axis.axis, "each axis once")


def _check_cartesian(motion: CartesianImpedance | CompliantMotion, frames: Collection[str]) -> None:
    _check_frame(motion.frame, "motion.frame", frames)
    if motion.goal_in_world is not None:
        check_all_finite(np.array(motion.goal_in_world.position), "motion.goal_in_world.position")
        check_quaternion(motion.goal_in_world.orientation, "motion.goal_in_world.orientation")
    _check_finite(motion.duration, "motion.duration")
    for part, value in enumerate(motion.stiffness):
        _check_finite(value, f"motion.stiffness[{part}]")
        if value < 0:
            raise refuse("stiffness below zero", f"motion.stiffness[{part}]", value, "0 or more")


def _check_end(end: EndCondition, field: str, frames: Collection[str]) -> None:
    if isinstance(end, PoseErrorEnd | ForceEnd | ContactEnd | StallEnd | TravelEnd):
        _check_frame(end.frame, f"{field}.frame", frames)
    if isinstance(end, PoseErrorEnd | ForceEnd | TravelEnd) and end.axis is not None:
        axis = np.array(end.axis)
        check_all_finite(axis, f"{field}.axis")
        if abs(np.linalg.norm(axis) - 1.0) > 1e-3:
            raise refuse("no unit vector", f"{field}.axis", list(end.axis), "length 1")
    for name in (
        "after",
        "position",
        "limit",
        "threshold",
        "margin",
        "error",
        "share",
        "distance",
        "within",
        "tolerance",
    ):
        if hasattr(end, name):
            _check_finite(getattr(end, name), f"{field}.{name}")


def _check_frame(frame: str, field: str, frames: Collection[str]) -> None:
    if frame not in frames:
        raise refuse("the robot has no such frame", field, frame, nearest(frame, frames))


def _check_finite(value: float, field: str) -> None:
    if not math.isfinite(value):
        raise refuse("not a finite number", field, value, "a finite number")


def check_all_finite(values: np.ndarray, field: str) -> None:
    """Raise RefusedError, naming the element, where something is no finite number."""
    if bad := np.argwhere(~np.isfinite(values)).tolist():
        place = "".join(f"[{index}]" for index in bad[0])
        raise refuse("not a finite number", f"{field}{place}", values[tuple(bad[0])], "a finite number")


def _times(given: list[float], columns: int, at: str, largest_payload: int) -> np.ndarray:
    """(k,) s of the knots of field `at`, each with positions and velocities of so many columns. Raises RefusedError."""
    knots = len(given)
    if knots < 2:
        raise refuse("a trajectory has at least two knots", f"{at}.times", f"{knots} knots", "2 or more")
    if knots * (1 + 2 * columns) > largest_payload:
        most = largest_payload // (1 + 2 * columns)
        raise refuse("the trajectory is too long for one action", f"{at}.times", f"{knots} knots", f"at most {most}")
    times = np.array(given)
    check_all_finite(times, f"{at}.times")
    if times[0] != 0.0:
        raise refuse("time begins with the action", f"{at}.times[0]", times[0], "0")
    if backward := np.flatnonzero(np.diff(times) <= 0).tolist():
        later = backward[0] + 1
        raise refuse("times don't increase", f"{at}.times[{later}]", times[later], f"more than {times[later - 1]:g} s")
    return times


def _table(given: Sequence[Sequence[float]], field: str, knots: int, joints: int) -> np.ndarray:
    if len(given) != knots:
        raise refuse("a row a knot", field, f"{len(given)} rows", f"{knots} rows, as in motion.times")
    for number, row in enumerate(given):
        if len(row) != joints:
            raise refuse("a column a joint", f"{field}[{number}]", f"{len(row)} numbers", f"{joints} numbers")
    table = np.array(given, dtype=float)
    check_all_finite(table, field)
    return table


def _check_within(
    values: np.ndarray, lowest: np.ndarray, highest: np.ndarray, *, field: str, joints: Sequence[str], unit: str
) -> None:
    if bad := np.argwhere((values < lowest) | (values > highest)).tolist():
        knot, column = bad[0]
        raise refuse(
            f"beyond the limits of {joints[column]}",
            f"{field}[{knot}][{column}]",
            f"{values[knot, column]:.4f} {unit}",
            f"{lowest[column]:.4f} to {highest[column]:.4f}",
        )


def _check_between(
    beyond: np.ndarray, reached: np.ndarray, limit: np.ndarray, *, field: str, joints: Sequence[str], unit: str
) -> None:
    if bad := np.argwhere(beyond).tolist():
        knot, column = bad[0]
        raise refuse(
            f"between knots {knot} and {knot + 1} the cubic passes the limit of {joints[column]}",
            f"{field}[{knot}][{column}]",
            f"{reached[knot, column]:.4f} {unit}",
            f"not past {limit[column]:.4f}: give more knots, or lower velocities",
        )


def nearest(given: str, known: Collection[str]) -> str:
    """What to expect instead of a name that is not known."""
    if close := difflib.get_close_matches(given, known, n=3, cutoff=0.5):
        return f"one such as {', '.join(close)}"
    few = sorted(known)[:6]
    return f"one of {', '.join(few)}" + (f", and {len(known) - len(few)} more" if len(known) > len(few) else "")
