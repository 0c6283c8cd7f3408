"""The series-elastic actuators against the figures of Radford et al. 2015, §3.2 (its figures 5 and 6): ``handrail bench sea``.

The frequency response from torque set-point to spring torque, open and closed; a constant torque while a hand forces the joint;
and plants that are not what the firmware believes them to be, with the disturbance observer and without it. Everything is
measured on the plant's own firmware and actuators. ``--out FOLDER`` writes bode.png, hand.png and mismatch.png, and the
responses as bode.csv.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.rows import Row, against
from hal.joint import Mode
from hal.plant.actuator import FIRMWARE_HZ, Actuators
from hal.plant.actuator_model import ActuatorModel, sized_for

RATED = 175.0
"""N·m, of the actuator that is measured; all others are this one scaled"""
HAND = ((0.35, 0.7), (0.12, 1.7), (0.04, 3.1))
"""amplitude rad, frequency Hz: what a hand does to the joint is their sum"""
_FREQUENCIES = np.unique(np.concatenate([np.round(np.geomspace(1.0, 200.0, 60)), np.arange(60.0, 81.0)]))
_SWEPT = np.array([1.0, 2, 3, 5, 7, 10, 14, 20, 28, 35, 40, 50, 60, 70])
_AMPLITUDE = 0.008 * RATED  # N·m: small enough for the current's limit at 70 Hz
_SLOW_HZ, _FLAT_HZ = 20.0, 70.0
_SETTLE_S, _MEASURE_S, _HAND_S = 0.6, 1.0, 4.0
_MINUS_3_DB = 20.0 * np.log10(np.sqrt(0.5))

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """A measured frequency response. `gain` is complex, spring torque over set-point, at `frequencies` Hz."""

    frequencies: Floats
    gain: npt.NDArray[np.complex128]

    @property
    def decibel(self) -> Floats:
        return 20.0 * np.log10(np.maximum(np.abs(self.gain), 1e-6))

    @property
    def phase_deg(self) -> Floats:
        return np.degrees(np.unwrap(np.angle(self.gain)))

    @property
    def peak_db(self) -> float:
        return float(self.decibel.max())

    @property
    def bandwidth_hz(self) -> float:
        """Where the gain falls through −3 dB, between two measured frequencies; infinite when it does not."""
        below = np.flatnonzero(self.decibel < _MINUS_3_DB)
        if not len(below):
            return float("inf")
        if (i := int(below[0])) == 0:
            return float(self.frequencies[0])
        share = (_MINUS_3_DB - self.decibel[i - 1]) / (self.decibel[i] - self.decibel[i - 1])
        return float(self.frequencies[i - 1] * (self.frequencies[i] / self.frequencies[i - 1]) ** share)

    def from_flat_db(self, hz: float) -> float:
        """The largest distance from 0 dB up to a frequency, dB."""
        return float(np.abs(self.decibel[self.frequencies <= hz]).max())

    def differs(self, other: Response, hz: float) -> float:
        """The largest distance between two responses up to a frequency, over the set-point."""
        return float(np.abs(self.gain - other.gain)[self.frequencies <= hz].max())


def gains(actuators: Actuators, frequencies: Floats, load_inertia: Floats | None = None) -> npt.NDArray[np.complex128]:
    """Spring torque over set-point (n,), every actuator at a frequency of its own, Hz (n,).

    Sines of a whole number of periods as set-points, the spring's torque correlated with them. `load_inertia` kg·m² (n,): of
    what the joints carry (None: they are locked).
    """
    n = len(frequencies)
    actuators.mode[:], actuators.powered[:] = Mode.TORQUE, True
    position, velocity, sum_ = np.zeros(n), np.zeros(n), np.zeros(n, complex)
    settle, measure = round(_SETTLE_S * FIRMWARE_HZ), round(_MEASURE_S * FIRMWARE_HZ)
    for cycle in range(settle + measure):
        turn = np.exp(2j * np.pi * frequencies * (cycle / FIRMWARE_HZ))
        actuators.torque[:] = _AMPLITUDE * turn.imag
        torque = actuators.step(position, velocity, 1)
        if load_inertia is not None:
            velocity += torque / load_inertia / FIRMWARE_HZ
            position += velocity / FIRMWARE_HZ
        if cycle >= settle:
            sum_ += torque * turn.conj()
    return sum_ * 2j / measure / _AMPLITUDE


def response(*, observer: bool = True, feedback: bool = True) -> Response:
    """Of the reference actuator with a locked output."""
    actuators = Actuators(sized_for(np.full(len(_FREQUENCIES), RATED)), observer=observer, feedback=feedback)
    return Response(_FREQUENCIES, gains(actuators, _FREQUENCIES))


def held_by_hand(torque: float, *, observer: bool = True) -> tuple[Floats, Floats]:
    """A constant torque N·m while a hand forces the joint: its position rad and the spring's torque N·m, every 0.2 ms."""
    actuators = Actuators(sized_for(np.array([RATED])), observer=observer)
    actuators.mode[:], actuators.powered[:], actuators.torque[:] = Mode.TORQUE, True, torque
    still = np.zeros(1)
    for _ in range(round(_SETTLE_S * FIRMWARE_HZ)):
        actuators.step(still, still, 1)
    time = np.arange(round(_HAND_S * FIRMWARE_HZ)) / FIRMWARE_HZ
    share = np.minimum(time / 0.5, 1.0)
    softly = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # how a hand takes hold: minimum jerk
    position = softly * np.sum([a * np.sin(2 * np.pi * f * time) for a, f in HAND], axis=0)
    velocity = np.gradient(position, 1.0 / FIRMWARE_HZ)
    spring = [actuators.step(position[i : i + 1], velocity[i : i + 1], 1)[0] for i in range(len(time))]
    return position, np.array(spring)


