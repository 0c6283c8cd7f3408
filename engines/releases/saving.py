"""A program's file read and saved over the link, for tools that edit it: saved, it is a release as any (docs/deployment.md)."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

from engines.programs import library
from engines.programs.program import read
from engines.programs.scxml import SUFFIX
from engines.releases.closure import bundle_of
from engines.releases.store import ReleaseStore
from handrail import messages as m
from handrail.bundles import pieces
from handrail.config import ConfigError
from handrail.topics import refuse


def source(call: m.GetProgram) -> m.ProgramSource:
    """The file as it is in force, with what it wants to be bound to. Refused where there is none of that name."""
    file = library.files().get(call.program)
    if file is None:
        raise refuse("no such program", "program", call.program, f"one of: {', '.join(sorted(library.files()))}")
    text = file.read_text(encoding="utf-8")
    try:
        program = read(file)
    except ConfigError:
        return m.ProgramSource(
            program=call.program, file=file.name, text=text
        )  # ListLibrary says what is wrong with it
    return m.ProgramSource(
        program=call.program,
        file=file.name,
        text=text,
        resources=[
            m.ProgramResource(name=name, kind=each.kind, templates=list(each.templates), title=each.title)
            for name, each in program.resources.items()
        ],
        parameters=[
            m.ProgramParameter(
                name=name,
                type=each.type,
                default=each.default,
                unit=each.unit,
                min=each.min if math.isfinite(each.min) else None,
                max=each.max if math.isfinite(each.max) else None,
                title=each.title,
            )
            for name, each in program.parameters.items()
        ],
    )


def save(call: m.SaveProgram, releases: ReleaseStore) -> m.BundleState:
    """Bring a program's text into force with what it needs here. Refused where it is unsound, or was edited meanwhile."""
    file = library.files().get(call.program)
    there = file.read_text(encoding="utf-8") if file is not None else ""
    if there != call.was:
        raise refuse(
            "the program is another one by now: read it anew", "was", f"{len(call.was)} bytes", "its present text"
        )
    if not call.program.isidentifier():
        raise refuse("no program can be called so", "program", call.program, "letters, digits and _")
    with tempfile.TemporaryDirectory() as folder:
        fresh = Path(folder) / f"{call.program}{SUFFIX if file is not None and file.suffix == SUFFIX else '.yaml'}"
        fresh.write_text(call.text, encoding="utf-8")
        try:
            bundle = bundle_of(str(fresh))
        except (ValueError, OSError) as problem:
            told = str(problem).replace(f"{folder}/", "")
            raise refuse("the program can't be saved", "text", call.program, told) from problem
    releases.take([m.Piece(address=each, data=pieces.pack(part)) for each, part in bundle.contents.items()])
    return releases.put(m.PutBundle(bundle=bundle.address, note=call.note, by=call.by))
