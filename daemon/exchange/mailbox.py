"""The mailbox through which the server gives the loop its commands: one writer, one reader, four slots.

The loop makes it at every start, so that no command written for a dead loop is ever carried out by the next one.
"""

from __future__ import annotations

import mmap
from pathlib import Path

import numpy as np

from daemon.exchange.shared_file import COUNTER, OTHER_COUNTER, WORDS, Attached, create, whole_lines

MARK = 0x48524D41494C_01


class MailboxFull(RuntimeError):
    """The loop has not taken the commands that lie in its mailbox: it hangs, or is not running."""


class MailboxReader:
    """The loop's side, which makes the mailbox: `take` a command, use it in place, then `done`."""

    def __init__(self, path: Path, command: np.dtype, slots: int = 4, floats: int = 1 << 18):
        """`command`: dtype of a command's fixed part; `floats`: room for the payload, in float64 (2 MiB by default)."""
        self._memory = create(
            path,
            WORDS * 8 + slots * (whole_lines(8 + command.itemsize) + floats * 8),
            magic=MARK,
            record_size=command.itemsize,
            count=slots,
            payload_size=floats,
        )
        self._words = memoryview(self._memory)[: WORDS * 8].cast(
            "q"
        )  # the loop looks in every cycle: quicker than numpy
        self._slots = _mail_slots(self._memory, command, slots, floats)
        self._taken = 0

    def take(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The oldest command not yet done: its fixed part, shape (1,), and its payload, float64 (k,); None: there is none.

        Both are views into the mailbox, valid until `done`.
        """
        if self._words[COUNTER] == self._taken:
            return None
        length, command, payload = self._slots[self._taken % len(self._slots)]
        return command, payload[: int(length[0])]

    def done(self) -> None:
        """Give the slot of the command taken last back to the writer."""
        self._taken += 1
        self._words[OTHER_COUNTER] = self._taken


class MailboxWriter:
    """The server's side: `post` commands. One process, one thread."""

    def __init__(self, path: Path, command: np.dtype):
        self._file = Attached(path, MARK, command.itemsize)
        self._command = command
        self._mapped = 0

    @property
    def floats(self) -> int:
        """The largest payload, in float64 numbers; 0 while no loop has started."""
        self._attach()
        return self._file.payload_size

    def post(self, command: np.ndarray, payload: np.ndarray | None = None) -> int:
        """Put a command (shape () or (1,)) and its payload (float64, any shape) into the mailbox; its number, from 1.

        Raises MailboxFull when the loop does not take them, or there is none; ValueError for a payload without room.
        """
        if not self._attach():
            raise MailboxFull("the daemon's loop has not started: there is no mailbox yet")
        posted, taken = int(self._words[COUNTER]), int(self._words[OTHER_COUNTER])
        if posted - taken >= len(self._slots):
            raise MailboxFull(f"{posted - taken} commands lie in the daemon loop's mailbox and it does not take them")
        length, slot_command, slot_payload = self._slots[posted % len(self._slots)]
        size = 0 if payload is None else payload.size
        if size > slot_payload.size:
            raise ValueError(f"payload of {size} numbers; expected at most {slot_payload.size}")
        if payload is not None:
            slot_payload[:size] = payload.reshape(-1)
        slot_command[0] = command if command.ndim == 0 else command[0]
        length[0] = size
        self._words[COUNTER] = posted + 1
        return posted + 1

    def _attach(self) -> bool:
        if not self._file.refresh():
            return False
        if self._mapped != self._file.generation:
            self._mapped = self._file.generation
            assert self._file.memory is not None
            self._words = np.frombuffer(self._file.memory, np.int64, WORDS)
            self._slots = _mail_slots(self._file.memory, self._command, self._file.count, self._file.payload_size)
        return True


def _mail_slots(
    memory: mmap.mmap, command: np.dtype, slots: int, floats: int
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Views on each slot: payload length (1,) int64, command (1,), payload (floats,) float64."""
    fixed = whole_lines(8 + command.itemsize)
    views = []
    for index in range(slots):
        offset = WORDS * 8 + index * (fixed + floats * 8)
        views.append(
            (
                np.frombuffer(memory, np.int64, 1, offset),
                np.frombuffer(memory, command, 1, offset + 8),
                np.frombuffer(memory, np.float64, floats, offset + fixed),
            )
        )
    return views
