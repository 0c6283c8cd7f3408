"""The client for asyncio does what the blocking one does, side by side and without a thread of the caller's."""

from __future__ import annotations

import asyncio
import inspect
import threading

import pytest

from handrail import aio
from handrail.client import Client
from handrail.messages import DaemonStatus, GetRobot, Pose
from handrail.topics import RefusedError, Unreachable


def test_has_every_method_of_the_blocking_client_with_its_signature():
    theirs = {name: method for name, method in vars(Client).items() if callable(method) and not name.startswith("_")}
    del theirs["on"]  # a reaction is a task that iterates events
    for name, method in theirs.items():
        own = getattr(aio.AsyncClient, name)
        assert inspect.signature(own).parameters.keys() == inspect.signature(method).parameters.keys(), name
        assert own.__doc__, name


def test_calls_answer_and_refusals_raise(stand):
    stand.daemon(), stand.engine(), stand.gate()

    async def main():
        async with aio.connect(stand.address, stand.keys, timeout_s=30.0) as robot:
            assert (await robot.robot()).name == "talos_upper"
            placed = await robot.place_instance("wheel_1", "wheel", Pose(position=(1.0, 0.0, 0.0)))
            assert placed.pose_in_world.position == (1.0, 0.0, 0.0)
            with pytest.raises(RefusedError, match="out of reach"):
                await robot.plan("wheel_1", "turn")

    asyncio.run(main())


def test_calls_that_are_awaited_side_by_side_travel_side_by_side(stand):
    daemon, engine = stand.daemon(), stand.engine()
    stand.gate()
    asked, free = threading.Event(), threading.Event()
    answer = daemon.answers[GetRobot]

    def slow(call):
        asked.set()
        assert free.wait(30)
        return answer(call)

    daemon.answers[GetRobot] = slow

    async def main():
        async with aio.connect(stand.address, stand.keys, timeout_s=30.0) as robot:
            first = asyncio.create_task(robot.robot())
            assert await asyncio.to_thread(asked.wait, 30)
            assert (await robot.snapshot()).run is None
            assert not first.done()
            free.set()
            assert (await first).name == "talos_upper"

    asyncio.run(main())
    assert len(engine.asked) == 1


def test_events_are_iterated_and_end_with_the_client(stand):
    daemon = stand.daemon()
    stand.gate()

    async def main():
        async with aio.connect(stand.address, stand.keys, timeout_s=30.0) as robot:
            async with robot.events(DaemonStatus, timeout_s=30.0) as statuses:
                assert await statuses.next(0.0) is None
                daemon.publish(stand.status(time_ns=1))
                assert (await statuses.next(30.0)).time_ns == 1
            events = await robot.events(DaemonStatus, timeout_s=30.0)
            heard = asyncio.Event()
            rest = asyncio.create_task(_all(events, heard))
            daemon.publish(stand.status(time_ns=2))
            await asyncio.wait_for(heard.wait(), 30.0)
            await robot.close()
            assert (await asyncio.wait_for(rest, 30.0))[-1].time_ns == 2
            with pytest.raises(Unreachable):
                await robot.status()

    asyncio.run(main())


async def _all(events, heard):
    got = []
    async for event in events:
        got.append(event)
        if event.time_ns == 2:
            heard.set()
    return got


def test_a_robot_that_is_not_there_is_unreachable(stand):
    async def main():
        async with aio.connect(stand.address, stand.keys, timeout_s=0.1):
            pass

    with pytest.raises(Unreachable, match="no gate answered"):
        asyncio.run(main())
