"""What recordings there are, and what stands in one: read in a process of its own, at low priority, a call at a time.

    python -m handrail.recordings < CALL > ANSWER

takes one ListRecordings or GetSamples (MessagePack) and answers it: a file that is broken, or takes long, costs nobody else
anything.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader

from handrail.messages import (
    Base,
    BaseAt,
    GetSamples,
    InstanceAt,
    InstanceState,
    ListRecordings,
    MarkedAt,
    RecordingInfo,
    Recordings,
    Refused,
    Samples,
)
from handrail.messages.recordings import MOST_SAMPLES
from handrail.runtime import recordings_folder
from handrail.topics import RefusedError, refuse

_MOST_LISTED, _MOST_MARKS = 100, 200
_NICE = 10
_PER_UNIT = 1e4  # of a position, a rad


class _Row(msgspec.Struct):
    name: str
    position: float | None = None


class _Joints(msgspec.Struct):
    """What is needed of /joint_states."""

    joints: list[_Row]


class _Mark(msgspec.Struct):
    text: str
    by: str = ""


def listing(place: Path, running: str = "") -> Recordings:
    """All recordings in a folder but the running one, the newest first."""
    files = sorted(place.glob("*.mcap"), key=lambda file: file.stat().st_mtime, reverse=True) if place.is_dir() else []
    there = next(each for each in (place, *place.parents) if each.is_dir())
    free_mb = shutil.disk_usage(there).free / 1e6
    return Recordings(
        recordings=[_info(file) for file in files[:_MOST_LISTED] if file.stem != running], free_mb=round(free_mb)
    )


def _info(file: Path) -> RecordingInfo:
    size = file.stat().st_size
    try:
        with file.open("rb") as stream:
            reader = make_reader(stream)
            began, ended = _span(reader)
            marks = [
                MarkedAt(round((stamp - began) / 1e9, 3), mark.text, mark.by)
                for stamp, mark in _messages(reader, "/mark", _Mark)
            ]
            return RecordingInfo(
                name=file.stem,
                size=size,
                began=began / 1e9,
                duration_s=(ended - began) / 1e9,
                robot=next((each.metadata.get("name", "") for each in reader.iter_metadata()), ""),
                marks=marks[:_MOST_MARKS],
            )
    except (McapError, msgspec.MsgspecError, OSError, ValueError) as problem:
        why = f"not complete, or no recording ({type(problem).__name__}): mcap recover may help"
        return RecordingInfo(name=file.stem, size=size, problem=why)


def samples(place: Path, call: GetSamples) -> Samples:
    """The robot and what was placed over some seconds of a recording. Raises RefusedError."""
    if call.duration_s * call.rate_hz > MOST_SAMPLES:
        raise refuse("too much at once", "rate_hz", call.rate_hz, f"duration_s times rate_hz at most {MOST_SAMPLES}")
    try:
        with (place / f"{call.recording}.mcap").open("rb") as stream:
            return _samples(make_reader(stream), call)
    except FileNotFoundError:
        raise refuse("no such recording", "recording", call.recording, "one that ListRecordings names") from None
    except (McapError, msgspec.MsgspecError, OSError, ValueError) as problem:
        raise refuse(
            f"can't be read: {type(problem).__name__}", "recording", call.recording, "a complete recording"
        ) from problem


def _samples(reader: McapReader, call: GetSamples) -> Samples:
    start, _ = _span(reader)
    begin, end = (start + round(at * 1e9) for at in (call.begin_s, call.begin_s + call.duration_s))

    def since(stamp: int) -> float:
        return round((stamp - start) / 1e9, 4)

    made = Samples(recording=call.recording, begin_s=call.begin_s, joints=[], times_s=[], positions=[])
    for stamp, row in _messages(reader, "/joint_states", _Joints, begin, end, 1e9 / call.rate_hz):
        made.joints = made.joints or [each.name for each in row.joints]
        if len(row.joints) == len(made.joints):
            made.times_s.append(since(stamp))
            made.positions.append([round((each.position or 0.0) * _PER_UNIT) for each in row.joints])
    made.bases = [
        BaseAt(since(stamp), base) for stamp, base in _messages(reader, "/base", Base, begin, end, 1e9 / call.rate_hz)
    ]
    before: dict[str, InstanceAt] = {}
    after: list[InstanceAt] = []
    for stamp, instance in _messages(reader, "/instance", InstanceState, None, end):
        told = InstanceAt(since(stamp), instance)
        if stamp > begin:
            after.append(told)
        elif instance.removed:
            before.pop(instance.name, None)
        else:
            before[instance.name] = told
    made.instances = [*before.values(), *after]
    return made


def _span(reader: McapReader) -> tuple[int, int]:
    """First and last moment of a recording, ns. Raises ValueError where there is none."""
    summary = reader.get_summary()
    if summary is None or summary.statistics is None or not summary.statistics.message_count:
        raise ValueError("no index, or nothing in it")
    return summary.statistics.message_start_time, summary.statistics.message_end_time


def _messages(
    reader: McapReader, topic: str, kind: Any, begin: int | None = None, end: int | None = None, apart_ns: float = 0.0
) -> Iterator[tuple[int, Any]]:
    """(ns, message) of a topic, those closer than `apart_ns` to the one before left out, and not read."""
    decoder = msgspec.json.Decoder(kind)
    due = 0.0
    for _, _, message in reader.iter_messages([topic], start_time=begin, end_time=end):
        if message.log_time + 1 >= due:
            due = message.log_time + apart_ns
            yield message.log_time, decoder.decode(message.data)


def answer(encoded: bytes, place: Path) -> msgspec.Struct:
    """The answer to a call."""
    call = msgspec.msgpack.decode(encoded, type=ListRecordings | GetSamples)
    try:
        return listing(place) if isinstance(call, ListRecordings) else samples(place, call)
    except RefusedError as error:
        return error.refusal
    except OSError as error:
        return Refused(message=f"{place}: {error.strerror}")


def main() -> None:
    """Entry point of ``python -m handrail.recordings``."""
    os.nice(_NICE)
    sys.stdout.buffer.write(msgspec.msgpack.encode(answer(sys.stdin.buffer.read(), recordings_folder())))


if __name__ == "__main__":
    main()
