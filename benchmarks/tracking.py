"""Where a worn robot's tools are, with the outer integral on the joint encoders' error and without: ``handrail bench tracking``.

TALOS' upper body with friction, 2° of backlash in every gear, and drives whose own loops close on a motor's angle, calibrated
to 1° (benchmarks/robots/talos_upper_worn), after Fallon et al. 2015, §6. The daemon's loop runs joint trajectories on the plant, in
lock-step in one process; the error is the distance of each tool's tip in the plant from where the reference puts it. Besides the
robot of that file some are drawn whose frictions, backlashes and calibrations are others than what their daemon is told, and
postures and paces with them; each row is the worst robot's. ``--out FOLDER`` writes tracking.png.
"""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from benchmarks.rows import Row
from daemon.exchange import Command, Kind, TrajectoryMotion
from daemon.loop import Loop
from hal.drives.protocol import LimbProtocol
from hal.hardware import Hardware
from hal.plant.direct_port import DirectPort
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime, memory_folder

ROBOT = Path(__file__).with_name("robots") / "talos_upper_worn"
GOAL_MM = 10.0
MOTIONS = 3
SEEDS = (None, 0, 1, 2)
"""of the robots; None: the file's own"""
FRICTION_OFF, BACKLASH_OFF, CALIBRATION = 0.3, 0.2, 0.0175
"""a drawn robot's friction and backlash differ from the file's by up to these shares; its motors are calibrated to so many rad"""
_FIRST_S, _MOVE_S, _STAND_S, _SETTLED_S = 2.0, 4.0, 1.0, 0.5
_PACES = (0.75, 1.25)
_ARM_REACH, _TORSO_REACH = 0.3, 0.15
"""rad around the home posture, within which postures are drawn"""
_KNOTS = 40
_SEED = 4

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """What happened, cycle by cycle (c,), from the first motion on."""

    time: Floats
    """s"""
    error: dict[str, Floats]
    """arm → mm, of its tool's tip"""
    joint_error: Floats
    """(c, n) rad, reference less truth"""
    offset: Floats
    """(c, n) rad, what the integral has moved the drives' set-points by"""
    jump: Floats
    """largest change of a drive's set-point torque, over what control.torque_rate allows"""
    standing: npt.NDArray[np.bool_]
    """has stood for half a second"""

    @property
    def worst(self) -> Floats:
        """mm, of the tool that is farther off"""
        return np.array(list(self.error.values())).max(axis=0)

    @property
    def hunting(self) -> float:
        """rad, the widest that a joint wandered while it stood"""
        stretches = np.split(self.joint_error, np.flatnonzero(np.diff(self.standing)) + 1)
        return max(float(np.ptp(stretch, axis=0).max()) for stretch in stretches[1::2])


class Bench:
    """The loop on the plant, enabled."""

    def __init__(self, description: RobotDescription, folder: Path):
        self.description, self.kinematics = description, Kinematics(description)
        self.world = World(description)
        hardware = Hardware(description, DirectPort(self.world), LimbProtocol(description))
        self.loop = Loop(hardware, self.kinematics, True, Runtime.at(folder))
        self._serial = 0
        for _ in range(5):
            self.loop.cycle()
        self.loop.life.enable()
        for _ in range(2000):
            self.loop.cycle()
            if self.loop.life.enabled:
                return
        raise RuntimeError(f"{description.name} does not come to be enabled; expected it within 2000 cycles")

    def move(self, posture: Floats, seconds: float) -> None:
        """Start a motion of all joints to `posture` rad (n,), minimum jerk. Raises RuntimeError where it is refused."""
        self._serial += 1
        start, u = self.loop.written.position.copy(), np.linspace(0.0, 1.0, _KNOTS)
        share, slope = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2 / seconds
        way = posture - start
        motion = TrajectoryMotion(
            np.arange(len(start)), u * seconds, start + np.outer(share, way), np.outer(slope, way)
        )
        command = Command(serial=self._serial, kind=Kind.START, motion=motion)
        refusal = self.loop.actions.start(command, self.loop.written, self.loop.time_ns)
        if refusal is not None:
            raise RuntimeError(f"motion {self._serial} was refused: {refusal}")

    def tips(self, position: Floats) -> dict[str, Floats]:
        """arm → m (3,) of its tool's tip with the joints at `position` rad (n,)"""
        arms = self.description.arms.values()
        return {arm.name: self.kinematics.frame(position, arm.tip).translation for arm in arms}


