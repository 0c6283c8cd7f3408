"""Recordings on the robot's computer: started, marked, ended, listed, and looked into a few seconds at a time."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, NonNegative, travels
from handrail.messages.instances import InstanceState
from handrail.messages.state import Base

MOST_SAMPLES = 600
"""in one answer"""
RecordingName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,62}$")]
"""a file's name without `.mcap`"""


@travels(priority=1, remote=True)
class StartRecording(Message):
    """Record everything that the robot's processes say, from now on, into a file on the robot's computer."""

    name: RecordingName
    by: str = ""
    """whose key the call came with: the link writes it"""
    role: str = ""


@travels(priority=1, remote=True)
class StopRecording(Message):
    """End the recording that StartRecording began: its file is complete a moment later."""

    by: str = ""
    role: str = ""


@travels(priority=2, remote=True)
class Mark(Message):
    """Something worth finding again: written into every recording that runs. As a call, and told to the recorders."""

    text: Annotated[str, Meta(min_length=1, max_length=200)]
    by: str = ""
    role: str = ""


class MarkedAt(msgspec.Struct, forbid_unknown_fields=True):
    """A mark in a recording."""

    at_s: float
    """since the recording's beginning"""
    text: str
    by: str = ""


class RecordingInfo(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A file of recordings."""

    name: str
    size: int
    """bytes"""
    began: float = 0.0
    """s since 1970"""
    duration_s: NonNegative = 0.0
    robot: str = ""
    marks: list[MarkedAt] = []
    problem: str = ""
    """why it can't be looked into; empty where it can"""


@travels(priority=5, remote=True)
class ListRecordings(Message):
    """Which recordings are there, and which is being made? Answered by the link."""


class Recordings(Message):
    """Answer to ListRecordings."""

    recordings: list[RecordingInfo]
    """the newest first, 100 at most; without the one that is being made"""
    running: str = ""
    """the one that is being made"""
    running_s: NonNegative = 0.0
    """for how long"""
    free_mb: NonNegative = 0.0
    """room where recordings are kept"""


@travels(priority=6, remote=True)
class GetSamples(Message):
    """How did the robot and what was placed stand, over some seconds of a recording? Answered by the link."""

    recording: RecordingName
    begin_s: NonNegative = 0.0
    """since the recording's beginning"""
    duration_s: Annotated[float, Meta(gt=0, le=60)] = 10.0
    rate_hz: Annotated[float, Meta(gt=0, le=30)] = 10.0
    """as many a second at most; duration times rate is 600 at most"""


class InstanceAt(msgspec.Struct, forbid_unknown_fields=True):
    """An instance as it stood from a moment on."""

    at_s: float
    instance: InstanceState


class BaseAt(msgspec.Struct, forbid_unknown_fields=True):
    """Where a base that is not fixed was."""

    at_s: float
    base: Base


class Samples(Message):
    """Answer to GetSamples."""

    recording: str
    begin_s: float
    joints: list[str]
    times_s: list[float]
    """(n,) since the recording's beginning"""
    positions: list[list[int]]
    """(n, joints) in 0.1 mrad: half the bytes of what a float takes"""
    bases: list[BaseAt] = []
    instances: list[InstanceAt] = []
    """those that stood at the beginning, then what changed, in order"""


ListRecordings.Reply = Recordings
GetSamples.Reply = Samples
