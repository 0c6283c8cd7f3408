"""Keepalives: the stages as timelines, what they do to a robot in the loop, and which answers count."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Flag, Kind, Outcome, Rule
from daemon.safety.keepalive import HOLD_NS, SETTLE_NS, STILL, Binding, Stage, heard, step
from daemon.serving.challenges import Challenges
from hal.drives.lifecycle import State
from handrail.keepalive import Keepalive, answer
from handrail.messages import BindKeepalive, Challenge, GetChallenge, KeepAlive, ReleaseKeepalive
from handrail.topics import RefusedError, Unreachable, refuse

MS = 1_000_000
OWNER, JOINT = 7, "arm_right_1_joint"


def stages(events: dict[int, str], until_ms: int, fastest: dict[int, float] | None = None) -> list[tuple[int, Stage]]:
    """(ms, stage) at every change of one bound for 100 ms, a cycle a ms; events: ms → heard. fastest: ms → rad/s from then on."""
    binding, speed, seen = Binding(100 * MS, 0), 0.0, [(0, Stage.ALIVE)]
    for ms in range(1, until_ms):
        speed = (fastest or {}).get(ms, speed)
        if ms in events:
            binding = heard(binding, ms * MS)
        binding = step(binding, ms * MS, speed)
        if binding.stage is not seen[-1][1]:
            seen.append((ms, binding.stage))
    return seen


def test_who_answers_in_time_is_alive_and_who_does_not_is_held_settled_and_damped() -> None:
    assert stages({ms: "heard" for ms in range(0, 5000, 100)}, 5000) == [(0, Stage.ALIVE)]
    settle = SETTLE_NS // MS
    assert stages({}, 5000) == [
        (0, Stage.ALIVE),
        (101, Stage.HOLD),
        (102, Stage.SETTLE),
        (103 + settle, Stage.DAMPING),
    ]


def test_the_robot_settles_when_it_stands_or_after_a_while() -> None:
    stood = stages({}, 5000, {1: 1.0, 400: STILL / 2})
    assert stood[2] == (400, Stage.SETTLE)
    assert stages({}, 5000, {1: 1.0})[2] == (102 + HOLD_NS // MS, Stage.SETTLE)


def test_a_good_answer_ends_hold_and_settling_and_comes_too_late_once_it_is_damped() -> None:
    assert stages({150: "heard"}, 240, {1: 1.0}) == [(0, Stage.ALIVE), (101, Stage.HOLD), (150, Stage.ALIVE)]
    assert stages({1500: "heard"}, 1590)[2:] == [(102, Stage.SETTLE), (1500, Stage.ALIVE)]
    assert stages({ms: "heard" for ms in range(2200, 9000, 10)}, 9000)[-1][1] is Stage.DAMPING


def silence(bench: Any, seconds: float) -> np.ndarray:
    return bench.run(round(seconds * 1e9 / bench.loop.period_ns))


def test_a_silent_owners_motion_comes_to_a_stand_and_the_robot_is_damped_later(bench: Any) -> None:
    bench.enable()
    assert bench.ask(Kind.BIND_KEEPALIVE, owner=OWNER, value=0.2) is Answer.ACCEPTED
    bench.start(bench.move(JOINT, 0.5, 5.0), owner=OWNER)
    for _ in range(4):
        assert bench.ask(Kind.KEEP_ALIVE, owner=OWNER) is Answer.ACCEPTED
        assert silence(bench, 0.1)["actions"][0]["state"] == ActionState.RUNNING
    silence(bench, 1.0)
    assert bench.action() == (ActionState.ENDED, Outcome.OWNER_LOST)
    held = bench.snapshot()
    assert held["flags"] == Flag.ENABLED
    assert held["safety"][Rule.KEEPALIVE]["holds"]
    assert bench.start(bench.move(JOINT, 0.1), owner=OWNER) is Answer.KEEPALIVE_LOST
    silence(bench, 1.0)
    assert np.abs(bench.drives.state.velocity).max() < STILL
    assert bench.snapshot()["flags"] == Flag.ENABLED, "it is held while it settles"
    silence(bench, 2.0)
    assert (bench.drives.life == State.QUICK_STOP_ACTIVE).all()
    assert bench.snapshot()["safety"][Rule.KEEPALIVE]["holds"]
    assert bench.ask(Kind.KEEP_ALIVE, owner=OWNER) is Answer.KEEPALIVE_LOST, "that was final"
    bench.enable()
    assert not bench.snapshot()["safety"][Rule.KEEPALIVE]["holds"]
    assert bench.start(bench.move(JOINT, 0.1), owner=OWNER) is Answer.ACCEPTED


def test_an_owner_who_is_back_in_time_moves_the_robot_again_and_others_are_not_bound(bench: Any) -> None:
    bench.enable()
    bench.ask(Kind.BIND_KEEPALIVE, owner=OWNER, value=0.2)
    assert bench.start(bench.move("arm_left_1_joint", 0.3, 5.0), owner=1) is Answer.ACCEPTED
    silence(bench, 0.5)
    assert bench.action()[0] is ActionState.RUNNING
    assert bench.ask(Kind.KEEP_ALIVE, owner=OWNER) is Answer.ACCEPTED
    assert not bench.snapshot()["safety"][Rule.KEEPALIVE]["holds"]
    assert bench.start(bench.move(JOINT, 0.1, 0.1), owner=OWNER) is Answer.ACCEPTED
    assert bench.ask(Kind.BIND_KEEPALIVE, owner=OWNER, value=0.0) is Answer.ACCEPTED
    silence(bench, 4.0)
    assert bench.snapshot()["flags"] == Flag.ENABLED, "released, he may be silent"
    assert bench.ask(Kind.BIND_KEEPALIVE, owner=OWNER, value=0.0) is Answer.KEEPALIVE_LOST


def test_only_the_answer_to_the_last_challenge_counts_and_only_once() -> None:
    challenges = Challenges()
    first = challenges.issue("me")
    for wrong in ("", first, answer(first, "you"), answer("x", "me")):
        with pytest.raises(RefusedError, match="does not count"):
            challenges.check("me", wrong)
    challenges.check("me", answer(first, "me"))
    with pytest.raises(RefusedError):
        challenges.check("me", answer(first, "me"))
    second = challenges.issue("me")
    assert second != first
    third = challenges.issue("me")
    with pytest.raises(RefusedError):
        challenges.check("me", answer(second, "me"))
    challenges.check("me", answer(third, "me"))


class Daemon:
    """Answers a Keepalive's calls; `failures` come first, one a KeepAlive."""

    def __init__(self, *failures: Exception) -> None:
        self.challenges, self.failures, self.good = Challenges(), list(failures), 0
        self.calls: list[type] = []

    def __call__(self, call: Any) -> Any:
        self.calls.append(type(call))
        if isinstance(call, KeepAlive):
            if self.failures:
                raise self.failures.pop(0)
            self.challenges.check(call.owner, call.answer)
            self.good += 1
        return None if isinstance(call, ReleaseKeepalive) else Challenge(challenge=self.challenges.issue(call.owner))


def test_the_operators_side_answers_until_it_is_let_go_and_survives_a_new_server() -> None:
    daemon = Daemon(Unreachable("late"), refuse("wrong", "answer", "", ""))
    with Keepalive(daemon, "me", 0.03) as kept:
        while daemon.good < 3:
            assert kept._thread.is_alive()
            kept._thread.join(0.01)
    assert not kept.lost
    assert daemon.calls[0] is BindKeepalive
    assert daemon.calls[-1] is ReleaseKeepalive
    assert GetChallenge in daemon.calls


def test_the_operators_side_does_not_answer_for_one_who_is_not_there_and_does_not_let_go_by_accident() -> None:
    daemon = Daemon()
    with pytest.raises(KeyError), Keepalive(daemon, "me", 0.03, alive=lambda: False):
        raise KeyError
    assert daemon.calls == [BindKeepalive]


def test_the_operators_side_says_that_the_daemon_has_ended_it() -> None:
    daemon = Daemon(refuse("the keepalive was not answered in time", "owner", "me", ""))
    with Keepalive(daemon, "me", 0.03) as kept:
        kept.wait()
    assert "not answered in time" in kept.lost
    assert ReleaseKeepalive not in daemon.calls
