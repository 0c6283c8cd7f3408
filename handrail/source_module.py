"""A user's Python file as a module, always as it stands on disk."""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType


class _AsItStands(SourceFileLoader):
    """Without bytecode: that goes by the file's size and second, and an edit of a digit within a second changes neither."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


def module_of(name: str, file: Path) -> ModuleType:
    """A new module of that name, whose code `run` runs."""
    spec = importlib.util.spec_from_file_location(name, file, loader=_AsItStands(name, str(file)))
    assert spec is not None  # a loader was given
    return importlib.util.module_from_spec(spec)


def run(module: ModuleType) -> None:
    """Run a module's code. Raises OSError, and what the code raises."""
    assert module.__spec__ is not None and module.__spec__.loader is not None  # `module_of` gave both
    sys.modules[module.__name__] = (
        module  # where annotations of its classes are looked up, of dataclasses and msgspec.Structs
    )
    module.__spec__.loader.exec_module(module)
