"""Where robots, scenes, programs and templates are found: the user's workspace first, then what Handrail brings.

A workspace is a folder of the user's own, named by ``HANDRAIL_WORKSPACE``, with a folder for each kind of thing in it.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path


def search_path(kind: str, package: str, folder: str = "") -> list[Path]:
    """Folders with things of a kind; where two have a thing of the same name, the first counts.

    :param kind: the workspace's folder for it, e.g. ``scenes``
    :param package: the package that brings the built-in ones, by name only: callers know where the data lies, not what the
        package does, so it is not imported
    :param folder: below the package
    """
    folders = []
    if workspace := os.environ.get("HANDRAIL_WORKSPACE"):
        folders.append(Path(workspace) / kind)
    spec = importlib.util.find_spec(package)
    if spec is not None and spec.submodule_search_locations:
        folders.append(Path(spec.submodule_search_locations[0]) / folder)
    return folders


def files(folders: list[Path], suffix: str = ".yaml") -> dict[str, Path]:
    """NAME → NAME.yaml (or another suffix) of everything in the folders."""
    found: dict[str, Path] = {}
    for folder in folders:
        for file in sorted(folder.glob(f"*{suffix}")):
            found.setdefault(file.stem, file)
    return found
