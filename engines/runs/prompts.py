"""Questions to the operator: open ones, and the answers to those that are closed, so that a late answer learns whose came first.

The open ones are on disk: those of an engine that was killed are withdrawn by the next one, so that each is closed once.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

import msgspec

from handrail.messages import AnswerPrompt, Prompt, PromptClosed
from handrail.topics import refuse

_REMEMBERED = 200
_log = logging.getLogger(__name__)


class Prompts:
    """All prompts of one engine. Every method may be called from any thread."""

    def __init__(self, publish: Callable[[Prompt | PromptClosed], None], file: Path | None = None):
        """`file`: where the ids of open ones are kept; those that are there already are withdrawn. None: nowhere."""
        self._publish, self._file = publish, file
        self._changed = threading.Condition()
        self._open: OrderedDict[str, Prompt] = OrderedDict()
        self._closed: OrderedDict[str, PromptClosed] = OrderedDict()
        if left := self._left():
            for id in left:
                self._closed[id] = PromptClosed(id=id)
                publish(self._closed[id])
            self._keep()

    def ask(self, prompt: Prompt) -> None:
        """Open a prompt. Its id must be new."""
        with self._changed:
            self._open[prompt.id] = prompt
            self._keep()
            self._publish(prompt)

    def wait(self, id: str) -> PromptClosed:
        """Block until a prompt is answered or withdrawn (then its answer is empty)."""
        with self._changed:
            self._changed.wait_for(lambda: id in self._closed)
            return self._closed[id]

    def answer(self, request: AnswerPrompt) -> None:
        """Take an operator's answer. Refused when there is no such prompt or option, or it was closed before."""
        with self._changed:
            if (closed := self._closed.get(request.id)) is not None:
                how = f"was already answered {closed.answer!r} by {closed.by}" if closed.answer else "was withdrawn"
                raise refuse(f"the prompt {how}", "id", request.id, "an open prompt")
            if request.id not in self._open:
                raise refuse("no such prompt", "id", request.id, f"one of: {', '.join(self._open) or 'none is open'}")
            options = self._open[request.id].options
            if request.answer not in options:
                raise refuse("not an option of this prompt", "answer", request.answer, f"one of: {', '.join(options)}")
            self._close(PromptClosed(id=request.id, answer=request.answer, by=request.by))

    def withdraw(self, id: str) -> bool:
        """Close a prompt that nobody needs to answer any more. False when it is closed already: then nothing happens."""
        with self._changed:
            if id not in self._open:
                return False
            self._close(PromptClosed(id=id))
            return True

    def open(self) -> list[Prompt]:
        """Those that wait for an answer, oldest first."""
        with self._changed:
            return list(self._open.values())

    def _close(self, closed: PromptClosed) -> None:
        del self._open[closed.id]
        self._closed[closed.id] = closed
        self._keep()
        while len(self._closed) > _REMEMBERED:
            self._closed.popitem(last=False)
        self._publish(closed)
        self._changed.notify_all()

    def _left(self) -> list[str]:
        """Ids of those that were open when the engine before this one ended without closing them."""
        if self._file is None or not self._file.exists():
            return []
        try:
            return msgspec.json.decode(self._file.read_bytes(), type=list[str])
        except (OSError, msgspec.DecodeError) as unreadable:
            _log.warning("open questions of the engine before: %s: %s", self._file, unreadable)
            return []

    def _keep(self) -> None:
        if self._file is None:
            return
        fresh = self._file.with_suffix(".new")
        try:
            fresh.write_bytes(msgspec.json.encode(list(self._open)))
            os.replace(fresh, self._file)
        except OSError as full:
            _log.warning("the open questions could not be kept in %s: %s", self._file, full)
