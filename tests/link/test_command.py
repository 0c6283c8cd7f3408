"""Who of those that are connected commands: taken, returned, taken over, and lost by whoever is not heard any more."""

from __future__ import annotations

import shutil
from collections.abc import Callable

import pytest

from handrail.client import Client, RefusedError
from handrail.link import keys
from handrail.link.command import COMMANDING, LAPSES_S, Command
from handrail.messages import AnswerPrompt, CancelAction, Enable, GetStatus, PauseRun, PlaceInstance, Pose, StopRun


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def command(clock: Clock) -> Command:
    return Command(clock)


def test_nobody_has_it_until_somebody_takes_it_and_then_others_only_look_and_end_things(command):
    command.check("bob", Enable())
    assert command.holder == "" and command.take("ada") == ""
    command.check("ada", Enable())
    with pytest.raises(RefusedError, match="ada has the command, and the link knows you as bob") as refused:
        command.check("bob", Enable())
    assert (refused.value.refusal.field, refused.value.refusal.value) == ("by", "bob")
    for call in (GetStatus(), PauseRun(), StopRun(), CancelAction(id="a")):
        command.check("bob", call)


def test_it_is_returned_or_taken_over(command):
    command.take("ada")
    with pytest.raises(RefusedError, match="ada has the command"):
        command.take("bob")
    with pytest.raises(RefusedError, match="ada has the command"):
        command.give_back("bob")
    assert command.take("bob", take_over=True) == "ada" and command.holder == "bob"
    with pytest.raises(RefusedError, match="bob has the command"):
        command.check("ada", Enable())
    command.give_back("bob")
    command.check("ada", Enable())
    command.give_back("ada")  # nobody has it: nothing to refuse


def test_who_is_not_heard_any_more_has_it_no_more(command, clock):
    command.take("ada")
    clock.now += LAPSES_S
    command.heard("ada")
    clock.now += LAPSES_S
    assert command.holder == "ada"
    command.heard("bob")
    clock.now += 0.1
    assert command.holder == ""
    command.heard("ada")
    assert command.holder == "", "what has lapsed does not come again"
    command.check("bob", Enable())


def test_what_commands_is_no_looking_and_no_ending():
    names = {kind.__name__ for kind in COMMANDING}
    assert not {name for name in names if name.startswith(("Get", "List", "Pause", "Cancel", "Stop"))}
    assert {"Enable", "Jog", "ExecutePlan", "Run", "AnswerPrompt", "CommandGripper", "StreamPose"} <= names


@pytest.fixture
def client_of(stand, tmp_path) -> Callable[[str], Client]:
    def make(name: str) -> Client:
        own = keys.ensure(tmp_path / name)
        shutil.copy(stand.keys / "server.key", own / "server.key")
        shutil.copy(own / "client.key", stand.keys / "allowed" / f"{name}.key")
        return stand.client(own)

    return make


def test_over_the_link_it_is_between_keys_and_stop_stays_everybodys(stand, client_of):
    daemon, engine, _ = stand.daemon(), stand.engine(), stand.gate()
    ada, bob = client_of("ada"), client_of("bob")
    assert ada.identity().commander == ""
    assert ada.take_command().commander == "ada" and bob.identity().commander == "ada"
    for call in (Enable(), AnswerPrompt(id="prompt-1", answer="approve", by="bob")):
        with pytest.raises(RefusedError, match="ada has the command, and the link knows you as bob"):
            bob.call(call)
    assert not daemon.asked and not engine.asked
    ada.call(Enable())
    bob.call(GetStatus())
    with pytest.raises(RefusedError, match="ada has the command"):
        bob.take_command()
    assert [type(call) for call in daemon.asked] == [Enable, GetStatus]
    bob.take_command(take_over=True)
    with pytest.raises(RefusedError, match="bob has the command, and the link knows you as ada"):
        ada.call(Enable())
    with pytest.raises(RefusedError, match="bob has the command"):
        ada.return_command()
    assert bob.return_command().commander == ""
    ada.call(Enable())
    bob.take_command()
    ada.call(PlaceInstance(name="w", template="wheel", pose_in_world=Pose(), parameters={}))  # objects are shared
    assert [type(call) for call in engine.asked] == [PlaceInstance]


def test_an_observer_can_not_take_it(stand, client_of):
    stand.daemon()
    stand.gate()
    otto = client_of("otto")
    (stand.keys / "allowed" / "observers").mkdir(exist_ok=True)
    (stand.keys / "allowed" / "otto.key").rename(stand.keys / "allowed" / "observers" / "otto.key")
    with pytest.raises(RefusedError, match="observers look on"):
        otto.take_command()
