"""Series-elastic actuators with their firmware: a motor, a gear and a spring, under torque control at 5 kHz.

After Radford et al., "Valkyrie: NASA's First Bipedal Humanoid Robot" (J. Field Robotics 2015), §3: feed-forward, PD and a
disturbance observer around the spring's torque, and joint impedance, damping and position control on top, all at the
firmware's rate. What the firmware knows of the joint it reads from encoder and spring sensor. The actuators themselves are
hal.plant.actuator_model, the compiled cycle hal.plant.actuator_kernels.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hal.plant import actuator_kernels as kernel
from hal.plant.actuator_kernels import FIRMWARE_HZ, ActuatorMemory
from hal.plant.actuator_model import ActuatorModel, actuators_of
from hal.plant.transmission import ParallelTransmission
from handrail.robot.description import RobotDescription

TORQUE_LOOP_HZ = 70.0
"""natural frequency of the closed torque loop, without its delays"""
TORQUE_DAMPING_RATIO = 0.67
OBSERVER_HZ = 60.0
"""bandwidth of the disturbance observer's second-order Butterworth filter Q"""
TORQUE_RATE_FILTER_HZ = 800.0
CURRENT_LOOP_HZ = 1500.0
POSITION_INTEGRAL_RATE = 2.0
"""1/s: integral over proportional gain of the position loop"""

_DT = 1.0 / FIRMWARE_HZ
_BUTTERWORTH = math.sqrt(0.5)


