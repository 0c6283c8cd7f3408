"""Where nodes are found: the user's workspace first, then what Handrail brings."""

from __future__ import annotations

import hashlib
from pathlib import Path

from handrail import config, workspace

_SUFFIXES = (".py", ".yaml")


def files() -> dict[str, Path]:
    """Every node's name and file: Python, or nodes that a YAML file wires together."""
    found: dict[str, Path] = {}
    for folder in workspace.search_path("nodes", "rtc_programs", "nodes"):
        for suffix in _SUFFIXES:
            found = {**workspace.files([folder], suffix), **found}
    return found


def find(name_or_file: str) -> Path:
    """A node's file, by its name or as it is. Raises ValueError naming those that there are."""
    if name_or_file.endswith(_SUFFIXES):
        file = Path(name_or_file)
        if not file.is_file():
            raise ValueError(f"node: got {name_or_file!r}, which is no file; expected NAME.py or NAME.yaml")
        return file
    known = files()
    if name_or_file not in known:
        raise ValueError(f"node: got {name_or_file!r}; expected one of {', '.join(sorted(known)) or 'none'}, or a file")
    return known[name_or_file]


def version(file: Path) -> str:
    """A hash of what a node is made of: of its file, and of its parts' where it is a composite. Raises OSError."""
    made_of = hashlib.sha256()
    seen: set[Path] = set()
    waiting = [file.resolve()]
    while waiting:
        each = waiting.pop()
        if each in seen:
            continue
        seen.add(each)
        made_of.update(each.read_bytes())
        if each.suffix == ".yaml":
            waiting += parts(each)
    return made_of.hexdigest()


def parts(file: Path) -> list[Path]:
    """The files of a composite's nodes, as far as they can be found: what is wrong with it is told when it is loaded."""
    try:
        nodes = config.read(file).data.get("nodes", {})
        return [find(str(part["node"])).resolve() for part in nodes.values()]
    except (ValueError, TypeError, KeyError, AttributeError):
        return []
