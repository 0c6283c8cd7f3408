"""Parallel transmissions: two linear actuators side by side that together move a pitch and a roll joint.

As in Valkyrie's ankles, waist and wrists (Radford et al. 2015, §2.2 and §2.3). Each rod runs from a universal joint on the
fixed side to a ball joint on the moving side; its length follows from both angles, exactly. With l the two lengths and
J = ∂l/∂(pitch, roll), rod forces F (pushing is positive) make joint torques Jᵀ F, and joint velocities make J q̇.

The actuators are described as if they were rotary: a rod's length and force by way of one constant lever arm (m), so that
position is length / arm (rad) and torque is force · arm (N·m), and one firmware serves both.
"""

from __future__ import annotations

import itertools
import math
import xml.etree.ElementTree as ET

import numpy as np
import numpy.typing as npt

from handrail.compiled import compiled
from handrail.robot.description import ParallelPair, RobotDescription

_GRID = 9
"""angles a joint at which a transmission is looked at for singularities"""
_WORST_CONDITION = 20.0
_NEWTON_STEPS, _CLOSE_ENOUGH = 30, 1e-13


class ParallelTransmission:
    """The geometry of one pair. Arrays are (pitch, roll) in joint space, (left, right) in actuator space."""

    def __init__(self, pair: ParallelPair, *, pitch_first: bool = True):
        """`pitch_first`: the pitch axis is the one nearer to the fixed side."""
        self.pair = pair
        self.rods = np.zeros(ROD_COLUMNS)
        """what the kernel needs: both fixed ends, both moving ends, order of the axes, 1 / arm"""
        self.rods[_FIXED : _FIXED + 6] = np.ravel(pair.fixed_ends)
        self.rods[_MOVING : _MOVING + 6] = np.ravel(pair.moving_ends)
        self.rods[_PITCH_FIRST] = pitch_first
        self.rods[_PER_ARM] = 1.0
        lengths, jacobian = self._both(0.0, 0.0)
        if lengths.min() <= 0.0:
            raise ValueError(f"parallel_pairs.{pair.name}: a rod has no length with both joints at zero")
        self.arm = float(np.sqrt((jacobian**2).sum(axis=1).mean()))
        """m, root mean square lever arm of the rods at zero"""
        if self.arm <= 0.0:
            raise ValueError(f"parallel_pairs.{pair.name}: both rods run through the axes; expected a lever arm")
        self.rods[_PER_ARM] = 1.0 / self.arm

    def _both(self, pitch: float, roll: float) -> tuple[np.ndarray, np.ndarray]:
        lengths, jacobian = np.zeros(2), np.zeros((2, 2))
        rod_lengths(pitch, roll, self.rods, lengths, jacobian)
        return lengths, jacobian

    def positions(self, pitch: float, roll: float) -> np.ndarray:
        """The actuators' positions for the joints' angles, rad: lengths in units of the arm (2,)."""
        return self._both(pitch, roll)[0]

    def jacobian(self, pitch: float, roll: float) -> np.ndarray:
        """∂ positions / ∂ (pitch, roll), (2, 2)."""
        return self._both(pitch, roll)[1]

    def lengths(self, pitch: float, roll: float) -> np.ndarray:
        """m (2,), of the rods."""
        return self.positions(pitch, roll) * self.arm

    def angles(self, positions: npt.ArrayLike, guess: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """The joints' angles (pitch, roll) rad for the actuators' positions, by Newton's method from a `guess`.

        Raises ValueError when the actuators cannot be there.
        """
        goal, angles = np.asarray(positions, float), np.array(guess, float)
        for _ in range(_NEWTON_STEPS):
            reached, jacobian = self._both(angles[0], angles[1])
            error = goal - reached
            if np.abs(error).max() < _CLOSE_ENOUGH:
                return angles
            try:
                angles += np.clip(np.linalg.solve(jacobian, error), -0.3, 0.3)
            except np.linalg.LinAlgError:
                break
        raise ValueError(f"parallel_pairs.{self.pair.name}: no angles for actuators at {goal[0]:g}, {goal[1]:g}")

    def rated(self, pitch_torque: float, roll_torque: float) -> float:
        """N·m that each actuator must be rated for, so that either joint reaches its torque alone, at zero."""
        inverse = np.linalg.inv(self.jacobian(0.0, 0.0).T)
        return float(np.abs(inverse * np.array([pitch_torque, roll_torque])).max())

    def check(self, lower: npt.ArrayLike, upper: npt.ArrayLike) -> None:
        """Raises ValueError where the pair could not move both joints between their limits (pitch, roll), rad."""
        lower, upper = np.asarray(lower, float), np.asarray(upper, float)
        sign = np.sign(np.linalg.det(self.jacobian(*((lower + upper) / 2))))
        for pitch, roll in itertools.product(*(np.linspace(lower[i], upper[i], _GRID) for i in range(2))):
            jacobian = self.jacobian(pitch, roll)
            if np.sign(np.linalg.det(jacobian)) != sign or np.linalg.cond(jacobian) > _WORST_CONDITION:
                raise ValueError(
                    f"parallel_pairs.{self.pair.name}: its rods cannot move pitch and roll apart at pitch {pitch:.3g}, "
                    f"roll {roll:.3g} rad, within the joints' limits; expected rods with different lever arms"
                )


def transmissions_of(description: RobotDescription) -> tuple[ParallelTransmission, ...]:
    """The transmissions of a robot's parallel pairs. Raises ValueError for one that is singular within its joints' limits."""
    if not description.parallel_pairs:
        return ()
    parents = {
        joint.find("child").get("link"): (joint.get("name"), joint.find("parent").get("link"))  # type: ignore[union-attr]
        for joint in ET.parse(description.urdf).getroot().findall("joint")
    }
    before: dict[str, set[str]] = {}
    for name, parent in parents.values():
        before[str(name)] = above = set()
        link = parent
        while link in parents:
            above.add(str(parents[link][0]))
            link = parents[link][1]
    found = []
    for pair in description.parallel_pairs:
        if pair.pitch not in before[pair.roll] and pair.roll not in before[pair.pitch]:
            raise ValueError(f"parallel_pairs.{pair.name}: {pair.pitch} and {pair.roll} are not on one chain")
        transmission = ParallelTransmission(pair, pitch_first=pair.pitch in before[pair.roll])
        rows = description.index([pair.pitch, pair.roll])
        transmission.check(description.lower[rows], description.upper[rows])
        found.append(transmission)
    return tuple(found)


_FIXED, _MOVING, _PITCH_FIRST, _PER_ARM, ROD_COLUMNS = 0, 6, 12, 13, 14


@compiled
def rod_lengths(pitch, roll, rods, positions, jacobian):  # type: ignore[no-untyped-def]
    """Write both rods' lengths (2,), in units of the arm, and their derivatives by pitch and roll (2, 2)."""
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    for i in range(2):
        mx, my, mz = rods[_MOVING + 3 * i], rods[_MOVING + 3 * i + 1], rods[_MOVING + 3 * i + 2]
        if rods[_PITCH_FIRST] != 0.0:  # R = R_y(pitch) R_x(roll)
            ay, az = cr * my - sr * mz, sr * my + cr * mz
            ex, ey, ez = cp * mx + sp * az, ay, cp * az - sp * mx
            px, py, pz = ez, 0.0, -ex  # y × e
            rx, ry, rz = sp * ay, -az, cp * ay  # R_y (x × a)
        else:  # R = R_x(roll) R_y(pitch)
            ax, az = cp * mx + sp * mz, cp * mz - sp * mx
            ex, ey, ez = ax, cr * my - sr * az, sr * my + cr * az
            px, py, pz = az, sr * ax, -cr * ax  # R_x (y × a)
            rx, ry, rz = 0.0, -ez, ey  # x × e
        dx, dy, dz = ex - rods[_FIXED + 3 * i], ey - rods[_FIXED + 3 * i + 1], ez - rods[_FIXED + 3 * i + 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        scale = rods[_PER_ARM] / length if length > 0.0 else 0.0
        positions[i] = length * rods[_PER_ARM]
        jacobian[i, 0] = (dx * px + dy * py + dz * pz) * scale
        jacobian[i, 1] = (dx * rx + dy * ry + dz * rz) * scale