class Actuators:
    """n series-elastic actuators and their firmware.

    Set-points (`position`, `velocity`, `torque`, `stiffness`, `damping`, `mode`) may be written at any time and hold until
    they are written again; `powered` False lets the current fall to zero and resets the loops.
    """

    def __init__(
        self,
        model: ActuatorModel,
        *,
        plant: ActuatorModel | None = None,
        pairs: tuple[tuple[int, int, ParallelTransmission], ...] = (),
        observer: bool = True,
        feedback: bool = True,
        seed: int = 0,
    ):
        """`model`: what the firmware believes the actuators to be, and `plant` what they are (None: the same).

        `pairs`: rows of pitch and roll, and the transmission between them. `observer`, `feedback`: False leaves out the
        disturbance observer, or the PD part too (to measure what they do). `seed`: of the encoders' noise.
        """
        n = len(model)
        self.model = model
        self.pairs = pairs
        stiffness, inertia, friction = model.stiffness, model.rotor_inertia, model.rotor_damping
        self.torque_kp = np.zeros(n)
        """proportional gain of the torque loop"""
        self.torque_kd = np.zeros(n)
        """s, derivative gain of the torque loop"""
        self.observer_hz = np.full(n, OBSERVER_HZ if observer else 0.0)
        """bandwidth of the disturbance observer; 0: none"""
        if feedback:
            closed = 2.0 * np.pi * TORQUE_LOOP_HZ
            self.torque_kp[:] = np.maximum(closed**2 * inertia / stiffness - 1.0, 0.0)
            closed = np.sqrt(stiffness * (1.0 + self.torque_kp) / inertia)
            wanted = 2.0 * TORQUE_DAMPING_RATIO * (1.0 + self.torque_kp) / closed
            self.torque_kd[:] = np.maximum(wanted - friction / stiffness, 0.0)
        parts = ActuatorMemory(n, len(pairs))
        self.memory = parts.memory
        """all that the arrays below show, in one piece for kernels: never rebind them"""
        self._table, self._state = table, _ = parts.table, parts.state
        _describe(table, model, plant or model)
        self.tune()
        self._state[:, kernel.HELD] = np.inf
        parts.seeds[:] = np.random.default_rng(seed).integers(1, 2**63, n, dtype=np.uint64)
        for number, (pitch, roll, transmission) in enumerate(pairs):
            parts.pairs[number], parts.rods[number] = (pitch, roll), transmission.rods
            parts.marks[kernel.PAIRED, [pitch, roll]] = True
        signals = parts.signals
        self.position, self.velocity, self.torque, self.stiffness, self.damping = signals[: kernel.DAMPING + 1]
        self.mode = parts.marks[kernel.MODE]
        """hal.joint.Mode"""
        self.powered, self.smooth, self.limited = parts.marks[kernel.POWERED : kernel.LIMITED + 1].view(np.bool_)
        """`smooth`: whether a change of mode goes on from the torque that was; False takes the new mode's torque at once.
        `limited`: whether a limit acted in the last step"""
        self.smooth[:] = True
        self.derating = signals[kernel.DERATING]
        """0..1, of torque and current: what a hot motor may still do"""
        self.derating[:] = 1.0
        self.spring_torque = signals[kernel.SPRING]
        """N·m, mean over the last step: what acts on the joint"""
        self.measured_position, self.measured_velocity = signals[kernel.READING], signals[kernel.READING_RATE]
        """rad, the encoder's last reading; rad/s, of the loop that tracks the encoder"""
        self.measured_torque = signals[kernel.READING_TORQUE]
        """N·m at the joint, the spring sensor's mean over the last step"""
        self.goal = signals[kernel.GOAL]
        """N·m, the torque that the last step's set-point asked for, within all limits"""
        self.current = self._state[:, kernel.CURRENT]
        """A, of the motors, now"""
        self.torque_limit = table[:, kernel.EFFORT]
        """N·m, of the set-point, at the joint"""
        self.current_limit = table[:, kernel.CURRENT_MAX]
        """A"""
        self.velocity_limit = table[:, kernel.SPEED_MAX]
        """rad/s (infinite: none)"""
        self.lower, self.upper = table[:, kernel.LOWER], table[:, kernel.UPPER]
        """rad"""
        self.position_kp, self.position_kd = table[:, kernel.POSITION_K], table[:, kernel.POSITION_D]
        """N·m/rad, N·m·s/rad, of the drives' own position loop"""
        self.position_ki = table[:, kernel.POSITION_I]
        """N·m/(rad·s)"""
        self.encoder_offset, self.torque_offset = table[:, kernel.ENCODER_ADDS], table[:, kernel.TORQUE_ADDS]
        """rad, N·m: added to what the sensors read"""

    @classmethod
    def of(cls, description: RobotDescription, **options: Any) -> Actuators:
        """A robot's actuators. Raises ValueError for a parallel pair that cannot work."""
        model, transmissions = actuators_of(description)
        pairs = tuple((*description.index([t.pair.pitch, t.pair.roll]).tolist(), t) for t in transmissions)
        actuators = cls(model, pairs=pairs, **options)
        actuators.torque_limit[:] = description.torque_limit
        return actuators

    def __len__(self) -> int:
        return len(self.mode)

    def relax(self, position: np.ndarray) -> None:
        """Put the rotors where the springs are slack, at rest, for joints at `position` rad (n,)."""
        table, state = self._table, self._state
        state[:] = 0.0
        state[:, kernel.ROTOR] = position
        for pitch, roll, transmission in self.pairs:
            state[[pitch, roll], kernel.ROTOR] = transmission.positions(position[pitch], position[roll])
        quantum = table[:, kernel.QUANTUM]
        reading = np.round((position + table[:, kernel.MOUNTED]) / quantum) * quantum + self.encoder_offset
        state[:, kernel.TRACKED] = self.measured_position[:] = reading
        state[:, kernel.HELD], state[:, kernel.MODE_BEFORE] = np.inf, self.mode
        for row in (self.spring_torque, self.measured_torque, self.measured_velocity, self.goal):
            row[:] = 0.0

    def set_position_gains(self, stiffness: np.ndarray, damping: np.ndarray) -> None:
        """Commission the drives' own position loop: N·m/rad and N·m·s/rad, (n,)."""
        self.position_kp[:] = stiffness
        self.position_kd[:] = damping
        self.position_ki[:] = POSITION_INTEGRAL_RATE * stiffness

    def set_limits(self, lower: np.ndarray, upper: np.ndarray, velocity: np.ndarray, braking: np.ndarray) -> None:
        """Commission ends rad, speed limits rad/s, and the N·m·s/rad with which a joint beyond them is braked, (n,)."""
        self.lower[:], self.upper[:], self.velocity_limit[:] = lower, upper, velocity
        self._table[:, kernel.SPEED_GAIN] = braking

    def move_encoder(self, row: int, offset: float) -> None:
        """Let one encoder's angle be read with another `offset`, rad; what follows it moves along, at rest."""
        moved = offset - self.encoder_offset[row]
        self.encoder_offset[row] = offset
        self.measured_position[row] += moved
        self._state[row, kernel.TRACKED] += moved

    def tune(self) -> None:
        """Take over `torque_kp`, `torque_kd` and `observer_hz`.

        Closed by PD, rotor and spring are P_c = wc² / (s² + 2 zc wc s + wc²) from torque set-point to torque. The observer
        subtracts d = Q P_c⁻¹ τ − Q τ_d' from the set-point, Q = wq² / (s² + √2 wq s + wq²), both by the bilinear transform.
        """
        model, table, kp = self.model, self._table, self.torque_kp
        wc = np.sqrt(model.stiffness * (1.0 + kp) / model.rotor_inertia)
        zc = (model.rotor_damping / model.stiffness + self.torque_kd) * wc / (2.0 * (1.0 + kp))
        wq, bilinear = 2.0 * np.pi * self.observer_hz, 2.0 / _DT
        a0 = bilinear**2 + 2.0 * _BUTTERWORTH * wq * bilinear + wq**2
        gain, q0 = wq**2 / wc**2, wq**2 / a0
        table[:, kernel.KP], table[:, kernel.KD] = kp, self.torque_kd
        table[:, kernel.P0] = gain * (bilinear**2 + 2.0 * zc * wc * bilinear + wc**2) / a0
        table[:, kernel.P1] = gain * (2.0 * wc**2 - 2.0 * bilinear**2) / a0
        table[:, kernel.P2] = gain * (bilinear**2 - 2.0 * zc * wc * bilinear + wc**2) / a0
        table[:, kernel.A1] = (2.0 * wq**2 - 2.0 * bilinear**2) / a0
        table[:, kernel.A2] = (bilinear**2 - 2.0 * _BUTTERWORTH * wq * bilinear + wq**2) / a0
        table[:, kernel.Q0], table[:, kernel.Q1], table[:, kernel.Q2] = q0, 2.0 * q0, q0

    def step(self, joint_position: np.ndarray, joint_velocity: np.ndarray, cycles: int) -> np.ndarray:
        """Run the firmware for some of its cycles while the joints move on at constant velocity.

        `joint_position` rad (n,), `joint_velocity` rad/s (n,) at the step's start. Returns `spring_torque`.
        """
        kernel.run(cycles, joint_position, joint_velocity, self.memory)
        return self.spring_torque


