"""All that a program needs, file by file: what travels with it when it is deployed."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from affordance_templates import catalogue, template_file
from engines.activities import ACTIVITIES
from engines.activities.base import Kind
from engines.nodes import library as nodes
from engines.programs import library, scxml, scxml_machine
from engines.programs.program import Program
from engines.releases.check import NODES
from handrail import behaviour_file, workspace
from handrail.bundles.manifest import Bundle, bundle


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


def bundle_of_node(name: str, file: Path) -> Bundle:
    """A node by itself, with its parts and the modules beside it that it imports. Raises ValueError, OSError."""
    return bundle(f"{NODES}{name}", {path: each.read_bytes() for path, each in _node(file.resolve())})


def bundle_here(released: str) -> Bundle | None:
    """What is here under the name that a release has: a program's, or `nodes/NAME`; None where nothing is called so.

    Raises as `bundle_of` does, where it is unsound.
    """
    if released.startswith(NODES):
        name = released.removeprefix(NODES)
        file = nodes.files().get(name)
        return bundle_of_node(name, file) if file is not None else None
    return bundle_of(released) if released in library.files() else None


def holds_node(file: Path) -> bool:
    """Whether a Python file has a class that is made as nodes are; others are modules that nodes import."""
    bases = (
        base for each in ast.walk(ast.parse(file.read_bytes())) if isinstance(each, ast.ClassDef) for base in each.bases
    )
    return any((base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "")) == "Node" for base in bases)


def _needed(program: Program) -> Iterator[tuple[str, Path]]:
    """(path in a workspace, file)"""
    yield from _own(program)
    for state in program.states():  # those of the programs that it runs among them
        if state.called is not None:
            yield from _own(state.called)
        elif state.file.do:
            for argument, value in state.file.with_.items():
                declared = ACTIVITIES[state.file.do].arguments.get(argument)
                if declared is None or not isinstance(value, str):
                    continue
                if declared.kind is Kind.NODE:
                    yield from _node(nodes.find(value).resolve())
                elif declared.kind is Kind.BEHAVIOUR and (file := behaviour_file.files().get(value)):
                    yield f"behaviours/{file.name}", file


def _own(program: Program) -> Iterator[tuple[str, Path]]:
    """Its file, and its resources' templates."""
    source = program.document.file
    yield f"rtc_programs/{program.name}{scxml.SUFFIX if source.suffix == scxml.SUFFIX else '.yaml'}", source
    if program.whole_because:
        yield from ((f"rtc_programs/{part.name}", part) for part in scxml_machine.parts(source))
    known = catalogue.files()
    for resource in program.resources.values():
        for file in filter(None, map(known.get, resource.templates)):
            yield f"affordance_templates/{file.name}", file
            for shape in template_file.read(file).resolve().shapes:
                if shape.file is not None and shape.file.is_relative_to(file.parent):
                    yield f"affordance_templates/{shape.file.relative_to(file.parent).as_posix()}", shape.file


def _node(file: Path) -> Iterator[tuple[str, Path]]:
    """A node's file, with its parts and the Python files beside it that it imports. Raises ValueError where code can't be read."""
    waiting, seen = [file], {file}
    while waiting:
        each = waiting.pop()
        yield f"nodes/{each.name}", each
        if each.suffix == ".py":
            yield from _modules(each, each.parent)
            continue
        for part in nodes.parts(each):
            if part not in seen:  # a composite that is a part of itself is refused where it is loaded
                seen.add(part)
                waiting.append(part)


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
    try:
        tree = ast.parse(file.read_bytes(), str(file))
    except SyntaxError as problem:
        raise ValueError(f"{file}:{problem.lineno}: {problem.msg}; expected Python") from problem
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
