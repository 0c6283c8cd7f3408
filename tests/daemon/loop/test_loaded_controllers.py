"""Controllers that are loaded by name: made beside the loop, switched in one cycle or not at all."""

import contextlib
import threading
from pathlib import Path

import msgspec
import pytest

from daemon.controllers import registry
from daemon.controllers.roster import read_roster
from daemon.controllers.workshop import Job, When, Workshop
from daemon.exchange import CONTROLLERS, Answer, ControllerState, Kind
from daemon.exchange.doorbell import Doorbell, server_doorbell
from handrail.messages import ConfigureController, LoadController
from tests.daemon.loop.conftest import PATIENCE_S, SWAY, Desk

HOLD = CONTROLLERS.index("hold")
LEFT, RIGHT = [f"arm_left_{i}_joint" for i in range(1, 8)], [f"arm_right_{i}_joint" for i in range(1, 8)]


def test_a_controller_goes_through_its_life_by_name(desk: Desk) -> None:
    slot = desk.begin("guide", "gravity_compensation", LEFT, configure=False)
    assert desk.settle(slot) is ControllerState.UNCONFIGURED
    desk.bench.enable()
    assert desk.switch([slot]) is Answer.CONTROLLER_STATE, "it has not been made yet"
    configure = msgspec.json.encode(ConfigureController(name="guide", parameters={"damping": 0.1}))
    assert desk.give(Kind.CONFIGURE, go=1 << slot, text=configure) is Answer.ACCEPTED
    assert desk.settle(slot) is ControllerState.INACTIVE
    assert desk.switch([slot]) is Answer.ACCEPTED
    assert desk.state(slot) is ControllerState.ACTIVE
    assert desk.claimed(slot) == LEFT
    assert desk.give(Kind.UNLOAD, go=1 << slot) is Answer.CONTROLLER_STATE, "it is active"
    rows = desk.bench.description.index(tuple(LEFT))
    assert desk.bench.run(5)["command"][3][rows] == pytest.approx(0.0), "no stiffness"
    assert desk.switch([], [slot]) is Answer.ACCEPTED
    assert desk.state(slot) is ControllerState.INACTIVE
    assert (desk.bench.snapshot()["claims"] == HOLD).all()
    assert desk.switch([slot]) is Answer.ACCEPTED, "it can be activated again"
    assert desk.switch([], [slot]) is Answer.ACCEPTED
    assert desk.give(Kind.UNLOAD, go=1 << slot) is Answer.ACCEPTED
    assert desk.settle(slot) is ControllerState.EMPTY
    assert desk.roster().loaded == []


def test_the_loop_goes_on_while_a_controller_is_made_and_makes_nothing_itself(desk: Desk, monkeypatch) -> None:
    """Counted, not timed: cycles pass while the constructor waits, and it runs in another thread than the loop."""
    proceed, makers = threading.Event(), []

    class Slow(registry.KINDS["gravity_compensation"]):  # type: ignore[misc]
        @classmethod
        def make(cls, setup):
            makers.append(threading.get_ident())
            assert proceed.wait(PATIENCE_S)
            return super().make(setup)

    monkeypatch.setitem(registry.KINDS, "slow", Slow)
    desk.bench.enable()
    slot = desk.begin("slow", "slow", LEFT)
    before = desk.bench.loop.cycles
    desk.bench.run(200)
    assert desk.bench.loop.cycles == before + 200
    assert desk.state(slot) is ControllerState.LOADING
    assert desk.switch([slot]) is Answer.CONTROLLER_STATE
    proceed.set()
    assert desk.settle(slot) is ControllerState.INACTIVE
    assert len(makers) == 2 and threading.get_ident() not in makers, "a twin that is rehearsed, and the controller"


def test_switching_compiles_and_imports_nothing_in_the_cycle(desk: Desk, workspace: Path, monkeypatch) -> None:
    (workspace / "sway.py").write_text(
        SWAY.replace("import numpy as np", "import numba\nimport numpy as np").replace(
            "        self.phase +=", "        wave(self.phase)\n        self.phase +="
        )
        + "\n@numba.njit\ndef wave(x):\n    return x * x\n"
    )
    desk.bench.enable()
    slot = desk.load("sway", "sway", LEFT)
    wave = desk.table._slots[slot].controller.update.__globals__["wave"]
    compiled = list(wave.signatures)
    assert compiled, "the rehearsal has compiled it"
    monkeypatch.setattr("builtins.__import__", lambda *a, **k: pytest.fail(f"imported {a[0]} in a cycle"))
    desk.table._manager.switch([], [desk.table._slots[slot].controller], desk.bench.loop.written)
    for _ in range(3):
        desk.bench.loop.cycle()
    monkeypatch.undo()
    assert wave.signatures == compiled


