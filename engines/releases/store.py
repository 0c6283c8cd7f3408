"""The code that an engine was given: pieces as they come, releases that are checked whole before they count, and the way back.

In one folder: `pieces/`; `N/`, a release's files, made like a workspace and never changed; `releases.json`, which says what there
is and is replaced in one step, so that an engine that is killed at any moment finds the old release or the new one.
"""

from __future__ import annotations

import logging
import os
import shutil
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from handrail import messages as m
from handrail.bundles import manifest as manifests
from handrail.bundles import pieces
from handrail.bundles.manifest import Manifest
from handrail.topics import refuse
from handrail.workspace import RELEASES

KEPT = 20
"""releases that there is a way back to"""
_LIMIT = 256 << 20
"""bytes of pieces"""
_MOST_PIECES = 4096
"""of a bundle: some 60 MB"""
_TOLD = 64
"""missing pieces that an answer names"""
_log = logging.getLogger(__name__)


class _Entry(msgspec.Struct, kw_only=True):
    release: m.Release
    bundles: dict[str, str]
    """program → its bundle, in the order in which they came: where two have a file of the same path, the later one's counts"""


class _File(msgspec.Struct, kw_only=True):
    entries: list[_Entry] = []


@dataclass(frozen=True)
class _Source:
    """Who changed what, and why."""

    program: str
    bundle: str
    by: str
    note: str


