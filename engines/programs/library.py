"""Where programs are found: the user's workspace first, then the built-in library."""

from __future__ import annotations

from pathlib import Path

from affordance_templates import catalogue
from affordance_templates.template_file import read as read_template
from engines.programs import program
from engines.programs.program import Program, files
from handrail.config import ConfigError
from handrail.messages import Library, LibraryEntry


def load(name_or_file: str) -> Program:
    """Read and check a program, by its name in the library or by its file. Raises ConfigError."""
    if name_or_file.endswith((".yaml", ".yml", ".scxml")):
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
