"""Series-elastic actuators with their firmware: a motor, a gear and a spring, under torque control at 5 kHz.

After Radford et al., "Valkyrie: NASA's First Bipedal Humanoid Robot" (J. Field Robotics 2015), §3: feed-forward, PD and a
disturbance observer around the spring's torque, and joint impedance, damping and position control on top, all at the
firmware's rate. Everything is referred to the joint: rotor angle and inertia are those behind the gear.

One kernel steps all actuators between two steps of the rigid bodies; nothing in it allocates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from hal.joint import Mode

FIRMWARE_HZ = 5000
GEAR_RATIO = 100.0
TORQUE_CONSTANT = 0.05
"""N·m/A, of the motor"""
OPEN_LOOP_RAD_S = 98.6
"""natural frequency of rotor and spring with a locked output"""
ROTOR_DAMPING_RATE = 158.3
"""1/s: viscous friction over rotor inertia"""
TORQUE_GAIN = 19.0
"""proportional gain of the torque loop: the closed loop's natural frequency is sqrt(1 + gain) times the open one's"""
TORQUE_DAMPING_RATIO = 0.7
OBSERVER_HZ = 60.0
"""bandwidth of the disturbance observer's second-order Butterworth filter Q"""
TORQUE_RATE_FILTER_HZ = 800.0
CURRENT_LOOP_HZ = 1500.0
ENCODER_BITS = 19
"""a turn of the joint, read behind the gear"""
CURRENT_RESERVE = 1.5
"""the current's limit over the current of the rated torque"""
POSITION_INTEGRAL_RATE = 2.0
"""1/s: integral over proportional gain of the position loop"""

_BUTTERWORTH = math.sqrt(0.5)

# Rows of the parameter array (n columns).
_K, _NKT, _B, _J, _KP, _KD, _IMAX, _EFFORT, _P0, _P1, _P2, _A1, _A2, _Q0, _Q1, _Q2, _AC, _AF, _POS_K, _POS_D, _POS_I = (
    range(21)
)
_PARAMETERS = 21
# Rows of the state array (n columns).
_ROTOR, _RATE, _CURRENT, _DISTURBANCE, _LAST, _SLOPE, _X1, _X2, _Y1, _Y2, _INTEGRAL = range(11)
_STATES = 11

_DAMPING, _TORQUE, _POSITION = int(Mode.DAMPING), int(Mode.TORQUE), int(Mode.POSITION)
_RESOLUTION = 2 * math.pi / 2**ENCODER_BITS


@dataclass(frozen=True)
class Springs:
    """What distinguishes one joint's actuator from another's. Arrays have shape (n,)."""

    stiffness: np.ndarray
    """N·m/rad"""
    rotor_inertia: np.ndarray
    """kg·m², behind the gear"""
    rotor_damping: np.ndarray
    """N·m·s/rad, behind the gear"""
    torque_limit: np.ndarray
    """N·m, rated"""


def springs_for(torque_limit: np.ndarray) -> Springs:
    """Actuators sized for rated torques N·m (n,), where a robot's description says nothing better.

    The reference is an actuator whose figures reproduce the paper's: k 3500 N·m/rad, N 100, rotor 3.6e-5 kg·m² and
    5.7e-3 N·m·s/rad before the gear, 175 N·m. Its open loop passes 14 Hz and its closed loop 70 Hz (−3 dB, locked output).
    Others have its spring scaled with their rated torque, 20 /rad × torque (within 5..200 N·m, so that the lightest wrist
    still has a spring that a millisecond step can integrate), and rotors that keep its natural frequency and damping.
    """
    stiffness = 20.0 * np.clip(np.asarray(torque_limit, dtype=float), 5.0, 200.0)
    inertia = stiffness / OPEN_LOOP_RAD_S**2
    return Springs(stiffness, inertia, inertia * ROTOR_DAMPING_RATE, np.asarray(torque_limit, dtype=float).copy())


