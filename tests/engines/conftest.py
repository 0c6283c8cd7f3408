"""A robot of two joints (the tool's angle about the wheel, its depth), a daemon that plays actions, a planner for both."""

from __future__ import annotations

import math
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from daemon.serving.leases import Leases
from engines.engine import Engine
from engines.planning.collision.seen import Camera, Seen
from engines.planning.measures import CLEARANCE, Measure
from engines.planning.plan import Infeasible, Plan, Segment
from engines.planning.strokes.behaviour import Choice
from engines.planning.waiting import Cancelled
from handrail import messages as m
from handrail.runtime import Runtime
from handrail.topics import Caller, Publisher, RefusedError, Service, Subscriber, refuse

JOINTS = ("angle", "depth", "other")
HINGE = np.array([0.55, -0.35, 0.30])
ENGAGE = 0.10


def tip_pose(position: np.ndarray, arm: str) -> tuple[np.ndarray, np.ndarray]:
    """The tool's tip on its circle about a hinge along +x."""
    angle, depth = position[0], position[1]
    return HINGE + np.array([depth, ENGAGE * math.cos(angle), ENGAGE * math.sin(angle)]), np.array([0.0, 0.0, 0.0, 1.0])


@pytest.fixture
def runtime() -> Iterator[Runtime]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    yield Runtime.at(folder)
    shutil.rmtree(folder, ignore_errors=True)


