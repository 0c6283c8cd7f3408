"""The plant with a door for tests: the service of `hal.plant.service`, a witness of every step, and requests served in between.

python -m hal.hil.plant_process --robot NAME --scene SCENE --clock lockstep|wall --runtime DIR
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt
import zmq

from hal.can.hub import Hub
from hal.drives.lifecycle import DriveError, State
from hal.drives.protocol import LimbProtocol
from hal.hil import door
from hal.hil.door import Await, Done, Fail, Look, No, Place, Push, Recall, Seen, Transition, Was
from hal.plant import scene, service
from hal.plant.bullet import pybullet as p
from hal.plant.drive_node import STEP_NS
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.runtime import Runtime

_PATIENCE_S = 0.01
"""longest wait on the bus, so that the door is served while time stands"""
SILENCE_S = 2.0
"""as hal.plant.service's, but longer: on a machine that is busy with other tests a host may have to wait for its turn"""
_TRACE_STEPS, _TRACE_KEPT = 10, 6000
"""one step of so many is remembered for `Recall`, and so many of them: a minute"""


class WatchedWorld(World):
    """A world that notes what really happens in every step."""

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, **options)
        n = len(self.position)
        self._faults: list[tuple[int, Fail]] = []
        self._pushes: list[tuple[int, int, tuple[float, float, float]]] = []
        self._states, self._errors = np.full(n, 255, np.uint8), np.zeros(n, np.uint8)
        self._last_states, self._speeding = self.drives.state.copy(), np.zeros(n, np.int64)
        self._trace, self._trace_ns = np.zeros((_TRACE_KEPT, n)), np.full(_TRACE_KEPT, -1, np.int64)
        self._remember()
        self._begin()

    def _remember(self) -> None:
        row = self.steps // _TRACE_STEPS % _TRACE_KEPT
        self._trace[row], self._trace_ns[row] = self.position, self.time_ns

    def _recall(self, time_ns: int) -> Was | No:
        known = np.flatnonzero(self._trace_ns >= 0)
        oldest, now = int(self._trace_ns[known].min()), self.time_ns
        if not oldest <= time_ns <= now:
            return No(f"time_ns {time_ns}: not remembered; expected {oldest} to {now}")
        row = known[np.where(self._trace_ns[known] <= time_ns, self._trace_ns[known], -1).argmax()]
        joints = dict(zip(self.description.joints, self._trace[row].tolist(), strict=True))
        return Was(time_ns=int(self._trace_ns[row]), joints=joints)

    def _begin(self) -> None:
        """A new window."""
        self.since_ns = self.time_ns
        self._lowest, self._highest = self.position.copy(), self.position.copy()
        self._fastest, self._longest = np.abs(self.velocity), np.zeros(len(self.position), np.int64)
        self._peaks: dict[str, float] = dict(self.contact_force)
        self._transitions: list[Transition] = []

    def go_on(self, most: int) -> int:
        self.step(felt=most == 1)  # every one is looked at
        return 1

    def step(self, *, felt: bool = True) -> None:
        for due, fault in [entry for entry in self._faults if entry[0] <= self.time_ns]:
            self._faults.remove((due, fault))
            for joint in fault.joints:
                self.drives.fail(self.description.joints.index(joint), DriveError[fault.error.upper()])
        for until, link, push in self._pushes:
            if self.time_ns < until:
                middle = p.getLinkState(self._robot, link, physicsClientId=self._client)[0]
                p.applyExternalForce(self._robot, link, push, middle, p.WORLD_FRAME, physicsClientId=self._client)
        super().step(felt=felt)
        if self.steps % _TRACE_STEPS == 0:
            self._remember()
        speed = np.abs(self.velocity)
        np.minimum(self._lowest, self.position, out=self._lowest)
        np.maximum(self._highest, self.position, out=self._highest)
        np.maximum(self._fastest, speed, out=self._fastest)
        if (fast := speed > self.description.velocity_limit).any():
            self._speeding = np.where(fast, self._speeding + STEP_NS, 0)
            np.maximum(self._longest, self._speeding, out=self._longest)
        else:
            self._speeding[:] = 0
        for name, force in self.contact_force.items():
            self._peaks[name] = max(self._peaks[name], force)
        if (self.drives.state != self._last_states).any():
            self._note_transitions()

    def _note_transitions(self) -> None:
        for row in np.flatnonzero(self.drives.state != self._last_states):
            self._transitions.append(
                Transition(
                    time_ns=self.time_ns,
                    joint=self.description.joints[row],
                    state=State(int(self.drives.state[row])).name.lower(),
                    error=DriveError(int(self.drives.error[row])).name.lower(),
                )
            )
        self._last_states[:] = self.drives.state

    # ------------------------------------------------------------------------------------------------- what is asked for

    def answer(self, request: door.Request) -> Seen | Was | Done | No:
        """Do what a test asks."""
        match request:
            case Await():
                return self._seen()
            case Look(anew=anew):
                seen = self._seen()
                if anew:
                    self._begin()
                return seen
            case Recall(time_ns=time_ns):
                return self._recall(time_ns)
            case Fail(joints=joints, error=error, after=after):
                if error.upper() not in DriveError.__members__ or error.upper() == "NONE":
                    known = ", ".join(name.lower() for name in DriveError.__members__ if name != "NONE")
                    return No(f"drive error {error!r}; expected one of {known}")
                if unknown := [joint for joint in joints if joint not in self.description.joints]:
                    return No(f"joints {unknown}: not of {self.description.name}")
                self._faults.append((self.time_ns + round(after * 1e9), request))
            case Push(link=link, force=force, duration=duration):
                links = {
                    p.getJointInfo(self._robot, i, physicsClientId=self._client)[12].decode(): i
                    for i in range(p.getNumJoints(self._robot, physicsClientId=self._client))
                }
                if link not in links:
                    return No(f"link {link!r}: not of {self.description.name}; it has {', '.join(links)}")
                self._pushes.append((self.time_ns + round(duration * 1e9), links[link], force))
            case Place(positions=positions):
                if unknown := [joint for joint in positions if joint not in self.description.joints]:
                    return No(f"joints {unknown}: not of {self.description.name}")
                target = self.position.copy()
                for joint, angle in positions.items():
                    target[self.description.joints.index(joint)] = angle
                self.place(target)
                self._begin()
        return Done(self.time_ns)

    def has_come(self, awaited: Await) -> bool:
        """Whether what a test waits for is the case."""
        if awaited.until_ns is not None:
            return self.time_ns >= awaited.until_ns
        names, states = self.description.joints, self.drives.state
        return all(State(int(states[names.index(joint)])).name.lower() == awaited.state for joint in awaited.joints)

    def _seen(self) -> Seen:
        drives = self.drives
        return Seen(
            joints=list(self.description.joints),
            since_ns=self.since_ns,
            truth=self.truth(),
            velocity=self.velocity.tolist(),
            lowest=self._lowest.tolist(),
            highest=self._highest.tolist(),
            fastest=self._fastest.tolist(),
            speeding_ns=self._longest.tolist(),
            peak_contact_force=dict(self._peaks),
            states=[State(state).name.lower() for state in drives.state.tolist()],
            errors=[DriveError(error).name.lower() for error in drives.error.tolist()],
            braked=drives.brakes.tolist(),
            transitions=self._transitions,
        )


