"""One connection to a robot: attaches early or late, survives the link going away, and keeps the network off the window's thread.

Six threads, none of which the window ever waits for:

- *keeper*: fetches the snapshot that a late client needs, then asks for the status once a second to know that the robot is still
  there, and how long the way to it takes; after an interruption it fetches the snapshot again.
- *listener*: receives events, and tells the keeper when they began anew.
- *caller*: sends the operator's calls, one after the other; *planner* those that may take long, so that none waits behind them.
- *mover*: sends where the robot is to go by hand, the newest place only, and waits for no arrival.
- *stopper*: sends STOP and nothing else, on a connection of its own (`stopper.py`).

What they learn goes into the `Inbox`; `handrail.client` does the talking.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol, TypeVar

from handrail.client import Live, Selection
from handrail.messages import (
    ActionEvent,
    CheckTask,
    ClientIdentity,
    CodeChanged,
    DaemonStatus,
    DeviceStates,
    EngineInfo,
    EngineSnapshot,
    GetEngine,
    GetIdentity,
    GetInstances,
    GetNodePorts,
    GetRobot,
    GetSamples,
    GetStatus,
    Instances,
    InstanceState,
    Jog,
    ListRecordings,
    MakePlan,
    Message,
    PlanMotion,
    PlanPreview,
    PointCloud,
    PortValue,
    Prompt,
    PromptClosed,
    Reach,
    RobotInfo,
    RobotState,
    RunState,
)
from handrail.topics import RefusedError
from tablet_client.models import arrivals
from tablet_client.models.arrivals import Inbox
from tablet_client.stopper import Stopper

_Answer = TypeVar("_Answer")

EVENTS = (
    RobotState,
    DaemonStatus,
    ActionEvent,
    InstanceState,
    PlanPreview,
    RunState,
    Prompt,
    PromptClosed,
    PointCloud,
    Reach,
    DeviceStates,
    EngineInfo,
    CodeChanged,
    PortValue,
)

_LONG = (MakePlan, PlanMotion, CheckTask, ListRecordings, GetSamples, GetNodePorts)
_GONE = 0.08  # s after which a place sent by hand counts as taken: it is answered only when the robot is there
_HEARTBEAT = 1.0  # s
_RETRY = 1.0  # s
_TIMEOUT = 3.0  # s, of the keeper's calls
_MISSES = 2  # unanswered heartbeats before the engine counts as gone: it may be busy planning


class Stream(Iterable[Any], Protocol):
    """Events, until it is closed."""

    def close(self) -> None: ...


class Client(Protocol):
    """What the session needs of `handrail.client.Client`: safe to use from several threads, reconnects by itself."""

    @property
    def traffic_by_kind(self) -> dict[str, int]: ...
    def call(self, message: Message, timeout_s: float | None = None) -> Any: ...
    def events(self, *kinds: type, timeout_s: float = 5.0) -> Iterable[Any]: ...
    def subscribe(self, *chosen: Selection | type, timeout_s: float = 5.0) -> Stream: ...
    def close(self) -> None: ...


class Session:
    """The tablet's connection. `connect` makes a client without waiting (`handrail.connect` with timeout 0)."""

    def __init__(
        self, connect: Callable[[], Client], inbox: Inbox, *, heartbeat: float = _HEARTBEAT, retry: float = _RETRY
    ):
        """`heartbeat`, `retry`: s between questions while the robot answers, and between attempts while it does not."""
        self._inbox = inbox
        self._heartbeat, self._retry = heartbeat, retry
        self._client = connect()
        self._stopper = Stopper(connect(), inbox.put)
        self._over = threading.Event()
        self._anew = threading.Event()
        self._nudge = threading.Event()
        self._calls: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._plans: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._places: queue.SimpleQueue[Jog | None] = queue.SimpleQueue()
        self._heard: Stream | None = None
        self._threads = [
            threading.Thread(target=target, name=f"tablet-{name}", daemon=True)
            for name, target in (
                ("keeper", self._keep),
                ("listener", self._listen),
                ("caller", lambda: self._call(self._calls)),
                ("planner", lambda: self._call(self._plans)),
                ("mover", self._go),
            )
        ]

    def start(self) -> None:
        for thread in self._threads:
            thread.start()
        self._stopper.start()

    def close(self, timeout: float = 2.0) -> None:
        """End the threads, waiting at most `timeout` s for each; a call that is still out there is abandoned."""
        self._over.set()
        self._calls.put(None)
        self._plans.put(None)
        self._places.put(None)
        self._nudge.set()
        self._client.close()
        self._stopper.close(timeout)
        for thread in self._threads:
            thread.join(timeout)

    def send(self, call: Message) -> None:
        """Send a call; its answer, or why there is none, arrives in the inbox."""
        (self._plans if isinstance(call, _LONG) else self._calls).put(call)

    def go(self, place: Jog) -> None:
        """Send the robot somewhere by hand, in place of what was asked for before; a refusal arrives in the inbox."""
        self._places.put(place)

    def hear(self, chosen: Sequence[Selection]) -> None:
        """Events that are chosen and not simply wanted, in place of those chosen before. Returns at once."""
        before = self._heard
        try:
            self._heard = stream = self._client.subscribe(*chosen, timeout_s=0)
        except ConnectionError:
            return  # the client was closed
        threading.Thread(target=self._pass_on, args=(stream,), name="tablet-chosen", daemon=True).start()
        if before is not None:
            before.close()

    def _pass_on(self, stream: Stream) -> None:
        for event in stream:
            self._inbox.put(event)

    def stop(self, reason: str) -> None:
        """Send STOP now, and again until it is answered. Returns at once, and never waits for another call."""
        self._stopper.stop(reason)

    # --------------------------------------------------------------------------------------------------------- keeper

    def _keep(self) -> None:
        tries, attached, engine, misses = 0, False, False, 0
        while not self._over.is_set():
            if self._anew.is_set():  # events may have been missed: ask for everything again
                self._anew.clear()
                attached = engine = False
            try:
                self._ping()
                if attached:
                    self._inbox.put(self._ask(GetStatus(), DaemonStatus))
                else:
                    info, status = self._ask(GetRobot(), RobotInfo), self._ask(GetStatus(), DaemonStatus)
                    self._inbox.put(arrivals.Attached(info, status))
                    attached, tries = True, 0
            except (ConnectionError, OSError, RefusedError) as error:
                tries += 1
                self._inbox.put(arrivals.Unanswered(tries, str(error)))
                attached = engine = False
                self._pause(self._retry)
                continue
            try:
                if engine:
                    self._ask(GetInstances(), Instances)
                else:
                    self._fetch_engine()
                    engine = True
                misses = 0
            except (ConnectionError, OSError, RefusedError) as error:
                misses += 1
                if not engine or misses >= _MISSES:
                    engine = False
                    self._inbox.put(arrivals.EngineDetached(str(error)))
            self._pause(self._heartbeat)

    def _ask(self, call: Message, expected: type[_Answer]) -> _Answer:
        answer = self._client.call(call, _TIMEOUT)
        if not isinstance(answer, expected):
            raise ConnectionError(f"{type(call).__name__}: answered with {type(answer).__name__}")
        return answer

    def _ping(self) -> None:
        """How long does a call take that the link answers itself, and whose key is this? Raises ConnectionError."""
        began = time.monotonic()
        took: float | None = None
        who = ClientIdentity(name="", role="none")
        try:
            with contextlib.suppress(RefusedError):  # a robot of before: it answers, and has no roles for observers
                who = self._ask(GetIdentity(), ClientIdentity)
            took = time.monotonic() - began
        finally:
            told = {} if who.role == "none" else {"name": who.name, "role": who.role, "commander": who.commander}
            self._inbox.put(arrivals.Pinged(time.monotonic(), took, self._client.traffic_by_kind, **told))

    def _fetch_engine(self) -> None:
        self._inbox.hold()
        first: tuple[Any, ...] = ()
        try:
            first = (arrivals.EngineAttached(self._ask(GetEngine(), EngineSnapshot)),)
        finally:
            self._inbox.release(*first)

    def _pause(self, seconds: float) -> None:
        self._nudge.wait(seconds)
        if not self._over.is_set():
            self._nudge.clear()

    # ------------------------------------------------------------------------------------------------ listener, caller

    def _listen(self) -> None:
        with contextlib.suppress(ConnectionError):  # the client was closed
            for event in self._client.events(*EVENTS, Live, timeout_s=0):
                if isinstance(event, Live):
                    self._anew.set()
                    self._nudge.set()
                else:
                    self._inbox.put(event)

    def _call(self, calls: queue.SimpleQueue[Message | None]) -> None:
        while (call := calls.get()) is not None:
            try:
                self._inbox.put(arrivals.CallDone(call, self._client.call(call)))
            except RefusedError as error:
                self._inbox.put(arrivals.CallFailed(call, str(error), refused=True))
            except (ConnectionError, OSError) as error:
                self._inbox.put(arrivals.CallFailed(call, str(error), refused=False))

    def _go(self) -> None:
        while (place := self._places.get()) is not None:
            while not self._places.empty():  # what has been overtaken is not sent
                newer = self._places.get()
                if newer is None:
                    return
                place = newer
            try:
                self._client.call(place, _GONE)
            except RefusedError as error:
                self._inbox.put(arrivals.CallFailed(place, str(error), refused=True))
            except (ConnectionError, OSError):
                pass  # it is on its way; whether the robot is there at all is the keeper's to find out
