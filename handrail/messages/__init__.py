"""Every message that crosses a process, as typed structs in MessagePack.

SI units, radians, integer nanoseconds of the robot's clock. A pose is position and quaternion (x, y, z, w); a name says its
frame. Each type states in ``spec`` how it travels: its priority (0 first), whether it is reliable or latest-value, and which
field makes a newer message supersede an older one. Any MessagePack reader can read them: a struct is a map with its type's
name under ``type``.
"""

from __future__ import annotations

from handrail.messages.actions import (
    ActionEvent,
    CancelAction,
    GripperOrder,
    PauseAction,
    ResumeAction,
    SetSpeed,
    StartAction,
    StartBehaviour,
    Step,
    StreamJoints,
    StreamPose,
)
from handrail.messages.base import (
    Message,
    Name,
    NonNegative,
    Ok,
    Pose,
    Positive,
    Refused,
    Spec,
    Vector,
    spec,
)
from handrail.messages.bundles import (
    BundleState,
    CodeChanged,
    GetProgram,
    GetReleases,
    Piece,
    ProgramParameter,
    ProgramResource,
    ProgramSource,
    PutBundle,
    Release,
    Releases,
    RollBack,
    RolledBack,
    SaveProgram,
)
from handrail.messages.command import ReturnCommand, TakeCommand
from handrail.messages.daemon import (
    ClearStop,
    CommandGripper,
    ConfigureController,
    ControllerEvent,
    ControllerInfo,
    ControllerList,
    Disable,
    Enable,
    GetBase,
    GetControllers,
    GetHardware,
    GetRobot,
    GetSafety,
    GetStatus,
    GetTiming,
    HardwareComponent,
    HardwareStatus,
    HoldTime,
    LoadController,
    LoopTiming,
    ReleaseTime,
    RobotInfo,
    SafetyReport,
    SafetyRule,
    Stop,
    SwitchControllers,
    SwitchRelay,
    Tared,
    TareSensor,
    TimeDistribution,
    UnloadController,
)
from handrail.messages.end_conditions import (
    ContactEnd,
    DivergenceEnd,
    EndCondition,
    ForceEnd,
    GripperAtEnd,
    GripperHoldsEnd,
    JointLimitEnd,
    PoseErrorEnd,
    StallEnd,
    TimeEnd,
    TorqueLimitEnd,
    TravelEnd,
)
from handrail.messages.engines import (
    EngineInfo,
    Engines,
    GetEngines,
)
from handrail.messages.goals import (
    Along,
    CentreOfMassGoal,
    FrameGoal,
    GazeGoal,
    Goal,
    JointsGoal,
    KeyFrame,
    PostureGoal,
    RelationGoal,
)
from handrail.messages.instances import (
    AttachInstance,
    Attachment,
    EditInstance,
    GetInstances,
    GetTemplate,
    HoldInstance,
    InstanceEdit,
    Instances,
    InstanceState,
    MoveInstance,
    PlaceInstance,
    Provenance,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    SavedTemplate,
    SaveTemplate,
    SetJoint,
    SetParameters,
    TemplateSource,
    UndoEdit,
)
from handrail.messages.jogs import Jog, Jogged
from handrail.messages.motions import (
    FIRST_KNOT,
    NOT_READY,
    NOT_STANDING,
    CartesianImpedance,
    Compliance,
    CompliantMotion,
    Dither,
    JointStream,
    JointTarget,
    JointTrajectory,
    Motion,
    PathForce,
    StepMotion,
    TaskAxis,
    WholeBody,
)
from handrail.messages.node_sources import (
    GetNodePorts,
    GetNodeSource,
    ListNodes,
    NodeEntry,
    NodeLibrary,
    NodePorts,
    NodeSource,
    SaveNode,
)
from handrail.messages.nodes import (
    GetNodes,
    NodePort,
    Nodes,
    NodeState,
    PortValue,
    PutNode,
    ReloadNode,
    StartNode,
    StopNode,
    WatchPort,
)
from handrail.messages.owners import (
    BindKeepalive,
    Challenge,
    CheckIn,
    GetChallenge,
    KeepAlive,
    Lease,
    ReleaseKeepalive,
    ReturnLease,
    TakeLease,
)
from handrail.messages.plans import (
    AwaitPlan,
    CancelPlanning,
    Choice,
    Choices,
    EditPlan,
    ExecutePlan,
    GetPlan,
    MakePlan,
    PlanGave,
    PlanMotion,
    PlanOrigin,
    PlanPreview,
    PlanProgress,
    PlanSegment,
    PlanSeries,
    PlanWaypoint,
    PlanWorst,
    RankChoices,
    StaleCause,
)
from handrail.messages.plant import (
    GroundTruth,
)
from handrail.messages.processes import (
    ClientIdentity,
    GetIdentity,
    GetProcesses,
    GetProcessLog,
    Processes,
    ProcessLog,
    ProcessUse,
    RestartProcess,
    SaidLine,
)
from handrail.messages.programs import (
    CheckTask,
    Deploy,
    Deployment,
    GetOutline,
    Library,
    LibraryEntry,
    ListLibrary,
    Outline,
    OutlineState,
    TaskCheck,
    TaskStep,
)
from handrail.messages.prompts import (
    AnswerPrompt,
    Prompt,
    PromptClosed,
)
from handrail.messages.reach import GetReach, Reach, WaypointReach
from handrail.messages.recordings import (
    BaseAt,
    GetSamples,
    InstanceAt,
    ListRecordings,
    Mark,
    MarkedAt,
    RecordingInfo,
    Recordings,
    Samples,
    StartRecording,
    StopRecording,
)
from handrail.messages.references import (
    FixedPose,
    FrameKnots,
    FrameLine,
    PoseStream,
    PostureKnots,
    Reference,
)
from handrail.messages.remote_engines import (
    CallForEngine,
    CallsForEngine,
    EngineSays,
    FetchCalls,
    Said,
)
from handrail.messages.runs import (
    EngineSnapshot,
    GetEngine,
    GetRunHistory,
    LogLine,
    OnFailure,
    PauseRun,
    ResumeRun,
    Run,
    RunFrom,
    RunHistory,
    RunState,
    SetAutonomy,
    SetBreakpoints,
    SetRunParameters,
    StateVisit,
    StepRun,
    StopRun,
    TakeTransition,
)
from handrail.messages.sensing import (
    DeviceStates,
    DeviceValues,
    ForceTorqueState,
    GripperState,
    ImuState,
    PointCloud,
    PowerState,
)
from handrail.messages.state import (
    Base,
    BusStatistics,
    DaemonStatus,
    DeviceStatus,
    DriveStatus,
    Foot,
    LeaseState,
    LoopStatistics,
    RobotState,
)
from handrail.messages.template_runs import ExpandTemplate, RunTemplate, TemplateProgram

