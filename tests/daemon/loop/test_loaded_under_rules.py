"""Controllers that were loaded by name are under the rules about joints, as actions are; the list tells what ended each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from daemon.controllers.roster import roster_file
from daemon.exchange import CONTROLLERS, LOADED_CODE, Answer, ControllerState, Kind, Outcome, Rule
from daemon.safety.bounds import DIVERGED, STALE
from daemon.serving.controller_desk import ControllerDesk
from hal.drives.lifecycle import State
from handrail.messages import ControllerEvent, ControllerInfo
from handrail.robot.description import RobotDescription
from handrail.robot.guarding import Guarding
from tests.daemon.loop.conftest import Bench, Desk
from tests.daemon.loop.test_failing_controllers import codes, free, rated_jump

__all__ = ["free"]
HOLD = CONTROLLERS.index("hold")
LEFT = [f"arm_left_{i}_joint" for i in range(1, 8)]
JOINT = LEFT[3]


@pytest.fixture
def bench(talos: RobotDescription, make_bench: Callable[..., Bench]) -> Bench:
    """Without the guard: soft arms are flung about here, which it would stop."""
    return make_bench(replace(talos, guard=Guarding(self_collision=False)))


class Teller:
    """The server's side: what it lists, and the events that it sends."""

    def __init__(self, desk: Desk):
        self._desk, self._file = desk, ControllerDesk(desk.bench.description, roster_file(desk.bench.runtime))
        assert list(self.events()) == [], "what was there before is no news"

    def events(self) -> Iterator[ControllerEvent]:
        snapshot = self._desk.bench.snapshot()
        assert self._file.look(snapshot)
        return self._file.deactivations(snapshot)

    def info(self, name: str) -> ControllerInfo:
        snapshot = self._desk.bench.snapshot()
        assert self._file.look(snapshot)
        return next(info for info in self._file.list(snapshot).controllers if info.name == name)


def push_away(desk: Desk, slot: int) -> None:
    """Up to and with the cycle in which an arm's joint is too far from its command for its controller."""
    desk.bench.drives.external_torque[desk.bench.index(JOINT)] = -3000.0
    for _ in range(300):
        desk.bench.run()
        if desk.state(slot) is not ControllerState.ACTIVE:
            return
    raise AssertionError("it goes on")


@pytest.fixture
def soft(free: Desk) -> int:
    """The slot of a controller of the left arm that is active, with one that gives way to fall back to."""
    free.load("guide", "gravity_compensation", LEFT)
    slot = free.load("soft", "joint_impedance", LEFT, fallback=["guide"])
    assert free.switch([slot]) is Answer.ACCEPTED
    return slot


def test_one_whose_joint_diverges_gives_way_to_its_fallback_in_that_cycle_and_may_be_switched_on_again(
    free: Desk, soft: int
) -> None:
    teller = Teller(free)
    push_away(free, soft)
    cycle = int(free.bench.snapshot()["cycle"])
    assert free.state(soft) is ControllerState.INACTIVE, "nothing is wrong with the controller"
    assert codes(free, LEFT) == {LOADED_CODE + 0}
    row = free.bench.snapshot()["safety"][Rule.DIVERGED]
    assert (row["times"], row["joint"]) == (1, free.bench.index(JOINT)) and row["value"] > row["limit"] == DIVERGED
    (event,) = teller.events()
    assert (event.name, event.state, event.cycle) == ("soft", "inactive", cycle)
    assert f"{JOINT} was {row['value']:.3f} rad" in event.detail
    told = teller.info("soft")
    assert (told.state, told.why, told.since_ns) == ("inactive", event.detail, event.time_ns)
    free.bench.drives.external_torque[:] = free.bench.drives.state.velocity[:] = 0.0
    free.bench.run(300)
    assert list(teller.events()) == []
    assert free.state(0) is ControllerState.ACTIVE, "what gives way does not diverge"
    description, where = free.bench.description, free.bench.snapshot()
    joints = description.index(tuple(LEFT))
    within = np.clip(where["position"], description.lower, description.upper)[joints]
    assert where["command"][0][joints] == pytest.approx(within, abs=0.02)
    assert free.switch([soft], [0]) is Answer.ACCEPTED
    assert (teller.info("soft").state, teller.info("soft").why) == ("active", "")
    assert teller.info("guide").why == "switched off"