@dataclass
class FakeDaemon:
    """Answers `daemon.call`; an action arrives at its last knot at once, unless `trip` or `slow` says otherwise."""

    runtime: Runtime
    calls: list[Any] = field(default_factory=list)
    slow: bool = False
    """actions run until `finish`, a cancel or an operator stop"""
    trip: Callable[[Any], str] = lambda action: ""
    """action → the outcome it ends with half-way, or nothing"""
    wheel: float = 0.0
    """rad, where the wheel that the tool pushes really is"""
    disturb: Callable[[Any], None] = lambda action: None
    robot: m.RobotInfo | None = None

    def __post_init__(self) -> None:
        self.command = np.array([0.0, -0.3, 0.0])
        self.cycle = 0
        self.running: list[Any] = []
        body = SimpleNamespace(joints=JOINTS, groups={"tool": JOINTS[:2]}, devices=[])
        self.leases = Leases(body, self.runtime.folder / "leases.json")  # type: ignore[arg-type]
        self._todo: list[Callable[[], None]] = []
        self._end = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        assert self._ready.wait(5)

    def _serve(self) -> None:
        service = Service(self.runtime.endpoint("daemon.call"), m.DaemonCall, self._handle)
        self.publisher = Publisher(self.runtime.endpoint("daemon.events"))
        self._ready.set()
        while not self._end.is_set():
            service.poll(0.01)
            self._state()
            while self._todo:
                self._todo.pop(0)()
        service.close()
        self.publisher.close()

    @property
    def action(self) -> Any:
        """The running action, the newest where there are several."""
        return self.running[-1] if self.running else None

    def close(self) -> None:
        self._end.set()
        self._thread.join(5)

    def kinds(self) -> list[str]:
        """Names of the calls that came, without the signs of life and the leases."""
        return [
            type(call).__name__ for call in self.calls if not isinstance(call, m.CheckIn | m.TakeLease | m.ReturnLease)
        ]

    def started(self) -> list[m.StartAction]:
        return [call for call in self.calls if isinstance(call, m.StartAction)]

    def resist(self, times: int) -> None:
        """The tool meets something so many times that it reaches in."""
        left = iter(range(times))

        def trip(action: Any) -> str:
            engaging = any(isinstance(end, m.PoseErrorEnd) for end in action.ends)
            return "pose_error" if engaging and next(left, None) is not None else ""

        self.trip = trip

    def finish(self) -> None:
        """Let the running action arrive."""
        self._todo.append(lambda: self._ended("done", 1.0))

    def operator_stop(self) -> None:
        self._todo.append(lambda: self._ended("stopped", 0.5))

    def _state(self) -> None:
        self.cycle += 1
        command = self.command.tolist()
        self.publisher.send(
            m.RobotState(
                time_ns=self.cycle * 2_000_000,
                cycle=self.cycle,
                position=command,
                velocity=[0.0] * 3,
                torque=[0.0] * 3,
                command=command,
            )
        )

        if self.cycle % 10 == 0:
            self.publisher.send(self._status())

    def take_over(self, owner: str, part: str) -> None:
        """Somebody else takes a part over: what runs on it is cancelled."""
        self._todo.append(lambda: self._take_over(owner, part))

    def _take_over(self, owner: str, part: str) -> None:
        self.leases.take(owner, part, take_over=True)
        self._ended("cancelled", 0.5)

    def _status(self) -> m.DaemonStatus:
        return m.DaemonStatus(
            time_ns=self.cycle * 2_000_000,
            clock="lockstep",
            enabled=True,
            stopped=False,
            drives=[],
            controllers={},
            action=self.action.id if self.action else "",
            actions=[action.id for action in self.running],
            loop=m.LoopStatistics(),
            buses=[],
            leases=self.leases.held(),
        )

    def _handle(self, call: Any) -> Any:
        self.calls.append(call)
        if isinstance(call, m.GetStatus):
            return self._status()
        if isinstance(call, m.GetRobot):
            return self.robot
        if isinstance(call, m.TakeLease):
            lease, _ = self.leases.take(call.owner, call.part, call.take_over)
            number = self.leases.sequence(call.owner)
            return m.Lease(part=lease.part, owner=lease.owner, epoch=lease.epoch, sequence=number)
        if isinstance(call, m.ReturnLease):
            return self.leases.give_back(call.owner, call.part, call.epoch)
        if isinstance(call, m.StartAction | m.StartBehaviour):
            self._start(call)
        elif isinstance(call, m.StreamJoints):
            if self.action is None or self.action.id != call.id:
                raise refuse("no such action", "id", call.id, "a running one")
            motion = msgspec.structs.replace(self.action.motion, positions=call.positions)
            self.running[-1] = msgspec.structs.replace(self.action, motion=motion)
        elif isinstance(call, m.CancelAction | m.PauseAction | m.ResumeAction):
            meant = [action for action in self.running if action.id == call.id]
            if not meant:
                raise refuse("no such action", "id", call.id, "a running one")
            if isinstance(call, m.CancelAction):
                self._todo.append(lambda: self._ended("cancelled", 0.5, meant[0]))
        return None

    def _start(self, action: m.StartAction | m.StartBehaviour) -> None:
        motion = action.motion if isinstance(action, m.StartAction) else action.steps[0].motion
        self.leases.check(action.owner, motion.joints, action.lease, action.sequence)  # type: ignore[union-attr]
        for other in self.running:
            theirs = other.motion if isinstance(other, m.StartAction) else other.steps[0].motion
            if set(theirs.joints or JOINTS) & set(motion.joints or JOINTS):
                raise refuse("claimed by a running action", "joints", other.id, "joints that nobody else claims")
        if isinstance(action, m.StartAction) and isinstance(action.motion, m.JointTrajectory):
            first = np.array(action.motion.positions[0])
            if np.abs(first - self.command[: len(first)]).max() > 0.02:
                raise refuse("first knot", m.FIRST_KNOT, first, f"within 0.02 rad of {self.command}")
        self.running.append(action)
        self._todo.append(lambda: self._event("running", "", action))
        self._todo.append(lambda: self.disturb(action))
        if outcome := self.trip(action):
            self._todo.append(lambda: self._ended(outcome, 0.5, action))
        elif not self.slow:
            self._todo.append(lambda: self._ended("done", 1.0, action))

    def _ended(self, outcome: str, share: float, action: Any = None) -> None:
        action = action or self.action
        if action not in self.running:
            return
        begin = self.command.copy()
        motion = None if isinstance(action, m.StartBehaviour) else action.motion
        if isinstance(motion, m.JointTrajectory):
            knots = np.array(motion.positions)
            at = np.interp(share, np.linspace(0, 1, len(knots)), np.arange(len(knots)))
            for k in range(knots.shape[1]):
                self.command[k] = np.interp(at, np.arange(len(knots)), knots[:, k])
        elif isinstance(motion, m.JointTarget):
            rows = [JOINTS.index(joint) for joint in motion.joints]
            self.command[rows] += share * (np.array(motion.positions) - self.command[rows])
        elif isinstance(motion, m.CartesianImpedance):
            self.command[1] = motion.goal_in_world.position[0] - HINGE[0]
        self._push(begin)
        self._event("ended", outcome, action)
        self.running.remove(action)

    def _push(self, begin: np.ndarray) -> None:
        """Turn the wheel where the tool, in between the spokes, runs against one."""
        if self.command[1] > 0 and self.command[0] > begin[0]:
            touching = math.asin(0.022 / ENGAGE)
            ahead = (self.wheel - begin[0]) % (math.pi / 2)
            self.wheel += max(0.0, self.command[0] + touching - (begin[0] + ahead))

    def _event(self, state: Any, outcome: str, action: Any) -> None:
        if action in self.running:
            position = self.command.tolist()
            self.publisher.send(
                m.ActionEvent(
                    id=action.id,
                    state=state,
                    outcome=outcome,
                    step=action.steps[-1].name if isinstance(action, m.StartBehaviour) else "",
                    time_ns=self.cycle * 2_000_000,
                    cycle=self.cycle,
                    position=position,
                    command=position,
                )
            )