def _describe(table: np.ndarray, model: ActuatorModel, plant: ActuatorModel) -> None:
    """Fill the kernel's table: the actuators as they are, and as the firmware believes them, without limits of motion."""
    table[:, kernel.K], table[:, kernel.B] = plant.stiffness, plant.rotor_damping
    table[:, kernel.PER_J] = 1.0 / plant.rotor_inertia
    table[:, kernel.NKT], table[:, kernel.COULOMB] = plant.torque_per_current, plant.rotor_friction
    table[:, kernel.SLACK] = plant.backlash / 2.0
    table[:, kernel.PER_QUANTUM] = 2.0**plant.encoder_bits / (2.0 * np.pi)
    table[:, kernel.QUANTUM] = 1.0 / table[:, kernel.PER_QUANTUM]
    table[:, kernel.NOISE], table[:, kernel.MOUNTED] = plant.encoder_noise, plant.encoder_offset
    table[:, kernel.MOTOR_MOUNTED], table[:, kernel.ON_MOTOR] = plant.motor_offset, plant.servo_on_motor
    table[:, kernel.MODEL_K], table[:, kernel.MODEL_NKT] = model.stiffness, model.torque_per_current
    table[:, kernel.CURRENT_MAX] = model.current_limit
    table[:, kernel.FORCE_MAX] = table[:, kernel.EFFORT] = model.torque_limit
    table[:, kernel.AC] = 1.0 - math.exp(-2.0 * np.pi * CURRENT_LOOP_HZ * _DT)
    table[:, kernel.AF] = 1.0 - math.exp(-2.0 * np.pi * TORQUE_RATE_FILTER_HZ * _DT)
    table[:, kernel.LOWER], table[:, kernel.UPPER] = -np.inf, np.inf
    table[:, kernel.SPEED_MAX] = 1e9
