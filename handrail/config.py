"""YAML files read into typed structs, with errors that name file, line, field, value and expectation."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import msgspec.inspect

from handrail import yaml_file
from handrail.yaml_file import Map, NotYAML, Seq

_T = TypeVar("_T")


class ConfigError(ValueError):
    """A file that can't be used. `str()` is one line for people: ``FILE:LINE: field: problem``."""

    def __init__(self, file: Path | str, line: int | None, field: str, problem: str):
        self.file, self.line, self.field, self.problem = str(file), line, field, problem
        where = f"{file}:{line}" if line else str(file)
        super().__init__(f"{where}: {field}: {problem}" if field else f"{where}: {problem}")


@dataclass(frozen=True)
class Document:
    """A parsed YAML file that remembers where each field stood."""

    file: Path
    data: Map
    base: Document | None = None
    """the document that this one extends; `data` then holds both"""
    own: Map | None = None
    """of a document that extends another one: what it says itself"""

    def line(self, path: str) -> int | None:
        """The line (from 1) of the field at a dotted path such as ``states.reach.with.plan`` or ``limbs[2].joints``."""
        node: Any = self.data
        line: int | None = None
        for part in re.findall(r"[^.\[\]]+", path):
            if isinstance(node, Map) and part in node.lines:
                line, node = node.lines[part], node[part]
            elif isinstance(node, Seq) and part.isdigit() and int(part) < len(node):
                line, node = node.lines[int(part)], node[int(part)]
            else:
                break
        return line

    def error(self, field: str, problem: str) -> ConfigError:
        """An error about a field of this file, or of the one that it extends where the field comes from there."""
        source = self
        while source.base is not None and source.own is not None and not _says(source.own, field):
            if not _says(source.base.data, field):  # nobody says it: this file should
                return ConfigError(self.file, Document(self.file, source.own).line(field), field, problem)
            source = source.base
        own = source.data if source.own is None else source.own
        return ConfigError(source.file, Document(source.file, own).line(field), field, problem)

    def over(self, base: Document) -> Document:
        """This document laid over another one: mappings are merged key by key, anything else replaces what was there, and
        ``null`` takes away."""
        return Document(self.file, _laid_over(base.data, self.data), base, self.data)

    def at(self, path: str) -> Any:
        """What stands at a dotted path. Raises ConfigError where a name in it can't be told from the path."""
        node: Any = self.data
        try:
            for part in re.findall(r"[^.\[\]]+", path):
                node = node[int(part) if isinstance(node, list) else part]
        except (KeyError, IndexError, ValueError, TypeError) as lost:
            raise self.error(path, "a name with a dot or a bracket in it; expected one without") from lost
        return node

    def convert(self, kind: type[_T], path: str = "") -> _T:
        """The document (or the part at `path`) as `kind`, a msgspec struct. Raises ConfigError."""
        return self.converted(self.at(path), kind, path)

    def converted(self, node: Any, kind: type[_T], path: str) -> _T:
        """What is meant by the part at `path`, as `kind`. Raises ConfigError, about the part as it stands there."""
        try:
            return msgspec.convert(node, kind)
        except msgspec.ValidationError as error:
            text, _, where = str(error).partition(" - at `$")
            field = where.rstrip("`").lstrip(".")
            field = f"{path}.{field}".strip(".").replace(".[", "[") if path else field
            field = self._named(field)
            missing = re.search(r"required field `([^`]+)`", text)
            if missing:
                field = f"{field}.{missing[1]}".lstrip(".")
            unknown = re.search(r"unknown field `([^`]+)`", text)
            if unknown:
                field = f"{field}.{unknown[1]}".lstrip(".")
            raise self.error(field, f"{text}{self._shown(field)}{_choices(text, kind, where)}") from error

    def _named(self, field: str) -> str:
        # msgspec shows map keys as `[...]`: find the one whose value fails.
        return field.replace("[...]", "")

    def _shown(self, field: str) -> str:
        node: Any = self.data
        for part in re.findall(r"[^.\[\]]+", field):
            if isinstance(node, Map) and part in node:
                node = node[part]
            elif isinstance(node, Seq) and part.isdigit() and int(part) < len(node):
                node = node[int(part)]
            else:
                return ""
        return "" if isinstance(node, dict | list) else f"; got {node!r}"


def _choices(text: str, kind: Any, where: str) -> str:
    """Which values a field may have, where it has one that is none of them. `where`: as msgspec says it, from `kind` on."""
    if not text.startswith("Invalid enum value"):
        return ""
    there = [msgspec.inspect.type_info(kind)]
    for part in re.findall(r"\[[^\]]*\]|[^.\[\]`]+", where):
        inside = list[msgspec.inspect.Type]()
        for each in _members(there):
            match each:
                case msgspec.inspect.StructType():
                    inside += [field.type for field in each.fields if field.encode_name == part]
                case msgspec.inspect.DictType():
                    inside.append(each.value_type)
                case msgspec.inspect.ListType() | msgspec.inspect.VarTupleType():
                    inside.append(each.item_type)
        there = inside
    values = [
        value for each in _members(there) if isinstance(each, msgspec.inspect.LiteralType) for value in each.values
    ]
    return f"; expected one of {', '.join(map(str, values))}" if values else ""


def _members(types: list[msgspec.inspect.Type]) -> Iterator[msgspec.inspect.Type]:
    """Each of them, of unions what may come."""
    for each in types:
        if isinstance(each, msgspec.inspect.UnionType):
            yield from _members(list(each.types))
        elif isinstance(each, msgspec.inspect.Metadata):
            yield from _members([each.type])
        else:
            yield each


def _says(data: Any, field: str) -> bool:
    """A field is there; of an element of a list, the list."""
    node = data
    for part in re.findall(r"[^.\[\]]+", field):
        if isinstance(node, list):
            return True
        if not isinstance(node, dict) or part not in node:
            return False
        node = node[part]
    return True


def _laid_over(base: Map, top: Map) -> Map:
    merged = Map()
    for key in {**base, **top}:
        if key not in top:
            merged[key] = base[key]
        elif isinstance(top[key], Map) and isinstance(base.get(key), Map):
            merged[key] = _laid_over(base[key], top[key])
        elif top[key] is not None or key not in base:
            merged[key] = top[key]
    return merged


def read(file: Path | str) -> Document:
    """Parse a YAML file (1.2, no tags that build objects). Raises ConfigError with file and line."""
    file = Path(file)
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ConfigError(file, None, "", "no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(file, None, "", f"can't be read: {error}") from error
    return parse(text, file)


def parse(text: str, file: Path) -> Document:
    """Parse YAML that somebody else has read; `file`: what its errors call it. Raises ConfigError with file and line."""
    try:
        data = yaml_file.parse(text)
    except NotYAML as error:
        raise ConfigError(file, error.line, "", error.problem) from error
    if not isinstance(data, Map):
        raise ConfigError(
            file, 1, "", f"expected a mapping at the top, got {'nothing' if data is None else repr(data)}"
        )
    return Document(file, data)
