"""Pictures show the robot and the wheel as the state says."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from hal.plant.picture import HEIGHT, WIDTH, PictureState, render
from hal.plant.scene import load


def test_a_picture_is_written_from_the_command_line(tmp_path):
    state, out = tmp_path / "state.json", tmp_path / "picture.png"
    state.write_text(
        json.dumps({"type": "GroundTruth", "joints": {"arm_right_4_joint": -1.5}, "hinges": {"valve": 0.5}})
    )
    what = ["--robot", "talos_upper", "--scene", "valve", "--state", str(state), "--out", str(out)]
    subprocess.run([sys.executable, "-m", "hal.plant.picture", *what], check=True, timeout=120)
    picture = np.asarray(Image.open(out))
    assert picture.shape == (HEIGHT, WIDTH, 3)
    assert len(np.unique(picture.astype(int) @ (1, 256, 65536))) > 500  # a robot, not a blank page


def test_a_turned_wheel_looks_different(robot):
    pictures = [render(robot, load("valve"), PictureState(hinges={"valve": angle})) for angle in (0.0, 0.6)]
    changed = np.abs(pictures[0].astype(int) - pictures[1].astype(int)).max(axis=2) > 40
    assert 200 < changed.sum() < 0.1 * changed.size


@pytest.mark.parametrize(
    ("state", "says"),
    [
        (PictureState(joints={"elbow": 1.0}), "joints.elbow: not in this scene; expected one of arm_right_1_joint"),
        (PictureState(hinges={"door": 1.0}), "hinges.door: not in this scene; expected one of valve"),
        (PictureState(hinges={"valve": float("nan")}), "hinges.valve: got nan"),
    ],
)
def test_what_is_not_there_is_named(robot, state, says):
    with pytest.raises(ValueError, match=says):
        render(robot, load("valve"), state)
