"""`handrail drives` on a terminal."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from hal.drives import cli, docs, family


def test_list_names_every_family_and_what_is_wrong_with_a_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "drives" / "odd").mkdir(parents=True)
    (tmp_path / "drives" / "odd" / "family.yaml").write_text("name: odd\n")
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "250")
    result = CliRunner().invoke(cli.app, ["list"])
    assert result.exit_code == 1
    for name in family.folders():
        assert name in result.output
    assert "odd/family.yaml" in result.output and "missing required field" in result.output


def test_docs_prints_the_reference_and_refuses_what_is_not_there() -> None:
    result = CliRunner().invoke(cli.app, ["docs", "power"])
    assert result.output == docs.reference(family.load("power"))
    assert "| Voltage | 0, 16 unsigned | 0 to 655.35, step 0.01 | V | voltage |" in result.output
    result = CliRunner().invoke(cli.app, ["docs", "canopen"])
    assert result.exit_code == 1 and "no such drive family; expected one of" in result.output


def test_get_refuses_a_joint_that_is_not_there_and_a_bus_that_is_not(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli.app, ["get", "nose", "serial", "--robot", "sea_bench", "--runtime", str(tmp_path)])
    assert result.exit_code == 1 and "joint nose: not on this robot; expected one of" in result.output
    result = CliRunner().invoke(cli.app, ["info", "--robot", "sea_bench", "--runtime", str(tmp_path)])
    assert result.exit_code == 1 and "no hub there" in result.output
