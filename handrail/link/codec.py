"""What crosses the link, byte for byte: one MessagePack struct of `handrail.messages`, zstd-compressed where it pays.

A payload is one byte that says how the rest is packed (0: as it is, 1: zstd with its size in the frame's header), then the
struct. Only types whose `spec` is remote are known here, and numbers must be finite. Whoever decodes takes nothing on trust: every
way in which bytes can be wrong ends in `Malformed`, and sizes are checked before memory is taken.

Calls travel as ``[number, payload]`` with a number of 8 bytes that the answer ``[number, payload]`` repeats; events as
``[type name, payload]``. A subscriber that wants to know when its stream is live also subscribes to ``sync.TOKEN``, which the
gate echoes.
"""

from __future__ import annotations

import datetime
import functools
import math
import operator
from typing import Any, get_args

import msgspec
import zstandard

from handrail.messages import (
    Answer,
    AttachInstance,
    AwaitPlan,
    BindKeepalive,
    CancelAction,
    CheckIn,
    CheckTask,
    CommandGripper,
    DaemonCall,
    DaemonEvent,
    Deploy,
    Disable,
    EditInstance,
    EditPlan,
    Enable,
    EngineCall,
    EngineEvent,
    EngineSays,
    ExecutePlan,
    ExpandTemplate,
    GateCall,
    GetChallenge,
    GetEngine,
    GetEngines,
    GetIdentity,
    GetInstances,
    GetNodePorts,
    GetNodes,
    GetNodeSource,
    GetOutline,
    GetPlan,
    GetProcesses,
    GetProcessLog,
    GetProgram,
    GetReach,
    GetReleases,
    GetRobot,
    GetRunHistory,
    GetSafety,
    GetSamples,
    GetStatus,
    GetTemplate,
    GuestCall,
    HoldInstance,
    HoldTime,
    InstanceState,
    Jog,
    KeepAlive,
    ListLibrary,
    ListNodes,
    ListRecordings,
    MakePlan,
    Mark,
    Message,
    MoveInstance,
    PauseAction,
    PlaceInstance,
    PlanMotion,
    PutBundle,
    PutNode,
    RankChoices,
    RedoEdit,
    ReleaseInstance,
    ReleaseKeepalive,
    ReleaseTime,
    ReloadNode,
    RemoveInstance,
    RestartProcess,
    ResumeAction,
    ReturnLease,
    RollBack,
    Run,
    RunFrom,
    RunTemplate,
    SaveNode,
    SaveProgram,
    SensorEvent,
    ServiceCall,
    SetJoint,
    SetParameters,
    SetSpeed,
    StartAction,
    StartBehaviour,
    StartNode,
    StartRecording,
    Stop,
    StopRecording,
    StreamJoints,
    StreamPose,
    TakeLease,
    UndoEdit,
    WatchPort,
    spec,
)

LARGEST_CALL = 1 << 20
"""bytes of a call's struct, unpacked"""
LARGEST_ANSWER = 64 << 20
"""bytes of an answer's or event's struct, unpacked"""
SYNC = b"sync."
"""prefix of the topics that the gate echoes as soon as they are subscribed"""

_PLAIN, _ZSTD = b"\x00", b"\x01"
_NOT_PLAIN = (bytes, bytearray, memoryview, datetime.datetime)
_WORTH_COMPRESSING = 256
_PAYS = 0.9
"""a payload is sent compressed if that leaves less than this share of it"""


class NoAnswer(Message):
    """The gate is there, but who should answer is not: the daemon or engine is down, restarting, or too slow."""

    message: str


def _remote(*unions: Any) -> tuple[type, ...]:
    return tuple(kind for union in unions for kind in get_args(union) or (union,) if spec(kind).remote)


