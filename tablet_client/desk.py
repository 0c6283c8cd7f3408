"""The operator's desk: the models as QML sees them, and the buttons' way down to the session.

Views are maps that QML binds to; each is rebuilt when something arrived and announced only when it differs. Codes, not sentences:
the words, and their translations, are QML's (`qml/Words.qml`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from PySide6.QtCore import Property, QObject, Qt, QTimer, Signal, Slot

from handrail.link.codec import OBSERVING
from handrail.messages import (
    AnswerPrompt,
    ClearStop,
    Enable,
    ExecutePlan,
    GetPlan,
    Jog,
    ListLibrary,
    MakePlan,
    Message,
    ReturnCommand,
    SaveTemplate,
    TakeCommand,
)
from tablet_client.bench_desk import BenchDesk
from tablet_client.camera_desk import CameraDesk
from tablet_client.growing_list import GrowingList
from tablet_client.health_desk import HealthDesk
from tablet_client.library_desk import LibraryDesk
from tablet_client.models.arrivals import Inbox
from tablet_client.models.command import commanders, if_lost
from tablet_client.models.journal import KEPT
from tablet_client.models.plan_figures import CLEARANCE, Figure, figures, level_of
from tablet_client.models.prompts import lets_go
from tablet_client.models.quantities import in_unit, label, quantity
from tablet_client.models.situation import Situation
from tablet_client.move_desk import MoveDesk
from tablet_client.pairing_desk import PairingDesk
from tablet_client.recordings_desk import RecordingsDesk
from tablet_client.rows import Rows
from tablet_client.run_desk import RunDesk
from tablet_client.scene.stage import Stage
from tablet_client.session import Session
from tablet_client.signals_desk import SignalsDesk
from tablet_client.tour_desk import TourDesk
from tablet_client.workshop import Workshop

FRAME = 33  # ms between two looks at what has arrived, while things arrive
FRAME_IN_SOFTWARE = 66  # the same where the processor draws: it may be the robot's own
_PATIENCE = 0.3  # s that a frame may take before the next look is taken anyway
_COMMANDS: dict[str, Callable[[], Message]] = {
    "enable": Enable,
    "clear_stop": ClearStop,
}
_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


def _shown(figure: Figure) -> dict[str, Any]:
    return {"label": label(figure.code), **asdict(figure)}


class Desk(QObject):
    """Everything that QML reads and calls. Lives on the window's thread."""

    headerChanged = Signal()
    promptChanged = Signal()
    ghostChanged = Signal()
    ghostTimeChanged = Signal()
    _arrived = Signal()

    def __init__(self, situation: Situation, stage: Stage, operator: str = "operator", frame: int = FRAME):
        super().__init__()
        self.situation, self._stage, self._operator = situation, stage, operator
        self.inbox = Inbox(self._arrived.emit)
        self._session: Session | None = None
        self._journal = GrowingList(("clock", "level", "code", "details"))
        self._hands = Rows(("name", "position", "low", "high", "poses", "holding", "state"), "name")
        self._run = RunDesk(situation, self._send)
        self._bench = BenchDesk(situation, stage, self._tell, self._soon)
        self._library = LibraryDesk(situation, self._send, self._soon)
        self._pairing = PairingDesk()
        self._camera = CameraDesk(situation)
        self._signals = SignalsDesk(situation)
        self._move = MoveDesk(situation, self._send, self._go, self._soon)
        self._workshop = Workshop(situation, self._send, self._soon)
        self._recordings = RecordingsDesk(situation, self._send, self._soon)
        self._health = HealthDesk(situation, self._send, self._soon)
        self._tour = TourDesk(situation, self._soon)
        self._header: dict[str, Any] = {}
        self._prompt: dict[str, Any] = {}
        self._ghost: dict[str, Any] = {}
        self._ghost_time = 0.0
        self._last_look = self._frame_since = time.monotonic()
        self._frame_out = self._closed = False
        self._look = QTimer(self, singleShot=True, interval=frame)
        self._look.timeout.connect(self.look)
        self._arrived.connect(self._soon, Qt.ConnectionType.QueuedConnection)
        stage.changed.connect(self._soon)
        self._ages = QTimer(self, interval=1000)
        self._ages.timeout.connect(self._soon)
        self._ages.start()
        self._build()

    def serve(self, session: Session) -> None:
        """Send the operator's calls through this session."""
        self._session = session
        self._workshop.serve(session)

    def close(self) -> None:
        """Look no more. Python may take the desk down on any thread, and Qt's timers must not run then."""
        self._closed = True  # pages that go say that nobody looks at them any more
        self._arrived.disconnect(self._soon)
        self._stage.changed.disconnect(self._soon)
        self._look.stop()
        self._ages.stop()
        self._move.close()

    # ---------------------------------------------------------------------------------------------------------- views

    @Property(_MAP, notify=headerChanged)
    def header(self) -> dict[str, Any]:
        return self._header

    @Property(QObject, constant=True)
    def signals(self) -> SignalsDesk:
        return self._signals

    @Property(QObject, constant=True)
    def tour(self) -> TourDesk:
        return self._tour

    @Property(QObject, constant=True)
    def health(self) -> HealthDesk:
        return self._health

    @Property(QObject, constant=True)
    def recordings(self) -> RecordingsDesk:
        return self._recordings

    @Property(QObject, constant=True)
    def library(self) -> LibraryDesk:
        return self._library

    @Property(QObject, constant=True)
    def move(self) -> MoveDesk:
        return self._move

    @Property(QObject, constant=True)
    def workshop(self) -> Workshop:
        return self._workshop

    @Property(QObject, constant=True)
    def camera(self) -> CameraDesk:
        return self._camera

    @Property(QObject, constant=True)
    def pairing(self) -> PairingDesk:
        return self._pairing

    @Property(QObject, constant=True)
    def run(self) -> RunDesk:
        return self._run

    @Property(_MAP, notify=promptChanged)
    def prompt(self) -> dict[str, Any]:
        return self._prompt

    @Property(_MAP, notify=ghostChanged)
    def ghost(self) -> dict[str, Any]:
        return self._ghost

    @Property(float, notify=ghostTimeChanged)
    def ghostTime(self) -> float:
        return self._ghost_time

    @Property(QObject, constant=True)
    def bench(self) -> BenchDesk:
        return self._bench

    @Property(QObject, constant=True)
    def hands(self) -> Rows:
        return self._hands

    @Property(QObject, constant=True)
    def journal(self) -> GrowingList:
        return self._journal

    # -------------------------------------------------------------------------------------------------------- buttons

    @Slot()
    def stop(self) -> None:
        """STOP: out on the session's own thread before this returns."""
        if self._session is not None:
            self._session.stop(f"{self._operator}, at the tablet")

    @Slot(str)
    def command(self, name: str) -> None:
        """Enable, or clear the stop; does nothing while the button says why it can't."""
        if not self.situation.why_not_command(name):
            self._send(_COMMANDS[name]())

    @Slot(bool)
    def takeCommand(self, over: bool) -> None:
        """Keep others from moving the robot; `over`: who has the command loses it."""
        if not self.situation.why_not_take_command():
            self._send(TakeCommand(take_over=over))

    @Slot()
    def returnCommand(self) -> None:
        """Let whoever is connected command."""
        if not self.situation.why_not_take_command():
            self._send(ReturnCommand())

    @Slot(str)
    def answer(self, option: str) -> None:
        """Answer the prompt that is shown."""
        prompt = self.situation.prompts.current
        if prompt is not None and not self.situation.why_not_answer(option):
            self._send(AnswerPrompt(id=prompt.id, answer=option, by=self._operator))

    @Slot()
    def execute(self) -> None:
        """Execute the plan that is shown; does nothing while the button says why it can't."""
        plan = self.situation.plans.shown
        if plan is not None and not self.situation.why_not_execute():
            self._send(ExecutePlan(id=plan.id))

    @Slot(str, float)
    def sendHand(self, gripper: str, position: float) -> None:
        """Send a gripper somewhere, rad or m of its driven joint."""
        call = self.situation.hands.call(gripper, position)
        if call is not None and not self.situation.why_not_hand():
            self._send(call)

    @Slot(float)
    def scrub(self, seconds: float) -> None:
        self.situation.plans.scrub(seconds)
        self._soon()

    @Slot(bool)
    def play(self, on: bool) -> None:
        self.situation.plans.play(on)
        self._soon()

    def _may(self, call: Message) -> bool:
        """Whether a call may leave: none that commands, while this window only looks. Buttons say so before."""
        return not self.situation.only_looks or isinstance(call, OBSERVING)

    def _send(self, call: Message) -> None:
        if self._session is not None and self._may(call):
            self.situation.sent(call)
            self._session.send(call)
            self._soon()

    def _go(self, place: Jog) -> None:
        """Send the robot somewhere by hand."""
        if self._session is not None and self._may(place):
            self._session.go(place)

    def _tell(self, call: Message) -> None:
        """Send what need not be shown as on its way: streams of edits are shown by what they edit."""
        if isinstance(call, MakePlan | SaveTemplate | ListLibrary):
            self._send(call)
        elif self._session is not None and self._may(call):
            self._session.send(call)

    # -------------------------------------------------------------------------------------------------------- looking

    @Slot()
    def frame_swapped(self) -> None:
        """The window has drawn what it was last given."""
        self._frame_out = False

    def _soon(self) -> None:
        if not self._look.isActive() and not self._closed:
            self._look.start()

    @Slot()
    def look(self) -> None:
        """Take what has arrived and show it, no faster than it can be drawn: a slow screen must not keep touches waiting."""
        now = time.monotonic()
        if self._frame_out and now - self._frame_since < _PATIENCE:
            self._look.start()
            return
        for item in self.inbox.take():
            self.situation.take(item)
        plans, busy = self.situation.plans, False
        if self._session is not None and self.situation.link.attached:
            for call in (*self.situation.service.want(now), *self._recordings.want(now)):
                self._session.send(call)
        if self._session is not None and (plan := plans.want()):
            self._session.send(GetPlan(id=plan))
        if self._session is not None and self.situation.link.engine:
            for call in self.situation.task.tree.want(now):
                self._session.send(call)
            busy = self._bench.send(now)
            templates = self.situation.templates.want(self.situation.world.instances.values())
            for call in (*templates, *self._library.want(), *self._workshop.want(now)):
                self._session.send(call)
        if self._stage.loaded:
            plans.advance(min(now - self._last_look, 0.2))
            self.situation.replay.advance(min(now - self._last_look, 0.2))
        self._last_look = now
        self._frame_out, self._frame_since = self._stage.show(self.situation), now
        self._build()
        self._journal.grow(self.situation.journal.entries, KEPT)
        if busy or self.situation.replay.playing or (plans.shown is not None and plans.playing and self._stage.loaded):
            self._look.start()

    def _build(self) -> None:
        self._announce("_header", self._build_header(), self.headerChanged)
        self._run.build()
        self._bench.build()
        self._library.build()
        self._workshop.build()
        self._camera.build()
        self._signals.build()
        self._health.build()
        self._tour.build()
        self._recordings.build()
        self._move.build()
        self._hands.show(self._build_hands())
        self._announce("_prompt", self._build_prompt(), self.promptChanged)
        self._announce("_ghost", self._build_ghost(), self.ghostChanged)
        self._announce("_ghost_time", self.situation.plans.time, self.ghostTimeChanged)

    def _announce(self, name: str, value: Any, signal: Any) -> None:
        if getattr(self, name) != value:
            setattr(self, name, value)
            signal.emit()

    def _build_header(self) -> dict[str, Any]:
        link, robot = self.situation.link, self.situation.robot
        status = robot.status
        return {
            "robot": robot.info.name if robot.info else "",
            "link": link.state,
            "linkWhy": link.why,
            "address": link.address,
            "tries": link.tries,
            "lostFor": int(time.monotonic() - link.since) if link.state == "lost" else 0,
            "engine": link.engine,
            "engineWhy": link.engine_why,
            "drives": robot.drives,
            "stopReason": status.stop_reason if status else "",
            "faulty": robot.faulty,
            "clock": status.clock if status else "",
            "time": robot.time_ns // 1_000_000_000,
            "held": bool(status and status.holds),
            "stopState": robot.stop_state,
            "stopWhy": robot.stop_why,
            "enableWhy": self._why("enable"),
            "clearWhy": self._why("clear_stop"),
            "moving": robot.moving,
            "speed": round(status.speed * 100) if status else 100,
            "cloudAge": self._cloud_age(),
            "ifLost": if_lost(status, self.situation.task.status),
            "commands": [{"part": part, "owner": owner} for part, owner in commanders(status)],
            "commander": self.situation.commander,
            "commandIsMine": bool(self.situation.commander) and not self.situation.others_command,
            "commandWhy": self.situation.why_not_take_command(),
            "actions": list(status.actions) if status else [],
            "handWhy": self.situation.why_not_hand(),
            "places": list(self.situation.world.instances),
        }

    def _cloud_age(self) -> int:
        """Whole s of the robot's clock since a camera's last picture; -1: there is none, -2: it is from another time."""
        age = self.situation.clouds.age(self.situation.robot.time_ns)
        return -2 if age == float("inf") else int(age)

    def _why(self, command: str) -> str:
        if _COMMANDS[command].__name__ in self.situation.pending:
            return "sending"
        return self.situation.why_not_command(command)

    def _build_hands(self) -> list[dict[str, Any]]:
        hands = self.situation.hands
        return [
            {
                "name": name,
                "position": round(state.position, 3),
                "low": span.low,
                "high": span.high,
                "poses": [{"name": pose, "position": at} for pose, at in span.poses.items()],
                "holding": state.holding,
                "state": state.state,
            }
            for name, state in hands.states.items()
            if (span := hands.spans.get(name)) is not None
        ]

    def _build_prompt(self) -> dict[str, Any]:
        prompts, plans = self.situation.prompts, self.situation.plans
        prompt = prompts.current
        if prompt is None:
            return {"open": False, "options": [], "details": []}
        plan = plans.get(prompt.plan)
        details = [{"label": name, "text": text} for name, text in (quantity(*pair) for pair in prompt.details.items())]
        if plan is not None:
            # What the plan itself tells is as true, and says where.
            known = [_shown(figure) for figure in figures(plan) if figure.decides]
            known.append({"label": "Duration", "text": in_unit("s", plan.duration)})
            labels = {each["label"] for each in known}
            details = known + [each for each in details if each["label"] not in labels]
        return {
            "open": True,
            "id": prompt.id,
            "text": prompt.text,
            "severity": prompt.severity,
            "options": [
                {"option": option, "go": lets_go(option), "why": self.situation.why_not_answer(option)}
                for option in prompt.options
            ],
            "details": details,
            "stale": plan is not None and not plan.fresh,
            "because": plan.stale_because if plan is not None else "",
            "waiting": prompts.waiting,
            "sent": prompts.sent,
            "refused": prompts.refused,
        }

    def _build_ghost(self) -> dict[str, Any]:
        plans = self.situation.plans
        plan, track = plans.shown, plans.track
        if plan is None or track is None:
            return {
                "shown": False,
                "marks": [],
                "keys": [],
                "figures": [],
                "duration": 0.0,
                "segment": "",
                "playing": False,
            }
        found = figures(plan)
        worst = next((figure for figure in found if figure.code == CLEARANCE.code), None)
        return {
            "shown": True,
            "label": plan.label,
            "executeWhy": "sending" if "ExecutePlan" in self.situation.pending else self.situation.why_not_execute(),
            "stale": not plan.fresh,
            "because": plan.stale_because,
            "duration": track.duration,
            "playing": plans.playing,
            "segment": track.segment(plans.time),
            "marks": [
                {"name": name, "at": at, "end": end, "level": level_of(plan, name)} for name, at, end in track.spans
            ],
            "keys": list(plan.key_times),
            "figures": [_shown(figure) for figure in found],
            "worstAt": worst.at if worst is not None else -1.0,
            "worstLevel": worst.level if worst is not None else "good",
        }
