"""The engine process: template instances, plans, programs and prompts of one robot, answered from one thread.

python -m engines.engine --robot talos_upper --runtime DIR
"""

from __future__ import annotations

import argparse
import logging
import queue
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import msgspec
import numpy as np
import zmq

from affordance_templates.server import AffordanceServer
from engines import deployment, library
from engines.activities.base import ActivityFailed, Planner, Services
from engines.daemon_client import DaemonClient
from engines.deployment import Deployed
from engines.plan_making import make_motion, make_plan
from engines.plans import PlanStore
from engines.prompts import Prompts
from engines.run import Job, PlanExecution, ProgramRun
from engines.service import DeferringService, Wake
from handrail import messages as m
from handrail.config import ConfigError
from handrail.robot import description as robot_description
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime
from handrail.topics import Publisher, RefusedError, refuse

TipPose = Callable[[np.ndarray, str], tuple[np.ndarray, np.ndarray]]
_DEPLOYMENTS_KEPT = 20


class Engine:
    """Serves `engine.call` and publishes `engine.events`. Made, driven and closed by one thread."""

    def __init__(self, runtime: Runtime, description: RobotDescription, planner: Planner, tip_pose: TipPose):
        self._wake = Wake()
        self._outbox: queue.SimpleQueue[msgspec.Struct] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._deployments: dict[str, Deployed] = {}
        self._job: Job | None = None
        self._run: ProgramRun | None = None
        self._publisher = Publisher(runtime.endpoint("engine.events"))
        daemon = DaemonClient(runtime, len(description.joints), log=lambda text: self._log("warning", text))
        affordances = AffordanceServer(runtime.folder / "instances.json", changed=self._instance_changed)
        plans = PlanStore(affordances.instances, daemon.world, self._tell)
        daemon.rested = plans.robot_rested
        self._services = Services(
            description=description,
            daemon=daemon,
            affordances=affordances,
            plans=plans,
            prompts=Prompts(self._tell),
            planner=planner,
            tip_pose=tip_pose,
            log=self._log,
        )
        for problem in affordances.problems:
            self._log("error", problem)
        self._answers: dict[type, Callable[[Any], Any]] = {
            m.PlaceInstance: lambda call: affordances.place(call).state(),
            m.MoveInstance: lambda call: affordances.move(call).state(),
            m.SetParameters: lambda call: affordances.set_parameters(call).state(),
            m.RemoveInstance: affordances.remove,
            m.GetInstances: lambda call: m.Instances(instances=[each.state() for each in affordances.instances()]),
            m.GetPlan: self._get_plan,
            m.MakePlan: self._make_plan,
            m.PlanMotion: self._plan_motion,
            m.ExecutePlan: self._execute_plan,
            m.ListLibrary: lambda call: _in_thread(library.listing, "library"),
            m.Deploy: self._deploy,
            m.Run: self._start,
            m.PauseRun: lambda call: self._running().pause(),
            m.ResumeRun: lambda call: self._running().resume(),
            m.StopRun: lambda call: self._running().stop(),
            m.AnswerPrompt: self._services.prompts.answer,
            m.GetEngine: lambda call: self._snapshot(),
        }
        self._service = DeferringService(runtime.endpoint("engine.call"), m.EngineCall, self._answer, self._wake)

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
        """Cancel what moves, publish what is left, and free everything."""
        if self._job is not None and self._job.active:
            try:
                self._job.stop()
            except RefusedError as refused:
                self._log("warning", str(refused))
            self._job.join(0.5)
        self._publish()
        self._services.daemon.close()
        self._service.close()
        self._publisher.close()
        self._wake.close()

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

    def _log(self, level: Any, text: str) -> None:
        logging.log({"info": logging.INFO, "warning": logging.WARNING}.get(level, logging.ERROR), text)
        self._tell(m.LogLine(source="engine", level=level, text=text))

    def _instance_changed(self, state: m.InstanceState) -> None:
        self._tell(state)
        self._services.plans.instance_changed(state.name)

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
        def plan() -> m.PlanPreview:
            try:
                return make_plan(self._services, call.instance, call.trajectory, call.arm, after=call.after)[1]
            except ActivityFailed as failed:
                raise refuse(str(failed)) from failed

        self._services.affordances.get(call.instance)
        return _in_thread(plan, "plan")

    def _plan_motion(self, call: m.PlanMotion) -> Future[m.PlanPreview]:
        def plan() -> m.PlanPreview:
            try:
                return make_motion(self._services, call)[1]
            except ActivityFailed as failed:
                raise refuse(str(failed)) from failed

        return _in_thread(plan, "plan")

    def _execute_plan(self, call: m.ExecutePlan) -> None:
        self._idle()
        record = self._services.plans.get(call.id)
        try:
            self._job = PlanExecution(self._services, record, call.segments)
        except ActivityFailed as failed:
            raise refuse(str(failed)) from failed

    def _deploy(self, call: m.Deploy) -> m.Deployment:
        try:
            program = library.named(call.program)
        except ConfigError as problem:
            raise refuse("the program can't be deployed", "program", call.program, str(problem)) from problem
        deployed = deployment.deploy(call, program, self._services.description, self._services.affordances)
        self._deployments[deployed.id] = deployed
        while len(self._deployments) > _DEPLOYMENTS_KEPT:
            del self._deployments[next(iter(self._deployments))]
        return m.Deployment(id=deployed.id, program=program.name, hash=program.hash)

    def _start(self, call: m.Run) -> m.RunState:
        self._idle()
        deployed = self._deployments.get(call.deployment)
        if deployed is None:
            known = ", ".join(self._deployments) or "none: deploy a program first"
            raise refuse("no such deployment", "deployment", call.deployment, f"one of: {known}")
        deployment.still_bound(deployed, self._services.description, self._services.affordances)
        self._job = self._run = ProgramRun(deployed, self._services, self._tell)
        return self._run.start()

    def _idle(self) -> None:
        if self._job is not None and self._job.active:
            raise refuse("the engine is busy: stop what runs first")

    def _running(self) -> Job:
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
    options = parser.parse_args(arguments)
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="engine: %(message)s")
    try:
        description = robot_description.load(options.robot)
        runtime = Runtime.at(options.runtime)
    except ValueError as problem:
        print(problem, file=sys.stderr)
        return 2

    from engines.planning.planners import Planners

    engine = Engine(runtime, description, Planners(description), tip_poses(description))
    # A signal that comes just before the poll begins would be handled only after it: its arrival must end the poll, too.
    signal.set_wakeup_fd(engine.wake_fd, warn_on_full_buffer=False)
    for name in (signal.SIGTERM, signal.SIGINT):
        signal.signal(name, lambda *_: engine.stop())
    print("engine ready", flush=True)
    engine.serve()
    engine.close()
    return 0


def tip_poses(description: RobotDescription) -> TipPose:
    """Where an arm's tool tip is in the world; may be asked from any thread."""
    import pinocchio as pin

    from handrail.robot.kinematics import Kinematics

    kinematics, lock = Kinematics(description), threading.Lock()

    def tip_pose(position: np.ndarray, arm: str) -> tuple[np.ndarray, np.ndarray]:
        with lock:
            pose = kinematics.frame(position, description.arms[arm].tip)
        return np.array(pose.translation), np.array(pin.Quaternion(pose.rotation).coeffs())

    return tip_pose


if __name__ == "__main__":
    sys.exit(main())