def test_one_whose_joint_is_not_measured_any_more_is_followed_by_hold_not_by_a_fallback_as_blind(
    free: Desk, soft: int
) -> None:
    free.bench.drives.silent[free.bench.index(JOINT)] = True
    free.bench.run(STALE)
    assert free.state(soft) is ControllerState.ACTIVE, "a few lost replies are none"
    free.bench.run(2)
    assert free.state(soft) is ControllerState.INACTIVE
    assert codes(free, LEFT) == {HOLD}
    assert rated_jump(free) < 0.01
    assert free.bench.snapshot()["safety"]["times"][Rule.STALE] == 1
    assert "had not been measured for 2" in Teller(free).info("soft").why
    before = free.bench.snapshot()["command"][0].copy()
    free.bench.drives.silent[:] = False
    free.bench.run(30)
    assert np.abs(free.bench.snapshot()["command"][0] - before).max() < 1e-9, "it is held, and nothing comes back"
    assert free.switch([soft]) is Answer.ACCEPTED


def test_who_commands_the_references_of_one_that_is_ended_goes_with_it(free: Desk, soft: int, workspace) -> None:
    sway = free.load("sway", "sway", LEFT[:1], onto="soft")
    assert free.switch([sway]) is Answer.ACCEPTED
    push_away(free, soft)
    assert free.state(sway) is ControllerState.INACTIVE
    teller = Teller(free)
    assert "from its command" in teller.info("soft").why
    assert "whose references it commands" in teller.info("sway").why


def test_the_rules_look_at_a_controllers_own_joints_only(free: Desk, soft: int) -> None:
    other = free.bench.index("arm_right_1_joint")
    free.bench.drives.silent[other] = True
    free.bench.run(STALE + 5)
    assert free.state(soft) is ControllerState.ACTIVE
    assert not free.bench.snapshot()["safety"]["times"][Rule.STALE]


@pytest.mark.parametrize(
    ("what", "why"),
    [("stop", "the operator stop"), ("disable", "the robot was disabled"), ("fault", "the drive of arm_right_1_joint")],
)
def test_what_deactivates_everything_is_told_of_each_and_nothing_comes_back(
    free: Desk, soft: int, what: str, why: str
) -> None:
    teller, bench = Teller(free), free.bench
    if what == "stop":
        bench.loop.life.stop("test")
    elif what == "disable":
        assert bench.ask(Kind.DISABLE) is Answer.ACCEPTED
    else:
        bench.drives.life[bench.index("arm_right_1_joint")] = State.FAULT
    bench.run(3)
    (event,) = teller.events()
    assert event.detail == teller.info("soft").why and why in event.detail
    bench.loop.life.clear_stop()
    right = free.load("right", "gravity_compensation", ["arm_right_1_joint"])
    if what == "fault":
        assert free.switch([right]) is Answer.ISOLATED
        assert free.switch([soft]) is Answer.ACCEPTED, "the other arm's may go on"
        assert free.switch([], [soft]) is Answer.ACCEPTED
    bench.enable()
    bench.run(20)
    assert free.state(soft) is ControllerState.INACTIVE
    assert (bench.snapshot()["claims"] == HOLD).all()
    assert free.switch([soft, right]) is Answer.ACCEPTED


def test_a_controller_that_was_made_anew_has_not_been_ended(free: Desk, soft: int) -> None:
    assert free.switch([], [soft]) is Answer.ACCEPTED
    assert free.bench.snapshot()["controller_changes"][soft]["why"] == Outcome.DONE
    text = b'{"type": "ConfigureController", "name": "soft"}'
    assert free.give(Kind.CONFIGURE, go=1 << soft, text=text) is Answer.ACCEPTED
    assert free.settle(soft) is ControllerState.INACTIVE
    assert Teller(free).info("soft").why == ""
