"""The roster: which controllers are loaded by name, as a file of the runtime folder that the loop's workshop writes and the server
reads. What state each is in stands in every snapshot; here is what changes seldom, and what is too long for a record."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from handrail.runtime import Runtime
from handrail.workspace import files, search_path

NEWS_KEPT = 32


class Loaded(msgspec.Struct, kw_only=True):
    """One controller that is loaded, or about to be."""

    slot: int
    name: str
    kind: str
    joints: list[str]
    interfaces: list[str] = []
    """what it claims of them, of hal.joint.COMMANDED"""
    references: list[str] = []
    """what others may claim of it"""
    onto: str = ""
    """the controller whose references it commands; empty: the robot"""
    fallback: list[str] = []
    parameters: dict[str, object] = {}
    error: str = ""
    """why it could not be loaded or configured, or failed since, with the traceback"""


class News(msgspec.Struct, kw_only=True):
    """Something that was not asked for has happened to a controller, or what was asked for has come about."""

    number: int
    name: str
    state: str
    detail: str
    time_ns: int
    cycle: int


class Roster(msgspec.Struct, kw_only=True):
    """The whole file."""

    number: int = 0
    """of the snapshot to which it belongs; goes up with every change"""
    kinds: list[str] = []
    """built in"""
    loaded: list[Loaded] = []
    news: list[News] = []
    """the last ones, the newest at the end"""


def roster_file(runtime: Runtime) -> Path:
    """Where it lies."""
    return runtime.folder / "controllers.json"


def write_roster(file: Path, roster: Roster) -> None:
    """Replace the file, whole."""
    fresh = file.with_suffix(".new")
    fresh.write_bytes(msgspec.json.encode(roster))
    os.replace(fresh, file)


def read_roster(file: Path) -> Roster:
    """What is there; an empty roster where no loop has started yet."""
    try:
        return msgspec.json.decode(file.read_bytes(), type=Roster)
    except FileNotFoundError:
        return Roster()


def own_kinds() -> dict[str, Path]:
    """The user's own controllers: name → file, found in the workspace, not imported."""
    built_in = Path(__file__).parent
    folders = [folder for folder in search_path("controllers", "daemon", "controllers") if folder != built_in]
    return {name: file for name, file in files(folders, ".py").items() if not name.startswith("_")}
