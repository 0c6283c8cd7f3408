"""All that the tablet knows, and the one place where it learns: messages, connection news and answers go in by `take`."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from handrail import messages
from handrail.engines import FIRST
from handrail.messages import AnswerPrompt, Message
from tablet_client.models import arrivals
from tablet_client.models.bench import Bench
from tablet_client.models.bringing import Bringing
from tablet_client.models.canvas.canvas import Canvas
from tablet_client.models.canvas.wiring import Wiring
from tablet_client.models.clouds import Clouds
from tablet_client.models.code import Code
from tablet_client.models.deployments import Deployments
from tablet_client.models.hands import Hands
from tablet_client.models.journal import Journal, Level
from tablet_client.models.launch import Launch
from tablet_client.models.link import Link
from tablet_client.models.link_quality import LinkQuality
from tablet_client.models.move import Move
from tablet_client.models.node_parameters import NodeParameters
from tablet_client.models.output import Output
from tablet_client.models.plans import Plans
from tablet_client.models.prompts import Prompts, lets_go
from tablet_client.models.recordings import RecordingList
from tablet_client.models.replay import Replay
from tablet_client.models.robot import Robot
from tablet_client.models.service import Service
from tablet_client.models.signals import Signals
from tablet_client.models.task import Task
from tablet_client.models.templates import Templates
from tablet_client.models.world import World

_RUN_LEVELS: dict[str, Level] = {"succeeded": "good", "failed": "error", "stopped": "warning", "paused": "warning"}

_EVERYBODYS = ("pause", "stop_run", "breakpoint")
"""what may be done with a run whoever has the command"""


class Situation:
    """The models, kept consistent with one another."""

    def __init__(self, address: str = "", *, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self.link = Link(address)
        self.quality = LinkQuality()
        self.name, self.role = "", ""
        """whose key this window has, as the robot says, and what it may; empty: the robot has not said"""
        self.robot = Robot()
        self.task = Task()
        self.prompts = Prompts()
        self.plans = Plans()
        self.world = World()
        self.templates = Templates()
        self.bench = Bench(self.world)
        self.library: list[messages.LibraryEntry] = []
        """the first engine's programs and templates: instances are placed from these"""
        self.launch = Launch()
        self.deployments = Deployments()
        self.clouds = Clouds()
        self.commander = ""
        """name of the key that has the command; empty: whoever is connected may command"""
        self.signals = Signals()
        self.hands = Hands()
        self.move = Move()
        self.service = Service()
        self.recordings = RecordingList(clock)
        self.replay = Replay()
        self.journal = Journal()
        self.output = Output()
        self.code = Code()
        self.canvas = Canvas(self.code)
        self.wiring = Wiring(self.code)
        self.bringing = Bringing()
        self.node_parameters = NodeParameters(self.code)
        self.pending: set[str] = set()
        """types of the calls that are on their way"""

    def take(self, item: Any) -> None:
        """Learn from one message or one piece of the session's news; what is not for the tablet is ignored."""
        handler = _HANDLERS.get(type(item))
        if handler is not None:
            handler(self, item)

    def sent(self, call: Message) -> None:
        """A call leaves: the window shows it as on its way."""
        self.pending.add(type(call).__name__)
        if isinstance(call, AnswerPrompt):
            self.prompts.answering(call)

    @property
    def only_looks(self) -> str:
        """Code of the reason why nothing may be commanded from here, whatever the robot does; empty where it may."""
        return "observer" if self.role == "observer" else "replaying" if self.replay.active else ""

    @property
    def others_command(self) -> str:
        """Code of the reason why nothing may be moved from here: somebody else has the command. Empty where it may."""
        return "others_command" if self.commander not in ("", self.name) else ""

    def why_not_take_command(self) -> str:
        """Code of the reason why the command can't be taken, or returned."""
        if self.only_looks:
            return self.only_looks
        if not self.link.attached or not self.name:
            return "no_robot"
        return "sending" if self.pending & {"TakeCommand", "ReturnCommand"} else ""

    def why_not_answer(self, option: str) -> str:
        """Code of the reason why an option of the current prompt can't be chosen; empty when it can."""
        prompt = self.prompts.current
        if self.only_looks or self.others_command:
            return self.only_looks or self.others_command
        if prompt is None or not self.link.attached or not self.link.engine:
            return "no_engine"
        if self.prompts.sent:
            return "sending"
        if prompt.plan and lets_go(option):
            if why := self.plans.why_not_execute(prompt.plan):
                return why
            if self.robot.status is not None and self.robot.status.stopped:
                return "stopped"
            if self.robot.status is not None and not self.robot.status.enabled:
                return "not_enabled"
        return ""

    def why_not_execute(self) -> str:
        """Code of the reason why the plan that is shown can't be executed; empty when it can."""
        plan = self.plans.shown
        if self.only_looks or self.others_command:
            return self.only_looks or self.others_command
        if not self.link.attached or not self.link.engine:
            return "no_engine"
        if plan is None:
            return "plan_missing"
        if why := self.plans.why_not_execute(plan.id):
            return why
        if self.prompts.current is not None and self.prompts.current.plan == plan.id:
            return "is_asked"
        if self.task.status == "running":
            return "program_runs"
        return self._why_not_move()

    def why_not_hand(self) -> str:
        """The same for sending a gripper somewhere."""
        return self._why_not_move() if self.link.attached else "no_robot"

    def why_not_jog(self) -> str:
        """The same for moving the robot by hand."""
        return "program_runs" if self.task.status == "running" else self.why_not_hand()

    def _why_not_move(self) -> str:
        status = self.robot.status
        if self.only_looks or self.others_command:
            return self.only_looks or self.others_command
        if status is None:
            return "no_robot"
        return "stopped" if status.stopped else "" if status.enabled else "not_enabled"

    def why_not_command(self, command: str) -> str:
        """The same for `enable`, `clear_stop`, and for all that may be done with the run (Task.why_not)."""
        if self.only_looks:
            return self.only_looks
        if not self.link.attached:
            return "no_robot"
        if self.others_command and command not in _EVERYBODYS:
            return self.others_command
        if command == "enable":
            return self.robot.why_not_enable()
        if command == "clear_stop":
            return self.robot.why_not_clear()
        return self.task.why_not(command) if self.link.engine else "no_engine"

    def note(self, level: Level, code: str, *details: str) -> None:
        self.journal.add(time.strftime("%H:%M:%S"), level, code, *details)

    # ----------------------------------------------------------------------------------------------------- connection

    def _link_news(self, item: Any) -> None:
        if not self.link.take(item, self._clock()):
            return
        if isinstance(item, arrivals.Unanswered | arrivals.EngineDetached):
            self.task.tree.detached()
            self.bench.detached()
            self.node_parameters.anew()
            self.bringing.anew()
        if isinstance(item, arrivals.Unanswered):
            self.pending.clear()
            self.service.anew()
            self.recordings.anew()
            self.replay.anew()
            self.note("error", "detached", item.why)
        elif isinstance(item, arrivals.EngineDetached):
            self.note("warning", "engine_detached", item.why)
        elif isinstance(item, arrivals.EngineAttached):
            self.note("info", "engine_attached")
        elif isinstance(item, arrivals.Attached):
            self.note("good", "attached", item.info.name)

    def _pinged(self, item: arrivals.Pinged) -> None:
        self.quality.take(item)
        if item.role and (item.name, item.role) != (self.name, self.role):
            self.name, self.role = item.name, item.role
            self.note("info", "role", item.name, item.role)
        if item.role:
            self._commands(item.commander)

    def _commands(self, commander: str) -> None:
        """Somebody has the command; empty: nobody."""
        if commander != self.commander:
            self.commander = commander
            self.note("info", "commander" if commander else "no_commander", commander)

    def _attached(self, item: arrivals.Attached) -> None:
        if self.robot.info is not None and self.robot.info.name != item.info.name:
            self.clouds.clear()
            self.quality.clear()
            self.replay.end()
        self.robot.attach(item.info, item.status)
        self.bench.arms = tuple(item.info.arms)
        self.bench.tools = tuple(item.info.tools.values())
        self.signals.describe(tuple(item.info.joints))
        self._link_news(item)

    def _engine_attached(self, item: arrivals.EngineAttached) -> None:
        snapshot = item.snapshot
        self.templates.anew()
        self.world.replace(snapshot.instances)
        asked = {prompt.plan for prompt in snapshot.prompts}
        self.plans.replace(snapshot.plans, waiting=None if snapshot.run is None else asked)
        self.task.take(snapshot.run)
        self.prompts.replace(snapshot.prompts)
        self._attend()
        self.launch.anew()
        self.deployments.anew()
        self.code.anew()
        self.wiring.known.anew()
        self._link_news(item)

    def _call_done(self, item: arrivals.CallDone) -> None:
        self.pending.discard(type(item.call).__name__)
        if isinstance(item.answer, messages.PlanPreview):
            self.plans.take(item.answer)
        elif isinstance(item.answer, messages.RunState):
            self.task.take(item.answer)
        elif isinstance(item.answer, messages.Outline | messages.RunHistory):
            self.task.tree.take(item.answer)
        elif isinstance(item.answer, messages.InstanceState):
            self.world.take(item.answer)
        elif isinstance(item.answer, messages.InstanceEdit):
            self._stepped(item.answer)
        elif isinstance(item.answer, messages.SavedTemplate):
            self.note("good", "template_saved", item.answer.name, item.answer.file)
            self.bench.saved = ("saved", item.answer.file)
        elif isinstance(item.answer, messages.ClientIdentity):
            self._commands(item.answer.commander)
        elif isinstance(item.answer, messages.TemplateSource):
            self.templates.take(item.answer)
        elif isinstance(item.answer, messages.Reach):
            self.bench.take(item.answer)
        elif isinstance(item.answer, messages.Library) and not item.call.engine:  # type: ignore[attr-defined]
            self.library = item.answer.entries
        elif isinstance(item.answer, messages.Nodes):
            for node in item.answer.nodes:
                self.output.hear_of(f"{FIRST}/{node.name}")
            self.code.running = item.answer.nodes
            self.signals.hear(item.answer.nodes)
        self.launch.take(item.call, item.answer)
        self.code.take(item.call, item.answer)
        self.wiring.known.take(item.call, item.answer)
        self.bringing.take(item.call, item.answer)
        self.node_parameters.take(item.call, item.answer)
        self.deployments.take(item.call, item.answer)
        self.service.take(item.call, item.answer)
        self.recordings.take(item.call, item.answer)
        self.replay.take(item.call, item.answer)
        self.bench.edits.answered(item.call)
        if isinstance(item.call, messages.PlanMotion):
            self.move.planned()

    def _stepped(self, edit: messages.InstanceEdit) -> None:
        if edit.instance is not None:
            self.world.take(edit.instance)
        for field, why in edit.left.items():
            self.note("info", "left", f"{edit.name}, {field}", why)
        for field, whose in edit.overwrote.items():
            self.note("info", "overwrote", f"{edit.name}, {field}", whose)

    def _call_failed(self, item: arrivals.CallFailed) -> None:
        name = type(item.call).__name__
        self.pending.discard(name)
        if isinstance(item.call, AnswerPrompt):
            self.prompts.failed(item.call, item.why)
        self.task.tree.failed(item.call, item.refused)
        self.launch.failed(item.call, item.why)
        self.code.failed(item.call, item.why)
        self.deployments.failed(item.call, item.why)
        self.service.failed(item.call, item.why)
        self.recordings.failed(item.call, item.why)
        self.replay.failed(item.call, item.why, self._clock())
        self.bench.edits.refused(item.call)
        if isinstance(item.call, messages.Jog):
            self.move.refused(item.why)
        if isinstance(item.call, messages.SaveTemplate):
            self.bench.saved = ("not_saved", item.why)
        if self.bringing.failed(item.call, item.why, refused=item.refused):
            return  # said where it was asked for
        if self.wiring.known.failed(item.call, item.why) or self.node_parameters.failed(item.call, item.why):
            return  # said where such a part is selected, and where the parameter is set
        if isinstance(item.call, messages.GetReach):
            self.bench.refused(item.why)
            return  # said beside the waypoints
        if isinstance(
            item.call, messages.GetProcesses | messages.GetProcessLog | messages.ListRecordings | messages.GetSamples
        ):
            return  # said on the page that asks
        self.note("warning" if item.refused else "error", "refused" if item.refused else "unanswered", name, item.why)

    def _stop_progress(self, item: arrivals.StopProgress) -> None:
        if item.state != self.robot.stop_state:
            level: Level = "error" if item.state == "failed" else "warning"
            self.note(level, f"stop_{item.state}", item.why)
        self.robot.take_stop(item)

    # --------------------------------------------------------------------------------------------------------- daemon

    def _robot_state(self, state: messages.RobotState) -> None:
        self.robot.state = state
        self.signals.take(state)

    def _daemon_status(self, status: messages.DaemonStatus) -> None:
        before, moved = self.robot.drives, self.robot.moving
        self.robot.take_status(status)
        after = self.robot.drives
        if before not in (after, "unknown"):
            level: Level = {"enabled": "good", "disabled": "info"}.get(after, "error")  # type: ignore[assignment]
            self.note(level, f"drives_{after}", status.stop_reason or ", ".join(self.robot.faulty))
        if self.robot.moving and not moved:
            self.plans.motion_began()

    def _action(self, event: messages.ActionEvent) -> None:
        moved = self.robot.moving
        self.robot.take_action(event)
        if self.robot.moving and not moved:
            self.plans.motion_began()
        if event.state == "ended" and event.outcome != "done":
            level: Level = "info" if event.outcome == "cancelled" else "warning"
            self.note(level, "action_ended", event.outcome, event.detail)

    def _cloud(self, cloud: messages.PointCloud) -> None:
        if problem := self.clouds.take(cloud):
            self.note("warning", "cloud_unreadable", cloud.camera, problem)

    # --------------------------------------------------------------------------------------------------------- engine

    def _run(self, run: messages.RunState) -> None:
        if "@" in run.run:
            return  # another engine's than the one that this window operates (docs/deployment.md)
        before = self.task.run
        self.task.take(run)
        if before is None or before.run != run.run or before.status != run.status:
            self.note(_RUN_LEVELS.get(run.status, "info"), f"run_{run.status}", run.program, run.detail)
        elif run.active and run.active != before.active:
            self.note("info", "state", run.active[-1])

    def _prompt(self, prompt: messages.Prompt) -> None:
        if prompt.id not in self.prompts:
            self.note("warning" if prompt.severity == "warning" else "info", "prompt", prompt.text)
        self.prompts.take(prompt)
        self._attend()

    def _prompt_closed(self, closed: messages.PromptClosed) -> None:
        if self.prompts.close(closed) is not None:
            self.note("info", "answered" if closed.answer else "withdrawn", closed.answer, closed.by)
        self._attend()

    def _plan(self, plan: messages.PlanPreview) -> None:
        before = self.plans.get(plan.id)
        self.plans.take(plan)
        if not plan.fresh and (before is None or before.fresh) and self.plans.shown is self.plans.get(plan.id):
            self.note("warning", "plan_stale", plan.label, plan.stale_because)

    def _instance(self, state: messages.InstanceState) -> None:
        self.world.take(state)

    def _devices(self, devices: messages.DeviceStates) -> None:
        self.hands.take(devices)

    def _reach(self, reach: messages.Reach) -> None:
        self.bench.take(reach)

    def _engine_info(self, info: messages.EngineInfo) -> None:
        self.deployments.info(info)

    def _code_changed(self, changed: messages.CodeChanged) -> None:
        self.deployments.changed(changed)
        self.code.anew()
        self.wiring.known.anew()
        if changed.engine == (self.launch.engine or next(iter(self.deployments.engines), changed.engine)):
            self.launch.anew()
        self.note("info", "code_changed", changed.engine, changed.release.program, changed.release.by)

    def _log(self, line: messages.LogLine) -> None:
        self.output.take(line)
        if line.level == "info" and line.source != FIRST:
            return  # what nodes print has a page of its own
        self.note(line.level, "log", line.text, line.source)

    def _attend(self) -> None:
        current = self.prompts.current
        self.plans.attend(current.plan if current else "")


_HANDLERS: dict[type, Callable[[Situation, Any], None]] = {
    arrivals.Attached: Situation._attached,
    arrivals.Unanswered: Situation._link_news,
    arrivals.EngineAttached: Situation._engine_attached,
    arrivals.EngineDetached: Situation._link_news,
    arrivals.Pinged: Situation._pinged,
    arrivals.CallDone: Situation._call_done,
    arrivals.CallFailed: Situation._call_failed,
    arrivals.StopProgress: Situation._stop_progress,
    messages.RobotState: Situation._robot_state,
    messages.DaemonStatus: Situation._daemon_status,
    messages.ActionEvent: Situation._action,
    messages.PointCloud: Situation._cloud,
    messages.RunState: Situation._run,
    messages.Prompt: Situation._prompt,
    messages.PromptClosed: Situation._prompt_closed,
    messages.PlanPreview: Situation._plan,
    messages.InstanceState: Situation._instance,
    messages.LogLine: Situation._log,
    messages.Reach: Situation._reach,
    messages.DeviceStates: Situation._devices,
    messages.EngineInfo: Situation._engine_info,
    messages.CodeChanged: Situation._code_changed,
    messages.PortValue: lambda situation, told: situation.signals.take_port(told),
}
