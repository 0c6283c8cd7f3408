"""What the actuators are made of: springs, rotors, gears, sensors. Everything is referred to the joint, behind the gear.

After Radford et al. 2015, §3.2: the open loop from motor torque to spring torque is k / (j s² + b s + k), resonant, −3 dB at
13 Hz. What a robot's description leaves out follows from each joint's rated torque.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from hal.plant.transmission import ParallelTransmission, transmissions_of
from handrail.robot.description import Actuator, RobotDescription

STIFFNESS_PER_TORQUE = 20.0
"""1/rad: a spring's stiffness over the rated torque, which turns it by 0.05 rad"""
OPEN_LOOP_RAD_S = 56.2
"""natural frequency of rotor and spring with a locked output: 8.94 Hz"""
OPEN_LOOP_DAMPING_RATIO = 0.3
GEAR_RATIO = 100.0
TORQUE_CONSTANT = 0.05
"""N·m/A, of the motor"""
CURRENT_RESERVE = 2.0
"""the current's limit over the current of the rated torque: 30 A for ever and 60 A in bursts (§2.3)"""
_LIGHTEST, _HEAVIEST = 5.0, 200.0  # N·m: rated torques beyond these get these one's springs
_OF_JOINTS = ("encoder_bits", "encoder_noise", "encoder_offset", "motor_offset")


@dataclass(frozen=True)
class ActuatorModel:
    """What distinguishes one joint's actuator from another's. Arrays have shape (n,) or (1,): the same for all.

    The two rows of a parallel pair are its left and right actuator, by way of the pair's lever arm (hal.plant.transmission);
    their encoders are the joints' own.
    """

    torque_limit: np.ndarray
    """N·m, rated"""
    stiffness: np.ndarray
    """N·m/rad, of the spring"""
    rotor_inertia: np.ndarray
    """kg·m²"""
    rotor_damping: np.ndarray
    """N·m·s/rad"""
    torque_per_current: np.ndarray
    """N·m/A: gear ratio · torque constant"""
    current_limit: np.ndarray
    """A"""
    rotor_friction: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """N·m, Coulomb friction of motor and gear, before the spring"""
    backlash: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """rad, of the gear, before the spring"""
    encoder_bits: np.ndarray = field(default_factory=lambda: np.full(1, Actuator().encoder_bits))
    """a turn of the joint"""
    encoder_noise: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """rad, standard deviation"""
    encoder_offset: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """rad by which the uncalibrated encoder reads too much"""
    motor_offset: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """rad by which the angle measured at the motor is too much"""
    servo_on_motor: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """1: the firmware's loops close on the angle measured at the motor, 0: on the encoder's"""

    def __post_init__(self) -> None:
        n = len(self.torque_limit)
        for each in fields(self):
            object.__setattr__(self, each.name, np.resize(np.asarray(getattr(self, each.name), float), n))

    def __len__(self) -> int:
        return len(self.torque_limit)


def sized_for(torque_limit: np.ndarray) -> ActuatorModel:
    """Actuators sized for rated torques N·m (n,), where nothing better is known.

    The reference is an actuator of 175 N·m with the paper's figures: k 3500 N·m/rad, N 100, kt 0.05 N·m/A, rotor
    1.1e-4 kg·m² before the gear, natural frequency 8.9 Hz with damping ratio 0.3, so that the open loop resonates and passes
    13 Hz. Others have its spring scaled with their rated torque (within 5..200 N·m, so that the lightest wrist still has a
    spring that a millisecond step can integrate), and rotors that keep its natural frequency and damping ratio.
    """
    rated = np.array(torque_limit, dtype=float)
    stiffness = STIFFNESS_PER_TORQUE * np.clip(rated, _LIGHTEST, _HEAVIEST)
    inertia = stiffness / OPEN_LOOP_RAD_S**2
    per_current = np.full(len(rated), GEAR_RATIO * TORQUE_CONSTANT)
    return ActuatorModel(
        torque_limit=rated,
        stiffness=stiffness,
        rotor_inertia=inertia,
        rotor_damping=2.0 * OPEN_LOOP_DAMPING_RATIO * OPEN_LOOP_RAD_S * inertia,
        torque_per_current=per_current,
        current_limit=CURRENT_RESERVE * rated / per_current,
    )


def actuators_of(description: RobotDescription) -> tuple[ActuatorModel, tuple[ParallelTransmission, ...]]:
    """A robot's actuators, and the transmissions of those that work in pairs.

    A given spring without a rotor gets one that keeps the open loop's natural frequency and damping ratio. Raises ValueError
    for a parallel pair that cannot work, and for one whose loops shall close on its motors: those measure lengths, not joints.
    """
    on_motor = np.array([actuator.servo == "motor" for actuator in description.actuators], float)
    for pair in description.parallel_pairs:
        for joint in (pair.pitch, pair.roll):
            if on_motor[description.index(joint)]:
                raise ValueError(f"actuators.{joint}.servo: got motor; expected joint in the parallel pair {pair.name}")
    transmissions = transmissions_of(description)
    rated = np.array(description.torque_limit, float)
    for transmission in transmissions:
        rows = description.index([transmission.pair.pitch, transmission.pair.roll])
        rated[rows] = transmission.rated(*rated[rows])

    def given(name: str, otherwise: np.ndarray | float) -> np.ndarray:
        values = [getattr(actuator, name) for actuator in description.actuators]
        return np.where(
            [value is None for value in values], otherwise, [0.0 if value is None else value for value in values]
        )

    sized = sized_for(rated)
    stiffness = given("spring_stiffness", sized.stiffness)
    inertia = given("rotor_inertia", stiffness / OPEN_LOOP_RAD_S**2)
    critical = np.sqrt(stiffness * inertia)
    per_current = given("gear_ratio", GEAR_RATIO) * given("torque_constant", TORQUE_CONSTANT)
    model = ActuatorModel(
        torque_limit=rated,
        stiffness=stiffness,
        rotor_inertia=inertia,
        rotor_damping=given("rotor_damping", 2.0 * OPEN_LOOP_DAMPING_RATIO * critical),
        torque_per_current=per_current,
        current_limit=given("current_limit", CURRENT_RESERVE * rated / per_current),
        backlash=given("backlash", 0.0),
        servo_on_motor=on_motor,
        **{name: given(name, 0.0) for name in _OF_JOINTS},
    )
    return model, transmissions
