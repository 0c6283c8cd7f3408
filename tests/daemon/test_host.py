"""`handrail up`: what it starts, what it refuses, what it tells."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from daemon import exchange
from daemon.exchange.mailbox import MailboxReader
from daemon.exchange.ring import StateRingWriter
from daemon.host import Clock, UsageError, check_network, children, drop_leftovers, further_engines, sole_service, up
from daemon.replay.recorder import free_name
from daemon.timing import TimingWriter
from handrail.config import ConfigError
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime

cli = typer.Typer()
cli.command()(up)


@pytest.fixture(scope="module")
def talos() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture
def runtime() -> Iterator[Runtime]:
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    yield Runtime.at(folder)
    shutil.rmtree(folder)


def on_real_buses(description: RobotDescription) -> RobotDescription:
    channels = tuple(msgspec.structs.replace(channel, interface="socketcan") for channel in description.channels)
    return dataclasses.replace(description, channels=channels)


def test_a_simulated_robot_gets_plant_loop_server_engine_link_and_camera_in_this_order(
    talos: RobotDescription, runtime: Runtime
) -> None:
    made = children(talos, robot="talos_upper", scene="valve", clock=Clock.LOCKSTEP, runtime=runtime, port=47800)
    assert [child.name for child in made] == ["plant", "loop", "server", "engine", "link", "camera"]
    commands = {child.name: " ".join(child.command[1:]) for child in made}
    where = f"--runtime {runtime.folder}"
    assert commands == {
        "plant": f"-m hal.plant.world --scene valve --robot talos_upper --clock lockstep {where}",
        "loop": f"-m daemon.loop --robot talos_upper --clock lockstep {where}",
        "server": f"-m daemon.server --robot talos_upper --clock lockstep {where}",
        "engine": f"-m engines.engine --robot talos_upper {where}",
        "link": f"-m handrail.link.gate {where} --port 47800 --bind 127.0.0.1",
        "camera": f"-m hal.plant.camera --scene valve --robot talos_upper --clock lockstep {where}",
    }
    assert next(child for child in made if child.name == "loop").bound_to == ("plant",)


def test_further_engines_are_named_or_counted(talos: RobotDescription, runtime: Runtime, tmp_path: Path) -> None:
    assert further_engines("1") == []
    assert further_engines("3") == ["engine2", "engine3"]
    made = children(
        talos, robot="talos_upper", scene="valve", clock=Clock.WALL, runtime=runtime, port=47800,
        engines=further_engines("vision"), code=tmp_path,
    )  # fmt: skip
    commands = {child.name: " ".join(child.command[1:]) for child in made}
    where = f"-m engines.engine --robot talos_upper --runtime {runtime.folder}"
    assert commands["engine"] == f"{where} --code {tmp_path / 'engine'}"
    assert commands["vision"] == f"{where} --name vision --code {tmp_path / 'vision'}"


@pytest.mark.parametrize("wrong", ["0", "9", "²", "vision,vision", "engine", "Vision", "daemon", ""])
def test_engines_that_can_not_be_are_refused(wrong: str) -> None:
    with pytest.raises(UsageError, match=f"--engines {wrong}: "):
        further_engines(wrong)


def test_engine_link_and_camera_can_be_left_out(talos: RobotDescription, runtime: Runtime) -> None:
    made = children(
        talos,
        robot="talos_upper",
        scene="valve",
        clock=Clock.WALL,
        runtime=runtime,
        port=47800,
        engine=False,
        link=False,
        camera=False,
    )
    assert [child.name for child in made] == ["plant", "loop", "server"]


def test_a_robot_without_cameras_gets_no_process_for_them(talos: RobotDescription, runtime: Runtime) -> None:
    blind = dataclasses.replace(talos, cameras=())
    made = children(blind, robot="talos_upper", scene="valve", clock=Clock.WALL, runtime=runtime, port=47800)
    assert "camera" not in [child.name for child in made]


def test_a_robot_on_real_buses_gets_no_plant(talos: RobotDescription, runtime: Runtime) -> None:
    made = children(on_real_buses(talos), robot="r", scene=None, clock=Clock.WALL, runtime=runtime, port=1)
    assert [child.name for child in made] == ["loop", "server", "engine", "link"]


def test_a_recorder_starts_first_so_that_it_ends_last_and_the_loop_writes_its_tape(
    talos: RobotDescription, runtime: Runtime, tmp_path: Path
) -> None:
    file = tmp_path / "run.mcap"
    recorder, _, loop, *others = children(
        talos, robot="talos_upper", scene="valve", clock=Clock.WALL, runtime=runtime, port=1, record=file
    )
    assert recorder.command[1:] == (
        "-m",
        "daemon.replay.recorder",
        "--out",
        str(file),
        "--runtime",
        str(runtime.folder),
    )
    assert recorder.name == "recorder" and loop.command[-1] == "--tape"
    assert not any("--tape" in child.command for child in others)


def test_what_was_recorded_is_never_written_over(tmp_path: Path) -> None:
    names = []
    for _ in range(3):
        names.append(free_name(tmp_path / "run.mcap").name)
        (tmp_path / names[-1]).touch()
    assert names == ["run.mcap", "run-2.mcap", "run-3.mcap"]


def test_lockstep_on_real_buses_is_refused(talos: RobotDescription, runtime: Runtime) -> None:
    with pytest.raises(UsageError, match=r"lockstep.*real buses"):
        children(on_real_buses(talos), robot="r", scene=None, clock=Clock.LOCKSTEP, runtime=runtime, port=1)


def test_a_scene_for_a_robot_on_real_buses_is_refused(talos: RobotDescription, runtime: Runtime) -> None:
    with pytest.raises(UsageError, match="--scene valve"):
        children(on_real_buses(talos), robot="r", scene="valve", clock=Clock.WALL, runtime=runtime, port=1)


def test_bit_timing_and_faults_are_the_plants_and_a_bad_file_is_refused_before_anything_starts(
    talos: RobotDescription, runtime: Runtime, tmp_path: Path
) -> None:
    file = tmp_path / "faults.yaml"
    file.write_text("faults:\n- {kind: drop, node: daemon}\n")
    what: dict[str, Any] = {
        "robot": "talos_upper",
        "scene": "valve",
        "clock": Clock.LOCKSTEP,
        "runtime": runtime,
        "port": 1,
    }
    plant, *others = children(talos, **what, bus_timing=True, faults=file)
    assert plant.command[-3:] == ("--bus-timing", "--faults", str(file))
    assert not any("--faults" in child.command for child in others)
    file.write_text("faults:\n- {kind: smoke}\n")
    with pytest.raises(ConfigError, match=r"faults.yaml:2.*kind"):
        children(talos, **what, faults=file)
    with pytest.raises(UsageError, match=f"--faults {file}.*real buses"):
        children(on_real_buses(talos), robot="r", scene=None, clock=Clock.WALL, runtime=runtime, port=1, faults=file)


def test_a_robot_on_a_bus_that_is_not_there_is_refused_before_anything_starts(talos: RobotDescription) -> None:
    with pytest.raises(UsageError, match=r"^CAN channel can0.*(no network interface|SocketCAN)"):
        check_network(on_real_buses(talos))
    unknown = msgspec.structs.replace(talos.channels[0], interface="sockcan")
    with pytest.raises(
        UsageError, match=r"channel can0: interface 'sockcan' is none that python-can has; expected .* socketcan,"
    ):
        check_network(dataclasses.replace(talos, channels=(unknown, talos.channels[1])))


def test_an_unknown_robot_is_one_line_that_names_those_there_are(runtime: Runtime) -> None:
    result = CliRunner().invoke(cli, ["talos_uper", "--scene", "valve", "--runtime", str(runtime.folder)])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "talos_uper" in result.stderr
    assert "talos_upper" in result.stderr


def test_an_unknown_or_missing_scene_is_one_line_that_names_those_there_are(runtime: Runtime) -> None:
    for arguments in (["--scene", "valv"], []):
        result = CliRunner().invoke(cli, ["talos_upper", *arguments, "--runtime", str(runtime.folder)])
        assert result.exit_code == 2
        assert result.stderr.count("\n") == 1
        assert "valve" in result.stderr


def test_a_wrong_scene_file_is_told_with_file_and_line(runtime: Runtime) -> None:
    file = runtime.folder / "wrong.yaml"
    file.write_text("objects:\n  valve:\n    kind: wheel\n    radius: -1\n    pose_in_world: {position: [0, 0, 0]}\n")
    result = CliRunner().invoke(cli, ["talos_upper", "--scene", str(file), "--runtime", str(runtime.folder)])
    assert result.exit_code == 2
    assert f"{file}:4: objects.valve.radius" in result.stderr


def test_a_second_service_in_the_same_folder_is_refused_and_names_the_first(runtime: Runtime) -> None:
    code = f"""
