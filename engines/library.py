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
    return named(name_or_file, "or a file")


def named(name: str, otherwise: str = "") -> Program:
    """Read and check a program of the library, by its name alone: what a client asks for opens no other file of the robot's.

    :param otherwise: what else would have been taken, for the ConfigError that names the programs that there are
    """
    known = files()
    if name not in known:
        expected = ", ".join([*sorted(known), otherwise] if otherwise else sorted(known))
        raise ConfigError(name, None, "program", f"no such program; expected one of {expected}")
    return program.read(known[name])


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
