"""Torques into a body's joints, one step, and states of joints and links out: what a world does a thousand times a second.

PyBullet's Python functions for it make tuples of nine numbers of every joint, and copy two kilobytes of description a joint to
find its place: a third of a step's time. The same library exports C functions; only the client that these want to be told is
private to it, so that its table of clients is looked up among the library's symbols. Where there are none (a stripped library,
another system), where the library is not of the version whose arguments are known, or where C's first look at the body differs
from Python's, the Python functions do the same, to the bit. A client that is gone is never told anything: its place in the table
says so before every call.
"""

from __future__ import annotations

import ctypes
import mmap
import struct
from collections.abc import Sequence
from functools import cache
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import numpy.typing as npt
from numba import carray, types
from numba.extending import intrinsic

from hal.plant.bullet import pybullet as p
from handrail.compiled import compiled

FELT = 9
"""Columns of a joint's row in `JointPort.felt`: position, velocity, reaction (6) where it is sensed, what its motor does."""
MOVED = 13
"""Columns of a link's row in `JointPort.moved`, of its inertial frame in the world: position, orientation (x, y, z, w), velocity
m/s, angular velocity rad/s."""
_VERSION = 202010061
"""of PyBullet's interface (pybullet.getAPIVersion): that of the C functions' arguments below"""
_MOTOR = 8
_SECTION, _SYMBOL_TABLE = "<IIQQQQIIQQ", 2
_SYMBOL = np.dtype(
    [("name", "<u4"), ("info", "u1"), ("other", "u1"), ("section", "<u2"), ("value", "<u8"), ("size", "<u8")]
)


class JointPort:
    """The way to some joints and links of one body. Arrays are written by what it does: never rebind them."""

    def __init__(
        self,
        body: int,
        client: int,
        driven: Sequence[int],
        watched: Sequence[int] = (),
        links: Sequence[int] = (),
        *,
        native: bool = True,
    ):
        """driven, watched: PyBullet's joints that get torques, and whose whole states are wanted; links: whose motion is, without
        the base. native: by C, if possible."""
        self._body, self._client = body, client
        self._driven, self._watched, self._links = tuple(driven), tuple(watched), tuple(links)
        n, k = len(self._driven), len(self._watched)
        self._memory = np.zeros(2 * n + FELT * k)
        self.position, self.velocity = self._memory[: 2 * n].reshape(2, n)
        """rad or m, and per s, (driven,)"""
        self.felt = self._memory[2 * n :].reshape(k, FELT)
        """states of the watched joints, (watched, FELT)"""
        self.moved = np.zeros((len(self._links), MOVED))
        """motion of the links when they were last looked at, (links, MOVED)"""
        self._rows = np.array(self._links, np.int64)
        # Joint's number, and its places among all positions and all velocities of the body.
        places = [p.getJointInfo(body, joint, physicsClientId=client) for joint in (*driven, *watched)]
        self._places = np.array([(place[0], place[3], place[4]) for place in places], np.int64).reshape(n + k, 3)
        self._pointers = np.zeros(4, np.int64)
        self._place = _place_of(client) if native else None
        self._handle = 0
        self.look()
        self.look_at_links()
        if self._place is not None and self._c_sees_the_same(self._place.value):
            self._handle = self._place.value

    @property
    def native(self) -> bool:
        """C functions are used: they were when this was made, and the client is still there."""
        return self._handle != 0 and self._place is not None and self._place.value == self._handle

    @property
    def parts(self) -> tuple[Any, ...]:
        """What `submit` takes beside the torques, where this is `native`."""
        return self._handle, self._body, self._places, self._memory, self._pointers

    def _c_sees_the_same(self, handle: int) -> bool:
        memory, moved = self._memory.copy(), self.moved.copy()
        try:
            _look(handle, self._body, len(self._driven), self._places, memory, self._pointers)
            _look_at_links(handle, self._body, self._rows, moved, self._pointers)
        except RuntimeError:
            return False
        return memory.tobytes() == self._memory.tobytes() and moved.tobytes() == self.moved.tobytes()

    def step(self, torque: npt.NDArray[np.float64]) -> None:
        """Let the world go on by one step with torques N·m or N (driven,), and look."""
        if self.native:
            submit(self._handle, self._body, torque, self._places, self._memory, self._pointers)
            return
        p.setJointMotorControlArray(
            self._body, self._driven, p.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=self._client
        )
        p.stepSimulation(physicsClientId=self._client)
        self.look()

    def look_at_links(self) -> None:
        """Read the motion of the links as it is now: all at once, since PyBullet works out the whole body's each time."""
        if not self._links:
            return
        if self.native:
            _look_at_links(self._handle, self._body, self._rows, self.moved, self._pointers)
            return
        states = p.getLinkStates(
            self._body, self._links, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=self._client
        )
        for row, state in zip(self.moved, states, strict=True):
            row[:] = *state[0], *state[1], *state[6], *state[7]

    def close(self) -> None:
        """The client is gone: from now on PyBullet's own functions raise what they raise then."""
        self._handle = 0

    def look(self) -> None:
        """Read the joints as they are now. Raises pybullet.error without a client."""
        states = p.getJointStates(self._body, (*self._driven, *self._watched), physicsClientId=self._client)
        n = len(self._driven)
        self.position[:], self.velocity[:], _, _ = zip(*states[:n], strict=True)
        for row, (position, velocity, reaction, motor) in zip(self.felt, states[n:], strict=True):
            row[:] = position, velocity, *reaction, motor


