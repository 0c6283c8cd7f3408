"""The engine process: template instances, plans, programs and prompts of one robot, answered from one thread.

python -m engines.engine --robot talos_upper --runtime DIR
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import logging
import queue
import signal
import socket
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zmq

from affordance_templates.server import AffordanceServer
from engines import identifiers
from engines.activities.base import ActivityFailed, Planner, Services
from engines.daemon_client import DaemonClient
from engines.instance_desk import InstanceDesk
from engines.learning.book import RunBook, location
from engines.learning.learner import Learner
from engines.link_poses import LinkPoses
from engines.nodes.desk import answers as node_answers
from engines.nodes.keeper import NodeKeeper
from engines.plans.desk import PlanningDesk, Task
from engines.plans.making import make_edit, make_motion, make_plan, rank_choices
from engines.plans.sight import Sight
from engines.plans.store import PlanStore
from engines.programs import deployment, library
from engines.programs.deployment import Deployed
from engines.programs.outline import outline
from engines.programs.program import Program
from engines.programs.rehearsal import Rehearsal
from engines.reach.desk import ReachDesk
from engines.releases import node_saving, saving
from engines.releases.check import check as check_release
from engines.releases.store import ReleaseStore
from engines.runs.edit import Waiting
from engines.runs.job import Job
from engines.runs.jog import JogExecution
from engines.runs.journal import Entry, RunJournal
from engines.runs.plan_execution import PlanExecution
from engines.runs.prompts import Prompts
from engines.runs.run import LINK_CUT, ProgramRun, Start
from engines.runs.spoken import Spoken
from engines.service import DeferringService, Wake
from engines.shared_instances import SharedInstances
from engines.template_runs import TemplateRuns
from engines.tip_poses import TipPose, tip_poses
from handrail import engines as engine_names
from handrail import messages as m
from handrail import workspace
from handrail.config import ConfigError
from handrail.engines import FIRST
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime
from handrail.sole_holder import HeldElsewhere, sole_holder
from handrail.topics import Publisher, RefusedError, refuse

_DEPLOYMENTS_KEPT = 20
_STOP_S = 10.0
"""wall time within which a run that is stopped for another one must have ended"""


class Engine:
    """Serves `engine.call` and publishes `engine.events`. Made, driven and closed by one thread."""

    def __init__(
        self,
        runtime: Runtime,
        description: RobotDescription,
        planner: Planner,
        tip_pose: TipPose,
        *,
        name: str = FIRST,
        code: Path | None = None,
        away: bool = False,
    ):
        """`name`: what it is called; all but the first share the instances of that one. `code`: where deployed code is kept;
        None: in the runtime folder, as long as that is there. `away`: beyond a link, which may be cut: then runs pause.
        Raises HeldElsewhere where an engine of that name runs.
        """
        self._name, first = name, name == FIRST
        self._held = ExitStack()
        self._held.enter_context(sole_holder(Path(engine_names.lock(runtime, name))))
        identifiers.belong_to(name)
        self._wake = Wake()
        self._outbox: queue.SimpleQueue[msgspec.Struct] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._desk = PlanningDesk(self._tell, lambda text: self._log("info", text, "planning"))
        self._spoken = Spoken()
        self._deployments: dict[str, Deployed] = {}
        self._releases = ReleaseStore(
            code or runtime.folder / f"{name}.code",
            lambda folder, programs: check_release(folder, programs, description),
            pinned=lambda: [each.folder for each in self._deployments.values() if each.folder is not None],
        )
        workspace.use(self._releases.folder)
        self._breakpoints: frozenset[str] = frozenset()
        self._autonomy = "full"
        self._journal = RunJournal(runtime.folder, "" if first else f"{name}.")
        self._changing_runs = threading.Lock()
        """held from the moment that a run is asked to go on from another state until the new one has begun"""
        self._called_off = threading.Event()
        """somebody has stopped what is being changed"""
        self._settings = threading.Lock()
        """for breakpoints and autonomy, which a run that is just being made must not miss"""
        self._seeds: dict[str, Mapping[str, Sequence[np.ndarray]]] = {}
        """deployment → state → where its plans ended in the last rehearsal"""
        self._job: Job | None = None
        self._by_hand: JogExecution | PlanExecution | None = None
        """what is, or was, moved in a pause of a run"""
        self._run: ProgramRun | None = None
        self._told_run = ("", "")
        self._publisher = Publisher(runtime.endpoint(f"{name}.events"))
        daemon = DaemonClient(runtime, len(description.joints), owner=name, log=lambda text: self._log("warning", text))
        affordances = (
            AffordanceServer(runtime.folder / "instances.json", changed=self._instance_changed)
            if first
            else SharedInstances(runtime, changed=self._instance_told, log=self._log)
        )
        self._instances = InstanceDesk(self._tell)
        self._reach = ReachDesk(description, affordances, daemon, self._tell)
        plans = PlanStore(affordances.instances, daemon.world, self._tell)
        self._sight = Sight(runtime)
        daemon.rested = plans.robot_rested
        self._services = Services(
            description=description,
            daemon=daemon,
            affordances=affordances,
            plans=plans,
            prompts=Prompts(self._tell, runtime.folder / f"{name}.prompts.json"),
            planner=planner,
            tip_pose=tip_pose,
            log=self._log,
            clouds=self._sight.clouds,
            nodes=NodeKeeper(self._tell, self._log),
            outlasts=LINK_CUT if away else frozenset(),
        )
        self._templates = TemplateRuns(self._services, runtime.folder / f"{name}.templates")
        book = location()
        self._learner = Learner(description.name, RunBook(book) if book else None, affordances.instances)
        for problem in (*affordances.problems, *self._releases.problems):
            self._log("error", problem)
        self._answers: dict[type, Callable[[Any], Any]] = {
            **self._instances.open(affordances, LinkPoses(description, daemon.measured)),
            m.GetPlan: self._get_plan,
            m.MakePlan: self._make_plan,
            m.CancelPlanning: lambda call: self._desk.cancel(),
            m.RankChoices: self._rank_choices,
            m.PlanMotion: self._plan_motion,
            m.EditPlan: self._edit_plan,
            m.ExecutePlan: self._execute_plan,
            m.AwaitPlan: self._await_plan,
            m.Jog: self._jog,
            m.GetReach: self._reach.ask,
            m.ListLibrary: lambda call: _in_thread(library.listing, "library"),
            m.Deploy: self._deploy,
            m.CheckTask: self._check_task,
            m.Run: self._start,
            m.ExpandTemplate: self._templates.program,
            m.RunTemplate: self._run_template,
            m.PauseRun: lambda call: self._running().pause(),
            m.ResumeRun: lambda call: self._resume(),
            m.StopRun: lambda call: self._stop_run(),
            m.StepRun: lambda call: self._step(),
            m.SetBreakpoints: self._set_breakpoints,
            m.TakeTransition: self._take_transition,
            m.RunFrom: self._run_from,
            m.SetRunParameters: lambda call: self._program_run().set_parameters(call.parameters),
            m.SetAutonomy: self._set_autonomy,
            m.GetRunHistory: self._history,
            m.GetOutline: self._outline,
            m.AnswerPrompt: self._services.prompts.answer,
            m.GetEngine: lambda call: self._snapshot(),
            **node_answers(self._services.nodes, _in_thread),
            m.PutBundle: lambda call: _in_thread(functools.partial(self._put_bundle, call), "bundle"),
            m.GetProgram: lambda call: _in_thread(functools.partial(saving.source, call), "program"),
            m.SaveProgram: lambda call: _in_thread(functools.partial(self._save_program, call), "save"),
            m.ListNodes: lambda call: node_saving.listing(),
            m.GetNodeSource: node_saving.source,
            m.SaveNode: lambda call: _in_thread(functools.partial(self._save_node, call), "save"),
            m.GetReleases: lambda call: self._releases.listing(self._name),
            m.GetEngines: lambda call: m.Engines(engines=[self._info()]),
            m.RollBack: lambda call: _in_thread(functools.partial(self._roll_back, call), "roll back"),
        }
        self._service = DeferringService(runtime.endpoint(f"{name}.call"), m.EngineCall, self._answer, self._wake)
        self._recover()
        self._tell(self._info())

    # ------------------------------------------------------------------------------------------------------------- the loop

    def serve(self) -> None:
        """Answer calls and publish events until `stop`."""
        poller = zmq.Poller()
        poller.register(self._service.socket, zmq.POLLIN)
        poller.register(self._wake.fileno(), zmq.POLLIN)
        while not self._closing.is_set():
            poller.poll()
            self._wake.clear()
            self._service.poll()
            self._publish()

    @property
    def wake_fd(self) -> int:
        """Non-blocking file descriptor; a byte written to it wakes `serve`."""
        return self._wake.write_fd

    def stop(self) -> None:
        """End `serve`, from any thread or a signal handler."""
        self._closing.set()
        self._wake.set()

    def close(self) -> None:
        """Cancel what moves and what is planned, publish what is left, and free everything."""
        self._desk.cancel()
        self._called_off.set()
        for job in (self._by_hand, self._job):
            if job is not None and job.active:
                try:
                    job.stop()
                except RefusedError as refused:
                    self._log("warning", str(refused))
                job.join(0.5)
        self._instances.close()
        self._publish()
        self._services.nodes.close()
        self._reach.close()
        self._services.daemon.close()
        if isinstance(self._services.affordances, SharedInstances):
            self._services.affordances.close()
        self._sight.close()
        self._service.close()
        self._publisher.close()
        self._wake.close()
        workspace.use(None)
        identifiers.belong_to(FIRST)
        self._held.close()

    def _answer(self, call: Any) -> Any:
        try:
            return self._answers[type(call)](call)
        except RefusedError:
            raise
        except Exception as crash:
            # One call that finds a defect must not end the engine, and with it a program that moves the robot.
            logging.exception("%s crashed", type(call).__name__)
            raise refuse(f"the engine could not carry it out: {type(crash).__name__}: {crash}") from crash

    def _publish(self) -> None:
        while not self._outbox.empty():
            self._publisher.send(self._outbox.get())

    def _tell(self, event: msgspec.Struct) -> None:
        """Publish an event, from any thread."""
        self._outbox.put(event)
        self._wake.set()

    def _log(self, level: Any, text: str, node: str = "") -> None:
        """A line for people, of the engine itself, or of one of its nodes, of a program, of its planning."""
        shown = f"{node}: {text}" if node else text
        logging.log({"info": logging.INFO, "warning": logging.WARNING}.get(level, logging.ERROR), shown)
        source = f"{self._name}/{node}" if node else self._name
        self._tell(m.LogLine(source=source, level=level, text=text))

    def _info(self) -> m.EngineInfo:
        run = self._run.state if self._run is not None else None
        return m.EngineInfo(
            name=self._name,
            host=socket.gethostname(),
            release=self._releases.number,
            program=run.program if run else "",
            status=run.status if run else "",
            hash=run.hash if run else "",
        )

    def _instance_changed(self, state: m.InstanceState) -> None:
        self._instances.told(state)
        self._instance_told(state)

    def _instance_told(self, state: m.InstanceState) -> None:
        self._services.plans.instance_changed(state.name)
        self._reach.instance_changed()

    # ------------------------------------------------------------------------------------------------------------- the calls

    def _get_plan(self, call: m.GetPlan) -> m.PlanPreview | Future[m.PlanPreview]:
        plans = self._services.plans
        record = plans.get(call.id)
        if not call.details:
            return plans.preview(record)

        def details() -> m.PlanPreview:
            preview = plans.details(record)
            rows, position = self._services.description.index(record.plan.joints), record.origin.world.command.copy()
            tool = []
            for segment in preview.segments if record.plan.arm else ():
                for knot in segment.positions:
                    position[rows] = knot
                    tool.append(np.round(self._services.tip(position, record.plan.arm), 4).tolist())
            return msgspec.structs.replace(preview, tool=tool)

        return _in_thread(details, "plan's details")

    def _make_plan(self, call: m.MakePlan) -> Future[m.PlanPreview]:
        def plan(task: Task) -> m.PlanPreview:
            return make_plan(
                self._services, call.instance, call.trajectory, call.arm, arc=call.arc, after=call.after, seen=call.seen,
                relax=call.relax, cancelled=task.cancelled.is_set, progress=task.progress,
            )[1]  # fmt: skip

        self._services.affordances.get(call.instance)
        return self._desk.work(f"{call.trajectory} at {call.instance}", plan)

    def _rank_choices(self, call: m.RankChoices) -> Future[m.Choices]:
        def rank(task: Task) -> m.Choices:
            return rank_choices(self._services, call, cancelled=task.cancelled.is_set)

        return self._desk.work(f"choices at {call.instance}", rank)

    def _plan_motion(self, call: m.PlanMotion) -> Future[m.PlanPreview]:
        def plan(task: Task) -> m.PlanPreview:
            return make_motion(self._services, call, cancelled=task.cancelled.is_set, progress=task.progress)[1]

        return self._desk.work(call.label or "motion", plan)

    def _edit_plan(self, call: m.EditPlan) -> Future[m.PlanPreview]:
        def plan(task: Task) -> m.PlanPreview:
            return make_edit(self._services, call, cancelled=task.cancelled.is_set, progress=task.progress)[1]

        return self._desk.work(f"edit of {call.id}", plan, supersedes=call.id)

    def _execute_plan(self, call: m.ExecutePlan) -> None:
        lender = self._lender()
        record = self._services.plans.get(call.id)
        try:
            self._moves(PlanExecution(self._services, record, call.segments, lender), lender)
        except ActivityFailed as failed:
            raise refuse(str(failed)) from failed

    def _put_bundle(self, call: m.PutBundle) -> m.BundleState:
        def put() -> m.BundleState:
            self._releases.take(call.pieces)
            return self._releases.put(call)

        return self._brought(put)

    def _save_program(self, call: m.SaveProgram) -> m.BundleState:
        return self._brought(lambda: saving.save(call, self._releases))

    def _save_node(self, call: m.SaveNode) -> m.BundleState:
        return self._brought(lambda: node_saving.save(call, self._releases))

    def _brought(self, bring: Callable[[], m.BundleState]) -> m.BundleState:
        before = self._releases.folder
        state = bring()
        if state.release is not None and self._releases.folder != before:
            self._code_changed(state.release)
        return state

    def _roll_back(self, call: m.RollBack) -> m.RolledBack:
        release = self._releases.roll_back(call)
        self._code_changed(release)
        return m.RolledBack(release=release)

    def _code_changed(self, release: m.Release) -> None:
        workspace.use(self._releases.folder)
        self._log("info", f"release {release.number}: {release.program}, deployed by {release.by}")
        self._tell(m.CodeChanged(engine=self._name, release=release))
        self._edit_run()
        self._tell(self._info())

    def _await_plan(self, call: m.AwaitPlan) -> m.PlanPreview | Future[m.PlanPreview]:
        for job in (self._by_hand, self._job):
            if isinstance(job, PlanExecution) and job.plan == call.id:
                return job.ended
        plans = self._services.plans
        record = plans.get(call.id)
        if not record.finished:
            raise refuse("the plan is not being executed", "id", call.id, "one that ExecutePlan has begun")
        return plans.preview(record, ghost=False)

    def _jog(self, call: m.Jog) -> Future[m.Jogged]:
        answer: Future[m.Jogged] = Future()
        for job in (self._by_hand, self._job):
            if isinstance(job, JogExecution) and job.turned_to(call, answer):
                return answer
        lender = self._lender()
        self._moves(JogExecution(self._services, call, answer, lender), lender)
        return answer

    def _moves(self, job: JogExecution | PlanExecution, lender: ProgramRun | None) -> None:
        if lender is None:
            self._job = job
        else:
            self._by_hand = job

    def _lender(self) -> ProgramRun | None:
        """The paused run beside which the robot may be moved by hand; None where nothing runs. Refused where something does."""
        run = self._run
        if run is None or self._job is not run or run.state.status != "paused":
            self._idle()
            return None
        self._not_by_hand()
        if self._changing_runs.locked():
            raise refuse("the engine is busy: a run is just being started")
        return run

    def _not_by_hand(self) -> None:
        if self._by_hand is not None and self._by_hand.active:
            raise refuse("the robot is being moved by hand: wait until it stands, or stop it")

    def _resume(self) -> None:
        job = self._running()
        if job is self._by_hand and not job.paused:
            self._not_by_hand()
        job.resume()

    def _step(self) -> None:
        self._not_by_hand()
        self._program_run().step()

    def _deploy(self, call: m.Deploy) -> m.Deployment:
        with workspace.pinned(workspace.deployed()):  # all of it from one release
            if call.program not in (known := library.files()):
                raise refuse("no such program", "program", call.program, f"one of {', '.join(sorted(known))}")
            try:
                program = library.named(call.program)
            except ConfigError as problem:
                raise refuse("the program can't be deployed", "program", call.program, str(problem)) from problem
            deployed = deployment.deploy(call, program, self._services.description, self._services.affordances)
        self._keep(deployed)
        bound = ", ".join(f"{role} is {what}" for role, what in deployed.bindings.items())
        self._log(
            "info",
            f"deployed as {deployed.id}, content {program.hash[:10]}" + (f": {bound}" if bound else ""),
            program.name,
        )
        self._edited(deployed, call.parameters)
        warnings = self._learner.before(deployed)
        return m.Deployment(id=deployed.id, program=program.name, hash=program.hash, warnings=warnings)

    def _edited(self, deployed: Deployed, parameters: Mapping[str, Any]) -> None:
        """Where it is another version of what runs, with the same bound: the run goes on in that, when it can."""
        run = self._run
        if run is None or not run.active or not deployed.newer_than(run.deployed):
            return
        run.edit(self._waiting(deployed, parameters))

    def _waiting(self, deployed: Deployed, parameters: Mapping[str, Any]) -> Waiting:
        def go_on_from(state: str) -> None:
            try:
                self._run_from(m.RunFrom(state=state, deployment=deployed.id)).result()
            except RefusedError as refused:
                self._log("error", f"{deployed.program.name}: {refused}")

        return Waiting(deployed, parameters, go_on_from)

    def _edit_run(self) -> None:
        """Code has changed: what runs may be another version now."""
        run = self._run
        if run is None or not run.active:
            return
        name, bindings = run.deployed.program.name, dict(run.deployed.bindings)
        try:
            with workspace.pinned(workspace.deployed()):
                program = library.named(name)
                if program.same_as(run.deployed.program):
                    return
                call = m.Deploy(program=name, bindings=bindings)
                newer = deployment.deploy(call, program, self._services.description, self._services.affordances)
        except (ConfigError, RefusedError) as problem:
            self._log("warning", f"{name} goes on in the version that runs: {problem}")
            return
        self._keep(newer)
        self._edited(newer, {})

    def _keep(self, deployed: Deployed) -> None:
        self._deployments[deployed.id] = deployed
        while len(self._deployments) > _DEPLOYMENTS_KEPT:
            gone = next(iter(self._deployments))
            del self._deployments[gone]
            self._seeds.pop(gone, None)

    def _deployed(self, id: str) -> Deployed:
        """Refused where it is not there, or its instances are gone."""
        deployed = self._deployments.get(id)
        if deployed is None:
            known = ", ".join(self._deployments) or "none: deploy a program first"
            raise refuse("no such deployment", "deployment", id, f"one of: {known}")
        deployment.still_bound(deployed, self._services.description, self._services.affordances)
        return deployed

    def _check_task(self, call: m.CheckTask) -> Future[m.TaskCheck]:
        deployed, world = self._deployed(call.deployment), self._services.daemon.world()
        if world is None:
            raise refuse("the daemon has not told where the robot is: is it running?")
        instances = self._services.affordances.instances()

        def check(task: Task) -> m.TaskCheck:
            rehearsed = Rehearsal(deployed, self._services, world, instances, task.cancelled).run()
            self._seeds[deployed.id] = rehearsed.ends
            return rehearsed.check

        return self._desk.work(f"check of {deployed.program.name}", check)

    def _start(self, call: m.Run) -> m.RunState:
        self._idle()
        return self._begin(self._deployed(call.deployment), on_failure=call.on_failure)

    def _run_template(self, call: m.RunTemplate) -> m.RunState:
        self._idle()
        deployed = self._templates.deploy(call)
        self._keep(deployed)
        return self._begin(deployed, on_failure=call.on_failure)

    def _begin(self, deployed: Deployed, start: Start | None = None, *, on_failure: m.OnFailure = "end") -> m.RunState:
        deployment.still_bound(deployed, self._services.description, self._services.affordances)
        doing = {state.id for state in deployed.program.states() if state.file.do}
        with self._settings:
            run = ProgramRun(
                deployed,
                self._services,
                self._run_changed,
                self._keep_run,
                breakpoints=self._breakpoints & doing,
                autonomy=self._autonomy,
                on_failure=on_failure,
                start=start,
                seeds=self._seeds.get(deployed.id),
                watch=self._learner.watch(deployed),
            )
            self._job = self._run = run
            return run.start()

    def _keep_run(self, deployed: Deployed, state: m.RunState, edit: Waiting | None) -> None:
        self._journal.write(deployed, state, edit)

    def _run_changed(self, deployed: Deployed, state: m.RunState) -> None:
        self._templates.told(deployed, state)
        self._tell(state)
        for line in self._spoken.lines(state):
            self._log("info", line, state.program)
        if (state.status, state.hash) != self._told_run:
            self._told_run = state.status, state.hash
            self._tell(self._info())
        if state.status in ("succeeded", "failed", "stopped"):
            _in_thread(lambda: self._services.nodes.end_run(state.run), "end of nodes")

    def _run_from(self, call: m.RunFrom) -> Future[m.RunState]:
        run = self._run
        if run is None:
            raise refuse("no program has run yet: start one first", "state", call.state, "a state of the last program")
        if self._job is not run or self._changing_runs.locked():
            self._idle()
        self._not_by_hand()
        deployed = self._deployed(call.deployment) if call.deployment else run.deployed
        if deployed.program.name != run.deployed.program.name:
            wanted = f"a deployment of {run.deployed.program.name}, which has run"
            raise refuse("it is of another program", "deployment", call.deployment, wanted)
        known = [state.id for state in deployed.program.states() if not state.file.final]
        if call.state not in known:
            raise refuse("no such state", "state", call.state, f"one of: {', '.join(known)}")
        # What can't begin must not end what runs.
        deployment.still_bound(deployed, self._services.description, self._services.affordances)
        start = run.again_from(call.state, paused=call.paused, within=deployed)
        # Taken here and not in the thread: from now on nothing else may begin.
        self._changing_runs.acquire()
        self._called_off.clear()

        def begin() -> m.RunState:
            try:
                if run.active:
                    with contextlib.suppress(RefusedError):  # it has just ended
                        run.stop()
                    run.join(_STOP_S)
                if run.active:
                    raise refuse(f"the run under way has not ended within {_STOP_S:g} s")
                if self._called_off.is_set():
                    raise refuse("it was stopped before it began")
                state = self._begin(deployed, start, on_failure=run.state.on_failure)
            finally:
                self._changing_runs.release()
            if self._called_off.is_set() and self._run is not None:
                with contextlib.suppress(RefusedError):
                    self._run.stop()
            return state

        return _in_thread(begin, "run from")

    def _stop_run(self) -> None:
        if self._changing_runs.locked():
            self._called_off.set()
            if self._changing_runs.locked():
                return  # what runs is being stopped already, and nothing begins after it
        self._running().stop()

    def _take_transition(self, call: m.TakeTransition) -> m.RunState:
        run = self._program_run()
        return run.let_fail(call.state) if call.way == "failed" else run.take(call.state, call.way)

    def _set_breakpoints(self, call: m.SetBreakpoints) -> None:
        with self._settings:
            if self._run is not None and self._run.active:
                self._run.set_breakpoints(call.states)
            self._breakpoints = frozenset(call.states)

    def _set_autonomy(self, call: m.SetAutonomy) -> None:
        with self._settings:
            self._autonomy = call.level
            if self._run is not None and self._run.active:
                self._run.set_autonomy(call.level)

    def _history(self, call: m.GetRunHistory) -> m.RunHistory:
        if self._run is None:
            raise refuse("no program has run yet")
        return m.RunHistory(run=self._run.state.run, visits=self._run.visits)

    def _outline(self, call: m.GetOutline) -> m.Outline:
        if call.deployment:
            return outline(self._deployed(call.deployment))
        if self._run is None:
            raise refuse("no program has run yet")
        return outline(self._run.deployed)

    def _recover(self) -> None:
        """Take up, paused, the run that was under way when the engine was killed."""
        try:
            found = self._journal.unfinished()
            if found is None:
                return
            program, entry = found
            request = m.Deploy(program=program.name, bindings=entry.bindings)
            deployed = self._deployed_again(request, program, entry.state.deployment, entry.release)
            data, known = entry.state.data, {state.id for state in program.states()}
            if odd := [id for id in entry.state.active if id not in known]:
                raise ValueError(f"active: got {odd[0]!r}; expected one of {', '.join(sorted(known))}")
            doing = {state.id for state in program.states() if state.file.do}
            self._autonomy, self._breakpoints = entry.state.autonomy, frozenset(entry.state.breakpoints) & doing
            inner = [state for state in program.states() if state.id in entry.state.active]
            inner = [state for state in inner if not any(child in inner for child in state.children)]
            start = Start(
                states=tuple(state.id for state in inner),
                variables={name: value for name, value in data.items() if name in program.variables or "/" in name},
                parameters={name: value for name, value in data.items() if name in program.parameters},
                paused="the engine was started anew; what it moved has stopped. Look, then go on, or run from another state",
                run=entry.state.run,
                edit=self._recovered_edit(deployed, entry),
            )
            self._begin(deployed, start, on_failure=entry.state.on_failure)
        except (ValueError, RefusedError) as problem:
            self._log("warning", f"the run that was under way is lost: {problem}")
        except Exception as crash:
            # Started anew, it would find the same journal: an engine without that run is better than none.
            logging.exception("the run that was under way could not be taken up")
            self._log(
                "error", f"the run that was under way is lost: the engine's own error: {type(crash).__name__}: {crash}"
            )

    def _recovered_edit(self, deployed: Deployed, entry: Entry) -> Waiting | None:
        """The version that waited for its place. Where it can't be had any more, that is told, and the run is without it."""
        try:
            program = self._journal.edited(entry)
            if program is None or entry.edit is None or program.same_as(deployed.program):
                return None
            edit = entry.edit
            request = m.Deploy(program=program.name, bindings=entry.bindings, parameters=edit.parameters)
            newer = self._deployed_again(request, program, edit.deployment, edit.release)
        except (ValueError, RefusedError) as problem:
            self._log("warning", f"the edit of {entry.state.program} that waited is lost: {problem}")
            return None
        return self._waiting(newer, edit.parameters)

    def _deployed_again(self, request: m.Deploy, program: Program, id: str, release: str) -> Deployed:
        """As it was deployed before the engine was killed: from the release that it was made from, whatever is in force by now."""
        folder = Path(release) if release else None
        if folder is not None and not folder.is_dir():
            self._log("warning", f"{program.name} goes on with today's code: the release that it was made from is gone")
            folder = workspace.deployed()
        with workspace.pinned(folder):
            deployed = deployment.deploy(request, program, self._services.description, self._services.affordances)
        deployed = replace(deployed, id=id)
        self._deployments[id] = deployed
        return deployed

    def _program_run(self) -> ProgramRun:
        if self._run is None or self._job is not self._run or not self._run.active:
            raise refuse("no program is running")
        return self._run

    def _idle(self) -> None:
        if self._changing_runs.locked():
            raise refuse("the engine is busy: a run is just being started")
        self._not_by_hand()
        if self._job is not None and self._job.active:
            raise refuse("the engine is busy: stop what runs first")

    def _running(self) -> Job:
        """What is moved by hand before the run in whose pause it is."""
        if self._by_hand is not None and self._by_hand.active:
            return self._by_hand
        if self._job is None or not self._job.active:
            raise refuse("nothing is running")
        return self._job

    def _snapshot(self) -> m.EngineSnapshot:
        services = self._services
        return m.EngineSnapshot(
            instances=[each.state() for each in services.affordances.instances()],
            plans=services.plans.previews(),
            run=self._run.state if self._run else None,
            prompts=services.prompts.open(),
        )


