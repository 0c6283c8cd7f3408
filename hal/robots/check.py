"""Is a robot one robot? Its model (pinocchio, what daemon and planners think) against its plant (PyBullet), and its network.

Each row says what was compared, what came out, and what it may be. Dynamics are compared with the base held, since that is how
the daemon sees the robot.
"""

from __future__ import annotations

import contextlib
import dataclasses
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import msgspec
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from hal.can import frames
from hal.can.timing import frame_ns
from hal.device import DeviceCommand
from hal.drives.lifecycle import State, controlword_towards
from hal.drives.protocol import LimbProtocol
from hal.joint import JointCommand, Mode
from hal.plant.bullet import pybullet as p
from hal.plant.bus_node import BusNode
from hal.plant.robot_body import BASE
from hal.plant.sensor_noise import without_noise
from hal.plant.sensors import GRAVITY
from hal.plant.world import World
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics

CONFIGURATIONS = 20
DYNAMICS, POSES, LINKAGE = 1e-6, 1e-5, 2e-3
"""largest difference of inertia (kg·m²) and gravity (N·m); of poses (m, and of rotation matrices; PyBullet answers in single
precision); of mimic joints (rad or m)"""
LOAD = 0.8
"""of a bus's time, at the host's period"""
STILL = 0.05
"""rad/s: encoders are noisy, and the drives follow them"""
SAMPLED = 1.1
"""sqrt(k/I)·dt of spring and link, from which on a millisecond step is unstable"""
QUICK_STOP = 150.0
"""1/s, damping over inertia, beyond which the torque loop's lag turns it into oscillation"""
_CYCLES = 50
"""in which every frame comes at least once"""
_HOST = -1
_STEP, _OFFSET, _SETTLING_CYCLES = 1e-3, 0.02, 380


class Row(msgspec.Struct, frozen=True):
    """One comparison."""

    about: str
    name: str
    value: str
    expected: str
    holds: bool

    def __post_init__(self) -> None:
        # A numpy.bool is no bool for whoever writes rows out.
        msgspec.structs.force_setattr(self, "holds", bool(self.holds))


def check(description: RobotDescription) -> Iterator[Row]:
    """All rows, one after the other as they are found."""
    # Model and plant are compared, not a sensor's noise with either.
    held = dataclasses.replace(
        without_noise(description), support="gantry" if description.base == "free" else "none", floor=None
    )
    with contextlib.closing(World(held)) as world:
        kinematics = Kinematics(description)
        yield from _joints(world, kinematics)
        yield from _dynamics(world, kinematics)
        yield from _limits(world)
        yield from _linkages(world)
    with contextlib.closing(World(held)) as world:
        yield from _holding(world, kinematics)
        yield from _devices(world, kinematics)
    with contextlib.closing(World(held)) as world:
        yield from _network(world)


def _row(about: str, name: str, value: float, most: float, unit: str = "") -> Row:
    return Row(about, name, f"{value:.2g}{unit}", f"≤ {most:g}{unit}", bool(value <= most))


def _joints(world: World, kinematics: Kinematics) -> Iterator[Row]:
    ours, theirs = set(kinematics.model.names) - {"universe"}, set(world.robot.dofs)
    odd = sorted(ours ^ theirs)
    yield Row("model", "moving joints", f"{len(theirs)}" + (f", not in both: {', '.join(odd)}" if odd else ""),
              f"{len(ours)}, the same in both", not odd)  # fmt: skip
    # A base that is held has no mass in PyBullet, and is no joint's in pinocchio.
    total = sum(inertia.mass for inertia in list(kinematics.model.inertias)[1:])
    links = [link for link in world.robot.links.values() if link != BASE]
    mass = sum(p.getDynamicsInfo(world.robot.number, link, physicsClientId=world.client)[0] for link in links)
    yield Row(
        "model", "mass that moves", f"{mass:.4f} kg", f"{total:.4f} kg", abs(mass - total) < 1e-5 * max(total, 1.0)
    )
    arms = world.robot.description.arms.values()
    missing = [arm.tip for arm in arms if not kinematics.model.existFrame(arm.tip)]
    yield Row("model", "tip frames of arms", ", ".join(missing) or "all there", "all there", not missing)