def test_a_users_own_controller_is_loaded_from_the_workspace_and_anew_when_its_file_has_changed(
    desk: Desk, workspace: Path
) -> None:
    desk.bench.enable()
    slot = desk.load("mine", "sway", ["arm_left_4_joint"])
    assert desk.switch([slot]) is Answer.ACCEPTED
    joint = desk.bench.index("arm_left_4_joint")
    start = float(desk.bench.loop.written.position[joint])
    assert desk.bench.run(250)["command"][0][joint] == pytest.approx(start + 0.2, abs=0.01)
    assert desk.switch([], [slot]) is Answer.ACCEPTED
    (workspace / "sway.py").write_text(SWAY.replace("0.1 *", "0.05 *").replace("0.2 *", "0.1 *"))
    other = desk.load("again", "sway", ["arm_left_4_joint"])
    assert desk.switch([other]) is Answer.ACCEPTED
    start = float(desk.bench.loop.written.position[joint])
    assert desk.bench.run(250)["command"][0][joint] == pytest.approx(start + 0.1, abs=0.01)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("import nothing_of_this_name", "No module named 'nothing_of_this_name'"),
        ("x = 1", "expected one class that is a Controller"),
        (SWAY + "\nclass Two(Sway):\n    pass\n", "Sway, Two; expected one class"),
        (SWAY.replace("def update", "def advance"), "Sway lacks update"),
        ("raise SystemExit(3)", "SystemExit: 3"),
    ],
)
def test_what_can_not_be_loaded_is_told_with_the_reason_and_leaves_no_trace(
    desk: Desk, workspace: Path, text: str, told: str
) -> None:
    (workspace / "bad.py").write_text(text)
    slot = desk.begin("bad", "bad", LEFT)
    assert desk.settle(slot) is ControllerState.EMPTY
    roster = desk.roster()
    assert roster.loaded == []
    assert (roster.news[-1].name, roster.news[-1].state) == ("bad", "finalized")
    assert told in roster.news[-1].detail


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            ("def activate(self", "def __init__(self, joints, gains):\n        1 / 0\n\n    def activate(self"),
            "ZeroDivisionError",
        ),
        (
            ("self.phase += 2", "out.position[0] = 1.0; self.phase += 2"),
            "it commands what it does not claim: position of arm_right_1",
        ),
        (
            ("self.write_impedance(robot, out,", "(lambda *_: 0)(robot, out,"),
            "it does not command what it claims: position of arm_left_1",
        ),
        (("+ 0.1 *", "+ np.nan *"), "what it commands is no finite number: position of arm_left_1"),
    ],
)
def test_what_can_not_be_made_stays_unconfigured_with_the_reason(
    desk: Desk, workspace: Path, change: tuple[str, str], told: str
) -> None:
    (workspace / "bad.py").write_text(SWAY.replace(*change))
    slot = desk.begin("bad", "bad", LEFT)
    assert desk.settle(slot) is ControllerState.UNCONFIGURED
    assert told in desk.roster().loaded[0].error
    (workspace / "bad.py").write_text(SWAY)


def test_a_kind_of_ones_own_takes_parameters_as_the_built_in_ones_do(desk: Desk, workspace: Path) -> None:
    built_in = Path(registry.__file__).with_name("gravity_compensation.py").read_text()
    (workspace / "own_guide.py").write_text(built_in)
    desk.load("guide", "own_guide", LEFT, parameters={"damping": 0.1})
    slot = desk.begin("wrong", "own_guide", LEFT, parameters={"damping": 7})
    assert desk.settle(slot) is ControllerState.UNCONFIGURED
    assert "damping" in desk.roster().loaded[-1].error