def drawn(description: RobotDescription, seed: int | None) -> RobotDescription:
    """The robot with other frictions, backlashes and calibrations in its plant; what its daemon is told stays. None: itself."""
    if seed is None:
        return description
    draw = np.random.default_rng([_SEED, seed])
    actuators = tuple(
        msgspec.structs.replace(
            actuator,
            friction=actuator.friction * draw.uniform(1.0 - FRICTION_OFF, 1.0 + FRICTION_OFF),
            backlash=actuator.backlash * draw.uniform(1.0 - BACKLASH_OFF, 1.0 + BACKLASH_OFF),
            motor_offset=draw.uniform(-CALIBRATION, CALIBRATION),
        )
        for actuator in description.actuators
    )
    return dataclasses.replace(description, actuators=actuators)


def postures(description: RobotDescription, count: int, seed: int = _SEED) -> list[Floats]:
    """Postures around home, the same in every run with this seed; the last one is home."""
    draw, home = np.random.default_rng(seed), description.home_position()
    reach = np.array([_TORSO_REACH if joint.startswith("torso") else _ARM_REACH for joint in description.joints])
    around = [home + draw.uniform(-reach, reach) for _ in range(count - 1)]
    return [np.clip(posture, description.lower + 0.1, description.upper - 0.1) for posture in around] + [home]


def run(
    description: RobotDescription,
    count: int = MOTIONS,
    first_s: float = _FIRST_S,
    move_s: float = _MOVE_S,
    stand_s: float = _STAND_S,
    seed: int = _SEED,
) -> Run:
    """Stand for `first_s`, go through `count` postures, and stand at each."""
    folder = Path(tempfile.mkdtemp(prefix="tracking", dir=memory_folder()))
    bench = Bench(description, folder)
    loop, period = bench.loop, description.period_ns * 1e-9
    integral, none = loop.manager.gains.integral, np.zeros(len(description.joints))
    for _ in range(round(first_s / period)):
        loop.cycle()
    moves, stands = round(move_s / period), round(stand_s / period)
    off: dict[str, list[float]] = {arm: [] for arm in description.arms}
    errors, offsets, standing = [], [], []
    torque, step, jumps = loop.written.torque.copy(), description.torque_rate_limit * period, []
    for posture in postures(description, count, seed):
        bench.move(posture, move_s)
        for cycle in range(moves + stands):
            loop.cycle()
            truth = bench.world.position
            wanted = bench.tips(loop.written.position)
            for arm, tip in bench.tips(truth).items():
                off[arm].append(1e3 * float(np.linalg.norm(wanted[arm] - tip)))
            jumps.append(float((np.abs(loop.written.torque - torque) / step).max()))
            torque[:] = loop.written.torque
            errors.append(loop.written.position - truth)
            offsets.append(none if integral is None else integral.offset.copy())
            standing.append(cycle >= moves + _SETTLED_S / period)
    loop.close()
    shutil.rmtree(folder)
    time = period * np.arange(1.0, len(errors) + 1)
    error = {arm: np.array(values) for arm, values in off.items()}
    return Run(time, error, np.array(errors), np.array(offsets), np.array(jumps), np.array(standing))


def alone(description: RobotDescription) -> RobotDescription:
    """The robot with nothing but the integral: friction and backlash are not fed forward."""
    assert description.integral is not None
    return dataclasses.replace(
        description, integral=dataclasses.replace(description.integral, friction=0.0, backlash=0.0)
    )