__all__ = [
    "FIRST_KNOT",
    "NOT_READY",
    "NOT_STANDING",
    "ActionEvent",
    "Along",
    "Answer",
    "AnswerPrompt",
    "AttachInstance",
    "Attachment",
    "AwaitPlan",
    "Base",
    "BaseAt",
    "BindKeepalive",
    "BundleState",
    "BusStatistics",
    "CallForEngine",
    "CallsForEngine",
    "CancelAction",
    "CancelPlanning",
    "CartesianImpedance",
    "CentreOfMassGoal",
    "Challenge",
    "CheckIn",
    "CheckTask",
    "Choice",
    "Choices",
    "ClearStop",
    "ClientIdentity",
    "CodeChanged",
    "CommandGripper",
    "Compliance",
    "CompliantMotion",
    "ConfigureController",
    "ContactEnd",
    "ControllerEvent",
    "ControllerInfo",
    "ControllerList",
    "DaemonCall",
    "DaemonEvent",
    "DaemonStatus",
    "Deploy",
    "Deployment",
    "DeviceStates",
    "DeviceStatus",
    "DeviceValues",
    "Disable",
    "Dither",
    "DivergenceEnd",
    "DriveStatus",
    "EditInstance",
    "EditPlan",
    "Enable",
    "EndCondition",
    "EngineCall",
    "EngineEvent",
    "EngineInfo",
    "EngineSays",
    "EngineSnapshot",
    "Engines",
    "ExecutePlan",
    "ExpandTemplate",
    "FetchCalls",
    "FixedPose",
    "Foot",
    "ForceEnd",
    "ForceTorqueState",
    "FrameGoal",
    "FrameKnots",
    "FrameLine",
    "GateCall",
    "GazeGoal",
    "GetBase",
    "GetChallenge",
    "GetControllers",
    "GetEngine",
    "GetEngines",
    "GetHardware",
    "GetIdentity",
    "GetInstances",
    "GetNodePorts",
    "GetNodeSource",
    "GetNodes",
    "GetOutline",
    "GetPlan",
    "GetProcessLog",
    "GetProcesses",
    "GetProgram",
    "GetReach",
    "GetReleases",
    "GetRobot",
    "GetRunHistory",
    "GetSafety",
    "GetSamples",
    "GetStatus",
    "GetTemplate",
    "GetTiming",
    "Goal",
    "GripperAtEnd",
    "GripperHoldsEnd",
    "GripperOrder",
    "GripperState",
    "GroundTruth",
    "GuestCall",
    "HardwareComponent",
    "HardwareStatus",
    "HoldInstance",
    "HoldTime",
    "ImuState",
    "InstanceAt",
    "InstanceEdit",
    "InstanceState",
    "Instances",
    "Jog",
    "Jogged",
    "JointLimitEnd",
    "JointStream",
    "JointTarget",
    "JointTrajectory",
    "JointsGoal",
    "KeepAlive",
    "KeyFrame",
    "Lease",
    "LeaseState",
    "Library",
    "LibraryEntry",
    "LinkEvent",
    "ListLibrary",
    "ListNodes",
    "ListRecordings",
    "LoadController",
    "LogLine",
    "LoopStatistics",
    "LoopTiming",
    "MakePlan",
    "Mark",
    "MarkedAt",
    "Message",
    "Motion",
    "MoveInstance",
    "Name",
    "NodeEntry",
    "NodeLibrary",
    "NodePort",
    "NodePorts",
    "NodeSource",
    "NodeState",
    "Nodes",
    "NonNegative",
    "Ok",
    "OnFailure",
    "Outline",
    "OutlineState",
    "PathForce",
    "PauseAction",
    "PauseRun",
    "Piece",
    "PlaceInstance",
    "PlanGave",
    "PlanMotion",
    "PlanOrigin",
    "PlanPreview",
    "PlanProgress",
    "PlanSegment",
    "PlanSeries",
    "PlanWaypoint",
    "PlanWorst",
    "PointCloud",
    "PortValue",
    "Pose",
    "PoseErrorEnd",
    "PoseStream",
    "Positive",
    "PostureGoal",
    "PostureKnots",
    "PowerState",
    "ProcessLog",
    "ProcessUse",
    "Processes",
    "ProgramParameter",
    "ProgramResource",
    "ProgramSource",
    "Prompt",
    "PromptClosed",
    "Provenance",
    "PutBundle",
    "PutNode",
    "RankChoices",
    "Reach",
    "RecordingInfo",
    "Recordings",
    "RedoEdit",
    "Reference",
    "Refused",
    "RelationGoal",
    "Release",
    "ReleaseInstance",
    "ReleaseKeepalive",
    "ReleaseTime",
    "Releases",
    "ReloadNode",
    "RemoveInstance",
    "RestartProcess",
    "ResumeAction",
    "ResumeRun",
    "ReturnCommand",
    "ReturnLease",
    "RobotInfo",
    "RobotState",
    "RollBack",
    "RolledBack",
    "Run",
    "RunFrom",
    "RunHistory",
    "RunState",
    "RunTemplate",
    "SafetyReport",
    "SafetyRule",
    "Said",
    "SaidLine",
    "Samples",
    "SaveNode",
    "SaveProgram",
    "SaveTemplate",
    "SavedTemplate",
    "SensorEvent",
    "ServiceCall",
    "SetAutonomy",
    "SetBreakpoints",
    "SetJoint",
    "SetParameters",
    "SetRunParameters",
    "SetSpeed",
    "Spec",
    "StaleCause",
    "StallEnd",
    "StartAction",
    "StartBehaviour",
    "StartNode",
    "StartRecording",
    "StateVisit",
    "Step",
    "StepMotion",
    "StepRun",
    "Stop",
    "StopNode",
    "StopRecording",
    "StopRun",
    "StreamJoints",
    "StreamPose",
    "SwitchControllers",
    "SwitchRelay",
    "TakeCommand",
    "TakeLease",
    "TakeTransition",
    "TareSensor",
    "Tared",
    "TaskAxis",
    "TaskCheck",
    "TaskStep",
    "TemplateProgram",
    "TemplateSource",
    "TimeDistribution",
    "TimeEnd",
    "TorqueLimitEnd",
    "TravelEnd",
    "UndoEdit",
    "UnloadController",
    "Vector",
    "WatchPort",
    "WaypointReach",
    "WholeBody",
    "spec",
]