@dataclass(frozen=True)
class Mismatch:
    """A plant that is not what the firmware believes it to be, and whether the observer helps there, slow and fast."""

    name: str
    helps_slow: bool
    helps_fast: bool
    factors: tuple[tuple[str, float], ...] = ()
    """of ActuatorModel's fields"""
    coulomb: float = 0.0
    """over the rated torque, before the spring"""
    load: float | None = None
    """inertia of what the joint carries over the rotor's; None: locked"""

    def plant(self, model: ActuatorModel) -> ActuatorModel:
        changed = {name: getattr(model, name) * factor for name, factor in self.factors}
        return dataclasses.replace(model, rotor_friction=self.coulomb * model.torque_limit, **changed)


MISMATCHES = (
    Mismatch("load 5 rotors' inertia", True, True, load=5.0),
    Mismatch("load as the rotor", True, True, load=1.0),
    Mismatch("load a fifth of the rotor", True, True, load=0.2),
    Mismatch("load a twentieth of the rotor", True, True, load=0.05),
    Mismatch("rotor's friction × 0", True, False, factors=(("rotor_damping", 0.0),)),
    Mismatch("rotor's friction × 2", True, False, factors=(("rotor_damping", 2.0),)),
    Mismatch("rotor's friction × 5", True, False, factors=(("rotor_damping", 5.0),)),
    Mismatch("Coulomb friction of 3 %", True, False, coulomb=0.03),
    Mismatch("rotor's inertia × 0.5", True, False, factors=(("rotor_inertia", 0.5),)),
    Mismatch("rotor's inertia × 0.7", True, False, factors=(("rotor_inertia", 0.7),)),
    Mismatch("rotor's inertia × 1.4", True, False, factors=(("rotor_inertia", 1.4),)),
    Mismatch("rotor's inertia × 2", True, False, factors=(("rotor_inertia", 2.0),)),
    Mismatch("spring × 0.7", False, False, factors=(("stiffness", 0.7),)),
    Mismatch("spring × 1.3", False, False, factors=(("stiffness", 1.3),)),
)
"""The observer takes out what slow forces do, and gives away some of the margin at its own bandwidth: a rotor twice as heavy as
believed makes it ring. A spring that is not what the firmware believes falsifies the torque sensor itself: nothing helps."""


