"""Code on its way to an engine and what became of it: bundles, releases, the way back."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, travels

_Address = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}$")]
"""of a piece: BLAKE2b of its content, 16 bytes (handrail.bundles.pieces)"""


class Piece(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A piece on its way."""

    address: _Address
    base: _Address | None = None
    """the piece that `data` is the difference to"""
    data: bytes
    """a zstd frame"""


@travels(priority=3, remote=True)
class PutBundle(Message):
    """Give an engine pieces of a bundle, none to ask which it lacks.

    As soon as nothing is lacking the bundle is checked whole, and takes the place of what the engine had of that program in one
    step; before, and where the check finds something (then it is refused), nothing changes. Pieces that have come stay for the next
    time.
    """

    bundle: _Address
    pieces: Annotated[list[Piece], Meta(max_length=256)] = []
    note: Annotated[str, Meta(max_length=400)] = ""
    engine: str = ""
    """its name, empty: the first"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """who deploys; the link writes here whose key it was"""


class Release(msgspec.Struct, kw_only=True):
    """The code that an engine has, from one change to the next. Releases are numbered, and none is ever changed."""

    number: int
    program: str
    """that was deployed"""
    bundle: str
    by: str
    at_ns: int
    """UTC of the engine's machine, since 1970"""
    note: str = ""
    changed: list[str] = []
    """paths that are new, other or gone since the release before it"""
    already: bool = False
    """in an answer: what was asked for was in force since this release, and nothing has changed"""


class BundleState(Message):
    """Answer to PutBundle."""

    base: str = ""
    """the bundle of this program that is in force now; where that is not known, the newest one"""
    lacks: list[str] = []
    """addresses that are still missing, the first 64; the bundle's own when nothing is known of it"""
    release: Release | None = None
    """the bundle is in force since this release"""


@travels(priority=1, remote=True)
class GetProgram(Message):
    """A program's file, as the engine has it in force."""

    program: Name
    engine: str = ""


class ProgramResource(msgspec.Struct, kw_only=True):
    """What a program names abstractly, and `Deploy` binds."""

    name: str
    kind: Literal["arm", "instance"]
    templates: list[str] = []
    """instance: which template it must be of, one of these; none: any"""
    title: str = ""


class ProgramParameter(msgspec.Struct, kw_only=True):
    """What `Deploy` may give a program."""

    name: str
    type: Literal["number", "integer", "text", "bool"]
    default: float | int | bool | str | None
    unit: str = ""
    min: float | None = None
    """None: it may be as low as one likes"""
    max: float | None = None
    title: str = ""


class ProgramSource(Message):
    """Answer to GetProgram."""

    program: str
    file: str
    """the file's name: it ends in .yaml or .scxml"""
    text: str
    resources: list[ProgramResource] = []
    """in the file's order; none where the file is unsound"""
    parameters: list[ProgramParameter] = []


@travels(priority=1, remote=True)
class SaveProgram(Message):
    """Bring a program that was edited into force, as a release; checked whole before, as a bundle is. Answered as PutBundle is."""

    program: Name
    text: str
    was: str = ""
    """the text that was edited: refused where the engine has another one by now. Empty: there is no program of that name"""
    note: Annotated[str, Meta(max_length=400)] = ""
    engine: str = ""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with; the link writes it here"""


@travels(priority=1, remote=True)
class GetReleases(Message):
    """What code does an engine have, since when, by whom, and what was there before?"""

    engine: str = ""


class Releases(Message):
    """Answer to GetReleases."""

    engine: str
    releases: list[Release]
    """those that there is a way back to, the newest last: it is in force"""
    files: dict[str, str] = {}
    """path → address of every file of the one in force (handrail.bundles.manifest.file_address)"""
    programs: dict[str, str] = {}
    """program → the bundle that it came with"""


@travels(priority=1, remote=True)
class RollBack(Message):
    """Bring back the code of an earlier release, as a new one. Checked whole before, as a bundle is."""

    number: int = 0
    """0: that before the one in force"""
    note: Annotated[str, Meta(max_length=400)] = ""
    engine: str = ""
    by: Annotated[str, Meta(max_length=128)] = ""


class RolledBack(Message):
    """Answer to RollBack."""

    release: Release


@travels(priority=2, remote=True)
class CodeChanged(Message):
    """An engine has other code from now on."""

    engine: Name
    release: Release


PutBundle.Reply = SaveProgram.Reply = BundleState
GetProgram.Reply = ProgramSource
GetReleases.Reply = Releases
RollBack.Reply = RolledBack
