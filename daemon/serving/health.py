"""How the service's processes are, told by the supervisor to the server through a small file of the runtime folder."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import msgspec

_NAME = "health.json"


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


def clear_health(folder: Path) -> None:
    """Nobody supervises from now on."""
    (folder / _NAME).unlink(missing_ok=True)