def swept(mismatches: Sequence[Mismatch] = MISMATCHES) -> tuple[list[Response], list[Response]]:
    """Responses to each mismatch, after that of the plant that is as believed: without the observer, and with it."""
    everything = [Mismatch("none", False, False), *mismatches]
    shape = (2, len(everything), len(_SWEPT))
    n = int(np.prod(shape))
    model = sized_for(np.full(n, RATED))
    each = [mismatch.plant(sized_for(np.full(len(_SWEPT), RATED))) for mismatch in everything]
    plant = ActuatorModel(
        **{
            field.name: np.tile(np.concatenate([getattr(one, field.name) for one in each]), 2)
            for field in dataclasses.fields(ActuatorModel)
        }
    )
    actuators = Actuators(model, plant=plant)
    actuators.observer_hz[: n // 2] = 0.0
    actuators.tune()
    loads = np.array([1e9 if one.load is None else one.load for one in everything])[None, :, None]
    inertia = np.broadcast_to(loads * model.rotor_inertia[0], shape).ravel()
    measured = gains(actuators, np.broadcast_to(_SWEPT, shape).ravel(), inertia).reshape(shape)
    without, with_ = ([Response(_SWEPT, gain) for gain in half] for half in measured)
    return without, with_


def rows(out: Path | None = None) -> list[Row]:
    """One row a figure of the paper, then two a mismatch. `out`: folder for pictures and the responses. About 15 s."""
    opened = response(observer=False, feedback=False)
    closed = response()
    torque = 0.3 * RATED
    hands = {name: held_by_hand(torque, observer=observer) for name, observer in (("with", True), ("without", False))}
    errors = {name: float(np.abs(spring - torque).max()) / RATED * 100 for name, (_, spring) in hands.items()}
    without, with_ = swept()
    if out:
        out.mkdir(parents=True, exist_ok=True)
        from benchmarks.sea_pictures import draw

        draw(out, opened, closed, hands, torque, without, with_)

    def row(name: str, value: float, unit: str, goal: str, *, holds: bool) -> Row:
        return Row(name=name, value=round(value, 3), unit=unit, goal=goal, holds=holds)

    found = [
        row("open loop, −3 dB", opened.bandwidth_hz, "Hz", "13 ± 0.5", holds=abs(opened.bandwidth_hz - 13.0) <= 0.5),
        row("open loop, resonant peak", opened.peak_db, "dB", "≥ 3", holds=opened.peak_db >= 3.0),
        row("closed loop, −3 dB", closed.bandwidth_hz, "Hz", "≥ 70", holds=closed.bandwidth_hz >= _FLAT_HZ),
        row(
            "closed loop, from flat up to 70 Hz",
            closed.from_flat_db(_FLAT_HZ),
            "dB",
            "≤ 3",
            holds=closed.from_flat_db(_FLAT_HZ) <= 3.0,
        ),
        row("closed loop, peak", closed.peak_db, "dB", "≤ 1", holds=closed.peak_db <= 1.0),
        row(
            "constant torque, forced by hand: error",
            errors["with"],
            "% of rated",
            "< 1",
            holds=errors["with"] < 1.0,
        ),
        against(
            "… and against the loop without observer",
            errors["with"],
            "% of rated",
            "no observer",
            errors["without"],
            at_most=0.5,
        ),
    ]
    for i, mismatch in enumerate(MISMATCHES, 1):
        for hz, helps in ((_SLOW_HZ, mismatch.helps_slow), (_FLAT_HZ, mismatch.helps_fast)):
            ours, peer = (100 * them[i].differs(them[0], hz) for them in (with_, without))
            entry = against(f"{mismatch.name}, to {hz:g} Hz", ours, "% off", "no observer", peer, at_most=0.95)
            if not helps:
                entry.goal, entry.holds = "no help", not entry.holds
            found.append(entry)
    return found
