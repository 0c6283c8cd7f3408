"""The test bench that docs/drives.md shows, on an emulated drive."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from hal.drives.limb_fd.messages import Parameters
from hal.drives.parameter_client import ParameterError

_DOCS = Path(__file__).parents[2] / "docs" / "drives.md"


@pytest.fixture(scope="module")
def runtime() -> Iterator[Path]:
    """A plant with two drives, on the wall's clock."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        what = ["--robot", "sea_bench", "--scene", "empty", "--clock", "wall", "--runtime", folder]
        plant = subprocess.Popen([sys.executable, "-m", "hal.plant.world", *what], stdout=subprocess.PIPE, text=True)
        assert plant.stdout is not None
        try:
            assert plant.stdout.readline() == "plant ready\n"
            yield Path(folder)
        finally:
            plant.terminate()
            plant.communicate(timeout=20)


@pytest.mark.timeout(300)
def test_the_test_bench_in_the_docs_moves_a_drive(runtime: Path) -> None:
    script = re.search(r"```python\n(import can\n.*?)```", _DOCS.read_text(encoding="utf-8"), re.DOTALL)
    assert script is not None
    assert script[1].count("watchdog=20)") == 1
    # On a busy machine the script is late by more than 20 cycles.
    patient = script[1].replace("watchdog=20)", "watchdog=250)")
    done = subprocess.run(
        [sys.executable, "-c", patient], capture_output=True, text=True, timeout=100, check=False,
        env=os.environ | {"HANDRAIL_RUNTIME": str(runtime)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = re.fullmatch(
        r"firmware (\d+), (\d+\.\d) V, at most (\d+) N·m\nmoved (-?\d\.\d+) rad, (-?\d+\.\d) N·m, <DriveError.NONE: 0>\n",
        done.stdout,
    )
    assert told is not None, done.stdout
    assert float(told[4]) == pytest.approx(0.3, abs=0.1)


def test_a_parameters_attribute_reads_and_writes_and_the_drives_refusals_name_it(runtime: Path) -> None:
    with can.Bus(interface="handrail", channel="can0", runtime=runtime) as bus:
        elbow = Parameters(bus, limb=0, axis=1)
        elbow.torque_limit = 12.5
        assert elbow.torque_limit == 12.5 and Parameters(bus, limb=0, axis=0).torque_limit != 12.5
        with pytest.raises(ParameterError, match=r"limb 0, axis 1: temperature_limit 1e[+]09: out of range"):
            elbow.temperature_limit = 1e9
        with pytest.raises(AttributeError, match="bus_voltage can only be read"):
            elbow.bus_voltage = 3.0  # type: ignore[misc]
        with pytest.raises(AttributeError, match="calibrate can only be written"):
            print(elbow.calibrate)
        with pytest.raises(ParameterError, match="limb 3, axis 0: serial: the drive does not answer"):
            print(Parameters(bus, limb=3, axis=0).serial)
