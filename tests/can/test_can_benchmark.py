"""The codec's benchmark, as `handrail bench can_codec` runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from benchmarks import can_codec
from benchmarks.cli import bench

cli = typer.Typer()
cli.command()(bench)


def test_every_row_stands_beside_cantools_and_is_written_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_codec, "_ROUNDS", 3)
    monkeypatch.setattr(can_codec, "_ROUND_S", 0.002)
    result = CliRunner().invoke(cli, ["can_codec", "--json", str(tmp_path / "rows.json")])
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert len(rows) == 6
    for row in rows:
        assert set(row) == {"name", "value", "unit", "peer", "peer_value", "ratio", "goal", "holds"}
        assert row["ratio"] > 0
        assert row["name"] in result.output
    assert result.exit_code == (0 if all(row["holds"] for row in rows) else 1)