def _dynamics(world: World, kinematics: Kinematics) -> Iterator[Row]:
    """Every moving joint by itself, those that grippers move too."""
    model, body, client = kinematics.model, world.robot, world.client
    data = model.createData()
    joints = list(model.names)[1:]
    rows = np.array([body.dofs[joint] for joint in joints])
    ours = np.array([model.idx_vs[model.getJointId(joint)] for joint in joints])
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    generator = np.random.default_rng(0)
    inertia = gravity = place = turn = scale = 0.0
    worst = ""
    for _ in range(CONFIGURATIONS):
        q = generator.uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi))
        positions = q[ours]
        values = np.zeros(len(rows))
        values[rows] = positions
        mass = body.mass_matrix(dict(zip(joints, positions.tolist(), strict=True)))[np.ix_(rows, rows)]
        pin.crba(model, data, q)
        expected = (np.triu(data.M) + np.triu(data.M, 1).T)[np.ix_(ours, ours)]
        inertia, scale = max(inertia, np.abs(mass - expected).max()), max(scale, np.abs(expected).max())
        still = [0.0] * len(rows)
        torque = p.calculateInverseDynamics(body.number, values.tolist(), still, still, physicsClientId=client)
        difference = np.abs(np.array(torque)[rows] - pin.computeGeneralizedGravity(model, data, q)[ours])
        gravity = max(gravity, difference.max())
        for joint, position in zip(joints, positions.tolist(), strict=True):
            body.place(joint, position)
        pin.framesForwardKinematics(model, data, q)
        for link, number in body.links.items():
            if number == BASE:
                continue
            _, at, orientation, _, _ = body.link_motion(number)
            pose = data.oMf[model.getFrameId(link)]
            off = float(np.abs(np.subtract(at, pose.translation)).max())
            if off > place:
                place, worst = off, link
            rotation = np.array(p.getMatrixFromQuaternion(orientation)).reshape(3, 3)
            turn = max(turn, float(np.abs(rotation - pose.rotation).max()))
    yield _row("model", f"mass matrix ({CONFIGURATIONS} postures)", inertia, DYNAMICS * max(scale, 1.0), " kg·m²")
    yield _row("model", f"gravity ({CONFIGURATIONS} postures)", gravity, DYNAMICS * max(scale, 1.0), " N·m")
    yield _row("model", f"positions of links (worst: {worst})", place, POSES, " m")
    yield _row("model", "orientations of links", turn, POSES)


def _limits(world: World) -> Iterator[Row]:
    description, client = world.robot.description, world.client
    wrong = []
    for row, joint in enumerate(description.joints):
        info = p.getJointInfo(world.robot.number, world.robot.joints[joint], physicsClientId=client)
        expected = description.lower[row], description.upper[row]
        if not np.allclose(info[8:10], expected, atol=1e-6):
            wrong.append(joint)
    yield Row("limits", "positions", ", ".join(wrong) or "as in the plant", "as in the plant", not wrong)
    for name, values in (("velocities", description.velocity_limit), ("torques", description.torque_limit)):
        idle = [j for j, v in zip(description.joints, values, strict=True) if not (np.isfinite(v) and v > 0)]
        yield Row("limits", name, ", ".join(idle) or "all > 0", "all > 0", not idle)
    rows = [world.robot.dofs[joint] for joint in description.joints]
    positions = dict(zip(description.joints, description.home_position().tolist(), strict=True))
    felt = 1.0 / np.diag(np.linalg.inv(world.robot.mass_matrix(positions)[np.ix_(rows, rows)]))
    ratio = np.sqrt(world.drives.actuators.model.stiffness / felt) * _STEP
    worst = int(np.argmax(ratio))
    yield _row("limits", f"springs a 1 ms step can take (worst: {description.joints[worst]})", ratio[worst], SAMPLED)
    mass = world.robot.mass_matrix(positions)[np.ix_(rows, rows)]
    damping = description.quick_stop_damping / np.sqrt(np.diag(mass) * felt)
    worst = int(np.argmax(damping))
    yield _row(
        "limits", f"quick stop's damping (worst: {description.joints[worst]})", damping[worst], QUICK_STOP, " /s"
    )


