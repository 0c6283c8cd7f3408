"""Where robots, scenes, programs and templates are found: the user's workspace first, then what Handrail brings.

A workspace is a folder of the user's own, named by ``HANDRAIL_WORKSPACE``, with a folder for each kind of thing in it. An engine
that code was deployed to has one more, which comes before it (docs/deployment.md).
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

RELEASES = "releases.json"
"""lies beside the folders of releases"""
_deployed: Path | None = None
"""what was deployed to this process, which is an engine"""
_pinned: ContextVar[tuple[Path | None] | None] = ContextVar("workspace", default=None)
"""(what a thread looks in instead,)"""


def use(folder: Path | None) -> None:
    """From now on this process finds first what lies in a folder made like a workspace (None: in none)."""
    global _deployed  # noqa: PLW0603 (which code a process has is a fact of the process)
    _deployed = folder


def release_of(file: Path) -> Path | None:
    """The folder of the release that a file is of, None where it is of none."""
    folder = file.parent.parent
    return folder if (folder.parent / RELEASES).is_file() else None


def deployed() -> Path | None:
    """The folder that is looked in first, here and now."""
    pinned = _pinned.get()
    return _deployed if pinned is None else pinned[0]


def pin(folder: Path | None) -> None:
    """From now on this thread finds first what lies in `folder`, whatever is deployed meanwhile."""
    _pinned.set((folder,))


@contextmanager
def pinned(folder: Path | None) -> Iterator[None]:
    """As `pin`, for a while."""
    before = _pinned.set((folder,))
    try:
        yield
    finally:
        _pinned.reset(before)


def search_path(kind: str, package: str, folder: str = "") -> list[Path]:
    """Folders with things of a kind; where two have a thing of the same name, the first counts.

    :param kind: the workspace's folder for it, e.g. ``scenes``
    :param package: the package that brings the built-in ones, by name only: callers know where the data lies, not what the
        package does, so it is not imported
    :param folder: below the package
    """
    folders = []
    if first := deployed():
        folders.append(first / kind)
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
