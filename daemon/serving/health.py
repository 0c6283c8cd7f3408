"""How the service's processes are, told by the supervisor to the server through a small file of the runtime folder."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

_NAME = "health.json"
_PROCESSES = "processes.json"


class ProcessTold(msgspec.Struct):
    """One process of the service, as its supervisor knows it."""

    name: str
    state: str
    process: int | None
    """its number; None while there is none"""
    since: float
    """s since 1970, of the state"""
    deaths: int
    last: str
    """the last line that it said, or that was said about it"""


def write_health(folder: Path, processes: Mapping[str, str]) -> None:
    """Replace what was told before. `processes`: name → `up`, `starting`, or what happened to it, in words."""
    fresh = folder / f"{_NAME}.new"
    fresh.write_bytes(msgspec.json.encode(dict(processes)))
    os.replace(fresh, folder / _NAME)


def read_health(folder: Path) -> dict[str, str]:
    """What the supervisor told last; empty where there is none."""
    try:
        return msgspec.json.decode((folder / _NAME).read_bytes(), type=dict[str, str])
    except (FileNotFoundError, msgspec.DecodeError):
        return {}


def write_processes(folder: Path, processes: Sequence[ProcessTold]) -> None:
    """Replace what was told before: for `handrail top`."""
    fresh = folder / f"{_PROCESSES}.new"
    fresh.write_bytes(msgspec.json.encode(processes))
    os.replace(fresh, folder / _PROCESSES)


def read_processes(folder: Path) -> list[ProcessTold]:
    """What the supervisor told last; empty where there is none."""
    try:
        return msgspec.json.decode((folder / _PROCESSES).read_bytes(), type=list[ProcessTold])
    except (FileNotFoundError, msgspec.DecodeError):
        return []


def clear_health(folder: Path) -> None:
    """Nobody supervises from now on."""
    (folder / _PROCESSES).unlink(missing_ok=True)
    (folder / _NAME).unlink(missing_ok=True)
