"""Watching a bus: candump's lines, decoded text beside them, log files that every CAN tool reads."""

from __future__ import annotations

import os
import re
import select
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import can
import cantools
from cantools.database.can import Database, Message

LOG_SUFFIXES = (".blf", ".asc", ".log", ".csv", ".db", ".mf4", ".trc", ".txt")
"""Formats of log files, as python-can writes them; .log is candump's own."""


def line(message: can.Message) -> str:
    """A message as candump -ta prints it: ``(12.345678)  can0  123  [16]  00 11 ...``; FD lengths have two digits."""
    identifier = f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
    length = f"[{message.dlc:02d}]" if message.is_fd else f" [{message.dlc}]"
    data = "remote request" if message.is_remote_frame else message.data.hex(" ").upper()
    return f" ({message.timestamp:.6f})  {message.channel}  {identifier:>8}  {length}  {data}"


_MESSAGE = re.compile(r"^BO_ (\d+) (\w+) ?:", re.MULTILINE)


def load_dbc(dbc: str | os.PathLike[str]) -> Database:
    """A file's database. Raises ValueError naming the file where cantools can't read it."""
    try:
        database = cantools.database.load_file(os.fspath(dbc))
    except (OSError, cantools.Error, ValueError) as error:
        raise ValueError(f"{dbc}: no CAN database that can be read: {error}") from error
    if not isinstance(database, Database):
        raise ValueError(f"{dbc}: a diagnostics database; expected one of CAN messages (DBC)")
    return database


def messages_of(dbc: str | os.PathLike[str]) -> dict[tuple[int, bool], str]:
    """(identifier, extended) → name of a file's messages. cantools takes a second for what a glance tells of a DBC file."""
    if Path(dbc).suffix.lower() == ".dbc":
        try:
            numbers = _MESSAGE.findall(Path(dbc).read_text(encoding="cp1252"))
        except (OSError, ValueError) as error:
            raise ValueError(f"{dbc}: no CAN database that can be read: {error}") from error
        if numbers:
            return {(int(n) & 0x1FFFFFFF, int(n) >= 1 << 31): name for n, name in numbers if name != _NO_MESSAGE}
    return {(message.frame_id, message.is_extended_frame): message.name for message in load_dbc(dbc).messages}


_NO_MESSAGE = "VECTOR__INDEPENDENT_SIG_MSG"  # where DBC files keep signals without a message


class Decoder:
    """What messages say, by DBC files: the first that has an identifier tells it. A file is read whole when it is needed."""

    def __init__(self, *dbcs: str | os.PathLike[str]):
        """Raises ValueError naming the file that can't be read."""
        self._names: dict[tuple[int, bool], str] = {}
        self._files: dict[tuple[int, bool], str | os.PathLike[str]] = {}
        self._messages: dict[tuple[int, bool], Message] = {}
        for dbc in dbcs:
            for identifier, name in messages_of(dbc).items():
                self._names.setdefault(identifier, name)
                self._files.setdefault(identifier, dbc)

    def name(self, can_id: int, extended: bool) -> str:
        """What the files call an identifier, empty where they have none."""
        return self._names.get((can_id, extended), "")

    def _definition(self, identifier: tuple[int, bool]) -> Message | None:
        if identifier not in self._messages and identifier in self._files:
            file = self._files[identifier]
            for message in load_dbc(file).messages:
                if self._files.get((message.frame_id, message.is_extended_frame)) == file:
                    self._messages[message.frame_id, message.is_extended_frame] = message
        return self._messages.get(identifier)

    def text(self, message: can.Message) -> str:
        """``Name(Signal: value unit, ...)``, empty for a message that the files do not have."""
        definition = self._definition((message.arbitration_id, message.is_extended_id))
        if definition is None or message.is_remote_frame:
            return ""
        try:
            values = definition.decode(bytes(message.data))
        except (cantools.Error, ValueError) as error:
            return f"{definition.name}(can't be decoded: {error})"
        assert isinstance(values, dict)  # a container message would be a list; DBC has none
        units = {signal.name: f" {signal.unit}" if signal.unit else "" for signal in definition.signals}
        return (
            f"{definition.name}({', '.join(f'{name}: {_plain(value)}{units[name]}' for name, value in values.items())})"
        )


def _plain(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def check_log(file: Path) -> None:
    """Raises ValueError when python-can has no writer for this file's suffix, or its folder is missing."""
    if file.suffix.lower() not in LOG_SUFFIXES:
        raise ValueError(f"log file {file}: suffix {file.suffix or 'none'}; expected one of {', '.join(LOG_SUFFIXES)}")
    if not file.absolute().parent.is_dir():
        raise ValueError(f"log file {file}: the folder {file.absolute().parent} is not there")


_GLANCE_S = 0.1


class Interrupt:
    """SIGINT and SIGTERM as a flag, so that they never come in the middle of a message. Main thread only."""

    def __init__(self) -> None:
        self.set = False
        self._event = os.eventfd(0, os.EFD_NONBLOCK)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, *_: object) -> None:
        self.set = True
        os.eventfd_write(self._event, 1)

    def fileno(self) -> int:
        """Readable once a signal has come."""
        return self._event

    def wait(self, seconds: float) -> bool:
        """Wait so long, or until a signal comes; returns whether one has."""
        if not self.set and seconds > 0.0:
            select.select([self._event], [], [], seconds)
        return self.set


def watch(
    bus: can.BusABC,
    sinks: Sequence[Callable[[can.Message], object]],
    *,
    count: int | None = None,
    duration_s: float | None = None,
    idle: Callable[[], object] | None = None,
    interrupt: Interrupt | None = None,
) -> int:
    """Give every message to every sink until `count` have come, `duration_s` is over (None: never) or `interrupt`.

    Returns how many. idle: called whenever nothing more is waiting, e.g. to flush. Raises can.CanOperationError when the bus
    ends.
    """
    seen = 0
    waiting: select.poll | None = select.poll()
    try:
        waiting.register(bus.fileno(), select.POLLIN)  # type: ignore[union-attr]
        if interrupt is not None:
            waiting.register(interrupt.fileno(), select.POLLIN)  # type: ignore[union-attr]
    except (NotImplementedError, OSError, ValueError):
        waiting = None  # an interface that can't be waited on together with a signal: look again and again
    deadline = None if duration_s is None else time.monotonic() + duration_s
    while (count is None or seen < count) and not (interrupt is not None and interrupt.set):
        left = None if deadline is None else deadline - time.monotonic()
        if left is not None and left <= 0.0:
            break
        message = bus.recv(0)
        if message is None:
            if idle is not None:
                idle()
            if waiting is None:
                message = bus.recv(_GLANCE_S)
            else:
                waiting.poll(None if left is None else 1000 * left)
        if message is None:
            continue
        for sink in sinks:
            sink(message)
        seen += 1
    return seen
