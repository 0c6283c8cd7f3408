"""Who has an observer's key looks on and may stop the robot; the link refuses everything else."""

from __future__ import annotations

import shutil
from collections.abc import Callable

import pytest

from handrail.client import Client, RefusedError, Unreachable
from handrail.link import codec, keys
from handrail.messages import (
    AnswerPrompt,
    ClientIdentity,
    Enable,
    ExecutePlan,
    GetChallenge,
    GetIdentity,
    GetProcesses,
    GetStatus,
    PlaceInstance,
    Pose,
    RestartProcess,
    Run,
    SetSpeed,
)

COMMANDS = (
    *(Enable(), SetSpeed(share=1.0), RestartProcess(process="loop"), GetChallenge(owner="otto")),
    *(PlaceInstance(name="w", template="wheel", pose_in_world=Pose(), parameters={}), ExecutePlan(id="plan-1")),
    *(Run(deployment="deployment-1"), AnswerPrompt(id="prompt-1", answer="approve", by="otto")),
)


@pytest.fixture
def client_in(stand, tmp_path) -> Callable[[str, str], Client]:
    """A client of that name whose key lies in a folder below `allowed`."""

    def make(name: str, folder: str) -> Client:
        own = keys.ensure(tmp_path / name)
        shutil.copy(stand.keys / "server.key", own / "server.key")
        place = stand.keys / "allowed" / folder
        place.mkdir(exist_ok=True)
        shutil.copy(own / "client.key", place / f"{name}.key")
        return stand.client(own)

    return make


def test_an_observer_sees_and_commands_nothing(stand, client_in):
    daemon, engine, _ = stand.daemon(), stand.engine(), stand.gate()
    otto = client_in("otto", "observers")
    assert otto.call(GetIdentity()) == ClientIdentity(name="otto", role="observer")
    assert otto.call(GetStatus()).clock == "lockstep"
    for call in COMMANDS:
        with pytest.raises(RefusedError, match=r"observers look on.*allowed/observers/otto\.key"):
            otto.call(call)
    assert [type(call) for call in daemon.asked] == [GetStatus] and not engine.asked
    (stand.keys / "allowed" / "observers" / "otto.key").rename(stand.keys / "allowed" / "otto.key")
    assert otto.call(GetIdentity()).role == "operator"
    otto.call(Enable())
    assert isinstance(daemon.asked[-1], Enable)


def test_all_that_an_observer_may_say_asks_something_or_stops_the_robot():
    others = {kind.__name__ for kind in codec.OBSERVING if not kind.__name__.startswith(("Get", "List"))}
    assert others == {"AwaitPlan", "WatchPort", "Stop"} and GetChallenge not in codec.OBSERVING


def test_processes_are_asked_of_the_supervisor_which_is_said_to_be_missing(stand, client_in):
    stand.gate()
    ada = client_in("ada", "")
    for call in (GetProcesses(), RestartProcess(process="loop")):
        with pytest.raises(Unreachable, match="not started by handrail up"):
            ada.call(call)