GetNodes.Reply = Nodes
StartNode.Reply = PutNode.Reply = NodeState
GetRobot.Reply = RobotInfo
GetStatus.Reply = DaemonStatus
GetTiming.Reply = LoopTiming
GetBase.Reply = Base
GetHardware.Reply = HardwareStatus
GetSafety.Reply = SafetyReport
TareSensor.Reply = Tared
TakeLease.Reply = Lease
BindKeepalive.Reply = GetChallenge.Reply = KeepAlive.Reply = Challenge
GetControllers.Reply = ControllerList
PlaceInstance.Reply = InstanceState
MoveInstance.Reply = InstanceState
SetParameters.Reply = InstanceState
HoldInstance.Reply = InstanceState
ReleaseInstance.Reply = InstanceState
EditInstance.Reply = InstanceEdit
AttachInstance.Reply = InstanceEdit
SaveTemplate.Reply = SavedTemplate
GetTemplate.Reply = TemplateSource
UndoEdit.Reply = InstanceEdit
RedoEdit.Reply = InstanceEdit
GetInstances.Reply = Instances
GetPlan.Reply = PlanPreview
MakePlan.Reply = PlanPreview
RankChoices.Reply = Choices
PlanMotion.Reply = PlanPreview
EditPlan.Reply = PlanPreview
ListLibrary.Reply = Library
SetJoint.Reply = InstanceState
Deploy.Reply = Deployment
CheckTask.Reply = TaskCheck
Run.Reply = RunState
RunFrom.Reply = RunState
TakeTransition.Reply = RunState
GetRunHistory.Reply = RunHistory
GetOutline.Reply = Outline
GetEngine.Reply = EngineSnapshot
GetReach.Reply = Reach
ExpandTemplate.Reply = TemplateProgram
RunTemplate.Reply = RunState

