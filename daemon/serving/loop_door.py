"""The server's way to the loop: commands with serials that only rise, the loop's answers, and what to do where none comes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from daemon import exchange
from daemon.exchange import Answer, Kind
from daemon.exchange.doorbell import Bell, Doorbell, loop_doorbell, server_doorbell
from daemon.exchange.mailbox import MailboxFull, MailboxWriter
from handrail.runtime import Runtime
from handrail.topics import refuse

Answered = tuple[int, int, float]
"""exchange.Answer, the row of the joint or device that it is about or -1, its value"""
Command = tuple[np.ndarray, np.ndarray | None]
"""header and payload"""

NO_LOOP = "the daemon's loop is not running; its supervisor starts it anew, and nothing moves before Enable"
ANSWER_TIMEOUT_S = 3.0
"""how long a call waits for the loop's word: it looks into its mailbox every cycle, and cycles in lock-step are long where the
machine is busy. With the preparation's less than callers wait (handrail.topics.Caller)."""
_ASK_AGAIN_S = 0.01


class LoopDoor:
    """Gives the loop commands, and hears its answers."""

    def __init__(
        self,
        runtime: Runtime,
        hear: Callable[[int], Answered | None],
        words: Callable[[Answered], tuple[str, str, Any, str]],
        log: Callable[[Literal["error"], str], None],
    ):
        """`hear`: deals with what the loop has published; its answer to the command of that serial, if among it. `words`: (message,
        field, value, expectation) of an answer that is no yes."""
        self._hear, self._words, self._log = hear, words, log
        self._mailbox = MailboxWriter(runtime.mailbox, exchange.COMMAND)
        self._bell = Bell(loop_doorbell(runtime.folder))
        self.doorbell = Doorbell(server_doorbell(runtime.folder))
        """rung by the loop when it has published"""
        # Counts on across restarts of the server: the loop must never see a serial twice.
        self._serial = time.monotonic_ns()

    @property
    def floats(self) -> int:
        """That the mailbox has room for, of a command's payload."""
        return self._mailbox.floats

    def close(self) -> None:
        self.doorbell.close()
        self._bell.close()

    def count(self) -> int:
        """A new command's serial."""
        self._serial += 1
        return self._serial

    def ring(self) -> bool:
        """Wake the loop; whether there is one."""
        return self._bell.ring()

    def ask(self, kind: Kind, *, owner: int = 0, action: int = 0, value: float = 0.0) -> None:
        """Give the loop a command without payload; RefusedError unless it accepts."""
        self.require(self.post(exchange.encode_command(kind, self.count(), owner=owner, action=action, value=value)))

    def leave(self, header: np.ndarray, payload: np.ndarray | None = None) -> None:
        """Give the loop a command whose answer nobody waits for. RefusedError: there is no room, or no loop."""
        try:
            self._mailbox.post(header, payload)
        except MailboxFull as error:
            raise refuse(str(error) if self._bell.ring() else NO_LOOP) from error
        if not self._bell.ring():
            raise refuse(NO_LOOP)

    def post(self, header: np.ndarray, payload: np.ndarray | None = None) -> Answered | None:
        """Give the loop a command and wait for its answer; None: no word in time. RefusedError: not given."""
        self.leave(header, payload)
        deadline = time.monotonic() + ANSWER_TIMEOUT_S
        while (answer := self._hear(int(header["serial"]))) is None:
            if (left := deadline - time.monotonic()) <= 0:
                return None
            self.doorbell.wait(left)
        return answer

    def post_while(self, answer: Answer, command: Callable[[], Command], gives_up: float) -> Answered | None:
        """Give the loop the same command again and again while that is what it answers, until `gives_up` (monotonic s)."""
        while True:
            told = self.post(*command())
            if told is None or told[0] != answer or time.monotonic() >= gives_up:
                return told
            self.doorbell.wait(_ASK_AGAIN_S)

    def require(self, answer: Answered | None) -> None:
        """RefusedError unless the loop has accepted."""
        if answer is None:
            raise refuse(
                f"the daemon's loop gave no answer in {ANSWER_TIMEOUT_S:g} s; it may still do what it was told"
            )
        if answer[0] != Answer.ACCEPTED:
            raise refuse(*self._words(answer))

    def tell(self, kind: Kind, *, owner: int = 0, action: int = 0, value: float = 0.0) -> None:
        """Give the loop a command that nobody called for; that there is no room for it is logged."""
        try:
            self._mailbox.post(exchange.encode_command(kind, self.count(), owner=owner, action=action, value=value))
        except MailboxFull as error:
            self._log("error", f"{kind.name.lower()} was not delivered: {error}")
        self._bell.ring()
