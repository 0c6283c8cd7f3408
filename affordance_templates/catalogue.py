"""Where templates are found: the user's workspace first, then the built-in library."""

from __future__ import annotations

import os
from pathlib import Path

from affordance_templates import template_file
from affordance_templates.template_file import Template
from handrail.config import ConfigError


def search_path() -> list[Path]:
    """Folders with templates (NAME.yaml), the first to have a name wins."""
    workspace = os.environ.get("HANDRAIL_WORKSPACE")
    own = [Path(workspace) / "affordance_templates"] if workspace else []
    return [*own, Path(__file__).parent / "library"]


def files() -> dict[str, Path]:
    """Every template's name and file."""
    found: dict[str, Path] = {}
    for folder in search_path():
        for file in sorted(folder.glob("*.yaml")):
            found.setdefault(file.stem, file)
    return found


def load(name: str) -> Template:
    """Read a template by name. Raises ConfigError, naming those that there are when there is none of that name."""
    known = files()
    if name not in known:
        raise ConfigError(name, None, "template", f"no such template; expected one of {', '.join(sorted(known))}")
    return template_file.read(known[name])
