"""Where programs are found: the user's workspace first, then the built-in library."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

from affordance_templates import catalogue
from affordance_templates.template_file import read as read_template
from engines import program
from engines.program import Program
from handrail.config import ConfigError
from handrail.messages import Library, LibraryEntry


def search_path() -> list[Path]:
    """Folders with programs (NAME.yaml), the first to have a name wins."""
    folders = []
    if workspace := os.environ.get("HANDRAIL_WORKSPACE"):
        folders.append(Path(workspace) / "rtc_programs")
    # By name only: the engines know where the library lies, not what is in it.
    built_in = importlib.util.find_spec("rtc_programs")
    if built_in is not None and built_in.submodule_search_locations:
        folders.append(Path(built_in.submodule_search_locations[0]))
    return folders


def files() -> dict[str, Path]:
    """Every program's name and file."""
    found: dict[str, Path] = {}
    for folder in search_path():
        for file in sorted(folder.glob("*.yaml")):
            found.setdefault(file.stem, file)
    return found


def load(name_or_file: str) -> Program:
    """Read and check a program, by its name in the library or by its file. Raises ConfigError."""
    if name_or_file.endswith((".yaml", ".yml")):
        return program.read(Path(name_or_file))
    known = files()
    if name_or_file not in known:
        raise ConfigError(
            name_or_file, None, "program", f"no such program; expected one of {', '.join(sorted(known))}, or a file"
        )
    return program.read(known[name_or_file])


def listing() -> Library:
    """Programs and templates, with what is wrong with those that can't be used."""
    entries = []
    for name, file in files().items():
        try:
            found = program.read(file)
            entries.append(LibraryEntry(name=name, kind="program", title=found.title, hash=found.hash))
        except ConfigError as problem:
            entries.append(LibraryEntry(name=name, kind="program", problem=str(problem)))
    for name, file in catalogue.files().items():
        try:
            template = read_template(file)
            entries.append(LibraryEntry(name=name, kind="template", title=template.title, hash=template.hash))
        except ConfigError as problem:
            entries.append(LibraryEntry(name=name, kind="template", problem=str(problem)))
    return Library(entries=entries)
