"""A bundle's way to an engine: what it lacks is asked, only that is sent, and what was cut off goes on where it was."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from handrail.bundles import manifest as manifests
from handrail.bundles import pieces
from handrail.bundles.manifest import Bundle, Manifest
from handrail.messages import BundleState, Piece, PutBundle, Release

_CALL = 16_000
"""packed bytes of pieces that one call carries, unless a single piece is larger: at 9.6 kbit/s, fourteen seconds"""
_GUESS = 2_000
"""packed bytes that are sent unasked, on the guess that the engine lacks them"""
_MOST_IN_A_CALL = 256
_AGAIN = 2
"""times that the same piece is sent once more"""
_CACHE_LIMIT = 64 << 20
_ANSWER_S = 240.0
"""for a call to go, be checked, and be answered"""

Progress = Callable[[int, int], None]
"""(pieces sent, pieces to be sent as far as is known)"""


def cache_folder() -> Path:
    """Where a client keeps what it has sent: ``handrail/bundles`` under ``$XDG_CACHE_HOME`` (else ``~/.cache``)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").absolute() / "handrail" / "bundles"


class Sender:
    """Sends bundles to engines, and remembers what it has sent so that the next one travels as the difference."""

    def __init__(self, call: Callable[..., Any], robot: str, cache: Path | None = None):
        """`call(message, timeout_s)` gives its answer; `robot`: whatever tells this robot from others."""
        folder = cache or cache_folder()
        self._call, self._robot = call, robot
        self._cache = pieces.PieceStore(folder / "pieces", _CACHE_LIMIT)
        self._last = folder / "last"
        self._last.mkdir(parents=True, exist_ok=True)

    def send(self, bundle: Bundle, *, engine: str = "", note: str = "", progress: Progress | None = None) -> Release:
        """Bring a bundle into force; the release that it came with. Raises RefusedError and Unreachable, after which the same call
        goes on with what is still missing.
        """
        memory = self._last / pieces.address(f"{self._robot} {engine} {bundle.manifest.program}".encode())
        before = self._manifest(memory.read_text(encoding="ascii") if memory.is_file() else "")
        # What the robot had last is a guess: if it is right, the first call is the only one.
        first = self._first(bundle, before) if before else []
        sent, asked, again = 0, "", 0
        state: BundleState = self._put(bundle, engine, note, first)
        while state.release is None:
            if not state.lacks:
                raise ValueError(f"bundle {bundle.address}: the engine lacks nothing, and has not taken it")
            # Asked for the same piece again, what was taken for its base is not there any more.
            again = again + 1 if state.lacks[0] == asked else 0
            if again > _AGAIN:
                raise ValueError(f"bundle {bundle.address}: the engine does not keep {asked}: is its disk full?")
            before = None if again else self._manifest(state.base)
            asked = state.lacks[0]
            batch = list(_within(self._pieces(state.lacks, bundle, before)))
            if progress is not None:
                progress(sent, sent + len(state.lacks))
            sent += len(batch)
            state = self._put(bundle, engine, note, batch)
        for content in bundle.contents.values():
            self._cache.put(content)
        memory.write_text(bundle.address, encoding="ascii")
        self._cache.collect()
        return state.release

    def _put(self, bundle: Bundle, engine: str, note: str, parts: list[Piece]) -> BundleState:
        call = PutBundle(bundle=bundle.address, pieces=parts, note=note, engine=engine)
        return self._call(call, _ANSWER_S)

    def _first(self, bundle: Bundle, before: Manifest) -> list[Piece]:
        """All that has changed, or only the bundle's list where that is too much to be sent on a guess."""
        known, size = set(before.pieces()), 0
        changed = [part for part in dict.fromkeys(bundle.manifest.pieces()) if part not in known]
        parts: list[Piece] = []
        for part in self._pieces([bundle.address, *changed], bundle, before):
            size += len(part.data)
            if parts and size > _GUESS:
                return parts[:1]
            parts.append(part)
        return parts

    def _pieces(self, addresses: Iterable[str], bundle: Bundle, before: Manifest | None) -> Iterator[Piece]:
        """Packed against what the engine has in the same place, where that is known here."""
        likely = {} if before is None else dict(_likely(bundle.manifest, before))
        listed = before.encoded() if before else None
        for address in addresses:
            content = bundle.contents.get(address)
            if content is None:
                raise ValueError(f"bundle {bundle.address}: the engine asks for {address}, which is none of its pieces")
            if address == bundle.address and listed is not None:
                base: bytes | None = listed
            else:
                base = self._cache.get(likely[address]) if address in likely else None
            data = pieces.pack(content, base)
            yield Piece(address=address, base=pieces.address(base) if base else None, data=data)

    def _manifest(self, address: str) -> Manifest | None:
        content = self._cache.get(address) if address else None
        return manifests.read(content) if content is not None else None


def _likely(new: Manifest, old: Manifest) -> Iterator[tuple[str, str]]:
    """(new piece, the old one that it is probably much like): that behind the same neighbour, else in the same place."""
    for path, parts in new.files.items():
        there = old.files.get(path, [])
        follower: Mapping[str, str] = dict(zip(["", *there], there, strict=False))
        for place, part in enumerate(parts):
            behind = parts[place - 1] if place else ""
            if (found := follower.get(behind) or (there[min(place, len(there) - 1)] if there else "")) != "":
                yield part, found


def _within(parts: Iterator[Piece]) -> Iterator[Piece]:
    """As many as one call carries, at least one."""
    size = 0
    for number, part in enumerate(parts):
        size += len(part.data)
        if number and (size > _CALL or number >= _MOST_IN_A_CALL):
            return
        yield part
