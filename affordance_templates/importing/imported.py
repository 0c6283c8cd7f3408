"""What becomes of somebody else's template, and what both formats say alike."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "torus": ("radius", "tube_radius")}
"""kind of a solid → its attributes"""
_MESHES = (".stl", ".obj", ".dae")


@dataclass
class Imported:
    """A template's text, and what of the source is not in it."""

    text: str
    left_out: list[str] = field(default_factory=list)
    meshes: dict[str, Path] = field(default_factory=dict)
    """a file that the template names, beside it → where it is now"""


def identifier(name: str) -> str:
    """A name that ours may have."""
    word = re.sub(r"\W+", "_", name.strip()).strip("_").lower() or "unnamed"
    return f"_{word}" if word[0].isdigit() else word


class Meshes:
    """The mesh files that a template of others names."""

    def __init__(self, file: Path):
        self._folder = file.resolve().parent
        self.found: dict[str, Path] = {}

    def take(self, name: str) -> tuple[str, str]:
        """(as the new template names it, "") of a file's name or `package://PACKAGE/PATH`; ("", why not)."""
        path = self._path(name)
        if path is None:
            return "", f"{name or 'no file'}: not found beside it"
        if path.suffix.lower() not in _MESHES:
            return "", f"{name}: expected {', '.join(_MESHES)}"
        known = next((each for each, there in self.found.items() if there == path), "")
        if not known:
            same = sum(Path(each).stem.startswith(path.stem) for each in self.found)
            known = f"meshes/{path.stem}{f'_{same}' if same else ''}{path.suffix.lower()}"
            self.found[known] = path
        return known, ""

    def _path(self, name: str) -> Path | None:
        """Of a package, the nearest folder above that is called so, or lies beside one above."""
        if not name.startswith("package://"):
            file = self._folder / name.removeprefix("file://")
            return file if name and file.is_file() else None
        package, _, rest = name.removeprefix("package://").partition("/")
        for above in (self._folder, *self._folder.parents):
            if (file := (above if above.name == package else above / package) / rest).is_file():
                return file
        return None