from daemon.host import sole_service
from handrail.runtime import Runtime
with sole_service(Runtime.at({str(runtime.folder)!r})):
    print("held", flush=True)
    input()
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    with pytest.raises(UsageError, match=f"process {process.pid}"), sole_service(runtime):
        pass
    process.kill()  # even so, nothing stays behind that would refuse the next
    process.wait()
    with sole_service(runtime):
        pass


def test_a_folder_that_cannot_be_used_is_one_line_that_names_it(runtime: Runtime) -> None:
    file = runtime.folder / "file"
    file.touch()
    result = CliRunner().invoke(cli, ["talos_upper", "--scene", "valve", "--runtime", str(file)])
    assert result.exit_code == 2
    assert result.stderr.startswith(f"handrail up: runtime folder: {file} can't be made")
    (runtime.folder / "up.lock").mkdir()
    with pytest.raises(UsageError, match="this user may write in"), sole_service(runtime):
        pass


def test_what_another_robot_left_in_the_folder_goes_and_what_this_one_left_stays(
    talos: RobotDescription, runtime: Runtime
) -> None:
    ours = exchange.snapshot_dtype(talos)
    StateRingWriter(runtime.state_ring, ours)
    MailboxReader(runtime.mailbox, exchange.COMMAND)
    TimingWriter(runtime.timing)
    drop_leftovers(runtime, talos)
    assert runtime.timing.exists()
    assert runtime.state_ring.exists()
    assert runtime.mailbox.exists()
    StateRingWriter(runtime.state_ring, np.dtype([("of_another_robot", "f8", 3)]))
    runtime.mailbox.write_bytes(b"")
    runtime.timing.write_bytes(b"of another version")
    drop_leftovers(runtime, talos)
    assert not runtime.state_ring.exists()
    assert not runtime.mailbox.exists()
    assert not runtime.timing.exists()
    drop_leftovers(runtime, talos)