class Doorkeeper:
    """The plant's hub; between two turns of the bus it serves the door."""

    def __init__(self, hub: Hub, world: WatchedWorld, runtime: Runtime):
        self._hub, self._world = hub, world
        self._door: zmq.Socket = zmq.Context.instance().socket(zmq.REP)
        self._door.setsockopt(zmq.LINGER, 0)
        self._door.bind(door.endpoint(runtime))
        self._awaited: tuple[Await, float] | None = None
        """what has not come yet, and until when by the monotonic clock it is waited for"""

    def poll(self, timeout_s: float | None = 0.0) -> npt.NDArray[np.void]:
        """As the hub's, but it does not wait long."""
        while self._awaited is not None or self._door.poll(0):
            if self._awaited is None:
                try:
                    request = door.decode_request(self._door.recv())
                except msgspec.DecodeError as problem:
                    self._door.send(door.encode(No(f"not a request that is known here: {problem}")))
                    continue
                if isinstance(request, Await) and not set(request.joints) <= set(self._world.description.joints):
                    self._door.send(door.encode(No(f"joints {request.joints}: not of {self._world.description.name}")))
                    continue
            else:
                request = self._awaited[0]
            if isinstance(request, Await) and not self._world.has_come(request):
                if self._awaited is None:
                    self._awaited = request, time.monotonic() + request.patience_s
                if time.monotonic() < self._awaited[1]:
                    break
            self._awaited = None
            self._door.send(door.encode(self._world.answer(request)))
        return self._hub.poll(_PATIENCE_S if timeout_s is None else min(timeout_s, _PATIENCE_S))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hub, name)


def _prepare(plant: service.Service, runtime: Runtime) -> None:
    assert isinstance(plant.world, WatchedWorld)
    plant.hub = Doorkeeper(plant.hub, plant.world, runtime)  # type: ignore[assignment]


def warm_up(robot: str, scene_name: str) -> None:
    """All that a plant of this robot compiles and loads, ahead of its start (hal.hil.nursery); no scene: nothing around it."""
    description = robots.load(robot)
    service.warm_up(description, scene.load(scene_name) if scene_name else scene.EMPTY)
    with tempfile.TemporaryDirectory(prefix="hil") as folder:
        bus = Path(folder) / "bus.sock"
        with contextlib.closing(Hub(bus, [channel.name for channel in description.channels])):
            LimbProtocol(description)


if __name__ == "__main__":
    service.SILENCE_S = SILENCE_S
    service.main(WatchedWorld, _prepare)
