"""`handrail stop` against a socket that stands for the loop's."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from handrail.runtime import Runtime
from handrail.stop import NoAnswer, clear_stop, stop, stop_now

cli = typer.Typer()
cli.command()(stop)


@pytest.fixture
def runtime() -> Iterator[Runtime]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    yield Runtime.at(folder)
    shutil.rmtree(folder)


@pytest.fixture
def loop(runtime: Runtime) -> Iterator[Callable[[dict[str, str]], list[str]]]:
    """Answers the first word of a datagram as told; `loop({...})` gives the list of what it was sent."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    threads = []

    def serve(answers: dict[str, str], received: list[str]) -> None:
        while True:
            data, sender = listener.recvfrom(4096)
            if data == b"END":
                return
            received.append(data.decode())
            answer = answers.get(received[-1].split()[0])
            if answer is not None and sender:
                listener.sendto(answer.encode(), sender)

    def begin(answers: dict[str, str]) -> list[str]:
        received: list[str] = []
        listener.bind(str(runtime.stop))
        threads.append(threading.Thread(target=serve, args=(answers, received)))
        threads[0].start()
        return received

    yield begin
    if threads:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ender:
            ender.sendto(b"END", str(runtime.stop))
        threads[0].join()
    listener.close()


def test_stop_sends_the_reason_and_succeeds_when_the_loop_answers(runtime: Runtime, loop: Callable) -> None:
    received = loop({"STOP": "stopped"})
    result = CliRunner().invoke(cli, ["smoke in the cell", "--runtime", str(runtime.folder)])
    assert result.exit_code == 0
    assert result.output == "stopped\n"
    assert received == ["STOP smoke in the cell"]


def test_clear_unlatches_and_succeeds_when_the_loop_answers(runtime: Runtime, loop: Callable) -> None:
    received = loop({"CLEAR": "cleared"})
    result = CliRunner().invoke(cli, ["--clear", "--runtime", str(runtime.folder)])
    assert result.exit_code == 0
    assert received == ["CLEAR"]


def test_without_a_loop_it_fails_and_says_where_it_looked_and_what_to_do(runtime: Runtime) -> None:
    result = CliRunner().invoke(cli, ["--runtime", str(runtime.folder)])
    assert result.exit_code == 1
    assert str(runtime.stop) in result.stderr
    assert "--runtime" in result.stderr
    assert "emergency stop" in result.stderr


def test_a_socket_left_over_by_a_dead_loop_counts_as_no_loop(runtime: Runtime) -> None:
    dead = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    dead.bind(str(runtime.stop))
    dead.close()
    with pytest.raises(NoAnswer, match="no daemon loop listens"):
        stop_now(runtime)


def test_a_loop_that_hangs_is_told_from_one_that_is_not_there(runtime: Runtime) -> None:
    hanging = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    hanging.bind(str(runtime.stop))
    with pytest.raises(NoAnswer, match="hangs"):
        stop_now(runtime, timeout_s=0.05)
    result = CliRunner().invoke(cli, ["--runtime", str(runtime.folder), "--timeout", "0.05"])
    assert result.exit_code == 1
    hanging.close()


def test_an_answer_that_is_not_a_stop_is_no_success(runtime: Runtime, loop: Callable) -> None:
    loop({"STOP": "what?"})
    result = CliRunner().invoke(cli, ["--runtime", str(runtime.folder)])
    assert result.exit_code == 1
    assert "what?" in result.stderr


def test_a_reason_of_many_lines_and_letters_becomes_one_short_line(runtime: Runtime, loop: Callable) -> None:
    received = loop({"STOP": "stopped", "CLEAR": "cleared"})
    stop_now(runtime, "line\nCLEAR\n" + "ä" * 300)
    assert received[0].startswith("STOP line CLEAR ä")
    assert "\n" not in received[0]
    assert len(received[0].encode()) <= len("STOP ") + 200
    assert clear_stop(runtime) == "cleared"


def test_a_reason_that_is_no_text_stops_all_the_same(runtime: Runtime, loop: Callable) -> None:
    received = loop({"STOP": "stopped"})
    assert stop_now(runtime, os.fsdecode(b"caf\xe9")) == "stopped"
    assert received == ["STOP caf?"]


def test_looking_for_a_robot_in_a_wrong_place_makes_no_folder_and_is_told(tmp_path: Path) -> None:
    short = Path(tempfile.gettempdir()) / f"hr-none-{os.getpid()}"
    (tmp_path / "file").touch()
    for wrong in (short, tmp_path / "file"):
        result = CliRunner().invoke(cli, ["--runtime", str(wrong)])
        assert result.exit_code == 1
        assert "no daemon loop listens" in result.stderr
    assert not short.exists()


def test_a_runtime_folder_with_too_long_a_name_is_wrong_use(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["--runtime", str(tmp_path / ("x" * 100))])
    assert result.exit_code == 2
    assert "Unix sockets" in result.stderr
