"""What the template tests share: templates written by the test itself."""

from __future__ import annotations

import pytest

from affordance_templates import template_file

CABINET = """\
title: Cabinet # what it is
parameters:
  width: {default: 0.6, unit: m, min: 0.2, max: 1.0, step: 0.05}
  swing: {default: 1, choices: [-1, 1], title: which way it opens}
  buttons: {default: 3, min: 1, max: 6, integer: true}
  opening: {default: 60, unit: deg, min: 5, max: 110}
definitions:
  grip: ${width - 0.05}
materials:
  steel: {color: [0.5, 0.5, 0.5, 1.0]}
objects:
  frame:
    shapes: [{kind: box, size: [0.4, width, 0.7], position: [0.2, width/2, 0]}]
    material: steel
    editable: {y: width}
  leaf: # the door's
    joint: hinge
    shapes: [{kind: box, size: [0.02, width, 0.7], position: [0, width/2, 0], material: steel}]
  handle:
    joint: latch
    position: [-0.05, grip, 0]
    shapes: [{kind: capsule, size: [0.01, 0.1], rpy: [pi/2, 0, 0]}]
  key:
    repeat: {i: buttons}
    joint: press[i]
    position: [-0.01, 0, 0.05 * i]
    shapes: [{kind: cylinder, size: [0.01, 0.02], rpy: [0, pi/2, 0]}]
joints:
  hinge: {kind: revolute, axis: [0, 0, swing], lower: 0, upper: 110 * deg}
  latch: {kind: revolute, parent: leaf, axis: [1, 0, 0], origin: [0, grip, 0], lower: 0, upper: 45 * deg}
  press: {repeat: {i: buttons}, parent: leaf, kind: prismatic, axis: [1, 0, 0], lower: 0, upper: 0.005}
features:
  button: {repeat: {i: buttons}, on: "key[i]", pointing: [1, 0, 0], across: [0, 1, 0]}
  edge:
    on: leaf
    arguments: {height: {default: 0, min: -0.35, max: 0.35}}
    position: [0, width, height]
  axle: {kind: axis, on: leaf, axis: [0, 0, 1]}
trajectories:
  open:
    hand: opening
    side: right
    stance: {position: [-0.8, 0.3, 0], yaw: 0}
    waypoints:
      - {name: before, approach: free, frame: handle, position: [-0.1, 0.03, 0], axis: [1, 0, 0], across: [0, 0, 1]}
      - name: grasp
        approach: guarded
        until: 5
        frame: handle
        axis: [1, 0, 0]
        across: [0, 0, 1]
        tool: [0, 0, -0.02]
        tolerance: {position: [0.01, 0.04, 0.01], rotation: [5 * deg, 5 * deg, 20 * deg]}
        speed: 0.05
        hand_pose: closed
      - {name: turn, approach: along, joint: latch, to: 30 * deg, force: {direction: [0, 1, 0], size: 10}}
      - {name: swing, approach: along, joint: hinge, to: opening * deg}
      - {name: away, approach: straight, frame: handle, position: [-0.1, 0, 0], axis: [1, 0, 0], hand_pose: open}
  hold:
    hand: holding
    waypoints:
      - {name: touch, approach: free, frame: edge(0.1), axis: [1, 0, 0]}
      - {name: stay, approach: along, joint: hinge, to: opening * deg}
  push:
    repeat: {i: buttons}
    waypoints:
      - {name: before, approach: free, frame: "button[i]", position: [0, 0, 0.05]}
      - {name: down, approach: guarded, frame: "button[i]", until: 8}
sync:
  both:
    trajectories: [open, hold]
    points: [[open.turn, hold.touch], [open.swing, hold.stay]]
"""


@pytest.fixture
def cabinet_text():
    """The text of a template that says everything that one can."""
    return CABINET


@pytest.fixture
def template_of(tmp_path):
    """text → template, read from a file."""

    def read(text: str):
        file = tmp_path / "cabinet.yaml"
        file.write_text(text)
        return template_file.read(file)

    return read


@pytest.fixture
def cabinet(template_of):
    return template_of(CABINET)