class ReleaseStore:
    """What one engine has. Every method may be called from any thread; one change is made at a time."""

    def __init__(
        self,
        folder: Path,
        check: Callable[[Path, Collection[str]], None],
        *,
        pinned: Callable[[], Collection[Path]] = tuple,
        limit: int = _LIMIT,
    ):
        """`check(folder, programs)` raises RefusedError where one of these programs can't run with what is in `folder`.

        `pinned`: folders of releases that something still runs. What can't be read of `folder` is told in `problems`.
        """
        self._folder, self._check, self._pinned = folder, check, pinned
        self._pieces = pieces.PieceStore(folder / "pieces", limit)
        self._changing = threading.Lock()
        self.problems: list[str] = []
        self._entries = self._read()
        if self._entries:
            self._restore()

    # ------------------------------------------------------------------------------------------------------------- reading

    @property
    def folder(self) -> Path | None:
        """Where the files of the release in force are; None when nothing was ever deployed."""
        entries = self._entries
        return self._folder / str(entries[-1].release.number) if entries else None

    @property
    def number(self) -> int:
        """Of the release in force, 0: there is none."""
        entries = self._entries
        return entries[-1].release.number if entries else 0

    def listing(self, engine: str) -> m.Releases:
        """All that can be gone back to, and what is in force."""
        entries = self._entries
        files = self._tree(entries[-1].bundles) if entries else {}
        return m.Releases(
            engine=engine,
            releases=[entry.release for entry in entries],
            files={path: manifests.file_address(parts) for path, parts in files.items()},
            programs=dict(entries[-1].bundles) if entries else {},
        )

    def state(self, bundle: str) -> m.BundleState:
        """What is missing of a bundle, and what there is that it may be much like."""
        lacks = self._lacks(bundle)
        program = "" if (found := self._manifest(bundle)) is None else found.program
        in_force = self._entries[-1].bundles if self._entries else {}
        base = in_force.get(program) or (self._entries[-1].release.bundle if self._entries else "")
        return m.BundleState(base=base, lacks=lacks[:_TOLD])

    # ------------------------------------------------------------------------------------------------------------- changing

    def take(self, parts: Collection[m.Piece]) -> None:
        """Keep pieces that have come; those whose base is not there are left. Refused when one is not what its address says."""
        for number, piece in enumerate(parts):
            base = None if piece.base is None else self._pieces.get(piece.base)
            if piece.base is not None and base is None:
                continue
            try:
                content = pieces.unpack(piece.data, base)
            except ValueError as problem:
                raise refuse("a piece came damaged", f"pieces[{number}].data", piece.address, str(problem)) from problem
            if (got := pieces.address(content)) != piece.address:
                raise refuse("a piece is not what its address says", f"pieces[{number}].address", piece.address, got)
            try:
                self._pieces.put(content)
            except OSError as full:
                raise refuse(f"the pieces can't be kept: {full}") from full
        self._pieces.collect(self._needed())

    def put(self, call: m.PutBundle) -> m.BundleState:
        """Bring a bundle into force once all of it is there. Refused where it can't run here: then nothing has changed."""
        state = self.state(call.bundle)
        if state.lacks:
            return state
        with self._one_at_a_time():
            found = self._manifest(call.bundle)
            if found is None:
                return self.state(call.bundle)
            entries = self._entries
            if entries and entries[-1].bundles.get(found.program) == call.bundle:
                came = [entry.release for entry in entries if entry.release.bundle == call.bundle]
                since = came[-1] if came else entries[0].release  # it is older than what is kept
                return msgspec.structs.replace(state, release=msgspec.structs.replace(since, already=True))
            before = dict(entries[-1].bundles) if entries else {}
            before.pop(found.program, None)
            source = _Source(found.program, call.bundle, call.by, call.note)
            release = self._switch({**before, found.program: call.bundle}, source)
        return msgspec.structs.replace(state, release=release)

    def roll_back(self, call: m.RollBack) -> m.Release:
        """Bring an earlier release back as a new one."""
        with self._one_at_a_time():
            entries = self._entries
            numbers = [entry.release.number for entry in entries[:-1]]
            wanted = call.number or (numbers[-1] if numbers else 0)
            if wanted not in numbers:
                known = ", ".join(map(str, numbers)) or "none: there is no release before the one in force"
                raise refuse("no such release to go back to", "number", wanted, f"one of: {known}")
            entry = entries[numbers.index(wanted)]
            source = _Source(
                entry.release.program, entry.release.bundle, call.by, call.note or f"back to release {wanted}"
            )
            return self._switch(entry.bundles, source)

    @contextmanager
    def _one_at_a_time(self) -> Iterator[None]:
        """Who comes meanwhile is refused instead of waiting."""
        if not self._changing.acquire(blocking=False):
            raise refuse("other code is just being deployed to this engine: try again when that is done")
        try:
            yield
        finally:
            self._changing.release()

    def _switch(self, bundles: Mapping[str, str], source: _Source) -> m.Release:
        """Write the files beside those in force, check them, and only then let them count."""
        entries = self._entries
        before = self._tree(entries[-1].bundles) if entries else {}
        after = self._tree(bundles)
        number = entries[-1].release.number + 1 if entries else 1
        try:
            folder = self._write(number, bundles)
            try:
                self._check(folder, list(bundles))
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
            release = m.Release(
                number=number,
                program=source.program,
                bundle=source.bundle,
                by=source.by or "local",
                at_ns=time.time_ns(),
                note=source.note,
                changed=sorted(path for path in {*before, *after} if before.get(path) != after.get(path)),
            )
            kept = [*entries, _Entry(release=release, bundles=dict(bundles))][-KEPT:]
            fresh = self._folder / "releases.new"
            fresh.write_bytes(msgspec.json.format(msgspec.json.encode(_File(entries=kept))))
            os.replace(fresh, self._folder / RELEASES)
        except (OSError, ValueError) as problem:
            raise refuse(f"the release can't be kept: {problem}") from problem
        self._entries = kept
        self._collect()
        return release

    def _write(self, number: int, bundles: Mapping[str, str]) -> Path:
        fresh, folder = self._folder / f"{number}.new", self._folder / str(number)
        for old in (fresh, folder):  # of an engine that was killed before it counted
            if old.exists():
                shutil.rmtree(old)
        fresh.mkdir()
        manifests.write(Manifest(program="all", files=self._tree(bundles)), self._pieces.get, fresh)
        os.replace(fresh, folder)
        return folder

    def _tree(self, bundles: Mapping[str, str]) -> dict[str, list[str]]:
        """path → pieces. Raises ValueError where a bundle's list is gone."""
        files: dict[str, list[str]] = {}
        for program, bundle in bundles.items():
            found = self._manifest(bundle)
            if found is None:
                raise ValueError(f"bundle {bundle} of {program} is missing")
            files |= found.files
        return files

    def _lacks(self, bundle: str) -> list[str]:
        found = self._manifest(bundle)
        if found is None:
            return [bundle]
        if (count := sum(map(len, found.files.values()))) > _MOST_PIECES:
            raise refuse("the bundle is too large", "bundle", f"{count} pieces", f"at most {_MOST_PIECES}")
        return self._pieces.lacks(found.pieces())

    def _manifest(self, bundle: str) -> Manifest | None:
        content = self._pieces.get(bundle)
        if content is None:
            return None
        try:
            return manifests.read(content)
        except ValueError as problem:
            raise refuse("not a bundle", "bundle", bundle, str(problem)) from problem

    # ----------------------------------------------------------------------------------------------------------------- disk

    def _needed(self) -> set[str]:
        """Addresses of what the releases that are kept are made of."""
        bundles = {bundle for entry in self._entries for bundle in entry.bundles.values()}
        return bundles.union(*(found.pieces() for bundle in bundles if (found := self._manifest(bundle)) is not None))

    def _collect(self) -> None:
        """Drop what no release that is kept needs."""
        self._pieces.collect(self._needed())
        needed = {self._folder / str(entry.release.number) for entry in self._entries} | set(self._pinned())
        for folder in self._folder.iterdir():
            if folder.name.split(".")[0].isdigit() and folder not in needed:
                shutil.rmtree(folder, ignore_errors=True)

    def _read(self) -> list[_Entry]:
        file = self._folder / RELEASES
        try:
            return msgspec.json.decode(file.read_bytes(), type=_File).entries
        except FileNotFoundError:
            return []
        except (OSError, msgspec.DecodeError, UnicodeDecodeError) as unreadable:
            os.replace(file, file.with_suffix(".unreadable"))
            self.problems.append(f"{file}: {unreadable}; put aside, this engine has no deployed code")
            return []

    def _restore(self) -> None:
        """Write the files of the release in force anew: nobody knows what became of them meanwhile."""
        newest = self._entries[-1]
        try:
            self._write(newest.release.number, newest.bundles)
        except (OSError, ValueError) as problem:
            self.problems.append(f"release {newest.release.number} is spoiled ({problem}); deploy anew")
