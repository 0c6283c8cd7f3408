"""Steps that send a gripper somewhere, and end by what it does: it goes by itself, in the cycle in which its step begins."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Kind, Outcome
from hal.hardware import LOST_AFTER
from handrail.messages import CompliantMotion, EndCondition, GripperAtEnd, GripperHoldsEnd, GripperOrder, Step
from tests.daemon.loop.test_devices import EFFORT, ENABLE, HAND, SPEED, Hand, hand  # noqa: F401

HOLDING = 5
AT = GripperAtEnd(gripper="hand", position=0.8, tolerance=0.05)
HOLDS = GripperHoldsEnd(gripper="hand")


def step(hand: Hand, name: str, *ends: EndCondition, duration: float = 9.0, to: float | None = None, **then) -> Step:  # noqa: F811
    joints = list(hand.bench.description.arms["right"].joints)
    motion = CompliantMotion(frame="tool_right_tip", joints=joints, duration=duration)
    order = None if to is None else GripperOrder(gripper="hand", position=to)
    return Step(name=name, motion=motion, ends=list(ends), gripper=order, then=then)


def told(hand: Hand) -> tuple[int, ActionState, Outcome, int]:  # noqa: F811
    row = hand.run()["actions"][0]
    return int(row["step"]), ActionState(int(row["state"])), Outcome(int(row["outcome"])), int(row["condition"])


def test_a_gripper_is_sent_off_in_the_cycle_in_which_its_step_begins_and_goes_on_when_all_is_over(hand: Hand) -> None:  # noqa: F811
    hand.enable()
    hand.bench.post_behaviour(step(hand, "wait", duration=0.1), step(hand, "close", duration=0.1, to=0.8))
    while told(hand)[0] == 0:
        assert hand.column == [0.3, SPEED, EFFORT, 1.0], "not before its turn"
    assert hand.column == [0.8, SPEED, EFFORT, 1.0]
    while (state := told(hand))[1] is ActionState.RUNNING:
        pass
    assert state[2] is Outcome.DONE
    hand.run(50)
    assert hand.column == [0.8, SPEED, EFFORT, 1.0], "what it holds is not let go"


def test_a_step_ends_when_its_gripper_is_where_it_shall_be(hand: Hand) -> None:  # noqa: F811
    hand.enable()
    hand.bench.post_behaviour(step(hand, "close", HOLDS, AT, to=0.8))
    hand.run(50)
    hand.position = 0.74
    assert told(hand)[1] is ActionState.RUNNING
    hand.position = 0.76
    assert told(hand) == (0, ActionState.ENDED, Outcome.CONDITION, 1)


def test_a_step_ends_when_its_gripper_holds_something_but_not_by_what_it_held_before(hand: Hand) -> None:  # noqa: F811
    hand.enable()
    values = hand.bench.hardware.devices.values
    values[HAND, HOLDING] = 1.0
    hand.bench.post_behaviour(step(hand, "close", HOLDS, to=0.8))
    assert told(hand)[1] is ActionState.RUNNING
    hand.run(10)
    values[HAND, HOLDING] = 0.0
    hand.run(100)
    values[HAND, HOLDING] = 1.0
    assert told(hand) == (0, ActionState.ENDED, Outcome.CONDITION, 0)


def test_a_step_whose_gripper_does_not_answer_ends_the_behaviour_and_one_at_the_start_is_refused(hand: Hand) -> None:  # noqa: F811
    hand.enable()
    hand.bench.post_behaviour(step(hand, "wait", duration=0.4), step(hand, "close", to=0.8))
    hand.answers = False
    hand.run(LOST_AFTER + 220)
    row = hand.run()["actions"][0]
    assert (row["step"], Outcome(int(row["outcome"])), row["joint"]) == (0, Outcome.STEP_REFUSED, -1)
    assert bytes(row["detail"]).startswith(b"its gripper does not answer")
    hand.bench.post_behaviour(step(hand, "close", to=0.8))
    assert Answer(int(hand.run()["answer"])) is Answer.DEVICE_SILENT
    assert hand.column[ENABLE] == 0.0


def test_an_order_of_a_behaviour_that_is_cancelled_before_its_turn_is_never_given(hand: Hand) -> None:  # noqa: F811
    hand.enable()
    before = np.array(hand.column)
    serial = hand.bench.post_behaviour(step(hand, "wait", duration=0.3), step(hand, "close", to=0.8))
    hand.run(20)
    assert hand.bench.ask(Kind.CANCEL, action=serial) is Answer.ACCEPTED
    hand.run(300)
    assert hand.column == pytest.approx(before)
