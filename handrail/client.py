"""`handrail.connect`: what tablets, the CLI and scripts call.

    import handrail
    from handrail.messages import Prompt, RunState

    with handrail.connect("tcp://127.0.0.1:47800") as robot:
        robot.enable()
        with robot.events(Prompt, RunState) as events:
            for event in events:
                ...

`handrail.cloud.unpack` makes arrays of a depth camera's PointCloud.

A call returns its typed answer. It raises `RefusedError` when the robot refused it (nothing has changed; the error names field,
value and expectation), and `Unreachable` when no answer came (the text says what to do, and whether it may have been carried out).
Calls may be made from any number of threads at once; none waits for another's answer, and a stop overtakes what is unsent.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec

from handrail.bundles.manifest import Bundle
from handrail.bundles.sending import Progress, Sender
from handrail.command_calls import CommandCalls
from handrail.instance_calls import InstanceCalls
from handrail.link import keys as link_keys
from handrail.link.events import Events, Live
from handrail.link.selections import Part, Selection
from handrail.link.session import Session
from handrail.messages import (
    AnswerPrompt,
    AwaitPlan,
    CancelPlanning,
    CheckTask,
    Choice,
    ClearStop,
    CommandGripper,
    DaemonStatus,
    Deploy,
    Deployment,
    Disable,
    EditPlan,
    Enable,
    EngineInfo,
    EngineSnapshot,
    ExecutePlan,
    GetEngine,
    GetEngines,
    GetOutline,
    GetPlan,
    GetReleases,
    GetRobot,
    GetRunHistory,
    GetStatus,
    Goal,
    Jog,
    Library,
    ListLibrary,
    MakePlan,
    OnFailure,
    Outline,
    PauseRun,
    PlanMotion,
    PlanPreview,
    PostureGoal,
    RankChoices,
    Release,
    Releases,
    ResumeRun,
    RobotInfo,
    RollBack,
    Run,
    RunFrom,
    RunHistory,
    RunState,
    SetAutonomy,
    SetBreakpoints,
    SetRunParameters,
    SetSpeed,
    StepRun,
    Stop,
    StopRun,
    SwitchRelay,
    TakeTransition,
    TaskCheck,
)
from handrail.node_calls import NodeCalls
from handrail.template_calls import TemplateCalls
from handrail.topics import RefusedError, Unreachable

__all__ = ["Client", "Events", "Live", "Part", "RefusedError", "Selection", "Unreachable", "connect"]

logger = logging.getLogger("handrail.client")

DEFAULT_ADDRESS = "tcp://127.0.0.1:47800"


def connect(
    address: str | None = None, keys: link_keys.ClientKeys | Path | str | None = None, *, timeout_s: float = 5.0
) -> Client:
    """Connect to the robot whose gate listens at `address` (tcp://HOST:PORT; None: $HANDRAIL_ADDRESS, else this machine's).

    tcp://HOST:PORT/ENGINE is one of its engines: as `Client.at(ENGINE)`.

    `keys`: a folder of keys, or None for this user's own (made on the first run; see `handrail.link.keys`). Waits `timeout_s` for
    the gate and raises Unreachable if it is not there; 0 does not wait, and the client connects as soon as the gate is up. Raises
    KeysError for keys that can't be used, ValueError for a malformed address.
    """
    own = keys if isinstance(keys, link_keys.ClientKeys) else link_keys.for_client(keys)
    address = address or os.environ.get("HANDRAIL_ADDRESS") or DEFAULT_ADDRESS
    scheme, _, place = address.partition("://")
    place, _, engine = place.partition("/")
    session = Session(f"{scheme}://{place}" if engine else address, own)
    if timeout_s > 0:
        try:
            session.wait_connected(timeout_s)
        except BaseException:  # Ctrl-C while it waits, too: nobody else could close the session's threads
            session.close()
            raise
    return Client(session, engine)


class Client(CommandCalls, InstanceCalls, NodeCalls, TemplateCalls):
    """One operator's connection to a robot. Made by `connect`; reconnects by itself; close it or use it as a context."""

    def __init__(self, session: Session, engine: str = ""):
        """`engine`: that calls are for which may go to several; empty: the first."""
        self._session, self._engine = session, engine

    @property
    def address(self) -> str:
        return self._session.address

    @property
    def traffic(self) -> tuple[int, int]:
        """Bytes sent and received by this client so far, as they cross the link."""
        return self._session.sent_bytes, self._session.received_bytes

    @property
    def traffic_by_kind(self) -> dict[str, int]:
        """Bytes received so far by type of event; answers to calls under the empty name."""
        return dict(self._session.received_by_kind)

    @property
    def connected(self) -> bool:
        """True while the gate is there and knows this client's key."""
        return self._session.connected

    def close(self) -> None:
        """Open calls end as Unreachable, event streams end."""
        self._session.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def call(self, message: msgspec.Struct, timeout_s: float | None = None) -> Any:
        """Any call of `handrail.messages` that may cross the link, by its struct; its answer."""
        if self._engine and not getattr(message, "engine", self._engine):
            message = msgspec.structs.replace(message, engine=self._engine)
        return self._session.call(message, timeout_s)

    def at(self, engine: str) -> Client:
        """The same connection, with programs run and deployed at another engine of the robot. Closed with this one."""
        return Client(self._session, engine)

    def engines(self) -> list[EngineInfo]:
        """The robot's engines, the first one first. `events(EngineInfo)` tells when one comes, goes, or does something else."""
        return self._session.call(GetEngines()).engines

    # ------------------------------------------------------------------------------------------------------------- robot

    def robot(self) -> RobotInfo:
        """Which robot this is: joints, limits (rad, rad/s, N·m), groups, tools, postures."""
        return self.call(GetRobot())

    def status(self) -> DaemonStatus:
        """What the daemon is doing now: drives, controllers, action, loop and bus statistics."""
        return self.call(GetStatus())

    def enable(self, timeout_s: float = 10.0) -> None:
        """Take every drive into operation and hold where it is; returns when the robot holds.

        Refused while the stop is latched. Raises TimeoutError, naming the drives, when some do not get there in time.
        """
        deadline = time.monotonic() + timeout_s
        with self.events(DaemonStatus) as statuses:
            self.call(Enable())
            status = self.status()
            while not status.enabled or status.isolated:
                left = deadline - time.monotonic()
                if left <= 0:
                    raise TimeoutError(f"the robot was not enabled in {timeout_s:g} s: {_late_drives(status)}")
                status = statuses.next(left) or status

    def disable(self) -> None:
        """Take every drive out of operation; brakes close."""
        self.call(Disable())

    def stop(self, reason: str = "") -> None:
        """Operator stop: every drive quick-stops; latches until `clear_stop`."""
        self.call(Stop(reason=reason[:200]))

    def clear_stop(self) -> None:
        """Unlatch the operator stop. Nothing moves: `enable` follows deliberately."""
        self.call(ClearStop())

    def set_speed(self, share: float, action: str = "") -> None:
        """Run every motion from now on, or one action, at `share` (0.1 to 1) of the planned speed: in mid-motion, too.

        `status().speed` says what it is; ActionEvents say at which speed an action runs.
        """
        self.call(SetSpeed(share=share, id=action))

    def command_gripper(self, gripper: str, position: float, velocity: float = 0.0, effort: float = 0.0) -> None:
        """Send a gripper to `position` (rad or m, of its driven joint), no faster and no harder than given; 0: its limit.

        Returns when the drive has been told: `events(DeviceStates)` tells when it is there, or holds something.
        """
        self.call(CommandGripper(gripper=gripper, position=position, velocity=velocity, effort=effort))

    def switch_relay(self, power: str, closed: bool, force: bool = False) -> None:
        """Open or close the relay of a power supply. Open, the drives have no power; `force`: even if the robot is enabled.

        Returns when the supply is being told: `events(DeviceStates)` tells when it has switched. `enable` follows deliberately.
        """
        self.call(SwitchRelay(power=power, closed=closed, force=force))

    # ------------------------------------------------------------------------------------------------------------- plans

    def plan(
        self, instance: str, trajectory: str, arm: str = "right", *, arc: float | None = None, after: str = "",
        seen: bool = False, relax: Sequence[str] = (), timeout_s: float | None = None,
    ) -> PlanPreview:  # fmt: skip
        """Plan a template's trajectory from where the robot is now, or from where a plan ends. Refused, with the reason, when
        infeasible.
        """
        call = MakePlan(
            instance=instance, trajectory=trajectory, arm=arm, arc=arc, after=after, seen=seen, relax=list(relax)
        )
        return self.call(call, timeout_s)

    def cancel_planning(self) -> None:
        """End all planning that calls are waiting for; `events(PlanProgress)` tells what is being done."""
        self.call(CancelPlanning())

    def rank_choices(
        self, instance: str, trajectory: str = "", arms: Sequence[str] = (), *, after: str = "",
        timeout_s: float | None = None,
    ) -> list[Choice]:  # fmt: skip
        """Which arm and place around the joint can do how much of a behaviour at an instance, the best first."""
        call = RankChoices(instance=instance, trajectory=trajectory, arms=list(arms), after=after)
        return self.call(call, timeout_s).choices

    def plan_motion(
        self, goals: Sequence[Goal], arm: str = "", *, timeout_s: float | None = None, **more: Any
    ) -> PlanPreview:
        """Plan a motion to goals; `more` are PlanMotion's other fields. Refused, with the reason, when infeasible."""
        return self.call(PlanMotion(goals=list(goals), arm=arm, **more), timeout_s)

    def edit_plan(
        self, plan: str, goals: Sequence[Goal], *, time: float = 0.0, frame: int = -1, timeout_s: float | None = None
    ) -> PlanPreview:
        """Plan a motion anew with a key frame more, `time` s into it, or with key frame `frame` changed; see EditPlan.

        A newer edit of the same plan, as a drag makes many, supersedes one that is still being planned, which is refused as such.
        """
        return self.call(EditPlan(id=plan, goals=list(goals), time=time, frame=frame), timeout_s)

    def undo_edit(self, plan: str) -> PlanPreview:
        """The plan that this one is an edit of, as fresh or stale as it is now. Refused when it is not kept any more.

        Raises ValueError for a plan that is no edit.
        """
        origin = self.get_plan(plan, details=True).origin
        before = origin.asked.get("edits") if origin is not None else None
        if not before:
            raise ValueError(f"plan: got {plan}, which is no edit; expected a plan that edit_plan made")
        return self.get_plan(str(before))

    def get_plan(self, plan: str, *, details: bool = False) -> PlanPreview:
        """A plan by its id, and whether it is still fresh; `details`: also what it was made from and keeps along its way."""
        return self.call(GetPlan(id=plan, details=details))

    def execute_plan(self, plan: str, segments: Sequence[str] = (), *, wait: bool = False) -> None:
        """Run a plan's segments (all, or those named). Refused when it is stale, with the reason.

        `wait`: until it has ended; refused then, with the reason, if it did not end as planned. `stop_run` ends it.
        """
        self.call(ExecutePlan(id=plan, segments=list(segments)))
        if wait:
            self.call(AwaitPlan(id=plan))

    def jog(self, joints: Mapping[str, float], *, by: bool = False, speed: float = 0.1) -> dict[str, float]:
        """Send joints somewhere (`by`: by so much), rad or m, without a plan; returns where they are once they are there.

        `speed`: share of their velocity limits, on top of the robot's (`set_speed`). Refused with what stopped them: the guard, a
        stop, somebody else's lease, a newer jog of the same joints, which takes over on the way. `stop_run` ends it.
        """
        return self.call(Jog(joints=dict(joints), by=by, speed=speed)).joints

    def home(self, posture: str = "ready", arm: str = "") -> PlanPreview:
        """Bring an arm, or without one all of the robot, to a posture: planned clear of everything, executed, and waited for.

        Returns the plan. Refused, with the reason, where there is no plan, or it did not end as planned.
        """
        joints = [] if arm else self.robot().joints
        plan = self.plan_motion([PostureGoal(name=posture)], arm, joints=joints)
        self.execute_plan(plan.id, wait=True)
        return plan

    # ---------------------------------------------------------------------------------------------------------- programs

    def library(self) -> Library:
        """Programs and templates that are there, and what is wrong with those that can't be used."""
        return self.call(ListLibrary())

    def deploy(
        self, program: str, bindings: Mapping[str, str] | None = None, parameters: Mapping[str, Any] | None = None
    ) -> Deployment:
        """Check a program whole and bind its resources, e.g. {"arm": "right", "valve": "wheel_1"}."""
        return self.call(Deploy(program=program, bindings=dict(bindings or {}), parameters=dict(parameters or {})))

    def send_bundle(
        self, bundle: Bundle, *, engine: str = "", note: str = "", progress: Progress | None = None,
        cache: Path | None = None,
    ) -> Release:  # fmt: skip
        """Bring a program with all that it needs to an engine (`engines.releases.closure.bundle_of` makes bundles).

        For developers' keys only. Only pieces that the engine lacks travel. Called again after the link broke, it goes on where it
        was. Refused, with nothing changed, where the robot can't run it. `progress(sent, known)` counts pieces; `cache`: where to
        remember what was sent.
        """
        sender = Sender(self.call, self._session.server, cache)
        return sender.send(bundle, engine=engine or self._engine, note=note, progress=progress)

    def releases(self, engine: str = "") -> Releases:
        """What code an engine has, since when and by whom, and what it can be rolled back to."""
        return self.call(GetReleases(engine=engine))

    def roll_back(self, number: int = 0, *, engine: str = "", note: str = "") -> Release:
        """Bring back an engine's code of an earlier release (0: the one before); developers' keys only."""
        return self.call(RollBack(number=number, engine=engine, note=note)).release

    def check_task(self, deployment: Deployment | str, *, timeout_s: float | None = None) -> TaskCheck:
        """Rehearse what was deployed, without moving: every motion verified before the first one."""
        id = deployment if isinstance(deployment, str) else deployment.id
        return self.call(CheckTask(deployment=id), timeout_s)

    def run(self, deployment: Deployment | str, *, on_failure: OnFailure = "end") -> RunState:
        """Start what was deployed.

        :param on_failure: where a state fails at what it does, and the program has no way on from there but its end: `end`, or
            `pause` until somebody resumes (it is tried again), skips it, or lets it fail (`let_fail`)
        """
        return self.call(
            Run(deployment=deployment if isinstance(deployment, str) else deployment.id, on_failure=on_failure)
        )

    def pause_run(self) -> None:
        """Pause the running program: the motion really stops."""
        self.call(PauseRun())

    def resume_run(self) -> None:
        """Go on. Refused, once, where a pre-condition of what its states do is not met, as after the robot was moved by hand: it
        stays paused and says which, and what can be done; resumed once more, the program goes its own way for what can't go on.
        """
        self.call(ResumeRun())

    def stop_run(self) -> None:
        """End the running program: its motion is cancelled, the robot holds."""
        self.call(StopRun())

    def step_run(self) -> None:
        """Let a paused program go on until its next activity is about to begin."""
        self.call(StepRun())

    def set_breakpoints(self, states: Sequence[str]) -> None:
        """Pause before these states do what they do, in this run and the next ones; replaces those that there were."""
        self.call(SetBreakpoints(states=list(states)))

    def skip(self, state: str) -> RunState:
        """Leave an active state as though it were done; what it does is cancelled."""
        return self.call(TakeTransition(state=state))

    def take_transition(self, state: str, way: int) -> RunState:
        """Leave an active state by its `way`-th transition (as in the file, from 0), whatever the guard says."""
        return self.call(TakeTransition(state=state, way=way))

    def let_fail(self, state: str) -> RunState:
        """Let the program go on from a failure that its run has paused for (`RunState.failing`), as it says."""
        return self.call(TakeTransition(state=state, way="failed"))

    def run_from(self, state: str, *, paused: bool = False, deployment: Deployment | str = "") -> RunState:
        """Run the last program anew from a state, with its variables as they stand; one under way is stopped before.

        :param deployment: of the program as it was edited meanwhile, to go on in
        """
        id = deployment if isinstance(deployment, str) else deployment.id
        return self.call(RunFrom(state=state, paused=paused, deployment=id))

    def set_run_parameters(self, parameters: Mapping[str, Any]) -> None:
        """Change the running program's parameters: each counts from when it is used next."""
        self.call(SetRunParameters(parameters=dict(parameters)))

    def set_autonomy(self, level: Literal["off", "low", "high", "full"]) -> None:
        """How much programs do without asking: transitions that name this level or one above it are asked about first."""
        self.call(SetAutonomy(level=level))

    def run_history(self) -> RunHistory:
        """The states that the last run went through, with their times and what ended them."""
        return self.call(GetRunHistory())

    def outline(self, deployment: Deployment | str = "") -> Outline:
        """The states of what was deployed, or of what ran last, as a tree."""
        return self.call(GetOutline(deployment=deployment if isinstance(deployment, str) else deployment.id))

    def answer(self, prompt: str, answer: str, by: str = "operator") -> None:
        """Answer a prompt by its id. Refused when it was already answered."""
        self.call(AnswerPrompt(id=prompt, answer=answer, by=by))

    def snapshot(self) -> EngineSnapshot:
        """Everything that a late client needs: instances, plans, the run, open prompts."""
        return self.call(GetEngine())

    # ------------------------------------------------------------------------------------------------------------ events

    def events(self, *kinds: type, timeout_s: float = 5.0) -> Events:
        """A stream of the given types of events: RobotState, DaemonStatus, RunState, Prompt ..., and `Live` among them, if wanted.

        Returns when the robot's side has confirmed the stream, so that nothing that happens afterwards is missed, or after
        `timeout_s` (0: at once) without: then it begins, with `Live`, as soon as the gate is there.
        """
        events = self._session.listen(kinds)
        if timeout_s > 0:
            events.wait_live(timeout_s)
        return events

    def subscribe(
        self,
        *chosen: Selection | type,
        rate: float = 0.0,
        fields: Sequence[str] = (),
        where: Mapping[str, str | Sequence[str]] | None = None,
        timeout_s: float = 5.0,
    ) -> Events:
        """A stream of some events: which, which of their fields, and at most how often; the gate sends no others.

        `rate` Hz, `fields` and `where` (field → a pattern or several, `*` stands for anything) count for the types that are given
        without a Selection of their own: `subscribe(RobotState, rate=2, fields=["time_ns", "position"])`,
        `subscribe(LogLine, where={"level": ["warning", "error"]})`. With `fields`, a `Part` with these values comes. Of events that
        come more often than chosen the newest goes. Raises ValueError for a type or field that there is not.
        """
        patterns = {name: (one,) if isinstance(one, str) else tuple(one) for name, one in (where or {}).items()}
        events = self._session.select(
            [each if isinstance(each, Selection) else Selection(each, rate, tuple(fields), patterns) for each in chosen]
        )
        if timeout_s > 0:
            events.wait_live(timeout_s)
        return events

    def on(self, kinds: type | tuple[type, ...], react: Callable[[Any], None], *, timeout_s: float = 5.0) -> Events:
        """Call `react(event)` for each event until the stream is closed, in a thread of its own (so it may make calls).

        What it raises is logged, and the stream goes on.
        """
        events = self.events(*(kinds if isinstance(kinds, tuple) else (kinds,)), timeout_s=timeout_s)
        threading.Thread(target=_react, args=(events, react), name="handrail-events", daemon=True).start()
        return events


def _late_drives(status: DaemonStatus) -> str:
    """Which drives are not in operation, those with the same trouble together."""
    late: dict[str, list[str]] = {}
    for drive in status.drives:
        if drive.state != "operation_enabled":
            late.setdefault(drive.problem or drive.state, []).append(drive.joint)
    words = [
        f"{', '.join(joints) if len(joints) <= 7 else f'{len(joints)} drives'}: {trouble}"
        for trouble, joints in late.items()
    ]
    return "; ".join(words) or "no answer"


def _react(events: Events, react: Callable[[Any], None]) -> None:
    for event in events:
        try:
            react(event)
        except Exception:  # whatever the caller's function raises: it is logged, and the next event may go well
            logger.exception("a reaction to %s failed; the stream goes on", type(event).__name__)
