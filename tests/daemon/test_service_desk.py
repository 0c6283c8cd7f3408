"""The supervisor's socket: how processes are, what they said, starting one anew; and those who ask wrongly."""

from __future__ import annotations

import asyncio
import os
import shutil
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from daemon.service_desk import ServiceDesk
from daemon.serving.health import write_processes
from daemon.supervisor import Child, Supervisor
from handrail import messages as m
from handrail.link.backend import Gone
from handrail.link.service import ask_supervisor
from handrail.runtime import Runtime

CODE = "import signal; print('{name} ready', flush=True); print('{name} thinks', flush=True); signal.pause()"
_answers = msgspec.msgpack.Decoder(m.Answer)


class Kept:
    """A supervisor with its desk, on the thread of the test, and somebody who asks, on another."""

    def __init__(self, runtime: Runtime):
        self.runtime = runtime
        children = [child("plant"), child("loop", bound_to=("plant",)), child("link")]
        self.supervisor = Supervisor(children, report=lambda name, text: None)
        self.supervisor.on_processes = lambda processes: write_processes(runtime.folder, processes)
        self.desk = ServiceDesk(runtime, self.supervisor)
        assert self.supervisor.start()

    def until(self, what: Callable[[], Any]) -> None:
        for _ in range(6000):
            if what():
                return
            self.supervisor.step(0.01)
        pytest.fail("did not happen")

    def ask(self, call: m.Message | bytes) -> Any:
        """The answer, while the supervisor goes on."""
        encoded = call if isinstance(call, bytes) else msgspec.msgpack.encode(call)
        answers: list[bytes] = []
        asking = threading.Thread(
            target=lambda: answers.append(asyncio.run(ask_supervisor(self.runtime, encoded, 60.0)))
        )
        asking.start()
        self.until(lambda: not asking.is_alive())
        return _answers.decode(answers[0])

    def pids(self) -> dict[str, int | None]:
        return {name: self.supervisor.pid(name) for name in ("plant", "loop", "link")}


def child(name: str, **options: Any) -> Child:
    return Child(name, (sys.executable, "-c", CODE.replace("{name}", name)), **options)


@pytest.fixture
def runtime() -> Iterator[Runtime]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    yield Runtime.at(folder)
    shutil.rmtree(folder)


@pytest.fixture
def kept(runtime: Runtime) -> Iterator[Kept]:
    made = Kept(runtime)
    yield made
    made.desk.close()
    made.supervisor.close()
    assert not runtime.service.exists()


def test_it_tells_how_processes_are_and_what_they_said_and_starts_them_anew(kept: Kept) -> None:
    before = kept.pids()
    kept.until(lambda: [line for _, line in kept.supervisor.log("link", 9)][-1] == "link thinks")
    told = kept.ask(m.GetProcesses()).processes
    assert [(each.name, each.state, each.process, each.depth) for each in told] == [
        (name, "up", pid, 0) for name, pid in before.items()
    ]
    assert all(each.memory_mb > 1.0 for each in told) and told[2].last == "link thinks"

    assert kept.ask(m.RestartProcess(process="plant", by="ada", role="operator")) == m.Ok()
    assert kept.pids() == before, "the answer is out before anything ends"
    kept.until(lambda: kept.pids()["plant"] not in (None, before["plant"]) and kept.supervisor.all_up)
    after = kept.pids()
    assert after["link"] == before["link"] and after["loop"] not in (None, before["loop"])
    said = [line.text for line in kept.ask(m.GetProcessLog(process="plant")).lines]
    assert "to be started anew, as ada asked" in said and said[-2:] == ["up after " + said[-2][9:], "plant thinks"]
    assert {each.name: each.deaths for each in kept.ask(m.GetProcesses()).processes}["plant"] == 0


def test_who_may_not_and_what_is_no_call_changes_nothing(kept: Kept) -> None:
    before = kept.pids()
    refused = kept.ask(m.RestartProcess(process="plant", by="vision", role="engine"))
    assert (refused.field, refused.value) == ("role", "engine") and "vision" in refused.message
    for call in (m.RestartProcess(process="nobody"), m.GetProcessLog(process="nobody")):
        assert kept.ask(call).expected == "one of: plant, loop, link"
    for nonsense in (b"\x00", msgspec.msgpack.encode(m.GetRobot()), b"\xc1" * 5000, os.urandom(64)):
        assert "not a call" in kept.ask(nonsense).message
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as silent:  # says nothing, and goes
        silent.connect(str(kept.runtime.service))
    assert kept.ask(m.GetProcesses()).processes and kept.pids() == before


def test_a_log_fits_into_its_packet_however_much_was_said(kept: Kept) -> None:
    for number in range(300):
        kept.supervisor._say("link", f"{number} " + "\N{GRINNING FACE}" * 600)
    lines = kept.ask(m.GetProcessLog(process="link", lines=200)).lines
    assert 10 < len(lines) < 200 and lines[-1].text.startswith("299 ") and len(lines[-1].text) == 500
    assert [int(line.text.split()[0]) for line in lines] == list(range(300 - len(lines), 300))


def test_where_nobody_supervises_that_is_said(runtime: Runtime) -> None:
    with pytest.raises(Gone, match="not started by handrail up"):
        asyncio.run(ask_supervisor(runtime, b"", 1.0))
