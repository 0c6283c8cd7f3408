"""An engine on another machine: its own runtime folder, the robot through a gate, and a line between them that can be cut."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec
import pytest
import typer
import zmq
import zmq.asyncio
from typer.testing import CliRunner

from daemon.serving.robot_info import robot_info
from engines.away import engine
from engines.uplink import Uplink
from handrail import messages as m
from handrail.bundles import manifest
from handrail.client import connect
from handrail.engines import FIRST
from handrail.link import codec, keys
from handrail.link import guests as guests_module
from handrail.link.guests import Guests
from handrail.link.session import Session
from handrail.robot import library as robots
from handrail.runtime import Runtime
from handrail.topics import RefusedError
from tests.engines.conftest import FakePlanner, Stack, until
from tests.line import Line
from tests.link.conftest import RunningGate, free_ports


@pytest.fixture
def robot_keys(tmp_path):
    """The robot's keys; another machine's, which it knows as the engine `vision`."""
    robot, away = keys.ensure(tmp_path / "robot"), keys.ensure(tmp_path / "away")
    shutil.copy(robot / "server.key", away / "server.key")
    (robot / "allowed" / "engines").mkdir()
    shutil.copy(away / "client.key", robot / "allowed" / "engines" / "vision.key")
    return robot, away


@pytest.fixture
def port():
    return free_ports()


@pytest.fixture
def gate(runtime, robot_keys, port):
    gate = RunningGate(runtime, robot_keys[0], port)
    yield gate
    gate.close()


@pytest.fixture
def line(gate, port):
    line = Line(port)
    yield line
    line.close()


@pytest.fixture
def client(gate, robot_keys, port):
    with connect(f"tcp://127.0.0.1:{port}", robot_keys[0], timeout_s=30) as client:
        yield client


@pytest.fixture
def folder():
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def vision(stack, line, robot_keys, folder):
    """An engine in a runtime folder of its own, with nothing of the robot but the line."""
    runtime = Runtime.at(folder)
    session = Session(f"tcp://127.0.0.1:{line.port}", keys.for_client(robot_keys[1]))
    session.wait_connected(30)
    uplink = Uplink(runtime, session, session.call(m.FetchCalls()).engine)
    vision = Stack(runtime, FakePlanner(), "vision", away=True)
    uplink.attend()
    yield vision
    vision.close()
    uplink.close()
    session.close()


def there(client) -> bool:
    return [each.name for each in client.engines() if each.up] == [FIRST, "vision"]


def test_it_is_listed_and_a_run_of_it_moves_the_robot_along_the_robots_instance(stack, vision, client, daemon):
    until(lambda: there(client))
    stack.place()
    until(vision.engine._services.affordances.instances)
    with client.events(m.Prompt) as prompts:
        at = client.at("vision")
        deployed = at.deploy("turn_valve", {"arm": "right", "valve": "wheel_1"}, {"goal_deg": 30.0, "max_strokes": 1})
        assert at.run(deployed).run.endswith("@vision")
        client.answer(prompts.next(30).id, "approve")
    vision.ended()
    assert {call.owner for call in daemon.started()} == {"vision"}
    (wheel,) = stack.call(m.GetInstances()).instances
    assert wheel.joint_state["hinge"] > 0.1


def test_a_cut_line_pauses_its_run_which_goes_on_in_its_state_when_the_line_is_back(
    stack, vision, client, daemon, line
):
    daemon.slow = True
    until(lambda: there(client))
    vision.run("press")
    client.answer(vision.prompt().id, "press")
    until(lambda: daemon.action is not None and vision.engine._services.daemon.runs(daemon.action.id))
    line.cut()
    paused = vision.wait(lambda e: isinstance(e, m.RunState) and e.status == "paused")
    assert paused.active == ["pressing"]
    assert "pressing begins anew when the run goes on" in paused.detail
    until(lambda: not there(client))
    daemon._todo.append(
        lambda: daemon._ended("owner_lost", 0.5)
    )  # as the real one's table does, for want of signs of life
    until(lambda: daemon.action is None)
    with client.events(m.RunState) as states:
        assert states.wait_live(30)
        line.mend()
        told = states.next(30)  # what it told while nobody heard
        while told.status != "paused":
            told = states.next(30)
    until(lambda: there(client))
    daemon.slow = False
    client.at("vision").resume_run()
    assert vision.ended().status == "succeeded"
    assert [call.owner for call in daemon.calls if isinstance(call, m.StartBehaviour)] == ["vision", "vision"]


def refused(call) -> m.Refused:
    with pytest.raises(RefusedError) as caught:
        call()
    return caught.value.refusal


def test_its_key_commands_under_its_own_name_alone_and_nobody_elses_key_is_an_engines(
    stack, daemon, client, robot_keys, gate, port
):
    assert "allowed/engines/" in refused(lambda: client.call(m.FetchCalls())).message
    assert "not a call" in refused(lambda: client.call(m.CheckIn(owner="vision"))).message
    session = Session(f"tcp://127.0.0.1:{port}", keys.for_client(robot_keys[1]))
    try:
        assert session.call(m.FetchCalls()).engine == "vision"
        session.call(m.CheckIn(owner="vision"))
        assert refused(lambda: session.call(m.CheckIn(owner="engine"))).expected == "vision"
        refused(lambda: session.call(m.CancelAction(id="a", by="engine")))
        assert daemon.calls[-1].by == "vision"
        assert refused(lambda: session.call(m.RollBack())).expected == "developer"
        assert session.call(m.FetchCalls(process="one")).engine == "vision"
        assert "another process" in refused(lambda: session.call(m.FetchCalls(process="two"))).message
    finally:
        session.close()
    first = robot_keys[0] / "allowed" / "engines" / "vision.key"
    first.rename(first.with_name("engine.key"))
    session = Session(f"tcp://127.0.0.1:{port}", keys.for_client(robot_keys[1]))
    try:
        assert "first engine" in refused(lambda: session.call(m.FetchCalls())).message
    finally:
        session.close()


def test_long_answers_come_in_pieces_and_what_no_engine_tells_is_not_passed_on(runtime, caplog):
    async def work() -> tuple[list[bytes], int]:
        context = zmq.asyncio.Context()
        guests = Guests(runtime, context)
        fetching = asyncio.create_task(guests.answer(m.FetchCalls(process="p"), "vision"))
        await asyncio.sleep(0)
        caller, hearer = context.socket(zmq.DEALER), context.socket(zmq.SUB)
        hearer.subscribe(b"")
        caller.connect(runtime.endpoint("vision.call"))
        hearer.connect(runtime.endpoint("vision.events"))
        await caller.send(b"call")
        (call,) = (await fetching).calls or (await guests.answer(m.FetchCalls(process="p"), "vision")).calls
        assert call.payload == b"call"
        foreign = msgspec.msgpack.encode(m.EngineInfo(name="engine"))
        says = [
            m.Said(b"lost with the line", number=call.number, more=True),
            m.Said(b"long ", number=call.number, more=True),
            m.Said(b"answer", number=call.number, piece=1),
            m.Said(foreign, event="EngineInfo"),
            m.Said(b"x", event="RobotState"),
        ]
        for batch, said in enumerate(says, 1):
            for _ in range(2):  # as after a cut, when nobody knows whether it came
                await guests.answer(m.EngineSays(process="p", batch=batch, said=[said]), "vision")
        answer = await caller.recv_multipart()
        heard = await hearer.poll(0)
        guests.close()
        context.destroy(linger=0)
        return answer, heard

    assert asyncio.run(work()) == ([b"long answer"], 0)
    assert "EngineInfo of 'engine'; expected vision" in caplog.text
    assert "'RobotState'; expected one of" in caplog.text


def test_an_answer_longer_than_the_link_carries_is_refused_instead_of_cut_off(runtime, monkeypatch):
    monkeypatch.setattr(codec, "LARGEST_ANSWER", 8)

    async def work() -> list[bytes]:
        context = zmq.asyncio.Context()
        guests = Guests(runtime, context)
        fetching = asyncio.create_task(guests.answer(m.FetchCalls(process="p"), "vision"))
        await asyncio.sleep(0)
        caller = context.socket(zmq.DEALER)
        caller.connect(runtime.endpoint("vision.call"))
        await caller.send(b"call")
        calls = (await fetching).calls
        while not calls:
            calls = (await guests.answer(m.FetchCalls(process="p"), "vision")).calls
        pieces = [
            m.Said(each, number=calls[0].number, piece=k, more=k < 2)
            for k, each in enumerate((b"12345", b"6789", b"0"))
        ]
        await guests.answer(m.EngineSays(process="p", batch=1, said=pieces), "vision")
        answer = await asyncio.wait_for(caller.recv_multipart(), 30)
        guests.close()
        context.destroy(linger=0)
        return answer

    (answer,) = asyncio.run(work())
    assert "more than the link carries" in msgspec.msgpack.decode(answer, type=m.Refused).message


def test_what_it_told_as_it_was_let_go_is_told_once_it_is_back_and_nothing_twice(runtime, monkeypatch):
    monkeypatch.setattr(guests_module, "_SILENT_S", 0.05)
    monkeypatch.setattr(guests_module, "_WAIT_S", 0.01)
    says = m.EngineSays(
        process="p",
        batch=1,
        said=[
            *(
                m.Said(msgspec.msgpack.encode(m.LogLine(source="vision", level="info", text=text)), event="LogLine")
                for text in "ab"
            ),
            m.Said(b"\x00" * 8, event="RobotState"),  # none that is passed on
        ],
    )

    async def work() -> list[str]:
        context = zmq.asyncio.Context()
        guests = Guests(runtime, context)
        await guests.answer(m.FetchCalls(process="p"), "vision")
        watching = asyncio.create_task(guests.watch())
        with pytest.raises(RefusedError, match="again"):  # it was let go, or nobody came to hear it
            await guests.answer(says, "vision")
        with pytest.raises(RefusedError, match="has to fetch its calls first"):
            while True:
                with contextlib.suppress(RefusedError) if guests._guests else contextlib.nullcontext():
                    await guests.answer(says, "vision")
        watching.cancel()
        monkeypatch.setattr(guests_module, "_SILENT_S", 30.0)
        hearer = context.socket(zmq.SUB)
        for name in codec.REMOTE_EVENTS:
            hearer.subscribe(name.encode())
        hearer.connect(runtime.endpoint("vision.events"))
        # Who waits, hears: connected to the place that is just being given up, a socket subscribes anew only where it is in use.
        first = hearer.recv_multipart()
        await guests.answer(m.FetchCalls(process="p"), "vision")
        for _ in range(2):
            await guests.answer(says, "vision")
        told = [await first, await hearer.recv_multipart()]
        heard = [msgspec.msgpack.decode(payload, type=m.LogLine).text for _, payload in told]
        heard += ["twice"] * await hearer.poll(0)
        guests.close()
        context.destroy(linger=0)
        return heard

    assert asyncio.run(work()) == ["a", "b"]


verb = typer.Typer()
verb.command()(engine)
PROGRAM = """
title: Ask
states:
  asking:
    do: prompt
    with: {text: "Well?", options: ["yes", "no"]}
    transitions: [{event: "*", target: done}]
  done: {final: true, outcome: succeeded}
