"""How long the tests of `make soak` run, and where they keep what an interrupted one goes on from (tools/soak.py)."""

from __future__ import annotations

import os
from pathlib import Path

SHARE = float(os.environ.get("HANDRAIL_SOAK_SHARE", "1"))
"""of the whole length"""


def share_of(whole: int) -> int:
    """So many of them are done, at least one."""
    return max(1, round(SHARE * whole))


def kept(otherwise: Path) -> Path:
    """The folder that outlives an interrupted soak; `otherwise` where none was named."""
    return Path(os.environ.get("HANDRAIL_SOAK_FOLDER", otherwise))