DAEMON_CALLS = _remote(DaemonCall)
ENGINE_CALLS = _remote(EngineCall)
GUEST_CALLS = _remote(GuestCall)
"""how an engine on another machine is there (`handrail.link.guests`)"""
SERVICE_CALLS = _remote(ServiceCall)
"""what the supervisor of all processes answers"""
REMOTE_CALL: Any = functools.reduce(
    operator.or_, DAEMON_CALLS + ENGINE_CALLS + GUEST_CALLS + SERVICE_CALLS + _remote(GateCall)
)
"""union of the calls that the link takes"""
COMMANDS = (
    *(StartAction, StartBehaviour, StreamPose, StreamJoints, CancelAction, PauseAction, ResumeAction),
    *(CheckIn, TakeLease, ReturnLease, HoldTime, ReleaseTime),
)
"""calls of engines to the daemon, which the link takes from keys of engines, too"""
REMOTE_CALL_OF_ENGINES: Any = functools.reduce(operator.or_, (SetJoint, *COMMANDS), REMOTE_CALL)
"""union of the calls that the link takes from keys of engines"""
REMOTE_EVENTS = {kind.__name__: kind for kind in _remote(DaemonEvent, EngineEvent, SensorEvent)}
"""name → type of the events that the link carries"""
GUEST_EVENTS = {
    name: kind for name, kind in REMOTE_EVENTS.items() if kind in get_args(EngineEvent) and kind is not InstanceState
}
"""those that an engine on another machine may tell: instances are the first engine's"""
REMOTE_ANSWER: Any = Answer | NoAnswer

CODE = (PutBundle, SaveProgram, SaveNode, RollBack, ReloadNode)
"""calls that change which code runs on the robot: a developer's. StartNode is none: it runs what the library has"""
OBSERVING = (
    *(ListRecordings, GetSamples),
    *(GetIdentity, GetRobot, GetStatus, GetSafety, GetProcesses, GetProcessLog),
    *(GetEngines, GetEngine, GetInstances, GetPlan, GetReach, GetRunHistory, GetOutline, GetNodes, WatchPort),
    *(ListLibrary, GetProgram, GetTemplate, ListNodes, GetNodePorts, GetNodeSource, GetReleases, AwaitPlan, Stop),
)
"""calls that change nothing, and STOP, which is everybody's: all that an observer may say"""
SIGNED = (
    *(RestartProcess, StartRecording, StopRecording, Mark),
    PutBundle,
    SaveProgram,
    SaveNode,
    RollBack,
    CommandGripper,
    BindKeepalive,
    GetChallenge,
    KeepAlive,
    ReleaseKeepalive,
    SetSpeed,
    PlaceInstance,
    MoveInstance,
    SetParameters,
    EditInstance,
    AttachInstance,
    RemoveInstance,
    UndoEdit,
    RedoEdit,
    HoldInstance,
    ReleaseInstance,
    *(StreamPose, StreamJoints, CancelAction, PauseAction, ResumeAction),
)
"""calls on which the gate writes whose key they came with (`by`), and what that may do (`role`)"""
RAW = (PutBundle, EngineSays)
"""calls that carry bytes, and no value of any kind that a client likes"""

_TIMEOUTS_S: dict[type, float] = {
    Stop: 1.0,
    Enable: 10.0,
    Disable: 10.0,
    MakePlan: 60.0,
    PlanMotion: 60.0,
    EditPlan: 60.0,
    RankChoices: 60.0,
    CheckTask: 120.0,
    GetReach: 60.0,
    ExecutePlan: 10.0,
    AwaitPlan: 600.0,
    Jog: 120.0,
    Deploy: 20.0,
    Run: 15.0,
    RunFrom: 25.0,
    RunTemplate: 20.0,
    ExpandTemplate: 20.0,
    PutBundle: 60.0,
    SaveProgram: 60.0,
    SaveNode: 60.0,
    RollBack: 60.0,
    StartNode: 60.0,
    GetNodePorts: 60.0,
    ReloadNode: 60.0,
    PutNode: 30.0,
    ListRecordings: 20.0,
    GetSamples: 20.0,
}
_TIMEOUT_S = 5.0


