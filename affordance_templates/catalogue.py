"""Where templates are found: the user's workspace first, then the built-in library."""

from __future__ import annotations

from pathlib import Path

from affordance_templates import template_file
from affordance_templates.template_file import Template
from handrail import workspace
from handrail.config import ConfigError


def files() -> dict[str, Path]:
    """Every template's name and file."""
    return workspace.files(workspace.search_path("affordance_templates", "affordance_templates", "library"))


def load(name: str) -> Template:
    """Read a template by name. Raises ConfigError, naming those that there are when there is none of that name."""
    known = files()
    if name not in known:
        raise ConfigError(name, None, "template", f"no such template; expected one of {', '.join(sorted(known))}")
    return template_file.read(known[name])
