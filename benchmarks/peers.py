"""Virtual environments of peers, each its own: their libraries exclude each other."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from handrail.robot.urdf import cache_folder


def environment(name: str, packages: Sequence[str]) -> Path:
    """The folder of an environment with those packages (PyPI), made under the user's cache on first use.

    Raises subprocess.CalledProcessError or OSError when it can't be made.
    """
    folder = cache_folder().parent / "peers" / "-".join(packages).replace("==", "-")
    if not (folder / "complete").exists():
        print(f"making an environment for {name} in {folder}", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        install = [str(folder / "bin" / "pip"), "install", "--quiet", *packages]
        subprocess.run(install, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        (folder / "complete").touch()
    return folder