def timeout_s(kind: type) -> float:
    """How long the robot's side may take to answer a call of this type."""
    return _TIMEOUTS_S.get(kind, _TIMEOUT_S)


class Malformed(ValueError):
    """Bytes that are no message of the link. `where` names the field if there is one."""

    def __init__(self, problem: str, where: str = "", value: object = "", expected: str = ""):
        super().__init__(problem)
        self.where, self.value, self.expected = where, str(value)[:80], expected


class Packer:
    """Packs structs into payloads. Not safe to share between threads."""

    def __init__(self, level: int = 3):
        self._encoder = msgspec.msgpack.Encoder()
        self._compressor = zstandard.ZstdCompressor(level=level, write_content_size=True)

    def pack(self, message: msgspec.Struct) -> bytes:
        return self.pack_encoded(self._encoder.encode(message))

    def pack_encoded(self, encoded: bytes) -> bytes:
        """The same for a struct that is MessagePack already."""
        if len(encoded) >= _WORTH_COMPRESSING:
            compressed = self._compressor.compress(encoded)
            if len(compressed) < _PAYS * len(encoded):
                return _ZSTD + compressed
        return _PLAIN + encoded


class Unpacker:
    """Reads payloads as one of the given types, strictly. Not safe to share between threads."""

    def __init__(self, kinds: Any, largest: int):
        """`kinds`: a message type or union of them; `largest`: bytes that a struct may have when unpacked."""
        self._decoder = msgspec.msgpack.Decoder(kinds)
        self._decompressor = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        self._largest = largest

    def unpack(self, payload: bytes) -> Any:
        """The message. Raises Malformed, whatever the bytes are."""
        encoded = self._expand(payload)
        try:
            return self._decoder.decode(encoded)
        except msgspec.ValidationError as error:
            problem, _, where = str(error).partition(" - at `$")
            raise Malformed(problem, where.rstrip("`").lstrip(".")) from error
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise Malformed(f"not MessagePack: {error}") from error
        except RecursionError as error:
            raise Malformed("nested too deeply") from error

    def _expand(self, payload: bytes) -> bytes:
        packing, body = payload[:1], payload[1:]
        if packing == _ZSTD:
            try:
                size = zstandard.frame_content_size(body)
                # Without a size in the header the frame could unpack to anything: it is not ours.
                if 0 <= size <= self._largest:
                    return self._decompressor.decompress(body, max_output_size=self._largest, allow_extra_data=False)
            except zstandard.ZstdError as error:
                raise Malformed(f"not zstd: {error}") from error
            raise Malformed("too large", "payload", size, f"a size in the header, of at most {self._largest} bytes")
        if packing != _PLAIN:
            raise Malformed("unknown packing", "payload", packing.hex(), "00 or 01")
        if len(body) > self._largest:
            raise Malformed("too large", "payload", len(body), f"at most {self._largest} bytes")
        return body


def check_plain(message: msgspec.Struct) -> None:
    """Refuse what MessagePack can carry but no call means: non-finite numbers, extension types, raw bytes. Raises Malformed."""
    try:
        _check_plain(msgspec.to_builtins(message, builtin_types=_NOT_PLAIN), "")
    except RecursionError as error:
        raise Malformed("nested too deeply") from error
    except TypeError as error:  # to_builtins meets an object that has no plain form, such as an extension type
        raise Malformed(f"a value that no call has: {error}") from error


def _check_plain(value: Any, where: str) -> None:
    match value:
        case float():
            if not math.isfinite(value):
                raise Malformed("not a finite number", where, value, "a finite number")
        case dict():
            for key, inner in value.items():
                if not isinstance(key, str):
                    raise Malformed("a map's key is not text", where, key, "text")
                _check_plain(inner, f"{where}.{key}" if where else key)
        case list() | tuple():
            for row, inner in enumerate(value):
                _check_plain(inner, f"{where}[{row}]")
        case None | str() | bool() | int():
            pass
        case _:
            raise Malformed("a value that no call has", where, type(value).__name__, "number, text, list, map, null")