class Actuators:
    """n series-elastic actuators and their firmware.

    Set-points (`position`, `velocity`, `torque`, `stiffness`, `damping`, `mode`) may be written at any time and hold until
    they are written again; `powered` False lets the current fall to zero and resets the loops.
    """

    def __init__(self, springs: Springs, *, observer: bool = True, feedback: bool = True):
        """`observer`, `feedback`: False leaves out the disturbance observer, or the PD part too (to measure what they do)."""
        n = len(springs.stiffness)
        self.springs = springs
        self._parameters = _parameters(springs, observer=observer, feedback=feedback)
        self._state = np.zeros((_STATES, n))
        self.position = np.zeros(n)
        """rad"""
        self.velocity = np.zeros(n)
        """rad/s"""
        self.torque = np.zeros(n)
        """N·m"""
        self.stiffness = np.zeros(n)
        """N·m/rad"""
        self.damping = np.zeros(n)
        """N·m·s/rad"""
        self.mode = np.zeros(n, np.uint8)
        """hal.joint.Mode"""
        self.powered = np.zeros(n, np.bool_)
        self.spring_torque = np.zeros(n)
        """N·m, mean over the last step: what acts on the joint"""
        self.goal = np.zeros(n)
        """N·m, the torque that the last step's set-point asked for, after saturation"""

    def __len__(self) -> int:
        return len(self.position)

    @property
    def current(self) -> np.ndarray:
        """A (n,), of the motors, now."""
        return self._state[_CURRENT]

    def relax(self, position: np.ndarray) -> None:
        """Put the rotors where the springs are slack, at rest, for joints at `position` rad (n,)."""
        self._state[:] = 0.0
        self._state[_ROTOR] = position
        self.spring_torque[:] = 0.0

    def set_position_gains(self, stiffness: np.ndarray, damping: np.ndarray) -> None:
        """Commission the drives' own position loop: N·m/rad and N·m·s/rad, (n,)."""
        self._parameters[_POS_K] = stiffness
        self._parameters[_POS_D] = damping
        self._parameters[_POS_I] = POSITION_INTEGRAL_RATE * stiffness

    def step(self, joint_position: np.ndarray, joint_velocity: np.ndarray, cycles: int) -> np.ndarray:
        """Run the firmware for some of its cycles while the joints move on at constant velocity.

        `joint_position` rad (n,), `joint_velocity` rad/s (n,) at the step's start. Returns `spring_torque`.
        """
        _step(
            cycles, 1.0 / FIRMWARE_HZ, joint_position, joint_velocity, self.position, self.velocity, self.torque,
            self.stiffness, self.damping, self.mode, self.powered, self._parameters, self._state, self.spring_torque,
            self.goal,
        )  # fmt: skip
        return self.spring_torque


def _parameters(springs: Springs, *, observer: bool, feedback: bool) -> np.ndarray:
    """The kernel's parameters (21, n): plant, torque loop, and the observer's filters by the bilinear transform.

    Closed by PD, rotor and spring are P_c = wc² / (s² + 2 zc wc s + wc²) from torque set-point to torque. The observer
    subtracts d = Q P_c⁻¹ τ − Q τ_d' from the set-point, Q = wq² / (s² + √2 wq s + wq²).
    """
    k, inertia, friction = springs.stiffness, springs.rotor_inertia, springs.rotor_damping
    n, dt = len(k), 1.0 / FIRMWARE_HZ
    nkt = GEAR_RATIO * TORQUE_CONSTANT
    kp = TORQUE_GAIN if feedback else 0.0
    wc = np.sqrt(k * (1.0 + kp) / inertia)
    kd = np.maximum(2.0 * TORQUE_DAMPING_RATIO * (1.0 + kp) / wc - friction / k, 0.0) if feedback else np.zeros(n)
    zc = (friction / k + kd) * wc / (2.0 * (1.0 + kp))
    wq, bilinear = 2.0 * np.pi * OBSERVER_HZ, 2.0 / dt
    a0 = bilinear**2 + 2.0 * _BUTTERWORTH * wq * bilinear + wq**2
    gain = wq**2 / wc**2 if observer else np.zeros(n)
    q0 = wq**2 / a0 if observer else 0.0
    table = np.zeros((_PARAMETERS, n))
    table[_K], table[_NKT], table[_B], table[_J] = k, nkt, friction, inertia
    table[_KP], table[_KD] = kp, kd
    table[_IMAX] = CURRENT_RESERVE * springs.torque_limit / nkt
    table[_EFFORT] = springs.torque_limit
    table[_P0] = gain * (bilinear**2 + 2.0 * zc * wc * bilinear + wc**2) / a0
    table[_P1] = gain * (2.0 * wc**2 - 2.0 * bilinear**2) / a0
    table[_P2] = gain * (bilinear**2 - 2.0 * zc * wc * bilinear + wc**2) / a0
    table[_A1] = (2.0 * wq**2 - 2.0 * bilinear**2) / a0
    table[_A2] = (bilinear**2 - 2.0 * _BUTTERWORTH * wq * bilinear + wq**2) / a0
    table[_Q0], table[_Q1], table[_Q2] = q0, 2.0 * q0, q0
    table[_AC] = 1.0 - math.exp(-2.0 * np.pi * CURRENT_LOOP_HZ * dt)
    table[_AF] = 1.0 - math.exp(-2.0 * np.pi * TORQUE_RATE_FILTER_HZ * dt)
    return table


