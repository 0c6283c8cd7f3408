"""All that a program needs, file by file: what travels with it when it is deployed."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from affordance_templates import catalogue
from engines.activities import ACTIVITIES
from engines.activities.base import Kind
from engines.nodes import library as nodes
from engines.programs import library
from engines.programs.program import Program
from handrail import behaviour_file, workspace
from handrail.bundles.manifest import Bundle, bundle

_FOUND: Mapping[Kind, tuple[str, Callable[[], Mapping[str, Path]]]] = {
    Kind.BEHAVIOUR: ("behaviours", behaviour_file.files),
    Kind.NODE: ("nodes", nodes.files),
}
"""arguments that name a file: its folder in a workspace, and where it is found"""


def bundle_of(name_or_file: str, *, scenes: bool = True) -> Bundle:
    """A program with all that it needs, as it is found here. Raises ConfigError where it is unsound, ValueError, OSError.

    :param scenes: also the scenes of its name, to check and rehearse it with
    """
    program = library.load(name_or_file)
    files = dict(_needed(program))
    if scenes and (
        scene := workspace.files(workspace.search_path("scenes", "rtc_programs", "scenes")).get(program.name)
    ):
        files[f"scenes/{scene.name}"] = scene
    return bundle(program.name, {path: file.read_bytes() for path, file in files.items()})


def _needed(program: Program) -> Iterator[tuple[str, Path]]:
    """(path in a workspace, file)"""
    yield f"rtc_programs/{program.name}{program.document.file.suffix}", program.document.file
    known = catalogue.files()
    for resource in program.resources.values():
        if file := known.get(resource.template):
            yield f"affordance_templates/{file.name}", file
    for state in program.states():
        if not state.file.do:
            continue
        for argument, value in state.file.with_.items():
            declared = ACTIVITIES[state.file.do].arguments.get(argument)
            if declared is None or declared.kind not in _FOUND or not isinstance(value, str):
                continue
            folder, files = _FOUND[declared.kind]
            if file := files().get(value):
                yield f"{folder}/{file.name}", file
                if declared.kind is Kind.NODE:
                    yield from _modules(file, file.parent)


def _modules(file: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """The Python files beside a node that it imports, and those that these import."""
    waiting, seen = [file], {file}
    while waiting:
        for name in _imported(waiting.pop()):
            parts = name.split(".")
            module = folder.joinpath(*parts[:-1], f"{parts[-1]}.py")
            package = folder.joinpath(*parts)
            for found in [module, *(sorted(package.rglob("*.py")) if package.is_dir() else ())]:
                if found.is_file() and found not in seen:
                    seen.add(found)
                    waiting.append(found)
                    yield f"nodes/{found.relative_to(folder).as_posix()}", found


def _imported(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"), str(file))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