def _linkages(world: World) -> Iterator[Row]:
    """All grippers at once, driven from where they rest to the other end."""
    world.place(world.description.home_position())
    grippers = {row: gripper for row, gripper in world.devices.grippers.items() if gripper.followers}
    longest = 0.0
    for row, gripper in grippers.items():
        gripper.place(gripper.rest)
        _, _, speed, effort = world.description.device_limits[gripper.joint]
        far = gripper.upper if gripper.upper - gripper.rest > gripper.rest - gripper.lower else gripper.lower
        world.devices.command(row, np.array([far, speed, effort, 1.0, 0, 0, 0, 0]))
        longest = max(longest, abs(far - gripper.rest) / speed)
    errors = {row: dict.fromkeys(gripper.followers, 0.0) for row, gripper in grippers.items()}
    for _ in range(round(longest / _STEP) // 20 + 5 if grippers else 0):
        world.advance(20)
        joints = world.truth().joints
        for row, gripper in grippers.items():
            for name, mimic in gripper.followers.items():
                error = abs(joints[name] - mimic.multiplier * joints[gripper.joint] - mimic.offset)
                errors[row][name] = max(errors[row][name], error)
    for row, found in errors.items():
        worst = max(found, key=found.__getitem__)
        device = world.description.devices[row].name
        yield _row("mimic", f"{device}: {len(found)} joints (worst: {worst})", found[worst], LINKAGE)


def _holding(world: World, kinematics: Kinematics) -> Iterator[Row]:
    """Enabled by its drives, told to go a little further in every joint, all signs at once."""
    description, drives = world.description, world.drives
    home = world.position.copy()
    command = JointCommand(len(home))
    # Away from a limit where one is near.
    direction = np.where(home + 2 * _OFFSET > description.upper, -1.0, 1.0)
    mass = kinematics.mass_matrix(home)
    felt = np.sqrt(np.diag(mass) / np.diag(np.linalg.inv(mass)))
    command.mode[:] = Mode.IMPEDANCE
    command.stiffness[:] = description.stiffness
    command.damping[:] = 2 * description.damping_ratio * np.sqrt(description.stiffness * felt)
    for _ in range(10):
        drives.control(controlword_towards(State.OPERATION_ENABLED, drives.state))
        world.step()
    steps = description.period_ns // 1_000_000
    peak = 0.0
    for cycle in range(_SETTLING_CYCLES):
        share = min(max(cycle / 80 - 0.5, 0.0), 1.0)
        command.position[:] = home + share * _OFFSET * direction
        command.torque[:] = kinematics.gravity(world.position)
        drives.command(command)
        world.advance(steps)
        if cycle > _SETTLING_CYCLES - 50:
            peak = max(peak, float(np.abs(world.velocity).max()))
    faulted = [j for j, error in zip(description.joints, drives.error, strict=True) if error]
    yield Row("drives", "enabled", ", ".join(faulted) or "all", "all", not faulted)
    went = (world.position - home) * direction / _OFFSET
    worst = int(np.argmin(went))
    name = f"go where they are told (worst: {description.joints[worst]})"
    yield Row("drives", name, f"{went[worst]:.0%}", "≥ 80% of the way", bool(went[worst] >= 0.8))
    yield _row("drives", "stand still", peak, STILL, " rad/s")
    rest = drives.actuators.spring_torque - kinematics.gravity(world.position)
    share = np.abs(rest - description.stiffness * (command.position - world.position)) / description.torque_limit
    yield _row("drives", "torque less gravity, over rated", float(share.max()), 0.05)


def _devices(world: World, kinematics: Kinematics) -> Iterator[Row]:
    devices = world.description.devices
    world.drives.switch_off()
    world.advance(100)
    world.devices.measure()
    world.advance(20)
    values = world.devices.measure().values
    for row, device in enumerate(devices):
        measured = values[row]
        match device.family:
            case "imu":
                up = kinematics.frame(world.position, device.link).rotation[2] * GRAVITY
                off = float(np.abs(measured[7:10] - up).max())
                yield _row("devices", f"{device.name}: gravity as the model turns it", off, 0.1, " m/s²")
            case "force_torque":
                weight = GRAVITY * mass_beyond(world.description, device.link)
                off = abs(float(np.linalg.norm(measured[:3])) - weight)
                yield _row("devices", f"{device.name}: carries {weight:.2f} N", off, 0.01 * weight + 0.02, " N off")
            case "gripper":
                lower, upper, *_ = world.description.device_limits[device.joint]
                inside = lower - 1e-3 <= measured[0] <= upper + 1e-3
                yield Row(
                    "devices", f"{device.name}: position", f"{measured[0]:.3f}", f"{lower:g} to {upper:g}", inside
                )
            case "power":
                good = bool(measured[4] == 1 and measured[0] > 0)
                yield Row("devices", f"{device.name}: voltage", f"{measured[0]:.1f} V", "> 0, relay closed", good)
            case _:
                yield Row("devices", f"{device.name}: {device.family}", "not simulated", "a node of its own", True)


def mass_beyond(description: RobotDescription, link: str) -> float:
    """kg of a link and all that hangs on it."""
    robot = ET.parse(description.urdf).getroot()
    below: dict[str, list[str]] = {}
    for joint in robot.findall("joint"):
        ends = [
            element.get("link", "") for element in (joint.find("parent"), joint.find("child")) if element is not None
        ]
        below.setdefault(ends[0], []).append(ends[1])
    mass, waiting = 0.0, [link]
    masses = {e.get("name", ""): e.find("inertial/mass") for e in robot.findall("link")}
    while waiting:
        here = waiting.pop()
        own = masses[here]
        mass += float(own.get("value", "0")) if own is not None else 0.0
        waiting += below.get(here, [])
    return mass


def _network(world: World) -> Iterator[Row]:
    """Identifiers and bus time of the robot's own frames, as its codec makes them, over as many cycles as the rarest one needs."""
    description = world.description
    protocol, node = LimbProtocol(description), BusNode(world)
    n, d = len(description.joints), len(description.devices)
    command, devices = JointCommand(n), DeviceCommand(d)
    command.position[:] = world.position
    # Payload as varied as a moving robot's: stuffing counts.
    command.torque[:], command.velocity[:] = 0.3 * description.torque_limit, 0.1 * description.velocity_limit
    devices.commanded[:] = True
    for row, device in enumerate(description.devices):
        devices.values[row, 0] = 1.0 if device.family == "power" else 0.0
    out = frames.empty(protocol.frames_a_cycle)
    says: dict[tuple[int, int], set[int]] = {}
    busiest = np.zeros(len(description.channels))
    for cycle in range(_CYCLES):
        count = protocol.encode_commands(command, cycle, description.watchdog_cycles, out)
        count += protocol.encode_devices(devices, cycle, cycle, description.watchdog_cycles, out[count:])
        count += protocol.encode_sync(cycle, out[count:])
        ours = out[:count].copy()
        node.receive(ours)
        theirs = node.answer().copy()
        for record in ours:
            says.setdefault((int(record["bus"]), int(record["can_id"])), set()).add(_HOST)
        for record, sender in zip(theirs, node.senders.tolist(), strict=True):
            says.setdefault((int(record["bus"]), int(record["can_id"])), set()).add(sender)
        busiest = np.maximum(busiest, _busy(np.concatenate([ours, theirs]), description))
    answering = {limb.joints[0] for limb in description.limbs if limb.answer == "master"}
    answering |= {joint for limb in description.limbs if limb.answer == "drives" for joint in limb.joints}
    answering |= {device.name for device in description.devices}
    heard = {node.names[sender] for senders in says.values() for sender in senders if sender != _HOST}
    silent = sorted(answering - heard)
    yield Row("network", "nodes that speak", ", ".join(silent) or str(len(heard)), f"all {len(answering)}", not silent)
    clashes = [f"0x{name:X} on {description.channels[bus].name}" for (bus, name), who in says.items() if len(who) > 1]
    yield Row(
        "network", f"{len(says)} identifiers", ", ".join(clashes) or "one node each", "one node each", not clashes
    )
    for channel, busy in zip(description.channels, busiest.tolist(), strict=True):
        yield Row("network", f"{channel.name}: load of the busiest cycle", f"{busy:.0%}", f"≤ {LOAD:.0%}", busy <= LOAD)


def _busy(records: npt.NDArray[np.void], description: RobotDescription) -> npt.NDArray[np.float64]:
    """Share of the host's period that the frames take of each channel."""
    busy = np.zeros(len(description.channels))
    words = frames.words(records)
    for row, bus in enumerate(records["bus"].tolist()):
        channel = description.channels[bus]
        busy[bus] += int(frame_ns(words, row, channel.bitrate, channel.data_bitrate)) / description.period_ns
    return busy
