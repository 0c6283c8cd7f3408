"""Pieces of files, addressed by what is in them: cut where the content says, sent as the difference to one that is there already.

A cut falls after a line whose checksum says so, so an edit changes the piece that it is in and none behind it. What is sent of a
changed piece is a zstd frame with the old one as its dictionary (RFC 8878, section 5): a line that changed costs some forty bytes.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import zlib
from collections.abc import Collection, Iterable
from pathlib import Path

import zstandard

ADDRESS = r"[0-9a-f]{32}"
"""of a piece: BLAKE2b of its content, 16 bytes, in hexadecimal digits"""
LARGEST = 1 << 18
"""bytes of a piece, unpacked"""
SMALLEST = 1 << 13
"""bytes of a piece that is not its file's last"""
_MOST = 1 << 15
_ONE_LINE_IN = 64
"""cuts, behind the least size"""
_LEVEL = 12


def address(content: bytes) -> str:
    """The name of a piece."""
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def cut(content: bytes) -> list[bytes]:
    """A file's pieces, of 8 to 32 KiB each (the last may be smaller); one that is empty has one, which is empty too."""
    pieces, begin, here = [], 0, 0
    for line in content.splitlines(keepends=True):
        here += len(line)
        while here - begin > _MOST:
            pieces.append(content[begin : begin + _MOST])
            begin += _MOST
        if here - begin >= SMALLEST and zlib.crc32(line) % _ONE_LINE_IN == 0:
            pieces.append(content[begin:here])
            begin = here
    if begin < len(content) or not pieces:
        pieces.append(content[begin:])
    return pieces


def pack(content: bytes, base: bytes | None = None) -> bytes:
    """A piece as it travels. `base`: one that the other side has, and that is much like it."""
    return zstandard.ZstdCompressor(level=_LEVEL, dict_data=_dictionary(base), write_content_size=True).compress(
        content
    )


def unpack(data: bytes, base: bytes | None = None) -> bytes:
    """What `pack` was given. Raises ValueError, whatever the bytes are."""
    try:
        size = zstandard.frame_content_size(data)
        if not 0 <= size <= LARGEST:
            raise ValueError(f"a piece of {size} bytes; expected its size in the header, of at most {LARGEST}")
        return zstandard.ZstdDecompressor(dict_data=_dictionary(base)).decompress(
            data, max_output_size=LARGEST, allow_extra_data=False
        )
    except zstandard.ZstdError as error:
        raise ValueError(f"not a packed piece: {error}") from error


def _dictionary(base: bytes | None) -> zstandard.ZstdCompressionDict | None:
    return zstandard.ZstdCompressionDict(base, dict_type=zstandard.DICT_TYPE_RAWCONTENT) if base else None


class PieceStore:
    """A folder of pieces, each a file under its address. A piece that is not what its name says is none."""

    def __init__(self, folder: Path, limit: int):
        """`limit`: bytes that `collect` leaves at most, beside what must be kept."""
        self._folder, self._limit = folder, limit
        folder.mkdir(parents=True, exist_ok=True)

    def get(self, address_: str) -> bytes | None:
        """A piece's content, None when it is not there."""
        file = self._folder / address_
        try:
            content = file.read_bytes()
        except OSError:
            return None
        if address(content) != address_:
            file.unlink(missing_ok=True)  # the disk has spoiled it: it is fetched anew
            return None
        with contextlib.suppress(OSError):
            os.utime(file)
        return content

    def put(self, content: bytes) -> str:
        """Keep a piece, whole or not at all; its address. Raises OSError."""
        name = address(content)
        file = self._folder / name
        if not file.is_file():
            fresh = self._folder / f".{name}.{secrets.token_hex(4)}"
            fresh.write_bytes(content)
            os.replace(fresh, file)
        return name

    def lacks(self, addresses: Iterable[str]) -> list[str]:
        """Those that are not there, each once, in their order."""
        return [each for each in dict.fromkeys(addresses) if not (self._folder / each).is_file()]

    def collect(self, keep: Collection[str] = ()) -> None:
        """Remove pieces that nothing needs, those used longest ago first, until what is left of them is within the limit."""
        found = []
        for file in self._folder.iterdir():
            if file.name not in keep:
                with contextlib.suppress(OSError):
                    status = file.stat()
                    found.append((status.st_mtime_ns, status.st_size, file))
        total = sum(size for _, size, _ in found)
        for _, size, file in sorted(found, key=lambda each: each[0]):
            if total <= self._limit:
                return
            file.unlink(missing_ok=True)
            total -= size
