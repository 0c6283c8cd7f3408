"""A loop's tape in an MCAP file: how its entries are written beside everything else that is recorded, and found again.

| topic | schema | an entry |
| --- | --- | --- |
| /loop/start | handrail.LoopStart | the robot's files, the clock; a file may hold several loops, one after the other |
| /loop/received, /loop/sent | handrail/LoopReceived, LoopSent (ros1msg) | frames of one look at the bus, of one write |
| /loop/command | handrail/LoopCommand (ros1msg) | a cycle's end: the set-points that it decided on, float64 |
| /loop/order | handrail/LoopOrder (ros1msg) | a command out of the mailbox |
| /loop/note | handrail.LoopNote | everything else |

`event` counts a loop's entries: what is missing is seen.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import msgspec
import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from zstandard import ZstdError

from daemon.exchange import COMMAND
from daemon.replay.recorded_loop import LoopStart
from daemon.replay.tape import Entry, Kind, TapeReader, as_words
from hal.can.frames import RECORD
from hal.joint import COMMANDED
from handrail.recorder import Recording
from handrail.ros1_schema import definition
from handrail.runtime import Runtime

START, RECEIVED, SENT, COMMANDS, ORDER, NOTE = (
    f"/loop/{name}" for name in ("start", "received", "sent", "command", "order", "note")
)
_PACKAGE = "handrail"
_HEAD = np.dtype([("event", "<u8"), ("cycle", "<u8"), ("time_ns", "<i8")])
_PACKED_HEAD = struct.Struct("<QQq")
_FLOAT64 = np.dtype("<f8")
_BROKEN = "broken"


class LoopNote(msgspec.Struct, kw_only=True):
    """An entry that comes seldom; what it tells, daemon.replay.tape.Kind says."""

    event: int
    cycle: int
    time_ns: int
    what: str
    """stop, wait, controller, motion, skip, end; or broken: the tape broke off in this cycle"""
    numbers: list[int]
    text: str


class UnusableRecording(ValueError):
    """A file that can't be replayed; str() says what is wrong with it."""


def _command(joints: int) -> np.dtype:
    """A COMMAND entry as it is in memory, but for what rounds it up to whole words."""
    rows = [(name, "<f8", joints) for name in COMMANDED]
    return np.dtype([*_HEAD.descr, ("cycle_time_ns", "<i8"), ("late_ns", "<i8"), *rows, ("mode", "u1", joints)])


