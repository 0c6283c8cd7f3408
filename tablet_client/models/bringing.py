"""Code that one engine has, brought to another: what was saved or deployed there is saved here, and is a release of this one's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from handrail.messages import GetNodeSource, GetProgram, Message, SaveNode, SaveProgram

_NODE = "nodes/"
"""what the program of a node's release begins with"""


@dataclass
class _Job:
    what: str
    """a program, or `nodes/NAME`"""
    source: str
    target: str
    out: Message
    """the call that is on its way"""
    text: str | None = None
    wired: bool = False
    sent: bool = False


class Bringing:
    """One at a time. `said`: code, what, target and why, of the last one: `bringing`, `brought`, `not_brought`."""

    def __init__(self) -> None:
        self._job: _Job | None = None
        self.said: tuple[str, str, str, str] = ("", "", "", "")

    @property
    def busy(self) -> bool:
        return self._job is not None

    def begin(self, what: str, source: str, target: str) -> None:
        """Of an engine to another one; nothing while another is under way."""
        if self._job is None:
            self._job = _Job(what, source, target, _read(what, source))
            self.said = ("bringing", what, target, "")

    def want(self) -> list[Message]:
        """The call that is due, each once."""
        job = self._job
        if job is None or job.sent:
            return []
        job.sent = True
        return [job.out]

    def take(self, call: Message, answer: Any) -> None:
        """An answer to one of these calls; others count for nothing."""
        job = self._job
        if job is None or call is not job.out:
            return
        if job.text is None:
            job.text, job.wired = answer.text, answer.file.endswith(".yaml")
            self._next(_read(job.what, job.target))
        elif isinstance(call, SaveProgram | SaveNode):
            self._end("brought")
        else:
            self._next(_saved(job, answer.text))

    def failed(self, call: Message, why: str, *, refused: bool) -> bool:
        """One of them was refused, or not answered; False: it was none of these."""
        job = self._job
        if job is None or call is not job.out:
            return False
        if refused and job.text is not None and not isinstance(call, SaveProgram | SaveNode):
            self._next(_saved(job, ""))  # the other engine has none of that name
        else:
            self._end("not_brought", why)
        return True

    def anew(self) -> None:
        """The robot is gone: what was under way is not."""
        if self._job is not None:
            self._end("not_brought")

    def _next(self, call: Message) -> None:
        assert self._job is not None
        self._job.out, self._job.sent = call, False

    def _end(self, code: str, why: str = "") -> None:
        assert self._job is not None
        self.said = (code, self._job.what, self._job.target, why)
        self._job = None


def _read(what: str, engine: str) -> Message:
    if what.startswith(_NODE):
        return GetNodeSource(node=what.removeprefix(_NODE), engine=engine)
    return GetProgram(program=what, engine=engine)


def _saved(job: _Job, was: str) -> Message:
    text, note = job.text or "", f"as {job.source} has it"
    if job.what.startswith(_NODE):
        node = job.what.removeprefix(_NODE)
        return SaveNode(node=node, text=text, was=was, wired=job.wired, note=note, engine=job.target)
    return SaveProgram(program=job.what, text=text, was=was, note=note, engine=job.target)
