"""Behaviours: one action follows another in the cycle that ends it, and the chain ends as its last step does."""

import numpy as np
import pytest

from daemon import exchange
from daemon.exchange import ActionState, Answer, Kind, Outcome
from daemon.exchange.commands import followers
from handrail.messages import CompliantMotion, JointLimitEnd, JointTrajectory, StartBehaviour, Step, TimeEnd

TIP = "tool_right_tip"


@pytest.fixture
def enabled(bench):
    bench.enable()
    return bench


def still(bench, name: str, duration: float, *ends, then: dict[str, str] | None = None) -> Step:
    joints = list(bench.description.arms["right"].joints)
    return Step(
        name=name, motion=CompliantMotion(frame=TIP, joints=joints, duration=duration), ends=list(ends), then=then or {}
    )


def steps_taken(bench) -> list[tuple[int, int]]:
    """(cycle, step) of every change until the behaviour ends, with the end as step −1."""
    told, last = [], None
    for _ in range(800):
        row = bench.snapshot()["actions"][0]
        if row["state"] == ActionState.ENDED:
            return [*told, (int(row["cycle"]), -1)]
        if (now := (int(row["step"]), int(row["steps_taken"]))) != last and now[1]:
            told.append((int(row["cycle"]), now[0]))
            last = now
        bench.run()
    raise AssertionError("the behaviour did not end")


def test_steps_follow_each_other_without_a_cycle_in_between(enabled) -> None:
    enabled.post_behaviour(still(enabled, "a", 0.1), still(enabled, "b", 0.05), still(enabled, "c", 0.02))
    enabled.run()
    told = steps_taken(enabled)
    assert [step for _, step in told] == [0, 1, 2, -1]
    assert np.diff([cycle for cycle, _ in told]) == pytest.approx([50, 25, 10], abs=1), "as long as each lasts"
    assert enabled.action()[1] is Outcome.DONE
    rights = enabled.description.index(tuple(enabled.description.arms["right"].joints))
    assert (enabled.snapshot()["claims"].reshape(-1, len(enabled.description.joints))[0][rights] == 1).all(), "hold"


def test_an_end_leads_where_its_step_says_and_else_it_ends_the_behaviour(enabled) -> None:
    first = still(enabled, "a", 9.0, TimeEnd(after=0.04), JointLimitEnd(margin=0.0), then={"time": "c"})
    second = still(enabled, "b", 9.0)
    third = still(enabled, "c", 9.0, TimeEnd(after=0.06))
    assert followers([first, second, third], 0) == [1, 2, -1]
    enabled.post_behaviour(first, second, third)
    enabled.run()
    assert [step for _, step in steps_taken(enabled)] == [0, 2, -1]
    row = enabled.snapshot()["actions"][0]
    assert (row["outcome"], row["condition"], row["value"]) == (Outcome.CONDITION, 0, pytest.approx(0.06, abs=0.003))


def test_a_behaviour_may_repeat_steps_but_not_for_ever(enabled) -> None:
    again = still(enabled, "a", 0.02, then={"done": "a"})
    enabled.post_behaviour(again, most_steps=5)
    enabled.run()
    assert [step for _, step in steps_taken(enabled)] == [0] * 5 + [-1]
    assert enabled.action()[1] is Outcome.TOO_MANY_STEPS


def test_a_trajectory_whose_turn_comes_elsewhere_ends_the_behaviour_and_moves_nothing(enabled) -> None:
    first = enabled.move("arm_right_1_joint", 0.1, 0.1)
    shifted = [[position + 0.2 for position in knot] for knot in first.positions]
    second = JointTrajectory(joints=first.joints, times=first.times, positions=shifted, velocities=first.velocities)
    enabled.post_behaviour(Step(name="a", motion=first), Step(name="b", motion=second))
    enabled.run()
    assert [step for _, step in steps_taken(enabled)] == [0, -1]
    row = enabled.snapshot()["actions"][0]
    assert (row["outcome"], row["joint"]) == (Outcome.STEP_REFUSED, enabled.index("arm_right_1_joint"))
    assert row["value"] == pytest.approx(0.1, abs=0.01)
    stood = enabled.loop.written.position.copy()
    assert (enabled.run(50)["command"][0] == stood).all()


def test_a_behaviour_is_paused_resumed_and_cancelled_as_one_action(enabled) -> None:
    steps = [still(enabled, "a", 0.2, TimeEnd(after=0.1), then={"time": "b"}), still(enabled, "b", 0.2)]
    serial = enabled.post_behaviour(*steps)
    enabled.run(10)
    assert enabled.ask(Kind.PAUSE, action=serial) is Answer.ACCEPTED
    enabled.run(300)
    assert enabled.action()[0] is ActionState.PAUSED
    assert enabled.ask(Kind.RESUME, action=serial) is Answer.ACCEPTED
    enabled.run(100)
    assert enabled.snapshot()["actions"][0]["step"] == 1
    assert enabled.ask(Kind.CANCEL, action=serial) is Answer.ACCEPTED
    steps_taken(enabled)
    assert enabled.action()[1] is Outcome.CANCELLED


def test_a_step_that_follows_on_the_way_to_a_pause_is_paused_too(enabled) -> None:
    serial = enabled.post_behaviour(
        still(enabled, "a", 9.0, TimeEnd(after=0.1), then={"time": "b"}), still(enabled, "b", 9.0)
    )
    enabled.run(46)
    enabled.ask(Kind.PAUSE, action=serial)
    enabled.run(250)
    row = enabled.snapshot()["actions"][0]
    assert (row["step"], row["state"]) == (1, ActionState.PAUSED)
    assert row["progress"] == 0.0
    enabled.ask(Kind.RESUME, action=serial)
    enabled.run(250)
    assert enabled.snapshot()["actions"][0]["progress"] > 0.1


def test_a_behaviours_events_name_its_steps_and_how_each_ended(enabled) -> None:
    steps = [still(enabled, "wait", 9.0, TimeEnd(after=0.04), then={"time": "rest"}), still(enabled, "rest", 0.1)]
    known = [(step.name, step.ends) for step in steps]
    enabled.post_behaviour(*steps)
    enabled.run()
    names = enabled.description.joints
    events = []
    for _ in range(100):
        snapshot = enabled.run()
        events.append(exchange.action_event(snapshot["actions"][0], "x", [], names, steps=known))
    told = dict.fromkeys((event.state, event.step, event.outcome, event.detail) for event in events)
    assert list(told) == [
        ("running", "wait", "", ""),
        ("running", "rest", "", "wait: ends[0]: time reached 0.04"),
        ("ended", "rest", "done", ""),
    ]


def test_a_behaviour_that_does_not_fit_its_payload_is_no_command(enabled) -> None:
    steps = [still(enabled, "a", 0.1, TimeEnd(after=1.0)), still(enabled, "b", 0.1)]
    message = StartBehaviour(id="x", owner="y", steps=steps, most_steps=7)
    frames = exchange.frame_names(enabled.description)
    joints = {name: enabled.index(name) for name in enabled.description.joints}
    header, payload = exchange.encode_behaviour(message, 1, 1, joints, {name: i for i, name in enumerate(frames)})
    command = exchange.decode(header, payload, frames)
    assert [(step.then, len(step.ends)) for step in command.steps] == [((1, -1), 1), ((-1,), 0)]
    assert command.most_steps == 7
    for count in (0, 3, 900):
        header["step_count"] = count
        with pytest.raises(ValueError, match="steps"):
            exchange.decode(header, payload, frames)