class FakePlanner:
    """Plans a visit in the two joints' own space."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.infeasible = False
        self.cannot: set[tuple[str, float | None]] = set()
        """arms and arcs for which there is no plan"""
        self.infeasible_from = 10**6
        """which plan, counted from 0, is the first that there is none of"""
        self.pace = threading.Event()
        self.pace.set()

    def plan(
        self,
        instance,
        trajectory,
        arm,
        position,
        *,
        arc=None,
        entry_shift=0.0,
        relax=(),
        base=None,
        others=(),
        seen=(),
        cancelled=None,
        progress=None,
    ) -> Plan:
        self.asked.append(
            {
                "seen": seen, "relax": list(relax), "arm": arm, "arc": arc, "entry_shift": entry_shift,
                "position": position.copy(), "instance": instance,
                "others": [each.name for each in others],
            }
        )  # fmt: skip
        if (arm, arc) in self.cannot:
            raise Infeasible("elbow limit", 0.12, "rad")
        assert self.pace.wait(20)
        if self.infeasible or len(self.asked) > self.infeasible_from:
            raise Infeasible("elbow limit", 0.12, "rad")
        resolved = instance.resolve()
        entry, joint = resolved.trajectories[trajectory].entry, resolved.joints["hinge"]
        centre = 0.5 if arc is None else arc
        angle = centre - entry.span / 2 + entry_shift
        while min(abs((angle - a - joint.position + math.pi) % (2 * math.pi) - math.pi) for a in entry.avoid) < (
            entry.contact_offset + entry.clearance
        ):
            angle += 0.01
        end = centre + entry.span / 2
        free = position[1] < -0.09
        steps = [("standoff" if free else "return", (angle, -0.08)), ("engage", (angle, 0.02)), ("turn", (end, 0.02))]
        steps += [("release", (end - 0.14, 0.02)), ("withdraw", (end - 0.14, -0.08))]
        if free:
            steps.insert(0, ("approach", (angle, -0.15)))
        segments, here = [], position[:2].copy()
        for name, goal in steps:
            way = np.linspace(here, goal, 5)
            ends = (m.PoseErrorEnd(frame="tip", position=0.02),) if name == "engage" else ()
            force = m.PathForce(frame="tip") if name == "turn" else None
            near = Measure(CLEARANCE, np.array([0.0, 1.0]), np.array([0.04, 0.03]), ("arm and wheel", "arm and post"))
            segments.append(Segment(name, np.linspace(0, 1, 5), way, np.zeros((5, 2)), ends, force, (near,)))
            here = np.array(goal)
        outputs = {"entry_angle": angle, "end_angle": end, "arc_centre": centre}
        id = f"plan-{len(self.asked)}"
        made_from = {instance.name: instance.version}
        return Plan(
            id,
            f"turn {instance.name}",
            arm,
            JOINTS[:2],
            tuple(segments),
            made_from,
            position[:2].copy(),
            0.03,
            0.2,
            outputs,
        )

    def rank(
        self, instance, position, *, trajectories=(), arms=(), others=(), base=None, cancelled=None
    ) -> list[Choice]:
        """Left can do all of it at 0.5, right at 1.5, and a part at 2.5."""
        choices = [("left", 0.5, 1.0, 0.2, ""), ("right", 1.5, 1.0, 0.7, ""), ("right", 2.5, 0.25, 0.1, "reach")]
        return [
            Choice((trajectories or ["turn"])[0], arm, arc, share, cost, lacks, np.array([0.1, -0.2]))
            for arm, arc, share, cost, lacks in choices
            if arm in (arms or ("left", "right"))
        ]

    def see(self, clouds, time_ns, position, instances) -> Seen:
        """Every camera sees as many obstacles as its cloud has points."""
        cameras = tuple(Camera(cloud.camera, 0.0, cloud.count) for cloud in clouds)
        return Seen((), cameras)

    def motion(
        self, call, instances, position, *, seeds=(), seen=None, base=None, cancelled=None, progress=None
    ) -> Plan:
        """To where the first goal has the joints."""
        while not self.pace.wait(0.01):
            (progress or print)("waiting for the test")
            if cancelled is not None and cancelled():
                raise Cancelled("planning was cancelled")
        names = [each.name for each in instances]
        self.asked.append({"call": call, "instances": names, "position": position.copy(), "seeds": list(seeds)})
        if self.infeasible:
            raise Infeasible("elbow limit", 0.12, "rad")
        if call.along is not None:
            call = msgspec.structs.replace(call, goals=[m.JointsGoal(positions={"angle": position[0] + call.along.by})])
        goal = call.goals[0]
        there = goal.positions if isinstance(goal, m.JointsGoal) else {"angle": position[0] + 0.3}
        end = np.array([there.get(joint, here) for joint, here in zip(JOINTS[:2], position[:2], strict=True)])
        way = np.linspace(position[:2], end, 5)
        segment = Segment("goals", np.linspace(0, 1, 5), way, np.zeros((5, 2)))
        made_from = {each.name: each.version for each in instances}
        id = f"plan-{len(self.asked)}"
        passed = tuple(np.linspace(0, 1, len(call.through) + 2)[1:-1].tolist())
        label = call.label or "to goals"
        return Plan(id, label, call.arm, JOINTS[:2], (segment,), made_from, way[0], 0.05, 0.2, key_times=passed)


class Stack:
    """An engine in a thread of its own, with a caller and everything that it published."""

    def __init__(self, runtime: Runtime, planner: FakePlanner, name: str = "engine", *, away: bool = False):
        self.runtime, self.planner, self.name, self.away = runtime, planner, name, away
        self.events: list[Any] = []
        self._started, self._end = threading.Event(), threading.Event()
        self._changed = threading.Condition()
        self._threads = [
            threading.Thread(target=self._engine, daemon=True),
            threading.Thread(target=self._listen, daemon=True),
        ]
        self._threads[0].start()
        assert self._started.wait(10)
        self._threads[1].start()
        self.caller = Caller(runtime.endpoint(f"{name}.call"))
        self.listening()

    def _engine(self) -> None:
        arm = SimpleNamespace(joints=JOINTS[:2], tip="tip")
        description = SimpleNamespace(
            name="two_joints",
            joints=JOINTS,
            groups={"tool": JOINTS[:2]},
            arms={"right": arm, "left": arm},
            velocity_limit=np.array([2.0, 2.0, 2.0]),
            lower=np.full(3, -3.0),
            upper=np.full(3, 3.0),
            index=lambda names: np.array([JOINTS.index(name) for name in names]),
        )
        self.engine = Engine(self.runtime, description, self.planner, tip_pose, name=self.name, away=self.away)  # type: ignore[arg-type]
        self._started.set()
        self.engine.serve()
        self.engine.close()

    def _listen(self) -> None:
        subscriber = Subscriber(self.runtime.endpoint(f"{self.name}.events"), m.EngineEvent)
        while not self._end.is_set():
            event = subscriber.receive(0.05)
            if event is not None:
                with self._changed:
                    self.events.append(event)
                    self._changed.notify_all()
        subscriber.close()

    def listening(self) -> None:
        """Return when events arrive here, and the engine knows where the robot is."""
        deadline = time.monotonic() + 30
        while not self.events and time.monotonic() < deadline:
            self.engine._log("info", "are you there?")
            with self._changed:
                self._changed.wait(0.05)
        assert self.events
        until(lambda: self.engine._services.daemon.command() is not None)

    def call(self, message: Any, timeout_s: float = 30.0) -> Any:
        return self.caller.call(message, timeout_s)

    def refusal(self, message: Any) -> m.Refused:
        with pytest.raises(RefusedError) as caught:
            self.call(message)
        return caught.value.refusal

    def wait(self, wanted: Callable[[Any], bool], timeout_s: float = 30.0) -> Any:
        """The first event that is wanted, past ones included."""
        with self._changed:
            found = self._changed.wait_for(lambda: next((e for e in self.events if wanted(e)), None), timeout_s)
        assert found is not None, [e for e in self.events if not isinstance(e, m.PlanPreview)][-8:]
        return found

    def prompt(self, count: int = 1) -> m.Prompt:
        """The count-th prompt."""
        self.wait(lambda e: isinstance(e, m.Prompt) and sum(isinstance(x, m.Prompt) for x in self.events) >= count)
        return [e for e in self.events if isinstance(e, m.Prompt)][count - 1]

    def ended(self) -> m.RunState:
        return self.wait(lambda e: isinstance(e, m.RunState) and e.status in ("succeeded", "failed", "stopped"))

    def place(self, **parameters: float) -> m.InstanceState:
        pose = m.Pose(position=tuple(HINGE.tolist()))
        return self.call(m.PlaceInstance(name="wheel_1", template="wheel", pose_in_world=pose, parameters=parameters))

    def run(self, program: str = "turn_valve", **parameters: Any) -> m.RunState:
        bindings = {"arm": "right", "valve": "wheel_1"} if program == "turn_valve" else {"arm": "right"}
        deployed = self.call(m.Deploy(program=program, bindings=bindings, parameters=parameters))
        return self.call(m.Run(deployment=deployed.id))

    def close(self) -> None:
        self.engine.stop()
        self._end.set()
        for thread in self._threads:
            thread.join(5)
        self.caller.close()


class Elsewhere:
    """Another caller, who waits in a thread of his own."""

    def __init__(self, stack, message):
        self._caller, self.answer, self.refusal = Caller(stack.runtime.endpoint("engine.call")), None, None
        self._thread = threading.Thread(target=self._ask, args=(message,), daemon=True)
        self._thread.start()

    def _ask(self, message) -> None:
        try:
            self.answer = self._caller.call(message, 30.0)
        except RefusedError as refused:
            self.refusal = str(refused)

    def end(self) -> None:
        self._thread.join(30.0)
        assert not self._thread.is_alive()
        self._caller.close()


def until(condition: Callable[[], bool], timeout_s: float = 30.0) -> None:
    """Wait for something that no event tells of."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