@njit(cache=True)
def _goal(mode, q, v, position, velocity, torque, stiffness, damping, kp, kd, integral):  # type: ignore[no-untyped-def]
    """The torque that a set-point asks for at joint position q and velocity v, N·m."""
    if mode == _DAMPING:
        return -damping * v
    if mode == _TORQUE:
        return torque
    if mode == _POSITION:
        return torque + kp * (position - q) + kd * (velocity - v) + integral
    return torque + stiffness * (position - q) + damping * (velocity - v)


@njit(cache=True)
def _step(  # type: ignore[no-untyped-def]
    cycles, dt, q, v, position, velocity, torque, stiffness, damping, mode, powered, table, state, spring, goals,
):  # fmt: skip
    """`cycles` of the firmware for every actuator; writes `state` (11, n), mean `spring` torque (n,), last `goals` (n,)."""
    for j in range(q.shape[0]):
        k, nkt, friction, inertia = table[_K, j], table[_NKT, j], table[_B, j], table[_J, j]
        rotor, rate, current = state[_ROTOR, j], state[_RATE, j], state[_CURRENT, j]
        disturbance, last, slope = state[_DISTURBANCE, j], state[_LAST, j], state[_SLOPE, j]
        x1, x2, y1, y2 = state[_X1, j], state[_X2, j], state[_Y1, j], state[_Y2, j]
        integral, effort = state[_INTEGRAL, j], table[_EFFORT, j]
        joint, mean, goal = q[j], 0.0, 0.0
        for _ in range(cycles):
            wanted = 0.0
            measured = k * (np.round(rotor / _RESOLUTION) * _RESOLUTION - joint)
            slope += table[_AF, j] * ((measured - last) / dt - slope)
            last = measured
            if powered[j]:
                goal = _goal(
                    mode[j], joint, v[j], position[j], velocity[j], torque[j], stiffness[j], damping[j],
                    table[_POS_K, j], table[_POS_D, j], integral,
                )  # fmt: skip
                if mode[j] == _POSITION and abs(goal) < effort:  # what is saturated already must not wind up
                    integral += table[_POS_I, j] * (position[j] - joint) * dt
                elif mode[j] != _POSITION:
                    integral = 0.0
                goal = min(max(goal, -effort), effort)
                set_point = goal - disturbance
                u = (1.0 + table[_KP, j]) * set_point - table[_KP, j] * measured - table[_KD, j] * slope
                y = table[_P0, j] * measured + x1
                x1 = table[_P1, j] * measured - table[_A1, j] * y + x2
                x2 = table[_P2, j] * measured - table[_A2, j] * y
                z = table[_Q0, j] * set_point + y1
                y1 = table[_Q1, j] * set_point - table[_A1, j] * z + y2
                y2 = table[_Q2, j] * set_point - table[_A2, j] * z
                disturbance = y - z
                wanted = min(max(u / nkt, -table[_IMAX, j]), table[_IMAX, j])
            else:
                disturbance, x1, x2, y1, y2, integral = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            current += table[_AC, j] * (wanted - current)
            rate += dt * (nkt * current - friction * rate - k * (rotor - joint)) / inertia
            rotor += dt * rate
            joint += dt * v[j]
            mean += k * (rotor - joint)
        state[_ROTOR, j], state[_RATE, j], state[_CURRENT, j] = rotor, rate, current
        state[_DISTURBANCE, j], state[_LAST, j], state[_SLOPE, j] = disturbance, last, slope
        state[_X1, j], state[_X2, j], state[_Y1, j], state[_Y2, j] = x1, x2, y1, y2
        state[_INTEGRAL, j] = integral
        spring[j] = mean / cycles
        goals[j] = goal
