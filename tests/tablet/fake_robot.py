"""A daemon, an engine and the link's answers in one object, without processes: what the tablet's tests stand on."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from affordance_templates import catalogue
from handrail import cloud
from handrail.messages import (
    AnswerPrompt,
    AttachInstance,
    Attachment,
    ClearStop,
    ClientIdentity,
    CodeChanged,
    DaemonStatus,
    Deploy,
    Deployment,
    DriveStatus,
    EditInstance,
    Enable,
    EngineInfo,
    Engines,
    EngineSnapshot,
    GetEngine,
    GetEngines,
    GetIdentity,
    GetInstances,
    GetNodes,
    GetOutline,
    GetPlan,
    GetProcesses,
    GetProcessLog,
    GetProgram,
    GetReach,
    GetReleases,
    GetRobot,
    GetRunHistory,
    GetSamples,
    GetStatus,
    HoldInstance,
    InstanceAt,
    InstanceEdit,
    Instances,
    InstanceState,
    Library,
    LibraryEntry,
    ListLibrary,
    ListNodes,
    ListRecordings,
    LoopStatistics,
    MarkedAt,
    NodeLibrary,
    Nodes,
    Outline,
    OutlineState,
    PlanPreview,
    PlanSegment,
    PointCloud,
    Pose,
    Processes,
    ProcessLog,
    ProcessUse,
    ProgramParameter,
    ProgramResource,
    ProgramSource,
    Prompt,
    PromptClosed,
    Reach,
    RecordingInfo,
    Recordings,
    Refused,
    Release,
    ReleaseInstance,
    Releases,
    ReturnCommand,
    RobotInfo,
    RobotState,
    RollBack,
    RolledBack,
    Run,
    RunHistory,
    RunState,
    SaidLine,
    Samples,
    SavedTemplate,
    SaveTemplate,
    StartRecording,
    StateVisit,
    Stop,
    StopRecording,
    TakeCommand,
    UndoEdit,
    WaypointReach,
)
from handrail.robot import library as robots
from handrail.topics import RefusedError, refuse
from tests.tablet.fake_client import ChosenStream, FakeClient

WHEEL = Pose(position=(0.55, -0.35, 0.30))


class FakeRobot:
    """A daemon and an engine in one object, with clients instead of a link. Thread-safe enough for tests."""

    def __init__(self) -> None:
        self.description = robots.load("talos_upper")
        self.position = self.description.home_position().tolist()
        self.calls: list[Any] = []
        self.reachable = True
        self.role: Any = "operator"
        self.commander = ""
        self.traffic = {"RobotState": 0, "": 0}
        self.processes: list[ProcessUse] = []
        self.recordings: list[RecordingInfo] = []
        self.recording = ""
        self.engine_there = True
        self.enabled, self.stopped, self.stop_reason, self.speed = True, False, "", 1.0
        self.hanging = threading.Event()  # set: calls other than STOP never come back
        self.released = threading.Event()
        self.instances: list[InstanceState] = []
        self.steps: list[InstanceState] = []
        """instances as they were before what can be taken back"""
        self.plans: list[PlanPreview] = []
        self.answers_plan: PlanPreview | None = None
        self.run: RunState | None = None
        self.prompts: list[Prompt] = []
        self.nodes = Nodes(nodes=[])
        self.visits: list[StateVisit] = []
        self.releases = [
            Release(number=1, program="press", bundle="1" * 32, by="anna", at_ns=0),
            Release(number=2, program="press", bundle="2" * 32, by="ben", at_ns=1, changed=["press.yaml"]),
        ]
        self._streams: list[queue.SimpleQueue[Any]] = []
        self.chosen: list[ChosenStream] = []
        """what the windows have subscribed to"""
        self.time_ns = 12_000_000_000

    # What a test makes it do -------------------------------------------------------------------------------------------

    def publish(self, *events: Any) -> None:
        for event in events:
            for stream in (*self._streams, *self.chosen):
                stream.put(event)

    def state(self, **moved: float) -> RobotState:
        """The robot's state with some joints moved, rad."""
        position = list(self.position)
        for joint, value in moved.items():
            position[self.description.index(joint)] = value
        zero = [0.0] * len(position)
        return RobotState(
            time_ns=self.time_ns, cycle=1, position=position, velocity=zero, torque=zero, command=position
        )

    def status(self, **changes: Any) -> DaemonStatus:
        drive = "quick_stop_active" if self.stopped else "operation_enabled" if self.enabled else "switch_on_disabled"
        fields: dict[str, Any] = {
            "time_ns": self.time_ns,
            "clock": "lockstep",
            "enabled": self.enabled and not self.stopped,
            "stopped": self.stopped,
            "stop_reason": self.stop_reason,
            "speed": self.speed,
            "drives": [DriveStatus(joint=joint, state=drive) for joint in self.description.joints],
            "controllers": {},
            "loop": LoopStatistics(),
            "buses": [],
        }
        return DaemonStatus(**{**fields, **changes})

    def picture(self, centre: tuple[float, float, float] = (0.55, -0.35, 0.30), **changes: Any) -> PointCloud:
        """What its camera would see: 400 points within 5 cm of a place."""
        near = np.random.default_rng(2).uniform(-0.05, 0.05, (400, 3))
        red = np.full((400, 3), (220, 30, 20), np.uint8)
        seen = cloud.pack("head", self.time_ns, near + centre, red, (0.15, 0.0, 0.56))
        return msgspec.structs.replace(seen, **changes)

    def wheel(self, **changes: Any) -> InstanceState:
        fields: dict[str, Any] = {
            "name": "wheel_1",
            "template": "wheel",
            "template_hash": catalogue.load("wheel").hash,
            "version": 1,
            "pose_in_world": WHEEL,
            "parameters": {},
            "joint_state": {"hinge": 0.3},
        }
        return InstanceState(**{**fields, **changes})

    def plan(self, plan: str = "plan-1", **changes: Any) -> PlanPreview:
        """A plan that lifts the right arm: two segments, 3 s."""
        joints = list(self.description.arms["right"].joints)
        start = [self.position[self.description.index(joint)] for joint in joints]
        middle = [
            value + shift for value, shift in zip(start, (0.25, 0.1, -0.2, 0.25, -0.3, 0.4, 0.2, 0.0, 0.0), strict=True)
        ]
        goal = [
            value + shift for value, shift in zip(middle, (0.1, 0.0, -0.2, 0.1, 0.1, 0.2, 0.0, 0.2, 0.1), strict=True)
        ]
        fields: dict[str, Any] = {
            "id": plan,
            "label": "Stroke 1",
            "joints": joints,
            "segments": [
                PlanSegment(name="approach", times=[0.0, 2.0], positions=[start, middle]),
                PlanSegment(name="turn", times=[0.0, 1.0], positions=[middle, goal]),
            ],
            "made_from": {"wheel_1": 1},
            "fresh": True,
            "clearance": 0.031,
            "limit_margin": 0.21,
            "duration": 3.0,
        }
        return PlanPreview(**{**fields, **changes})

    def prompt(self, **changes: Any) -> Prompt:
        fields: dict[str, Any] = {
            "id": "prompt-1",
            "run": "run-1",
            "text": "Turn the valve with the right arm?",
            "options": ["approve", "reject"],
            "plan": "plan-1",
            "details": {"clearance_m": 0.031},
        }
        return Prompt(**{**fields, **changes})

    def running(self, **changes: Any) -> RunState:
        fields: dict[str, Any] = {
            "run": "run-1",
            "deployment": "deployment-1",
            "program": "turn_valve",
            "hash": "3f9a1c77d20b",
            "status": "running",
            "active": ["turning", "confirm"],
            "data": {"turned_deg": 0.0, "goal_deg": 285.0, "strokes": 0},
        }
        return RunState(**{**fields, **changes})

    def edited(self, name: str, **changes: Any) -> InstanceState:
        """An instance with something changed, as its engine answers and tells."""
        old = next(each for each in self.instances if each.name == name)
        if "parameters" in changes:
            changes["parameters"] = {**old.parameters, **changes["parameters"]}
        new = msgspec.structs.replace(old, version=old.version + 1, **changes)
        self.instances = [new if each is old else each for each in self.instances]
        self.publish(new)
        return new

    def merged(self, call: EditInstance) -> InstanceEdit:
        """An instance with the fields of an edit, the others as they were."""
        old = next(each for each in self.instances if each.name == call.name)
        pose = Pose(
            position=call.position or old.pose_in_world.position,
            orientation=call.orientation or old.pose_in_world.orientation,
        )
        joints = {**old.joint_state, **call.joints}
        new = self.edited(call.name, pose_in_world=pose, parameters=call.parameters, joint_state=joints)
        return InstanceEdit(name=call.name, instance=new)

    def attached(self, call: AttachInstance) -> InstanceEdit:
        """An instance that goes along with something, or stands in the world again."""
        along = Attachment(link=call.link, instance=call.instance, pose=Pose()) if call.link or call.instance else None
        return InstanceEdit(name=call.name, instance=self.edited(call.name, attachment=along))

    def held(self, name: str, by: str) -> InstanceState:
        """An instance that is taken hold of, or let go; what is done meanwhile is one step to undo."""
        old = next(each for each in self.instances if each.name == name)
        if by and not old.held_by:
            self.steps.append(old)
        new = msgspec.structs.replace(old, held_by=by)
        self.instances = [new if each is old else each for each in self.instances]
        self.publish(new)
        return new

    def undone(self) -> InstanceEdit:
        if not self.steps:
            raise refuse("nothing to undo: local has done nothing that is still known")
        was = self.steps.pop()
        new = self.edited(was.name, pose_in_world=was.pose_in_world, parameters=was.parameters)
        return InstanceEdit(
            name=was.name, instance=new, fields=["position"], left={"orientation": "ben has changed it"}
        )

    def reach(self, call: GetReach) -> Reach:
        """One waypoint is within reach, one near a limit, one is not; of the others nothing is told."""
        told = [
            WaypointReach(name="approach", state="reached"),
            WaypointReach(name="engage", state="near", constraint="joint limits", about="elbow", by=0.05, unit="rad"),
            WaypointReach(name="turn", state="not", constraint="clearance", about="arm and rim", by=0.021, unit="m"),
        ]
        return Reach(
            instance=call.instance, version=1, trajectory=call.trajectory, arm=call.arm, waypoints=told, settled=True
        )

    def source(self) -> ProgramSource:
        """Of turn_valve: two resources, and a parameter of each type."""
        return ProgramSource(
            program="turn_valve",
            file="turn_valve.yaml",
            text="# Turn a wheel\n# by strokes.\ntitle: Turn a valve\n# not this\n",
            resources=[
                ProgramResource(name="arm", kind="arm", title="the arm that turns"),
                ProgramResource(name="valve", kind="instance", templates=["wheel", "lever_valve"]),
            ],
            parameters=[
                ProgramParameter(name="goal_deg", type="number", default=285, unit="deg", min=5, max=3600),
                ProgramParameter(name="strokes", type="integer", default=10, min=1),
                ProgramParameter(name="trajectory", type="text", default="turn"),
                ProgramParameter(name="gently", type="bool", default=False),
            ],
        )

    def back(self, call: RollBack) -> RolledBack:
        """Go back to an earlier release, as a new one."""
        old = next(each for each in self.releases if each.number == call.number)
        new = msgspec.structs.replace(old, number=len(self.releases) + 1, note=f"rolled back to {old.number}")
        self.releases.append(new)
        self.publish(CodeChanged(engine=call.engine, release=new))
        return RolledBack(release=new)

    def recorded(self) -> RecordingInfo:
        """A recording of 15 s: the right arm's first joint turns by 0.05 rad/s, a wheel is there from 5 s on."""
        marks = [MarkedAt(5.0, "the wheel is placed", "ada")]
        return RecordingInfo(
            name="valve", size=31_000_000, began=1_790_000_000.0, duration_s=15.0, robot="talos_upper", marks=marks
        )

    def samples(self, call: GetSamples) -> Samples:
        times = np.arange(call.begin_s, min(call.begin_s + call.duration_s, 15.0), 1 / call.rate_hz)
        joint = self.description.arms["right"].joints[0]
        place = InstanceAt(5.0, self.wheel())
        return Samples(
            recording=call.recording,
            begin_s=call.begin_s,
            joints=[joint],
            times_s=times.tolist(),
            positions=[[round(500 * at)] for at in times],
            instances=[place],
        )

    def outline(self) -> Outline:
        """The states of what it runs, as turn_valve has them."""
        states = [
            OutlineState(id="planning", title="Plan the first stroke", does="plan", ways=["confirm", "failed"]),
            OutlineState(id="turning", title="Turn, stroke by stroke", ways=["failed"]),
            OutlineState(id="confirm", parent="turning", title="Ask the operator", does="prompt", ways=["stroking"]),
            OutlineState(
                id="stroking", parent="turning", title="Reach in, turn, let go", does="execute", ways=["done"]
            ),
            OutlineState(id="done", outcome="succeeded"),
            OutlineState(id="failed", outcome="failed"),
        ]
        return Outline(
            deployment="deployment-1", program="turn_valve", title="Turn a valve", hash="3f9a1c77d20b", states=states
        )

    # What a client sees ------------------------------------------------------------------------------------------------

    def connect(self) -> FakeClient:
        return FakeClient(self)

    def answer(self, call: Any) -> Any:
        self.calls.append(call)
        if isinstance(call, Stop):
            self.stopped, self.stop_reason = True, call.reason
            self.publish(self.status())
            return None
        if isinstance(call, ClearStop):
            self.stopped, self.enabled = False, False
            self.publish(self.status())
        if isinstance(call, Enable):
            if self.stopped:
                raise RefusedError(Refused(message="the stop is latched"))
            self.enabled = True
            self.publish(self.status())
        if isinstance(call, AnswerPrompt):
            self.prompts = [prompt for prompt in self.prompts if prompt.id != call.id]
            self.publish(PromptClosed(id=call.id, answer=call.answer, by=call.by))
        if isinstance(call, StartRecording):
            self.recording = call.name
        if isinstance(call, StopRecording):
            self.recording = ""
        arms = self.description.arms
        answers: dict[type, Callable[[], Any]] = {
            GetRobot: lambda: RobotInfo(
                name=self.description.name,
                joints=list(self.description.joints),
                lower=self.description.lower.tolist(),
                upper=self.description.upper.tolist(),
                velocity_limit=self.description.velocity_limit.tolist(),
                torque_limit=self.description.torque_limit.tolist(),
                groups={name: list(joints) for name, joints in self.description.groups.items()},
                tools={name: arm.tip for name, arm in arms.items()},
                tips={},
                arms={name: list(arm.joints) for name, arm in arms.items()},
                home=self.description.home,
                period_ns=self.description.period_ns,
            ),
            GetStatus: self.status,
            ListRecordings: lambda: Recordings(recordings=self.recordings, running=self.recording, free_mb=40e3),
            GetSamples: lambda: self.samples(call),
            GetIdentity: lambda: ClientIdentity(name="ada", role=self.role, commander=self.commander),
            TakeCommand: lambda: self.commands("ada"),
            ReturnCommand: lambda: self.commands(""),
            GetProcesses: lambda: Processes(processes=self.processes),
            GetProcessLog: lambda: ProcessLog(
                process=call.process, lines=[SaidLine(2.0, f"{call.process} ready"), SaidLine(1.0, "all is well")]
            ),
            GetEngine: lambda: EngineSnapshot(
                instances=self.instances, plans=self.plans, run=self.run, prompts=self.prompts
            ),
            GetInstances: lambda: Instances(instances=self.instances),
            GetPlan: lambda: self.answers_plan,
            HoldInstance: lambda: self.held(call.name, "local"),
            ReleaseInstance: lambda: self.held(call.name, ""),
            UndoEdit: self.undone,
            EditInstance: lambda: self.merged(call),
            AttachInstance: lambda: self.attached(call),
            SaveTemplate: lambda: SavedTemplate(name=call.name, file=f"/workspace/{call.name}.yaml", hash="0"),
            ListLibrary: lambda: Library(
                entries=[
                    LibraryEntry(name="wheel", kind="template"),
                    LibraryEntry(name="turn_valve", kind="program", title="Turn a valve", hash="3f9a1c77d20b"),
                    LibraryEntry(name="broken", kind="program", problem="broken.yaml:3: states: got 4"),
                ]
            ),
            GetProgram: self.source,
            Deploy: lambda: Deployment(id="deployment-9", program=call.program, hash="3f9a1c77d20b"),
            Run: lambda: self.running(deployment=call.deployment),
            GetEngines: lambda: Engines(engines=[EngineInfo(name="engine", program="turn_valve", status="running")]),
            GetReleases: lambda: Releases(
                engine=call.engine, releases=self.releases, programs={"press": self.releases[-1].bundle}
            ),
            RollBack: lambda: self.back(call),
            GetReach: lambda: self.reach(call),
            GetOutline: self.outline,
            GetNodes: lambda: self.nodes,
            ListNodes: lambda: NodeLibrary(nodes=[]),
            GetRunHistory: lambda: RunHistory(run=self.run.run if self.run else "", visits=self.visits),
        }
        return answers[type(call)]() if type(call) in answers else None

    def commands(self, name: str) -> ClientIdentity:
        self.commander = name
        return ClientIdentity(name="ada", role=self.role, commander=name)

    def calls_of(self, kind: type) -> list[Any]:
        return [call for call in self.calls if isinstance(call, kind)]
