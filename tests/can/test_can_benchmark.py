"""The codec's benchmark."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from benchmarks import can_codec


def test_every_row_beats_cantools_and_is_written_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(can_codec, "_ROUNDS", 3)
    monkeypatch.setattr(can_codec, "_ROUND_S", 0.002)
    monkeypatch.setattr(sys, "argv", ["can_codec", "--json", str(tmp_path / "rows.json")])
    can_codec.main()
    shown = capsys.readouterr().out
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert len(rows) == 6
    for row in rows:
        assert set(row) == {"name", "value", "unit", "peer", "peer_value", "ratio"}
        assert row["ratio"] < 1.0
        assert row["name"] in shown