def test_parameters_that_a_kind_does_not_know_are_named(desk: Desk) -> None:
    slot = desk.begin("guide", "gravity_compensation", LEFT, parameters={"dampling": 0.1})
    assert desk.settle(slot) is ControllerState.UNCONFIGURED
    assert "dampling" in desk.roster().loaded[0].error


def test_a_switch_is_whole_or_changes_nothing(desk: Desk) -> None:
    left = desk.load("left", "gravity_compensation", LEFT)
    both = desk.load("both", "gravity_compensation", [*LEFT, *RIGHT])
    assert desk.switch([left]) is Answer.NOT_ENABLED
    desk.bench.enable()
    assert desk.switch([left, both]) is Answer.CLAIMED
    assert (desk.bench.snapshot()["claims"] == HOLD).all()
    assert desk.switch([left]) is Answer.ACCEPTED
    assert desk.switch([both]) is Answer.CLAIMED
    assert desk.bench.snapshot()["answer_joint"] == desk.bench.index("arm_left_1_joint")
    assert desk.claimed(left) == LEFT
    assert desk.switch([both], [left], roster=desk.table.roster - 1) is Answer.ROSTER_CHANGED
    assert desk.switch([both], [left]) is Answer.ACCEPTED, "in one cycle"
    assert (desk.state(left), desk.state(both)) == (ControllerState.INACTIVE, ControllerState.ACTIVE)
    assert desk.bench.start(desk.bench.move("arm_left_1_joint", 0.1)) is Answer.CLAIMED
    assert desk.switch([], [left]) is Answer.CONTROLLER_STATE
    assert desk.switch([15]) is Answer.CONTROLLER_STATE


def test_a_newcomer_that_raises_backs_the_whole_switch_out(desk: Desk, workspace: Path) -> None:
    (workspace / "shy.py").write_text(
        SWAY.replace("    def activate", "    tries = 0\n\n    def activate").replace(
            "self.start,",
            "type(self).tries += 1\n        if self.tries > 1:\n            raise OSError('not now')\n        self.start,",
        )
    )
    desk.bench.enable()
    good, shy = desk.load("good", "gravity_compensation", LEFT), desk.load("shy", "shy", RIGHT)
    assert desk.switch([good, shy]) is Answer.NOT_ACTIVATED
    assert (desk.bench.snapshot()["claims"] == HOLD).all()
    assert desk.settle(shy) is ControllerState.UNCONFIGURED
    assert desk.state(good) is ControllerState.INACTIVE
    assert "OSError: not now" in desk.roster().loaded[1].error


def test_a_stop_takes_every_controller_out_and_enabling_brings_none_back(desk: Desk) -> None:
    desk.bench.enable()
    slot = desk.load("guide", "gravity_compensation", LEFT)
    assert desk.switch([slot]) is Answer.ACCEPTED
    desk.bench.loop.life.stop("a test")
    desk.bench.run(5)
    assert desk.state(slot) is ControllerState.INACTIVE
    assert desk.switch([slot]) is Answer.STOP_LATCHED
    desk.bench.loop.life.clear_stop()
    desk.bench.enable()
    assert desk.state(slot) is ControllerState.INACTIVE
    assert (desk.bench.snapshot()["claims"] == HOLD).all()


def test_no_more_controllers_are_loaded_than_there_are_slots(desk: Desk) -> None:
    for number in range(16):
        desk.begin(f"c{number}", "gravity_compensation", LEFT, configure=False)
    call = LoadController(name="one_too_many", kind="gravity_compensation", joints=LEFT)
    assert desk.give(Kind.LOAD, text=msgspec.json.encode(call)) is Answer.TOO_MANY
    assert desk.settle(15) is ControllerState.UNCONFIGURED
    assert len(desk.roster().loaded) == 16


def test_the_server_is_woken_when_the_roster_has_been_written(desk: Desk, tmp_path: Path) -> None:
    loop = desk.bench.loop
    workshop = Workshop(
        loop.robot.kinematics, loop.manager.gains, loop.hardware.state, 0.002, tmp_path / "controllers.json"
    )
    with contextlib.closing(Doorbell(server_doorbell(tmp_path))) as server:
        workshop.put(Job(When(roster=7, time_ns=0, cycle=0), slot=3, forget=True))
        assert server.wait(PATIENCE_S)
        assert read_roster(tmp_path / "controllers.json").number == 7
    workshop.close()
