"""`handrail new`: what it begins can be used at once, and nothing that is there is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from affordance_templates import catalogue
from affordance_templates.template_file import read as read_template
from daemon.controllers.registry import find_kind
from engines.nodes.cli import app as nodes
from engines.programs import library
from hal.plant import scene
from handrail.behaviour_file import SOME_ARM, BehaviourFile, find
from handrail.new import app


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "mine"
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(folder))
    assert new("workspace", str(folder)) == ""
    return folder


def new(*arguments: str) -> str:
    """What is wrong, if it says so."""
    result = CliRunner().invoke(app, arguments)
    return str(result.exception) if result.exit_code else ""


def test_what_is_begun_is_sound_and_found_by_its_name(own: Path) -> None:
    for kind in ("program", "behaviour", "scene", "template", "controller", "node"):
        assert new(kind, "mine") == ""
    assert library.load("mine").title
    assert BehaviourFile(find("mine"), SOME_ARM).steps
    assert scene.find("mine") == own / "scenes" / "mine.yaml"
    assert read_template(catalogue.files()["mine"]).title
    assert find_kind("mine").__module__ == "workspace_controllers.mine"
    tried = CliRunner().invoke(nodes, ["test", "mine"])
    assert tried.exit_code == 0 and "passed" in tried.output


def test_any_that_is_there_may_be_the_start(own: Path) -> None:
    new("program", "turn_more", "--like", "turn_valve")
    assert library.load("turn_more").title == library.load("turn_valve").title
    new("controller", "soft", "--like", "joint_impedance")
    new("controller", "softer", "--like", "soft")
    assert find_kind("softer").__name__ == "JointImpedance"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("program", "my-program"), "my-program: not a name; expected letters"),
        (("program", "press"), "press.yaml: is there already"),
        (
            ("program", "mine", "--like", "dig"),
            "--like dig: no such program; expected one of follow, ",
        ),
        (("controller", "mine", "--like", "base"), "--like base: no such controller; expected one of gravity_"),
        (("workspace", "."), ".: is there and not empty"),
        (("workspace", "rtc_programs/press.yaml"), "press.yaml: is a file"),
        (("workspace", "rtc_programs/press.yaml/x"), "x: can't be made"),
    ],
)
def test_what_can_not_be_begun_is_told(own: Path, arguments: tuple[str, ...], told: str) -> None:
    (own / "rtc_programs" / "press.yaml").write_text("mine")
    assert told in new(*arguments).replace(str(own), "")
    assert (own / "rtc_programs" / "press.yaml").read_text() == "mine"


def test_without_a_workspace_it_says_how_to_make_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HANDRAIL_WORKSPACE", raising=False)
    assert "HANDRAIL_WORKSPACE is not set" in new("program", "mine")
