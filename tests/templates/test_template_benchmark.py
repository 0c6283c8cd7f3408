"""`handrail bench templates` measures every template of the library."""

from __future__ import annotations

from affordance_templates import catalogue
from benchmarks import templates


def test_there_is_a_row_for_every_template(monkeypatch):
    monkeypatch.setattr(templates, "_ROUNDS", 2)
    rows = templates.expansions()
    assert [row.name.partition(":")[0] for row in rows] == sorted(catalogue.files())
    assert all(row.unit == "ms" and row.value > 0 for row in rows)
