"""`handrail controllers ...` against a robot that is up, and what it says where something is wrong."""

import msgspec
import pytest
from typer.testing import CliRunner

from daemon.cli import aligned
from daemon.controllers.cli import controllers
from daemon.controllers.roster import Loaded, Roster
from daemon.serving.validation import check_load, check_loaded
from handrail import messages as m
from handrail.robot import library as robots
from handrail.topics import RefusedError

JOINTS = ("shoulder_joint", "elbow_joint")


@pytest.mark.handrail(robot="sea_bench")
@pytest.mark.timeout(300)
def test_controllers_are_listed_loaded_switched_and_unloaded_while_the_robot_runs(robot, handrail_rig):
    def run(*words: str):
        return CliRunner().invoke(controllers, [*words, "--runtime", str(handrail_rig.folder)])

    def listed() -> m.ControllerList:
        told = run("list", "--json")
        assert told.exit_code == 0, told.output
        return msgspec.json.decode(told.stdout, type=m.ControllerList)

    first = listed()
    assert [(c.name, c.state, c.joints) for c in first.controllers] == [("hold", "active", list(JOINTS))]
    assert {"joint_impedance", "gravity_compensation"} <= set(first.kinds)
    loaded = run(
        "load", "soft", "--kind", "joint_impedance", "--joints", "elbow*", "--parameters", '{"stiffness": 0.5}'
    )
    assert (loaded.exit_code, loaded.stdout) == (0, "soft is inactive\n")
    assert run("switch", "--activate", "soft").exit_code == 0
    assert {c.name: (c.state, c.joints) for c in listed().controllers} == {
        "soft": ("active", ["elbow_joint"]),
        "hold": ("active", ["shoulder_joint"]),
    }
    robot.daemon.wait_status(lambda status: status.controllers.get("soft") == ["elbow_joint"], "the status tells")
    shown = run("list").stdout.splitlines()
    assert shown[1].split()[:3] == ["soft", "joint_impedance", "active"]
    assert shown[1].split()[4:] == ["s", "everything", "robot", "elbow_joint"]
    refused = run("unload", "soft")
    assert refused.exit_code == 1 and "controller soft does not allow that" in refused.output
    assert run("switch", "--deactivate", "soft").exit_code == 0
    assert "soft is inactive: switched off\n" in run("list").stdout
    assert run("unload", "soft").exit_code == 0
    assert [c.name for c in listed().controllers] == ["hold"]


@pytest.mark.handrail(robot="sea_bench")
@pytest.mark.timeout(300)
def test_of_a_robot_that_nobody_has_enabled_no_controller_is_listed(daemon, handrail_rig):
    told = CliRunner().invoke(controllers, ["list", "--runtime", str(handrail_rig.folder)])
    assert (told.exit_code, told.stdout) == (
        0,
        "no controller is loaded\nkinds: gravity_compensation, joint_impedance\n",
    )
    assert aligned([("name", "cycles"), ("hold", "7")]) == ["name  cycles", "hold       7"]
    assert aligned([("name", "cycles")]) == ["name  cycles"]


@pytest.mark.parametrize(
    ("change", "field", "expected"),
    [
        ({"name": "there"}, "name", "a name of its own"),
        ({"name": "hold"}, "name", "a name of its own"),
        ({"kind": "joint_impedanse"}, "kind", "joint_impedance"),
        ({"joints": []}, "joints", "names of joints"),
        ({"joints": ["elbow_joint", "knee"]}, "joints[1]", "elbow_joint"),
        ({"joints": ["elbow_joint", "elbow_joint"]}, "joints[1]", "each joint once"),
        ({"onto": "nobody"}, "onto", "there"),
        ({"onto": "guide"}, "onto", "there"),
        ({"onto": "there", "joints": ["shoulder_joint"]}, "joints[0]", "elbow_joint"),
        ({"fallback": ["guide", "nobody"]}, "fallback[1]", "there"),
    ],
)
def test_a_controller_that_can_not_be_loaded_is_refused_with_field_value_and_expectation(change, field, expected):
    impedance = {"kind": "joint_impedance", "references": ["position", "velocity"]}
    roster = Roster(
        loaded=[
            Loaded(slot=0, name="there", joints=["elbow_joint"], **impedance),
            Loaded(slot=1, name="guide", kind="gravity_compensation", joints=["elbow_joint"]),
        ]
    )
    good = {"name": "mine", "kind": "joint_impedance", "joints": ["elbow_joint"]}
    kinds, robot = ["gravity_compensation", "joint_impedance"], robots.load("sea_bench")
    check_load(m.LoadController(**good), robot, roster, kinds, 100, 1000)
    with pytest.raises(RefusedError) as refused:
        check_load(m.LoadController(**(good | change)), robot, roster, kinds, 100, 1000)
    assert refused.value.refusal.field == field
    assert expected in refused.value.refusal.expected
    assert refused.value.refusal.value


def test_what_is_not_loaded_is_named_with_what_is():
    with pytest.raises(RefusedError) as refused:
        check_loaded("soft", "activate[0]", Roster())
    assert "activate[0], value soft, expected a loaded controller" in str(refused.value)
    with pytest.raises(RefusedError) as refused:
        huge = m.LoadController(name="a", kind="b", joints=["elbow_joint"])
        check_load(huge, robots.load("sea_bench"), Roster(), ["b"], 2000, 1000)
    assert refused.value.refusal.field == "parameters"


def test_nothing_to_switch_and_parameters_that_are_no_object_are_said_in_a_line(tmp_path):
    nothing = CliRunner().invoke(controllers, ["switch", "--runtime", str(tmp_path)])
    assert nothing.exit_code == 1
    assert "expected --activate NAME, --deactivate NAME or both" in nothing.output
    bad = CliRunner().invoke(controllers, ["configure", "soft", "--parameters", "[1]", "--runtime", str(tmp_path)])
    assert bad.exit_code == 1
    assert "expected a JSON object" in bad.output
    nobody = CliRunner().invoke(controllers, ["list", "--runtime", str(tmp_path)])
    assert nobody.exit_code == 1 and "no robot is up in" in nobody.output
