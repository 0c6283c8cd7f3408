"""A drive family made up for tests, whose positions travel as 32-bit floating-point numbers, and so may be none at all."""

from __future__ import annotations

import re
from pathlib import Path

from hal.drives import family

NAME = "floats"
POSITION = slice(1, 5)
"""the answer's bytes that are the position"""
TOLD = slice(0, 4)
"""the command's bytes that are the position"""

_DESCRIBED = """
name: floats
title: positions as floating-point numbers
text: made up for tests
serves: joints
limbs: 8
axes: 7
modes: [damping, torque, impedance]
messages:
  control:
    message: Command_{limb}_{axis}
    payloads:
      disable_voltage: FF FF FF FF FF FF FF F8
      quick_stop: FF FF FF FF FF FF FF F9
      shutdown: FF FF FF FF FF FF FF FA
      switch_on: FF FF FF FF FF FF FF FB
      enable_operation: FF FF FF FF FF FF FF FC
      fault_reset: FF FF FF FF FF FF FF FD
  command:
    message: Command_{limb}_{axis}
    fields: {position: Position, stiffness: Kp, damping: Kd, mode: {constant: 2}}
  status:
    message: Feedback_{limb}_{axis}
    fields:
      position: Position
      velocity: Velocity
      torque: Torque
      state:
        signal: Error
        values:
          {1: switch_on_disabled, 2: ready_to_switch_on, 3: switched_on, 4: operation_enabled, 5: quick_stop_active, 7: fault}
"""
_COMMAND = """ SG_ Position : 0|32@1- (1,0) [-12.5|12.5] "rad" {node}
 SG_ Kp : 32|12@1+ (0.1221001221001221,0) [0|500] "N*m/rad" {node}
 SG_ Kd : 44|12@1+ (0.001221001221001221,0) [0|5] "N*m*s/rad" {node}
"""
_FEEDBACK = """ SG_ Error : 4|4@1+ (1,0) [0|15] "" Host
 SG_ Id : 0|4@1+ (1,0) [0|15] "" Host
 SG_ Position : 8|32@1- (1,0) [-12.5|12.5] "rad" Host
 SG_ Velocity : 40|12@1+ (0.02197802197802198,-45) [-45|45] "rad/s" Host
 SG_ Torque : 52|12@1+ (0.026373626373626374,-54) [-54|54] "N*m" Host
"""


def make(workspace: Path) -> None:
    """Write the family into a workspace's folder of drives: MIT's frames, but for how their positions are coded."""
    folder = workspace / "drives" / NAME
    folder.mkdir(parents=True)
    (folder / "family.yaml").write_text(_DESCRIBED)
    text, floats = (Path(family.__file__).parent / "mit" / "mit.dbc").read_text(), []

    def signals(found: re.Match[str]) -> str:
        number, name, node = found["number"], found["name"], found["name"].replace("Command", "Motor")
        floats.append(f"SIG_VALTYPE_ {number} Position : 1;\n")
        return found["head"] + (_COMMAND.format(node=node) if name.startswith("Command") else _FEEDBACK)

    text = re.sub(r"(?P<head>BO_ (?P<number>\d+) (?P<name>(Command|Feedback)_\d_\d): .*\n)( SG_ .*\n)+", signals, text)
    (folder / f"{NAME}.dbc").write_text(text + "".join(floats))
