"""The documented example runs as users run it, and a test that fails leaves evidence that CAN tools and Foxglove open."""

import re
import subprocess
import sys
from pathlib import Path

import can
import pytest
from mcap.reader import make_reader

EXAMPLE = Path(__file__).parents[2] / "examples" / "test_my_controller.py"
WHOLE_BODY = EXAMPLE.with_name("test_whole_body.py")

FAILING = """
import pytest

@pytest.mark.handrail(robot="sea_bench")
def test_that_fails(robot):
    robot.move("elbow_joint", 0.1, 0.2)
    assert robot.position("elbow_joint") > 9.0

@pytest.mark.handrail(robo="talos_upper")
def test_that_is_marked_wrongly(plant):
    pass

@pytest.mark.handrail(scene="FOLDER/scene.yaml")
def test_with_a_wrong_scene(plant):
    pass

@pytest.mark.handrail(faults="FOLDER/faults.yaml")
def test_with_wrong_faults(plant):
    pass

@pytest.mark.handrail(faults="FOLDER/node.yaml")
def test_with_faults_of_nobody(plant):
    pass
"""


def test_the_example_is_a_controller_and_its_test_in_thirty_lines():
    assert len(EXAMPLE.read_text().splitlines()) <= 30


@pytest.mark.timeout(300)
def test_the_examples_pass_and_a_failing_test_leaves_captures_and_a_recording(tmp_path):
    (tmp_path / "test_failing.py").write_text(FAILING.replace("FOLDER", str(tmp_path)))
    pose = "pose_in_world: {position: [1, 0, 0]}"
    (tmp_path / "scene.yaml").write_text(f"objects:\n  wall:\n    kind: box\n    {pose}\n    size: [1, -2, 1]\n")
    (tmp_path / "faults.yaml").write_text("faults:\n- {kind: drop, probability: 1.5}\n")
    (tmp_path / "node.yaml").write_text("faults:\n- {kind: drop}\n- {kind: cut, node: arm_midle_*}\n")
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", "/dev/null"),
            *("--basetemp", str(tmp_path / "base"), str(EXAMPLE), str(WHOLE_BODY), str(tmp_path / "test_failing.py")),
        ],
        capture_output=True,
        text=True,
        timeout=290,
        check=False,
    )
    assert "2 passed" in done.stdout, done.stdout
    assert "1 failed" in done.stdout
    assert "robo; expected robot, scene, clock" in done.stdout
    for words in (
        r"scene.yaml:5: objects.wall.size\[1\]: .*> 0.0; got -2",
        r"faults.yaml:2: faults\[0\].probability: .*<= 1.0; got 1.5",
        r"node.yaml:3: faults\[1\].node: got 'arm_midle_\*'; expected a name, or a glob, of arm_left_1_joint, .*battery",
    ):
        assert re.search(f"^@pytest.mark.handrail: {tmp_path}/{words}", done.stdout, re.MULTILINE), done.stdout
    evidence = dict(re.findall(r"^(capture|recording): (\S+)$", done.stdout, re.MULTILINE))
    with can.LogReader(evidence["capture"]) as log:
        assert sum(1 for _ in log) > 1000
    with open(evidence["recording"], "rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert {"/joint_states", "/daemon_status"} <= {channel.topic for channel in summary.channels.values()}