def test_the_service_goes_on_when_nobody_reads_its_log_any_more(runtime: Runtime) -> None:
    process = subprocess.Popen([sys.executable, "-c", SERVICE, str(runtime.folder)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    while "Ctrl-C" not in process.stdout.readline():
        pass
    process.stdout.close()
    os.kill(_children_of(process.pid)["loop"], signal.SIGKILL)
    deadline = time.monotonic() + 20
    while json.loads((runtime.folder / "health.json").read_text()) != {"plant": "up", "loop": "up (died once)"}:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.02)
    children = _children_of(process.pid).values()
    process.send_signal(signal.SIGHUP)  # as a terminal that is closed sends it
    process.wait(timeout=20)
    assert not (runtime.folder / "health.json").exists(), "it ended in order"
    assert not any(os.path.exists(f"/proc/{child}") for child in children)


SERVICE = """
import sys
from daemon import host
from daemon.supervisor import Child
from handrail.runtime import Runtime
ready = "import signal; print('{} ready', flush=True); signal.pause()"
fakes = [Child(name, (sys.executable, "-c", ready.format(name))) for name in ("plant", "loop")]
host._serve(fakes, Runtime.at(sys.argv[1]), 47800)
"""


def test_the_service_tells_how_to_go_on_keeps_its_health_file_and_ends_all_on_ctrl_c(runtime: Runtime) -> None:
    process = subprocess.Popen([sys.executable, "-c", SERVICE, str(runtime.folder)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    health = runtime.folder / "health.json"
    told = ""
    while "Ctrl-C" not in told:
        line = process.stdout.readline()
        assert line, told
        told += line
    assert f"handrail stop --runtime {runtime.folder}" in told
    assert "handrail tablet --connect tcp://127.0.0.1:47800" in told
    assert json.loads(health.read_text()) == {"plant": "up", "loop": "up"}
    first = health.open()  # while it is open no other file can have its number
    loop = _children_of(process.pid)["loop"]
    os.kill(loop, signal.SIGKILL)
    deadline = time.monotonic() + 20
    while json.loads(health.read_text()) != {"plant": "up", "loop": "up (died once)"}:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    with first:  # replaced whole, never seen half written
        assert not os.path.samestat(os.fstat(first.fileno()), health.stat())
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "was ended by SIGKILL; starting it anew" in rest
    assert "ending all processes" in rest
    assert not health.exists()


def _children_of(pid: int) -> dict[str, int]:
    """Name → process, of the fake children."""
    import psutil

    names = {}
    for child in psutil.Process(pid).children():
        code = child.cmdline()[2]
        names[code.split("'")[1].split()[0]] = child.pid
    return names
