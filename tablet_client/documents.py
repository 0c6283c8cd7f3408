"""What the window writes for people: files in their documents folder, named by what they are and when they were written."""

from __future__ import annotations

import os
import time
from pathlib import Path

from PySide6.QtCore import QStandardPaths


def save(what: str, ending: str, text: str) -> tuple[str, str]:
    """Write a text to a new file; what to say of it: `saved` and where to, or `not_saved` and why not."""
    folder = Path(QStandardPaths.writableLocation(QStandardPaths.StandardLocation.DocumentsLocation))
    file = folder / f"handrail-{what}-{time.strftime('%Y%m%d-%H%M%S')}.{ending}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    except OSError as problem:
        return "not_saved", f"{problem.strerror or problem}: {file}"
    return "saved", str(file).replace(os.path.expanduser("~"), "~", 1)