DaemonCall = (
    GetRobot
    | GetStatus
    | GetTiming
    | GetBase
    | GetHardware
    | GetSafety
    | GetControllers
    | LoadController
    | ConfigureController
    | SwitchControllers
    | UnloadController
    | Enable
    | Disable
    | Stop
    | ClearStop
    | CheckIn
    | TakeLease
    | BindKeepalive
    | GetChallenge
    | KeepAlive
    | ReleaseKeepalive
    | ReturnLease
    | HoldTime
    | ReleaseTime
    | StartAction
    | StartBehaviour
    | CancelAction
    | PauseAction
    | ResumeAction
    | SetSpeed
    | StreamPose
    | StreamJoints
    | CommandGripper
    | SwitchRelay
    | TareSensor
)
DaemonEvent = RobotState | DaemonStatus | ActionEvent | DeviceStates | ControllerEvent | LogLine
SensorEvent = PointCloud
"""what a camera's process publishes (topic `sensors.events`)"""
EngineCall = (
    PlaceInstance
    | MoveInstance
    | SetParameters
    | EditInstance
    | AttachInstance
    | SaveTemplate
    | GetTemplate
    | UndoEdit
    | RedoEdit
    | HoldInstance
    | ReleaseInstance
    | RemoveInstance
    | GetInstances
    | GetPlan
    | MakePlan
    | CancelPlanning
    | RankChoices
    | PlanMotion
    | EditPlan
    | ExecutePlan
    | AwaitPlan
    | Jog
    | ListLibrary
    | Deploy
    | CheckTask
    | Run
    | PauseRun
    | ResumeRun
    | StopRun
    | StepRun
    | SetBreakpoints
    | TakeTransition
    | RunFrom
    | SetRunParameters
    | SetAutonomy
    | GetRunHistory
    | GetOutline
    | AnswerPrompt
    | GetEngine
    | GetNodes
    | StartNode
    | StopNode
    | PutNode
    | ReloadNode
    | WatchPort
    | PutBundle
    | GetProgram
    | SaveProgram
    | ListNodes
    | GetNodePorts
    | GetNodeSource
    | SaveNode
    | GetReleases
    | RollBack
    | GetEngines
    | SetJoint
    | GetReach
    | ExpandTemplate
    | RunTemplate
)
GuestCall = FetchCalls | EngineSays
"""what an engine on another machine asks the gate"""
ServiceCall = GetProcesses | GetProcessLog | RestartProcess | StartRecording | StopRecording | Mark | ListRecordings
"""what the supervisor of the robot's service answers"""
GateCall = GetIdentity | GetSamples | TakeCommand | ReturnCommand
"""what the link answers itself"""
LinkEvent = Mark
"""what the link tells on the robot's own side (topic `link.events`)"""
EngineEvent = (
    InstanceState
    | PlanPreview
    | PlanProgress
    | RunState
    | Prompt
    | PromptClosed
    | LogLine
    | CodeChanged
    | EngineInfo
    | PortValue
    | Reach
)
Answer = (
    Ok
    | Refused
    | RobotInfo
    | DaemonStatus
    | LoopTiming
    | Base
    | HardwareStatus
    | SafetyReport
    | Lease
    | Challenge
    | Tared
    | ControllerList
    | InstanceState
    | Instances
    | InstanceEdit
    | SavedTemplate
    | TemplateSource
    | PlanPreview
    | Choices
    | Library
    | Deployment
    | TaskCheck
    | Outline
    | RunState
    | RunHistory
    | EngineSnapshot
    | Jogged
    | Nodes
    | NodeState
    | BundleState
    | Releases
    | RolledBack
    | Engines
    | CallsForEngine
    | ProgramSource
    | NodeLibrary
    | NodePorts
    | NodeSource
    | Reach
    | TemplateProgram
    | Processes
    | ProcessLog
    | ClientIdentity
    | Recordings
    | Samples
)
