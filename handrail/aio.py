"""The client for asyncio: every call of `handrail.client.Client`, awaited.

    import asyncio
    from handrail import aio
    from handrail.messages import Prompt

    async def main():
        async with aio.connect() as robot:
            await robot.enable()
            async with robot.events(Prompt) as prompts:
                async for prompt in prompts:
                    await robot.answer(prompt.id, "approve")

    asyncio.run(main())

Calls that are awaited side by side (`asyncio.gather`, tasks) travel side by side. A task that is cancelled stops waiting; what it
asked for may still be carried out, as when a connection breaks: nobody can take back what was sent.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Coroutine, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from handrail import client
from handrail.client import Client
from handrail.link.events import Events
from handrail.link.keys import ClientKeys
from handrail.link.selections import Selection

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")

_MOST_AT_ONCE = 256
"""calls that wait for answers at the same time, one thread each; threads are made as they are needed"""


def _awaited(
    method: Callable[Concatenate[Client, _P], _R],
) -> Callable[Concatenate[AsyncClient, _P], Coroutine[Any, Any, _R]]:
    """A method of Client as a coroutine of AsyncClient, with its signature and its words."""

    @functools.wraps(method)
    async def call(self: AsyncClient, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        return await self._elsewhere(functools.partial(method, self.sync, *args, **kwargs))

    return call


class Opening(Generic[_T]):
    """What is being opened: awaited it is there, and `async with` it is closed at the end."""

    def __init__(self, opening: Coroutine[Any, Any, _T], close: Callable[[_T], Coroutine[Any, Any, None]]):
        self._opening, self._close = opening, close
        self._opened: _T

    def __await__(self) -> Generator[Any, Any, _T]:
        return self._opening.__await__()

    async def __aenter__(self) -> _T:
        self._opened = await self._opening
        return self._opened

    async def __aexit__(self, *_: object) -> None:
        await self._close(self._opened)


class AsyncEvents:
    """A stream of events for one task: iterate it, or await `next`. Made by `AsyncClient.events`."""

    def __init__(self, events: Events):
        self._events = events
        self._arrived = asyncio.Event()
        loop = asyncio.get_running_loop()

        def wake() -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._arrived.set)

        events.on_change(wake)

    async def next(self, timeout_s: float | None = None) -> Any | None:
        """The next event; None when none came in time or the stream is closed (None waits for ever, 0 does not wait)."""
        if timeout_s is None:
            return await self._next()
        try:
            async with asyncio.timeout(timeout_s):
                return await self._next()
        except TimeoutError:
            return self._events.next(0)

    async def _next(self) -> Any | None:
        while True:
            self._arrived.clear()  # before the look, so that what comes after it is not missed
            event = self._events.next(0)
            if event is not None or self._events.closed:
                return event
            await self._arrived.wait()

    def drain(self) -> list[Any]:
        """All events that wait, without waiting."""
        return self._events.drain()

    async def close(self) -> None:
        """End the stream; whoever waits for it returns."""
        self._events.close()

    def __aiter__(self) -> AsyncEvents:
        return self

    async def __anext__(self) -> Any:
        if (event := await self._next()) is None:
            raise StopAsyncIteration
        return event


class AsyncClient:
    """One operator's connection to a robot, for asyncio. Made by `connect`; methods are Client's, awaited."""

    def __init__(self, sync: Client):
        self.sync = sync
        """the same connection for code that blocks"""
        self._threads = ThreadPoolExecutor(_MOST_AT_ONCE, thread_name_prefix="handrail-aio")

    async def _elsewhere(self, call: Callable[[], _R]) -> _R:
        return await asyncio.get_running_loop().run_in_executor(self._threads, call)

    @property
    def address(self) -> str:
        return self.sync.address

    @property
    def connected(self) -> bool:
        """True while the gate is there and knows this client's key."""
        return self.sync.connected

    def at(self, engine: str) -> AsyncClient:
        """The same connection, with programs run and deployed at another engine of the robot."""
        return AsyncClient(self.sync.at(engine))

    async def close(self) -> None:
        """Open calls end as Unreachable, event streams end."""
        await asyncio.to_thread(self.sync.close)

    def events(self, *kinds: type, timeout_s: float = 5.0) -> Opening[AsyncEvents]:
        """A stream of the given types of events, as `Client.events` has it: `async with robot.events(RunState) as events`."""

        async def opening() -> AsyncEvents:
            return AsyncEvents(await self._elsewhere(functools.partial(self.sync.events, *kinds, timeout_s=timeout_s)))

        return Opening(opening(), AsyncEvents.close)

    def subscribe(
        self,
        *chosen: Selection | type,
        rate: float = 0.0,
        fields: Sequence[str] = (),
        where: Mapping[str, str | Sequence[str]] | None = None,
        timeout_s: float = 5.0,
    ) -> Opening[AsyncEvents]:
        """A stream of some events, as `Client.subscribe` has it: `async with robot.subscribe(LogLine, rate=1) as lines`."""

        async def opening() -> AsyncEvents:
            choose = functools.partial(
                self.sync.subscribe, *chosen, rate=rate, fields=fields, where=where, timeout_s=timeout_s
            )
            return AsyncEvents(await self._elsewhere(choose))

        return Opening(opening(), AsyncEvents.close)

    call = _awaited(Client.call)
    engines = _awaited(Client.engines)
    robot = _awaited(Client.robot)
    status = _awaited(Client.status)
    enable = _awaited(Client.enable)
    disable = _awaited(Client.disable)
    stop = _awaited(Client.stop)
    clear_stop = _awaited(Client.clear_stop)
    set_speed = _awaited(Client.set_speed)
    command_gripper = _awaited(Client.command_gripper)
    switch_relay = _awaited(Client.switch_relay)
    place_instance = _awaited(Client.place_instance)
    move_instance = _awaited(Client.move_instance)
    set_parameters = _awaited(Client.set_parameters)
    edit_instance = _awaited(Client.edit_instance)
    attach_instance = _awaited(Client.attach_instance)
    undo_instances = _awaited(Client.undo_instances)
    redo_instances = _awaited(Client.redo_instances)
    hold_instance = _awaited(Client.hold_instance)
    release_instance = _awaited(Client.release_instance)
    remove_instance = _awaited(Client.remove_instance)
    instances = _awaited(Client.instances)
    plan = _awaited(Client.plan)
    cancel_planning = _awaited(Client.cancel_planning)
    rank_choices = _awaited(Client.rank_choices)
    plan_motion = _awaited(Client.plan_motion)
    edit_plan = _awaited(Client.edit_plan)
    undo_edit = _awaited(Client.undo_edit)
    get_plan = _awaited(Client.get_plan)
    execute_plan = _awaited(Client.execute_plan)
    jog = _awaited(Client.jog)
    home = _awaited(Client.home)
    library = _awaited(Client.library)
    deploy = _awaited(Client.deploy)
    send_bundle = _awaited(Client.send_bundle)
    releases = _awaited(Client.releases)
    roll_back = _awaited(Client.roll_back)
    check_task = _awaited(Client.check_task)
    run = _awaited(Client.run)
    pause_run = _awaited(Client.pause_run)
    resume_run = _awaited(Client.resume_run)
    stop_run = _awaited(Client.stop_run)
    step_run = _awaited(Client.step_run)
    set_breakpoints = _awaited(Client.set_breakpoints)
    skip = _awaited(Client.skip)
    take_transition = _awaited(Client.take_transition)
    let_fail = _awaited(Client.let_fail)
    run_from = _awaited(Client.run_from)
    set_run_parameters = _awaited(Client.set_run_parameters)
    set_autonomy = _awaited(Client.set_autonomy)
    run_history = _awaited(Client.run_history)
    outline = _awaited(Client.outline)
    answer = _awaited(Client.answer)
    snapshot = _awaited(Client.snapshot)
    reach = _awaited(Client.reach)
    expand_template = _awaited(Client.expand_template)
    run_template = _awaited(Client.run_template)
    nodes = _awaited(Client.nodes)
    node_library = _awaited(Client.node_library)
    node_source = _awaited(Client.node_source)
    save_node = _awaited(Client.save_node)
    start_node = _awaited(Client.start_node)
    put_node = _awaited(Client.put_node)
    reload_node = _awaited(Client.reload_node)
    stop_node = _awaited(Client.stop_node)


def connect(
    address: str | None = None, keys: ClientKeys | Path | str | None = None, *, timeout_s: float = 5.0
) -> Opening[AsyncClient]:
    """Connect to a robot's gate, as `handrail.connect` does: `async with connect() as robot` or `robot = await connect()`."""

    async def opening() -> AsyncClient:
        return AsyncClient(
            await asyncio.to_thread(functools.partial(client.connect, address, keys, timeout_s=timeout_s))
        )

    return Opening(opening(), AsyncClient.close)