def _of_c(name: str, result: Any, *arguments: Any) -> Any:
    return types.ExternalFunction(name, result(*arguments))


_POINTER = types.intp
_control = _of_c("b3JointControlCommandInit2", _POINTER, _POINTER, types.int32, types.int32)
_set_torque = _of_c("b3JointControlSetDesiredForceTorque", types.int32, _POINTER, types.int32, types.float64)
_step = _of_c("b3InitStepSimulationCommand", _POINTER, _POINTER)
_request = _of_c("b3RequestActualStateCommandInit", _POINTER, _POINTER, types.int32)
_with_velocity = _of_c("b3RequestActualStateCommandComputeLinkVelocity", types.int32, _POINTER, types.int32)
_with_kinematics = _of_c("b3RequestActualStateCommandComputeForwardKinematics", types.int32, _POINTER, types.int32)
wait = _of_c("b3SubmitClientCommandAndWaitStatus", _POINTER, _POINTER, _POINTER)
_kind = _of_c("b3GetStatusType", types.int32, _POINTER)
_state = _of_c("b3GetStatusActualState2", types.int32, *[_POINTER] * 13)
sensors_of = _of_c("b3CreateSensorCommandInit", _POINTER, _POINTER, types.int32)
feel_joint = _of_c("b3CreateSensorEnable6DofJointForceTorqueSensor", types.int32, _POINTER, types.int32, types.int32)
"""C functions for compiled code, once `JointPort.native` says that the library is loaded"""
_FUNCTIONS = [
    each.symbol
    for each in (
        _control,
        _set_torque,
        _step,
        _request,
        _with_velocity,
        _with_kinematics,
        wait,
        _kind,
        _state,
        sensors_of,
        feel_joint,
    )
]
_TORQUE_CONTROL = int(p.TORQUE_CONTROL)
_STATE_TOLD = 21
"""CMD_ACTUAL_STATE_UPDATE_COMPLETED (Bullet's SharedMemoryPublic.h). Of another status, such as that of a body that has been
removed, b3GetStatusActualState2 gives addresses where nothing is."""


def _numbers_at(typing: Any, address: Any) -> Any:
    pointer = types.CPointer(types.float64)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(pointer))

    return pointer(types.intp), generate


_numbers: Any = intrinsic(_numbers_at)


@compiled
def _look(client, body, n, places, memory, pointers):  # type: ignore[no-untyped-def]
    """Write JointPort's memory, of which n joints are driven. Raises RuntimeError if PyBullet does not answer."""
    at = pointers.ctypes.data
    status = wait(client, _request(client, np.int32(body)))
    if (
        status == 0
        or _kind(status) != _STATE_TOLD
        or _state(status, 0, 0, 0, 0, 0, at, at + 8, at + 16, 0, at + 24, 0, 0) == 0
    ):
        raise RuntimeError("PyBullet does not tell the state of its bodies")
    # Base and joints, position and velocity, reactions, motors: as many of each as PyBullet has at most.
    most = 7 + 128
    positions, velocities = carray(_numbers(pointers[0]), most), carray(_numbers(pointers[1]), most)
    reactions, motors = carray(_numbers(pointers[2]), 6 * 128), carray(_numbers(pointers[3]), 128)
    for j in range(n):
        memory[j], memory[n + j] = positions[places[j, 1]], velocities[places[j, 2]]
    for k in range(n, len(places)):
        joint, at_position, at_velocity = places[k]
        row = memory[2 * n + FELT * (k - n) : 2 * n + FELT * (k - n + 1)]
        row[0] = positions[at_position] if at_position >= 0 else 0.0
        row[1] = velocities[at_velocity] if at_velocity >= 0 else 0.0
        row[2:_MOTOR] = reactions[6 * joint : 6 * (joint + 1)]
        row[_MOTOR] = motors[joint]


