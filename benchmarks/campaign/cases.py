"""What is done to the robot in a run: a fault, to whom, when, for how long. Everything is drawn from the run's number."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from benchmarks.campaign.kinds import DEVICE_KINDS, KINDS, PROCESS_KINDS
from hal.can.faults import Fault
from hal.hil.plant_process import SILENCE_S
from handrail.robot.description import RobotDescription

LENGTH_S = 3.8
"""of the motion in which the fault begins"""
DRIVE_ERRORS = ("encoder", "overcurrent", "overtemperature", "communication", "internal")
DEVICE_FAULTS = ("drop", "delay", "corrupt", "stuck", "bus_off", "cut")
_FAMILIES = {"sensor": ("imu", "force_torque"), "battery": ("power",)}
_HOST = "daemon"


class Case(msgspec.Struct, kw_only=True, frozen=True):
    """One run's fault."""

    number: int
    kind: str
    at: float
    """s of the plant's time after the motion began"""
    words: str
    """for people"""
    fault: Fault | None = None
    """kinds of the bus and of devices"""
    joint: str = ""
    error: str = ""
    """kind drive_error"""
    frozen_s: float = 0.0
    """kind loop_frozen, wall time"""


def draw(number: int, seed: int, description: RobotDescription) -> Case:
    """The case of a run; kinds take turns, so that every so many runs have all of them."""
    kind = KINDS[number % len(KINDS)]
    random = np.random.default_rng([seed, number])
    at = round(float(random.uniform(0.0, LENGTH_S)), 3)
    # Faults strike where the robot works: the drives of the moving arm more often than others.
    arm = description.arms["right"].joints
    joint = str(random.choice(arm if random.random() < 0.8 else description.joints))
    if kind == "drive_error":
        error = str(random.choice(DRIVE_ERRORS))
        return Case(number=number, kind=kind, at=at, joint=joint, error=error, words=f"{joint}: {error}")
    if kind in PROCESS_KINDS:
        # Less than the plant's patience, then it is a hiccup; or more, then the drives are on their own.
        hiccup = random.random() < 0.5
        span = (0.02, 0.5) if hiccup else (SILENCE_S + 0.5, SILENCE_S + 1.5)
        frozen = round(float(random.uniform(*span)), 3) if kind == "loop_frozen" else 0.0
        return Case(number=number, kind=kind, at=at, frozen_s=frozen, words=f"{frozen:g} s" if frozen else "")
    if kind in DEVICE_KINDS:
        device = random.choice([device.name for device in description.devices if device.family in _FAMILIES[kind]])
        fields = {"kind": str(random.choice(DEVICE_FAULTS)), "node": str(device)} | _passing(random)
    else:
        fields = _bus_fault(kind, joint, random, description)
    fault = msgspec.convert({"kind": kind, "after": at, "seed": number, **fields}, Fault)
    shown = {name: value for name, value in fields.items() if name != "seed"}
    words = ", ".join(f"{k} {v:#x}" if k == "can_id" else f"{k} {v}" for k, v in shown.items())
    return Case(number=number, kind=kind, at=at, fault=fault, words=words)


def _bus_fault(kind: str, joint: str, random: np.random.Generator, description: RobotDescription) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    # Who: mostly one drive, else the host, a whole channel, or everybody.
    who = random.choice(["drive", "host", "channel", "all"], p=[0.5, 0.25, 0.15, 0.1])
    limb = next(limb for limb in description.limbs if joint in limb.joints)
    if kind == "babble":
        # A rogue that wins every arbitration, or one that loses them all.
        fields |= {"node": joint, "can_id": int(random.choice([0x000, 0x150, 0x7FF])), "channel": limb.channel}
    elif kind == "bus_off" or (kind == "stuck" and who in ("channel", "all")) or who == "drive":
        fields["node"] = joint if who != "host" else _HOST
    elif who == "host":
        fields["node"] = _HOST
    elif who == "channel" or kind == "cut":
        fields["channel"] = limb.channel
    if kind in ("drop", "delay", "duplicate", "reorder", "corrupt", "bit_error"):
        fields["probability"] = float(random.choice([0.02, 0.1, 0.3, 1.0]))
    if kind == "delay":
        fields["delay"] = float(random.choice([0.001, 0.003, 0.01, 0.05]))
    return fields | _passing(random)


def _passing(random: np.random.Generator) -> dict[str, Any]:
    """For how long: it passes, or it stays."""
    return {"duration": round(float(10 ** random.uniform(-2.7, 0.0)), 4)} if random.random() < 0.7 else {}
