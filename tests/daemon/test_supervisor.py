"""The supervisor, with small scripts for children."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from daemon.serving.health import ProcessTold
from daemon.supervisor import Child, StartError, Supervisor

READY = """
import signal, sys, time
print("{name} ready", flush=True)
signal.pause()
"""


class Watched:
    """A supervisor and what it reported."""

    def __init__(self, *children: Child):
        self.lines: list[tuple[str, str]] = []
        self.health: list[dict[str, str]] = []
        self.supervisor = Supervisor(children, report=lambda name, text: self.lines.append((name, text)))
        self.supervisor.on_health = self.health.append

    def until(self, what: Callable[[], bool], patience_s: float = 60.0) -> None:
        deadline = time.monotonic() + patience_s
        while not what():
            assert time.monotonic() < deadline, (self.lines, self.supervisor.health())
            self.supervisor.step(0.05)

    def up(self, name: str, *, other_than: int | None = None) -> bool:
        return self.supervisor.health()[name].startswith("up") and self.supervisor.pid(name) not in (None, other_than)

    def said(self, text: str) -> bool:
        return any(text in line for _, line in self.lines)


@pytest.fixture
def watch() -> Iterator[Callable[..., Watched]]:
    made: list[Watched] = []

    def make(*children: Child) -> Watched:
        made.append(Watched(*children))
        return made[-1]

    yield make
    for watched in made:
        watched.supervisor.close()


def script(name: str, code: str = READY, **options: object) -> Child:
    return Child(name, (sys.executable, "-c", code.replace("{name}", name)), **options)  # type: ignore[arg-type]


def alive(pid: int) -> bool:
    return psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE


def test_a_child_starts_only_when_those_before_it_are_ready(watch: Callable[..., Watched], tmp_path: Path) -> None:
    slow = f"""
import pathlib, signal, time
time.sleep(0.3)
pathlib.Path({str(tmp_path / "mark")!r}).touch()
print("slow ready", flush=True)
signal.pause()
"""
    after = f"""
import pathlib, signal
assert pathlib.Path({str(tmp_path / "mark")!r}).exists(), "started too early"
print("after ready", flush=True)
signal.pause()
"""
    watched = watch(script("slow", slow), script("after", after, after=("slow",)), script("beside"))
    assert watched.supervisor.start()
    ups = [name for name, line in watched.lines if line.startswith("up after")]
    assert ups.index("slow") < ups.index("after")
    assert set(ups) == {"slow", "after", "beside"}


def test_another_line_than_ready_does_not_take_a_child_up(watch: Callable[..., Watched]) -> None:
    code = 'import signal\nprint("other ready", flush=True)\nprint("talks", flush=True)\nsignal.pause()'
    watched = watch(script("child", code))
    watched.until(lambda: watched.said("talks"))
    assert watched.supervisor.health() == {"child": "starting"}


def test_a_killed_child_is_started_anew_and_the_others_are_left_alone(watch: Callable[..., Watched]) -> None:
    watched = watch(script("loop"), script("server"))
    watched.supervisor.start()
    loop, server = watched.supervisor.pid("loop"), watched.supervisor.pid("server")
    assert loop is not None
    os.kill(loop, signal.SIGKILL)
    watched.until(lambda: watched.up("loop", other_than=loop))
    assert watched.supervisor.pid("server") == server
    assert watched.said("was ended by SIGKILL; starting it anew")
    assert watched.supervisor.health()["loop"] == "up (died once)"
    assert any(health["loop"].startswith("down") for health in watched.health)


def test_processes_are_told_with_their_deaths_and_last_words(watch: Callable[..., Watched]) -> None:
    told: list[list[ProcessTold]] = []
    code = 'import os, signal\nprint("child ready", flush=True)\nprint("here", os.getpid(), flush=True)\nsignal.pause()'
    watched = watch(script("child", code))
    watched.supervisor.on_processes = told.append
    watched.supervisor.start()
    watched.until(lambda: told[-1][0].last == f"here {told[-1][0].process}")
    (first,) = told[-1]
    assert (first.state, first.deaths) == ("up", 0) and abs(time.time() - first.since) < 60
    assert first.process is not None
    os.kill(first.process, signal.SIGKILL)
    watched.until(lambda: "was ended by SIGKILL" in told[-1][0].last and told[-1][0].state == "back-off")
    assert (told[-1][0].process, told[-1][0].deaths) == (None, 1)
    watched.until(lambda: told[-1][0].state == "up" and told[-1][0].last.startswith("here"))


def test_what_is_bound_to_a_dead_child_is_ended_and_follows_it(watch: Callable[..., Watched]) -> None:
    watched = watch(script("plant"), script("loop", bound_to=("plant",)), script("link"))
    watched.supervisor.start()
    plant, loop, link = (watched.supervisor.pid(name) for name in ("plant", "loop", "link"))
    assert plant is not None
    os.kill(plant, signal.SIGKILL)
    watched.until(lambda: watched.up("plant", other_than=plant) and watched.up("loop", other_than=loop))
    ups = [name for name, line in watched.lines if line.startswith("up after")]
    assert ups[-2:] == ["plant", "loop"]
    assert watched.supervisor.pid("link") == link


def test_children_that_die_in_the_same_moment_are_both_started_anew(watch: Callable[..., Watched]) -> None:
    watched = watch(script("plant"), script("loop", bound_to=("plant",)))
    watched.supervisor.start()
    before = [watched.supervisor.pid(name) for name in ("plant", "loop")]
    for pid in before:
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
    time.sleep(0.1)
    watched.until(lambda: watched.up("plant", other_than=before[0]) and watched.up("loop", other_than=before[1]))


def test_the_delay_before_a_new_start_doubles_while_a_child_keeps_dying(
    watch: Callable[..., Watched], tmp_path: Path
) -> None:
    once_ready = f"""
