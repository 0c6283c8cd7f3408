"""Where nodes are found: the user's workspace first, then what Handrail brings."""

from __future__ import annotations

from pathlib import Path

from handrail import workspace


def files() -> dict[str, Path]:
    """Every node's name and file."""
    return workspace.files(workspace.search_path("nodes", "rtc_programs", "nodes"), ".py")


def find(name_or_file: str) -> Path:
    """A node's file, by its name or as it is. Raises ValueError naming those that there are."""
    if name_or_file.endswith(".py"):
        file = Path(name_or_file)
        if not file.is_file():
            raise ValueError(f"node: got {name_or_file!r}, which is no file; expected NAME.py")
        return file
    known = files()
    if name_or_file not in known:
        raise ValueError(f"node: got {name_or_file!r}; expected one of {', '.join(sorted(known)) or 'none'}, or a file")
    return known[name_or_file]