def _in_thread(work: Callable[[], Any], name: str) -> Future[Any]:
    future: Future[Any] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as problem:
            future.set_exception(problem)
            if not isinstance(problem, RefusedError):
                logging.exception("%s crashed", name)

    threading.Thread(target=run, name=name, daemon=True).start()
    return future


def main(arguments: list[str] | None = None) -> int:
    """Run the engine until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(description="Handrail's execution engine: instances, plans, programs, prompts.")
    parser.add_argument("--robot", required=True, help="robot's name in the library, or its folder")
    parser.add_argument("--runtime", help="folder in which the robot's processes meet")
    parser.add_argument("--name", default=FIRST, help="its name, where it is not the robot's first engine")
    parser.add_argument("--code", type=Path, help="folder where deployed code is kept (default: in the runtime folder)")
    options = parser.parse_args(arguments)
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="engine: %(message)s")
    try:
        description = robots.load(options.robot)
        runtime = Runtime.at(options.runtime)
        name = engine_names.checked(options.name)
    except ValueError as problem:
        print(problem, file=sys.stderr)
        return 2

    from engines.planning.planners import Planners

    try:
        engine = Engine(
            runtime, description, Planners(description), tip_poses(description), name=name, code=options.code
        )
    except HeldElsewhere as held:
        print(f"an engine {name} runs in {runtime.folder} already (process {held.process})", file=sys.stderr)
        return 2
    serve(engine, name)
    return 0


def serve(engine: Engine, name: str) -> None:
    """Run it until SIGTERM or SIGINT, having said that it is ready, and free it."""
    # A signal that comes just before the poll begins would be handled only after it: its arrival must end the poll, too.
    signal.set_wakeup_fd(engine.wake_fd, warn_on_full_buffer=False)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: engine.stop())
    print(f"{name} ready", flush=True)
    engine.serve()
    engine.close()


if __name__ == "__main__":
    sys.exit(main())