_DEFINITIONS = {
    RECEIVED: definition(np.dtype([*_HEAD.descr, ("ticks", "<i8")]), _PACKAGE, ("frames", RECORD)),
    SENT: definition(_HEAD, _PACKAGE, ("frames", RECORD)),
    ORDER: definition(np.dtype([*_HEAD.descr, ("command", COMMAND)]), _PACKAGE, ("payload", _FLOAT64)),
}
_NAMES = {RECEIVED: "LoopReceived", SENT: "LoopSent", COMMANDS: "LoopCommand", ORDER: "LoopOrder"}
_ROWS = {RECEIVED: (1, RECORD.itemsize // 8), SENT: (0, RECORD.itemsize // 8), ORDER: (COMMAND.itemsize // 8, 1)}
"""of each that ends in rows: words of an entry's body before them, words of a row"""
_KINDS = {RECEIVED: Kind.RECEIVED, SENT: Kind.SENT, ORDER: Kind.ORDER}
_TOPICS = {kind: topic for topic, kind in _KINDS.items()}


class TapeRecorder:
    """Takes what is on the tape in a runtime folder, and writes it into a recording."""

    def __init__(self, runtime: Runtime):
        self._tape = TapeReader(runtime.tape)
        self._event, self._broken = 0, False
        self._command, self._command_text = _HEAD, ""
        self.broken: list[int] = []
        """the cycles in which a loop's tape broke off"""

    def __call__(self, recording: Recording) -> None:
        """Take all that is there: what the loop before left first, where another one has started."""
        self._drain(recording)
        generation = self._tape.generation
        if self._tape.attach() and self._tape.generation != generation:
            self._broken = False
            self._drain(recording)

    def _drain(self, recording: Recording) -> None:
        for entry in self._tape.read():
            self._write(recording, entry)
        if self._broken or (cycle := self._tape.broken_in) is None:
            return
        for entry in self._tape.read():  # written between the two looks
            self._write(recording, entry)
        self._broken = True
        self.broken.append(cycle)
        self._note(recording, cycle, 0, _BROKEN, [], "")

    def _write(self, recording: Recording, entry: Entry) -> None:
        body = entry.body
        if entry.kind is Kind.START:
            start = msgspec.json.decode(body.tobytes().rstrip(b"\0"), type=LoopStart)
            self._event, self._command = 0, _command(len(start.joints))
            self._command_text = definition(self._command, _PACKAGE)
            recording.write_plain(START, start, entry.time_ns)
        elif entry.kind is Kind.COMMAND:
            data = self._head(entry) + body.tobytes()
            self._pack(recording, COMMANDS, self._command_text, data[: self._command.itemsize], entry)
        elif (topic := _TOPICS.get(entry.kind)) is not None:
            before, row = _ROWS[topic]
            count = np.uint32((len(body) - before) // row)
            data = b"".join((self._head(entry), body[:before].tobytes(), count.tobytes(), body[before:].tobytes()))
            self._pack(recording, topic, _DEFINITIONS[topic], data, entry)
        else:
            numbers, text = body.view(np.int64).tolist(), ""
            if entry.kind is Kind.STOP:
                numbers, text = numbers[:1], body[2:].tobytes()[: numbers[1]].decode()
            self._note(recording, entry.cycle, entry.time_ns, entry.kind.name.lower(), numbers, text)

    def _head(self, entry: Entry) -> bytes:
        self._event += 1
        return _PACKED_HEAD.pack(self._event, entry.cycle, entry.time_ns)

    def _pack(self, recording: Recording, topic: str, text: str, data: bytes, entry: Entry) -> None:
        recording.write_packed(topic, f"{_PACKAGE}/{_NAMES[topic]}", text, data, entry.time_ns)

    def _note(self, recording: Recording, cycle: int, time_ns: int, what: str, numbers: list[int], text: str) -> None:
        self._event += 1
        note = LoopNote(event=self._event, cycle=cycle, time_ns=time_ns, what=what, numbers=numbers, text=text)
        recording.write_plain(NOTE, note, time_ns)


class FiledLoop:
    """One of the loops in a file. Take all of its `entries` before the next loop."""

    def __init__(self, start: LoopStart, messages: _Messages):
        self.start = start
        self.incomplete = ""
        """once its entries have been taken: why there are no more, where the loop had not ended"""
        self._messages, self._event, self._ended = messages, 0, False

    def entries(self) -> Iterator[Entry]:
        """The entries, START left out. Raises UnusableRecording where one is missing."""
        while (found := self._messages.peek()) is not None and found[0] != START:
            self._messages.next()
            if (entry := self._entry(*found)) is not None:
                yield entry
        self.incomplete = self.incomplete or self._messages.cut or ("" if self._ended else "the recording was ended")

    def _entry(self, topic: str, data: bytes) -> Entry | None:
        note = msgspec.json.decode(data, type=LoopNote) if topic == NOTE else None
        event, cycle, time_ns = (
            (note.event, note.cycle, note.time_ns) if note is not None else _PACKED_HEAD.unpack_from(data)
        )
        if event != self._event + 1:
            raise UnusableRecording(
                f"{self._messages.path}: cycle {cycle}: entry {event} of the loop follows entry {self._event}: some are missing"
            )
        self._event = event
        if note is not None:
            return self._noted(note)
        data = data[_HEAD.itemsize :]
        if topic == COMMANDS:
            return Entry(Kind.COMMAND, cycle, time_ns, as_words(data))
        before = 8 * _ROWS[topic][0]  # the number of rows follows from the length
        return Entry(_KINDS[topic], cycle, time_ns, np.frombuffer(data[:before] + data[before + 4 :], np.uint64))

    def _noted(self, note: LoopNote) -> Entry | None:
        if note.what == _BROKEN:
            self.incomplete = (
                f"its tape broke off in cycle {note.cycle}: the recorder did not take away in time what the loop wrote"
            )
            return None
        kind = Kind[note.what.upper()]
        self._ended = self._ended or kind is Kind.END
        body = np.array(note.numbers, np.int64).view(np.uint64)
        if kind is Kind.STOP:
            reason = note.text.encode()
            body = np.concatenate([body, np.array([len(reason)], np.uint64), as_words(reason)])
        return Entry(kind, note.cycle, note.time_ns, body)


class _Messages:
    """The loops' messages in a file, in the order in which they were written, and a look at the next one."""

    def __init__(self, stream: IO[bytes], path: Path):
        self.path = path
        self.cut = ""
        """why there is no more, where the file does not end as it should"""
        self._found = self._read(stream)
        self._next = next(self._found, None)

    def peek(self) -> tuple[str, bytes] | None:
        """Topic and data of the next; None: there is none."""
        return self._next

    def next(self) -> None:
        """Go on."""
        self._next = next(self._found, None)

    def _read(self, stream: IO[bytes]) -> Iterator[tuple[str, bytes]]:
        topics: dict[int, str] = {}
        schemas: dict[int, Schema] = {}
        begun = False
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                begun = True
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.topic.startswith("/loop/"):
                    topics[record.id] = record.topic
                    self._check_form(record.topic, schemas.get(record.schema_id))
                elif isinstance(record, Message) and record.channel_id in topics:
                    yield topics[record.channel_id], record.data
        except UnusableRecording:
            raise
        except (McapError, ValueError, ZstdError, struct.error) as error:
            if not begun:
                raise UnusableRecording(f"{self.path}: no MCAP file") from error
            if isinstance(error, CRCValidationError) or stream.read(1):
                raise UnusableRecording(f"{self.path}: damaged: {error}") from error
            self.cut = "the file breaks off: its recorder was killed, or it was not copied whole"

    def _check_form(self, topic: str, schema: Schema | None) -> None:
        """Records are read as they are in memory: of those of a version that had others nothing could be made."""
        expected = _DEFINITIONS.get(topic)
        if expected is not None and (schema is None or schema.data.decode() != expected):
            raise UnusableRecording(
                f"{self.path}: recorded by a version of Handrail whose {topic} has other fields; replay it with that one"
            )


def loops(path: Path) -> Iterator[FiledLoop]:
    """The loops that a recording holds. Raises UnusableRecording."""
    try:
        with path.open("rb") as stream:
            messages = _Messages(stream, path)
            if messages.peek() is None:
                raise UnusableRecording(
                    f"{path}: no loop was recorded{' before ' + messages.cut if messages.cut else ''}; expected a recording of "
                    "handrail up --record"
                )
            while (found := messages.peek()) is not None:
                topic, data = found
                if topic != START:
                    raise UnusableRecording(
                        f"{path}: the recording begins after the loop's start, whose state nobody knows then; "
                        "expected one of the loop's whole life (handrail up --record)"
                    )
                messages.next()
                loop = FiledLoop(msgspec.json.decode(data, type=LoopStart), messages)
                yield loop
                for _ in loop.entries():
                    pass
    except OSError as error:
        raise UnusableRecording(f"{path}: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise UnusableRecording(f"{path}: recorded by another version of Handrail: {error}") from error