@pytest.fixture
def wait_until() -> Callable[..., None]:
    return until


@pytest.fixture
def daemon(runtime: Runtime) -> Iterator[FakeDaemon]:
    daemon = FakeDaemon(runtime)
    yield daemon
    daemon.close()


@pytest.fixture
def planner() -> FakePlanner:
    return FakePlanner()


@pytest.fixture
def start(runtime: Runtime, daemon: FakeDaemon, planner: FakePlanner) -> Iterator[Callable[[], Stack]]:
    """Starts engines on one runtime, one after another."""
    stacks: list[Stack] = []

    def begin() -> Stack:
        for stack in stacks:
            stack.close()
        stacks.append(Stack(runtime, planner))
        return stacks[-1]

    yield begin
    for stack in stacks:
        stack.close()


@pytest.fixture
def second(stack: Stack, runtime: Runtime) -> Iterator[Stack]:
    """An engine beside the first one."""
    vision = Stack(runtime, FakePlanner(), "vision")
    yield vision
    vision.close()


@pytest.fixture
def stack(start: Callable[[], Stack]) -> Stack:
    return start()


@pytest.fixture
def stroking(stack: Stack, daemon: FakeDaemon) -> None:
    """turn_valve runs, in its first stroke, which moves until `daemon.finish`."""
    daemon.slow = True
    stack.place()
    stack.run(goal_deg=10)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    until(lambda: stack.engine._run._motion._running)


@pytest.fixture
def elsewhere(stack) -> Callable[[Any], Elsewhere]:
    """message → another caller, who waits for the answer."""
    return lambda message: Elsewhere(stack, message)
