"""A template told by one machine is the same on another."""

from __future__ import annotations

import pytest

from affordance_templates import catalogue, travelling
from handrail import workspace
from handrail.messages import GetTemplate, TemplateSource
from handrail.topics import RefusedError

CRATE = """\
title: Crate
objects:
  body:
    shapes: [{kind: mesh, file: meshes/crate.obj, size: [2, 1, 1]}]
"""
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def crate(tmp_path, monkeypatch):
    folder = tmp_path / "robots" / "affordance_templates"
    (folder / "meshes").mkdir(parents=True)
    (folder / "crate.yaml").write_text(CRATE)
    (folder / "meshes" / "crate.obj").write_text(TETRAHEDRON)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path / "robots"))
    return catalogue.load("crate")


def test_it_has_the_same_hash_and_shapes_there_meshes_among_them(crate, tmp_path, monkeypatch):
    told = travelling.told(GetTemplate(template="crate"))
    monkeypatch.delenv("HANDRAIL_WORKSPACE")
    travelling.put(told, tmp_path / "here")
    with workspace.pinned(tmp_path / "here"):
        there = catalogue.load("crate")
    assert there.hash == told.hash == crate.hash
    (shape,) = there.resolve().shapes
    assert shape.size == (2, 1, 1) and shape.file.read_text() == TETRAHEDRON


def test_one_that_is_not_there_is_refused_and_no_name_leads_out_of_the_folder(crate, tmp_path):
    with pytest.raises(RefusedError, match=r"no such template; expected one of box, .*, crate"):
        travelling.told(GetTemplate(template="carte"))
    for name in ("../evil.obj", "/evil.obj", "meshes/../../evil.obj"):
        with pytest.raises(ValueError, match="expected one beside it or below"):
            travelling.put(
                TemplateSource(template="crate", hash="0", text=CRATE, meshes={name: b""}), tmp_path / "here"
            )
    assert not (tmp_path / "here").exists()
