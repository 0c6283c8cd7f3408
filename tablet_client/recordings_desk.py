"""Recordings, and the one that is seen again, as QML sees them, and the buttons' way down."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from handrail.messages import Message, StopRecording
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


class RecordingsDesk(QObject):
    """What QML reads of recordings and of the replay, and calls."""

    changed = Signal()
    replayChanged = Signal()
    timeChanged = Signal()

    def __init__(self, situation: Situation, send: Callable[[Message], None], soon: Callable[[], None]):
        """`send` sends what a button asked for, `soon` has the models looked at anew."""
        super().__init__()
        self._situation, self._send, self._soon = situation, send, soon
        self._view: dict[str, Any] = {}
        self._replay: dict[str, Any] = {}
        self._time = 0.0
        self._found = Rows(("name", "when", "seconds", "megabytes", "marks", "problem", "fits"), "name")
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(_MAP, notify=replayChanged)
    def replay(self) -> dict[str, Any]:
        return self._replay

    @Property(float, notify=timeChanged)
    def time(self) -> float:
        """s since the recording's beginning"""
        return self._time

    @Property(QObject, constant=True)
    def found(self) -> Rows:
        return self._found

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks at the page, or no more."""
        self._situation.recordings.look(on)
        self._soon()

    @Slot(str)
    def start(self, name: str) -> None:
        """Begin a recording; without a name it is called by the time."""
        if not self.why("start"):
            self._send(self._situation.recordings.start(name))

    @Slot()
    def stop(self) -> None:
        """End it."""
        if not self.why("stop"):
            self._send(StopRecording())

    @Slot(str)
    def mark(self, text: str) -> None:
        """Mark this moment in it."""
        call = None if self.why("mark") else self._situation.recordings.mark(text)
        if call is not None:
            self._send(call)

    @Slot(str)
    def show(self, name: str) -> None:
        """See a recording again."""
        info = next((each for each in self._situation.recordings.found if each.name == name), None)
        if info is not None and not info.problem:
            self._situation.bench.select("")
            self._situation.replay.begin(info)
            self._soon()

    @Slot()
    def back(self) -> None:
        """Back to what is."""
        self._situation.replay.end()
        self._soon()

    @Slot(float)
    def scrub(self, seconds: float) -> None:
        self._situation.replay.scrub(seconds)
        self._soon()

    @Slot(bool)
    def play(self, on: bool) -> None:
        self._situation.replay.play(on)
        self._soon()

    def why(self, command: str) -> str:
        """Code of the reason why `start`, `stop` or `mark` can't be done now; empty when it can."""
        situation = self._situation
        if not situation.link.attached:
            return "no_robot"
        if situation.only_looks:
            return situation.only_looks
        if {"start": "StartRecording", "stop": "StopRecording", "mark": "Mark"}[command] in situation.pending:
            return "sending"
        running = bool(situation.recordings.running)
        return "" if running != (command == "start") else "is_recording" if running else "not_recording"

    def want(self, now: float) -> list[Message]:
        """The calls that are due."""
        slow = self._situation.quality.figures().quality in ("slow", "bad") if self._situation.replay.active else False
        return self._situation.recordings.want(now) + self._situation.replay.want(now, slow=slow)

    def build(self) -> None:
        """Look at the models anew."""
        recordings, replay = self._situation.recordings, self._situation.replay
        robot = self._situation.robot.info.name if self._situation.robot.info else ""
        self._found.show(
            [
                {
                    "name": each.name,
                    "when": time.strftime("%Y-%m-%d %H:%M", time.localtime(each.began)) if each.began else "",
                    "seconds": each.duration_s,
                    "megabytes": each.size / 1e6,
                    "marks": [{"at": mark.at_s, "text": mark.text, "by": mark.by} for mark in each.marks],
                    "problem": each.problem,
                    "fits": not each.problem and each.robot in ("", robot),
                }
                for each in recordings.found
            ]
        )
        view = {
            "known": recordings.known,
            "running": recordings.running,
            "runningFor": int(recordings.running_s) if recordings.open else 0,
            "free": int(recordings.free_mb // 1000),
            "problem": recordings.problem,
            "why": {name: self.why(name) for name in ("start", "stop", "mark")},
        }
        if view != self._view:
            self._view = view
            self.changed.emit()
        shown = {
            "active": replay.active,
            "name": replay.recording,
            "duration": replay.duration_s,
            "playing": replay.playing,
            "waiting": replay.waiting,
            "problem": replay.problem,
            "marks": [{"at": mark.at_s, "text": mark.text} for mark in replay.marks],
        }
        if shown != self._replay:
            self._replay = shown
            self.replayChanged.emit()
        if replay.time_s != self._time:
            self._time = replay.time_s
            self.timeChanged.emit()