"""


def test_as_a_process_it_gets_programs_from_developers_runs_them_and_ends_on_sigterm(
    stack, daemon, client, robot_keys, gate, port, folder, tmp_path
):
    daemon.robot = robot_info(robots.load("talos_upper"))
    options = ["--connect", f"tcp://127.0.0.1:{port}", "--keys", str(robot_keys[1]), "--runtime", str(folder)]
    other = CliRunner().invoke(verb, [*options, "--name", "arm"])
    assert (other.exit_code, "key as the engine vision; expected arm" in " ".join(other.output.split())) == (1, True)
    command = [sys.executable, "-c", "import typer; from engines.away import engine; typer.run(engine)", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "vision ready\n"
        until(lambda: there(client))
        path = "rtc_programs/ask_away.yaml"
        bundle = manifest.bundle("ask_away", {path: PROGRAM.encode()})
        release = client.send_bundle(bundle, engine="vision", cache=tmp_path / "cache")
        assert client.releases("vision").programs == {"ask_away": bundle.address}
        assert (release.program, client.releases().programs) == ("ask_away", {})
        with client.events(m.Prompt, m.RunState) as events:
            at = client.at("vision")
            at.run(at.deploy("ask_away"))
            for event in events:
                if isinstance(event, m.Prompt):
                    client.answer(event.id, "yes")
                elif event.status == "succeeded":
                    break
        process.terminate()
        assert process.wait(30) == 0
        until(lambda: not there(client))
    finally:
        process.kill()
        process.wait()
