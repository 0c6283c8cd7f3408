"""A bundle: a program and all that it needs, as a list of files and their pieces. The bundle's name is the address of that list."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.bundles import pieces

FOLDERS = ("rtc_programs", "nodes", "behaviours", "affordance_templates", "scenes")
"""of a workspace, from which bundles take files and into which they put them"""
_PATH = re.compile(rf"(?:{'|'.join(FOLDERS)})(?:/[A-Za-z0-9_][A-Za-z0-9_.\-]*)+")

Address = Annotated[str, Meta(pattern=rf"^{pieces.ADDRESS}$")]


class Manifest(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """What a bundle consists of."""

    program: Annotated[str, Meta(min_length=1, max_length=128)]
    files: dict[str, list[Address]]
    """path in a workspace → the file's pieces"""

    def encoded(self) -> bytes:
        """The same bytes for the same content."""
        files = {path: self.files[path] for path in sorted(self.files)}
        return msgspec.msgpack.encode(Manifest(program=self.program, files=files))

    def pieces(self) -> Iterator[str]:
        """The addresses of all that it is made of."""
        for parts in self.files.values():
            yield from parts

    def addresses(self) -> dict[str, str]:
        """path → one address for the whole file."""
        return {path: file_address(parts) for path, parts in self.files.items()}


def read(content: bytes) -> Manifest:
    """A manifest that came from elsewhere. Raises ValueError, naming the path that has no place in a workspace."""
    try:
        manifest = msgspec.msgpack.decode(content, type=Manifest)
    except (msgspec.DecodeError, UnicodeDecodeError) as problem:
        raise ValueError(f"not a bundle's list of files: {problem}") from problem
    for path in manifest.files:
        if not _PATH.fullmatch(path):
            raise ValueError(f"files: got {path!r}; expected a path below one of {', '.join(FOLDERS)}")
    return manifest


def file_address(parts: list[str]) -> str:
    """One address for a file of one or more pieces."""
    return parts[0] if len(parts) == 1 else pieces.address("".join(parts).encode())


@dataclass(frozen=True)
class Bundle:
    """A bundle with its content, as whoever deploys it has it."""

    manifest: Manifest
    contents: Mapping[str, bytes] = field(repr=False)
    """address → piece, the manifest's own among them"""

    @property
    def address(self) -> str:
        return pieces.address(self.manifest.encoded())


def bundle(program: str, files: Mapping[str, bytes]) -> Bundle:
    """Make a bundle of `files` (path in a workspace → content)."""
    contents: dict[str, bytes] = {}
    addresses: dict[str, list[str]] = {}
    for path, content in files.items():
        parts = pieces.cut(content)
        addresses[path] = [pieces.address(part) for part in parts]
        contents.update(zip(addresses[path], parts, strict=True))
    manifest = Manifest(program=program, files=addresses)
    listed = manifest.encoded()
    if len(listed) > pieces.LARGEST:
        raise ValueError(
            f"bundle {program}: its list of files has {len(listed)} bytes; expected at most {pieces.LARGEST}"
        )
    contents[pieces.address(listed)] = listed
    return Bundle(manifest, contents)


def write(manifest: Manifest, get: Callable[[str], bytes | None], folder: Path) -> None:
    """Write a bundle's files into a workspace's folder. Raises ValueError where a piece is missing, OSError."""
    for path, parts in manifest.files.items():
        contents = [get(part) for part in parts]
        if None in contents:
            raise ValueError(f"{path}: piece {parts[contents.index(None)]} is missing")
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"".join(part for part in contents if part is not None))