def rows(out: Path | None = None) -> list[Row]:
    """Some minutes."""
    worn = robots.load(ROBOT)
    runs: dict[str, list[Run]] = {"all": [], "alone": [], "none": []}
    for seed in SEEDS:
        robot, pace = drawn(worn, seed), 1.0 if seed is None else _PACES[seed % len(_PACES)]
        variants = {"all": robot, "alone": alone(robot), "none": dataclasses.replace(robot, integral=None)}
        for name, variant in variants.items():
            runs[name].append(run(variant, move_s=_MOVE_S * pace, seed=_SEED if seed is None else seed))
    if out:
        out.mkdir(parents=True, exist_ok=True)
        hardest = int(np.argmax([_way_most(each) for each in runs["alone"]]))
        draw(out / "tracking.png", worn, *(each[hardest] for each in runs.values()))

    def row(name: str, of: Callable[[Run], float], most: float, unit: str = "mm", peer: str = "none") -> Row:
        ours, theirs = max(map(of, runs["all"])), max(map(of, runs[peer]))
        said = {"none": "without the integral", "alone": "the integral alone"}[peer]
        return Row(
            name=name, value=round(ours, 3), unit=unit, goal=f"< {most:g}", holds=ours < most,
            peer=said, peer_value=round(theirs, 3), ratio=round(ours / theirs, 4),
        )  # fmt: skip

    peers = ("none", "alone")
    return [
        *(row("tool off, standing for 0.5 s, largest", _standing, GOAL_MM, peer=peer) for peer in peers),
        *(row("tool off, on the way, root mean square", _way_rms, GOAL_MM, peer=peer) for peer in peers),
        *(row("on the way, 95th percentile", _way_p95, GOAL_MM, peer=peer) for peer in peers),
        *(row("on the way, largest", _way_most, GOAL_MM, peer=peer) for peer in peers),
        row("a joint wanders while it stands, at most", _hunting, 5.0, "mrad"),
        row("the drives' torque jumps, of what may be", _jump, 1.0, "", "alone"),
        row("while it stands", _jump_standing, 0.1, "", "alone"),
    ]


def _standing(run: Run) -> float:
    return float(run.worst[run.standing].max())


def _way_rms(run: Run) -> float:
    return _rms(run.worst[~run.standing])


def _way_p95(run: Run) -> float:
    return float(np.percentile(run.worst[~run.standing], 95))


def _way_most(run: Run) -> float:
    return float(run.worst[~run.standing].max())


def _hunting(run: Run) -> float:
    return 1e3 * run.hunting


def _jump(run: Run) -> float:
    return float(run.jump.max())


def _jump_standing(run: Run) -> float:
    return float(run.jump[run.standing].max())


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def draw(file: Path, description: RobotDescription, with_: Run, alone: Run, without: Run) -> None:
    """The tools' errors over time, with and without, and below what the integral has learned."""
    figure = Figure(figsize=(11, 8))
    figure.subplots_adjust(left=0.07, right=0.98, bottom=0.07, top=0.95, hspace=0.1)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, arm in zip(panels, with_.error, strict=False):
        axes.plot(without.time, without.error[arm], color="#b5382a", label="without the integral")
        axes.plot(alone.time, alone.error[arm], color="#c8962d", label="with it")
        axes.plot(with_.time, with_.error[arm], color="#1f5fa8", label="with it, friction and backlash fed forward")
        axes.axhline(GOAL_MM, color="#777777", linewidth=0.8, linestyle=":")
        axes.set(ylabel=f"{arm} tool off, mm", ylim=(0, None))
    panels[0].set_title(f"{description.name}: distance of each tool's tip from its reference, in the plant")
    panels[0].legend(loc="upper right")
    for joint, offset in zip(description.joints, with_.offset.T, strict=True):
        panels[2].plot(with_.time, np.degrees(offset), linewidth=0.8, label=joint.removesuffix("_joint"))
    panels[2].set(xlabel="s", ylabel="set-points moved by, degrees", xlim=(0, with_.time[-1]))
    panels[2].legend(loc="upper right", ncols=6, fontsize=6)
    for axes in panels:
        axes.grid(visible=True, alpha=0.25)
        for edge in np.flatnonzero(np.diff(with_.standing.astype(int)) == 1):
            axes.axvline(with_.time[edge], color="#777777", linewidth=0.5, alpha=0.5)
    figure.savefig(file, dpi=100)