import pathlib, signal, sys
mark = pathlib.Path({str(tmp_path / "mark")!r})
if mark.exists():
    sys.exit("no bus")
mark.touch()
print("loop ready", flush=True)
signal.pause()
"""
    watched = watch(script("loop", once_ready))
    watched.supervisor.start()
    pid = watched.supervisor.pid("loop")
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    watched.until(lambda: watched.said("starting it anew in 1 s"))
    told = [line.rpartition(" in ")[2] for _, line in watched.lines if "starting it anew" in line]
    assert told == ["0.25 s", "0.5 s", "1 s"]
    assert ("loop", "no bus") in watched.lines


def test_a_child_that_dies_at_the_first_start_ends_all_and_its_words_are_told(watch: Callable[..., Watched]) -> None:
    watched = watch(
        script("plant"), script("loop", 'import sys; sys.exit("robot.yaml:3: no such joint")', after=("plant",))
    )
    with pytest.raises(StartError, match="loop ended with exit status 1"):
        watched.supervisor.start()
    assert ("loop", "robot.yaml:3: no such joint") in watched.lines
    assert watched.supervisor.pid("plant") is None


def test_a_child_that_never_becomes_ready_counts_as_dead(watch: Callable[..., Watched]) -> None:
    watched = watch(script("loop", "import time; time.sleep(60)", ready_s=0.2))
    with pytest.raises(StartError, match="loop was ended by SIGKILL"):
        watched.supervisor.start()
    assert watched.said("is not ready after 0.2 s")


def test_the_end_comes_in_reverse_order_and_each_may_finish_its_work(
    watch: Callable[..., Watched], tmp_path: Path
) -> None:
    code = f"""
import pathlib, signal, sys, time
def end(*_):
    time.sleep(0.05)
    with pathlib.Path({str(tmp_path / "order")!r}).open("a") as file:
        file.write("{{name}}\\n")
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("{{name}} ready", flush=True)
while True:
    signal.pause()
"""
    watched = watch(*(script(name, code) for name in ("plant", "loop", "server")))
    watched.supervisor.start()
    watched.supervisor.end()
    assert (tmp_path / "order").read_text().split() == ["server", "loop", "plant"]


def test_a_child_that_ignores_sigterm_is_killed_with_its_own_children(
    watch: Callable[..., Watched], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.supervisor.END_S", 0.3)
    code = """
import signal, subprocess, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
grandchild = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
print("grandchild", grandchild.pid, flush=True)
print("stubborn ready", flush=True)
while True:
    signal.pause()
"""
    watched = watch(script("stubborn", code))
    watched.supervisor.start()
    pid = watched.supervisor.pid("stubborn")
    grandchild = next(int(line.split()[1]) for _, line in watched.lines if line.startswith("grandchild"))
    assert pid is not None
    watched.supervisor.end()
    assert watched.said("killed")
    assert not alive(pid)
    deadline = time.monotonic() + 30
    while alive(grandchild) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not alive(grandchild)


def test_children_that_talk_much_never_block_not_even_while_all_are_ended(watch: Callable[..., Watched]) -> None:
    chatty = """
import signal, sys
def end(*_):
    print("x" * 300000, flush=True)
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("y" * 300000, file=sys.stderr, flush=True)
print("{name} ready", flush=True)
while True:
    signal.pause()
"""
    watched = watch(script("one", chatty), script("two", chatty))
    watched.supervisor.start()
    watched.supervisor.end()
    assert [len(line) for _, line in watched.lines if line[:2] == "xx"] == [300000, 300000]
    assert not watched.said("killed")


def test_children_die_with_a_supervisor_that_is_killed() -> None:
    code = """
import sys
from daemon.serving.health import ProcessTold
from daemon.supervisor import Child, Supervisor
ready = "import time; print('child ready', flush=True); time.sleep(60)"
supervisor = Supervisor([Child("child", (sys.executable, "-c", ready))], report=lambda *_: None)
supervisor.start()
print(supervisor.pid("child"), flush=True)
supervisor.run()
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    child = int(process.stdout.readline())
    assert alive(child)
    process.kill()
    process.wait()
    deadline = time.monotonic() + 30
    while alive(child) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not alive(child)


def test_asked_to_end_from_a_signal_handler_it_returns_at_once(watch: Callable[..., Watched]) -> None:
    watched = watch(script("child"))
    watched.supervisor.start()
    previous = signal.signal(signal.SIGALRM, lambda *_: watched.supervisor.ask_end())
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        watched.supervisor.run()
    finally:
        signal.signal(signal.SIGALRM, previous)


def test_a_child_that_waits_for_a_later_one_is_refused() -> None:
    with pytest.raises(ValueError, match="loop waits for 'plant'"):
        Supervisor([script("loop", after=("plant",)), script("plant")], report=lambda *_: None)