@compiled
def submit(client, body, torque, places, memory, pointers):  # type: ignore[no-untyped-def]
    """Torques, step, state. places (joints, 3), memory: JointPort's; pointers (4,): room for four addresses.

    Raises RuntimeError if PyBullet does not answer.
    """
    n = len(torque)
    command = _control(client, np.int32(body), np.int32(_TORQUE_CONTROL))
    for j in range(n):
        _set_torque(command, np.int32(places[j, 2]), torque[j])
    wait(client, command)
    wait(client, _step(client))
    _look(client, body, n, places, memory, pointers)


@compiled
def _look_at_links(client, body, links, moved, pointers):  # type: ignore[no-untyped-def]
    """Write JointPort's `moved` for its links. Raises RuntimeError if PyBullet does not answer."""
    request = _request(client, np.int32(body))
    _with_velocity(request, np.int32(1))
    _with_kinematics(request, np.int32(1))
    at = pointers.ctypes.data
    status = wait(client, request)
    if status == 0 or _kind(status) != _STATE_TOLD or _state(status, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, at, at + 8) == 0:
        raise RuntimeError("PyBullet does not tell the state of its bodies")
    poses, rates = carray(_numbers(pointers[0]), 7 * 128), carray(_numbers(pointers[1]), 6 * 128)
    for row in range(len(links)):
        link = links[row]
        moved[row, :7] = poses[7 * link : 7 * (link + 1)]
        moved[row, 7:] = rates[6 * link : 6 * (link + 1)]


def _place_of(client: int) -> ctypes.c_size_t | None:
    """Where PyBullet keeps the C functions' handle of one of its clients, 0 once it is gone; None where it cannot be had."""
    # Only of a server in this process: one behind a window or another process may go while a call waits for it.
    connection = p.getConnectionInfo(client)
    if not connection["isConnected"] or connection["connectionMethod"] != p.DIRECT:
        return None
    table = _table_of_clients()
    return None if table is None else ctypes.c_size_t.from_address(table + client * ctypes.sizeof(ctypes.c_size_t))


@cache
def _table_of_clients() -> int | None:
    """Address of the library's table of clients; None where it cannot be known."""
    if p.getAPIVersion() != _VERSION:
        return None
    library = ctypes.CDLL(p.__file__)
    if not all(hasattr(library, name) for name in _FUNCTIONS):
        return None
    table, known = _symbol(b"sPhysicsClients1"), _symbol(_FUNCTIONS[0].encode())
    if table is None or known is None:
        return None
    address = ctypes.cast(getattr(library, _FUNCTIONS[0]), ctypes.c_void_p).value
    assert address is not None
    llvm.load_library_permanently(p.__file__)
    return address - known + table


def _symbol(name: bytes) -> int | None:
    """Where a symbol is from the start of PyBullet's library, private ones too (ELF, 64 bits); None if nowhere."""
    with open(p.__file__, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as library:
        if library[:5] != b"\x7fELF\x02":
            return None
        (start,) = struct.unpack_from("<Q", library, 0x28)
        size, count = struct.unpack_from("<HH", library, 0x3A)
        sections = [struct.unpack_from(_SECTION, library, start + number * size) for number in range(count)]
        for _, kind, _, _, offset, length, names, *_ in sections:
            if kind != _SYMBOL_TABLE:
                continue
            at, room = sections[names][4:6]
            place = library[at : at + room].find(b"\0" + name + b"\0") + 1
            symbols = np.frombuffer(library[offset : offset + length], _SYMBOL)
            found = symbols["value"][symbols["name"] == place]
            if place and len(found):
                return int(found[0])
    return None
