"""The pytest plugin: fixtures `bus`, `plant`, `daemon` and `robot` on a fresh rig for each test, evidence where one fails.

    @pytest.mark.handrail(robot="sea_bench", scene="valve", clock="wall")

Nothing heavy is imported before a test asks for one of the fixtures.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from hal.hil.bus import Bus
    from hal.hil.daemon import Daemon
    from hal.hil.nursery import Nursery
    from hal.hil.plant import Plant
    from hal.hil.rig import Rig
    from hal.hil.robot import Robot

MARK = "handrail"
_RIG = pytest.StashKey["Rig"]()


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        f"{MARK}(robot='talos_upper', scene='', clock='lockstep', bus_timing=False, faults=''): "
        "the robot, scene, clock and bus that the fixtures bus, plant, daemon and robot have",
    )


@pytest.fixture(scope="session")
def handrail_nursery() -> Iterator[Nursery]:
    """The warm process that the tests' processes are forked from."""
    from hal.hil.nursery import Nursery

    nursery = Nursery()
    yield nursery
    nursery.close()


@pytest.fixture
def handrail_rig(request: pytest.FixtureRequest, handrail_nursery: Nursery) -> Iterator[Rig]:
    """The test's processes and handles; the other fixtures are parts of it."""
    import msgspec

    from hal.hil.rig import Options, Rig
    from handrail.config import ConfigError

    marked: dict[str, Any] = {}
    for mark in reversed(list(request.node.iter_markers(MARK))):
        marked |= mark.kwargs
        if mark.args:
            raise pytest.UsageError(f"@pytest.mark.{MARK}{mark.args}: expected keywords only")
    known = [field.name for field in dataclasses.fields(Options)]
    if unknown := [name for name in marked if name not in known]:
        raise pytest.UsageError(f"@pytest.mark.{MARK}: {', '.join(unknown)}; expected {', '.join(known)}")
    try:
        msgspec.convert(marked, Options)
    except msgspec.ValidationError as error:
        raise pytest.UsageError(f"@pytest.mark.{MARK}: {error}; got {marked}") from error
    try:
        rig = Rig(Options(**marked), handrail_nursery)
    except ConfigError as error:
        pytest.fail(f"@pytest.mark.{MARK}: {error}", pytrace=False)
    request.node.stash[_RIG] = rig
    yield rig
    rig.close()


@pytest.fixture
def plant(handrail_rig: Rig) -> Plant:
    """The simulated robot and its world: its ground truth, and a test's hands in it."""
    return handrail_rig.plant


@pytest.fixture
def bus(handrail_rig: Rig) -> Bus:
    """The virtual CAN bus: every frame, and faults."""
    return handrail_rig.bus


@pytest.fixture
def daemon(handrail_rig: Rig) -> Daemon:
    """The control daemon's loop and server, running; the robot is not enabled."""
    return handrail_rig.daemon


@pytest.fixture
def robot(handrail_rig: Rig) -> Robot:
    """Everything, enabled and holding."""
    return handrail_rig.robot


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Any:
    report = yield
    rig = item.stash.get(_RIG, None)
    if rig is not None and report.failed and report.when in ("setup", "call"):
        name = re.sub(r"[^\w.-]+", "_", item.nodeid)[-120:]
        # pytest keeps its temporary folders of the last three sessions.
        folder = Path(item.config._tmp_path_factory.getbasetemp()) / "handrail" / name  # type: ignore[attr-defined]
        report.sections.append(("Handrail", "\n".join(rig.keep_evidence(folder))))
    return report
