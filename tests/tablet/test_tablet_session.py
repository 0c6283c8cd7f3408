"""The connection: attaches early or late, comes back, and lets nothing stand in STOP's way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from handrail.messages import Enable, PauseRun, RobotState, Stop
from tablet_client.models import arrivals
from tablet_client.models.arrivals import Inbox
from tablet_client.session import Session


class Attached:
    """A running session and everything that it has said so far."""

    def __init__(self, robot: Any):
        self.inbox = Inbox()
        self.session = Session(robot.connect, self.inbox, heartbeat=0.02, retry=0.02)
        self.heard: list[Any] = []

    def has(self, kind: type, **fields: Any) -> list[Any]:
        """What was said of that type with those values."""
        self.heard += self.inbox.take()
        return [
            item
            for item in self.heard
            if isinstance(item, kind) and all(getattr(item, name) == value for name, value in fields.items())
        ]


@pytest.fixture
def attach(robot) -> Iterator[Callable[[], Attached]]:
    made: list[Attached] = []

    def start() -> Attached:
        attached = Attached(robot)
        attached.session.start()
        made.append(attached)
        return attached

    yield start
    robot.released.set()
    for attached in made:
        attached.session.close()


def test_a_tablet_that_comes_first_waits_and_attaches_when_the_robot_comes(robot, attach, wait):
    robot.reachable = False
    tablet = attach()
    wait(lambda: len(tablet.has(arrivals.Unanswered)) >= 3)
    assert not tablet.has(arrivals.Attached)
    robot.reachable = True
    wait(lambda: tablet.has(arrivals.Attached) and tablet.has(arrivals.EngineAttached))


def test_a_tablet_that_comes_late_gets_everything_at_once(robot, attach, wait):
    robot.plans, robot.prompts, robot.run = [robot.plan()], [robot.prompt()], robot.running()
    tablet = attach()
    snapshot = wait(lambda: tablet.has(arrivals.EngineAttached))[0].snapshot
    assert snapshot.prompts == [robot.prompt()] and snapshot.plans == [robot.plan()]


def test_events_arrive(robot, attach, wait):
    tablet = attach()
    wait(lambda: tablet.has(arrivals.Attached))
    robot.publish(robot.state(head_1_joint=0.9))
    wait(lambda: tablet.has(RobotState))


def test_a_link_that_goes_away_and_comes_back_is_told_and_what_was_missed_is_fetched(robot, attach, wait):
    tablet = attach()
    wait(lambda: tablet.has(arrivals.EngineAttached))
    robot.reachable = False
    wait(lambda: tablet.has(arrivals.Unanswered))
    robot.prompts = [robot.prompt()]
    robot.reachable = True
    wait(lambda: len(tablet.has(arrivals.Attached)) >= 2)
    wait(lambda: [news for news in tablet.has(arrivals.EngineAttached) if news.snapshot.prompts])


def test_an_engine_that_dies_is_told_apart_from_a_robot_that_is_gone(robot, attach, wait):
    tablet = attach()
    wait(lambda: tablet.has(arrivals.EngineAttached))
    robot.engine_there = False
    wait(lambda: tablet.has(arrivals.EngineDetached))
    assert not tablet.has(arrivals.Unanswered)
    robot.engine_there = True
    wait(lambda: len(tablet.has(arrivals.EngineAttached)) >= 2)


def test_a_robot_without_an_engine_can_be_watched_and_enabled(robot, attach, wait):
    robot.engine_there, robot.enabled = False, False
    tablet = attach()
    wait(lambda: tablet.has(arrivals.Attached))
    tablet.session.send(Enable())
    wait(lambda: tablet.has(arrivals.CallDone))
    assert robot.enabled


def test_a_refusal_comes_back_with_its_reason(robot, attach, wait):
    robot.stopped = True
    tablet = attach()
    wait(lambda: tablet.has(arrivals.Attached))
    tablet.session.send(Enable())
    failed = wait(lambda: tablet.has(arrivals.CallFailed))[0]
    assert failed.refused and "latched" in failed.why


def test_stop_overtakes_calls_that_never_come_back(robot, attach, wait):
    tablet = attach()
    wait(lambda: tablet.has(arrivals.EngineAttached))
    robot.hanging.set()
    tablet.session.send(PauseRun())
    tablet.session.send(Enable())
    tablet.session.stop("operator")
    wait(lambda: tablet.has(arrivals.StopProgress, state="answered"))
    assert robot.stopped and robot.stop_reason == "operator"
    assert not robot.calls_of(Enable)


def test_stop_is_repeated_until_the_robot_answers(robot, attach, wait):
    robot.reachable = False
    tablet = attach()
    tablet.session.stop("operator")
    wait(lambda: len(tablet.has(arrivals.StopProgress, state="sending")) >= 2)
    robot.reachable = True
    wait(lambda: tablet.has(arrivals.StopProgress, state="answered"))
    assert [stop.reason for stop in robot.calls_of(Stop)] == ["operator"]


def test_a_stop_that_nobody_answers_is_given_up_loudly(robot, attach, wait, monkeypatch):
    monkeypatch.setattr("tablet_client.stopper._PAUSE", 0.001)
    robot.reachable = False
    tablet = attach()
    tablet.session.stop("operator")
    failed = wait(lambda: tablet.has(arrivals.StopProgress, state="failed"))[0]
    assert "nobody is there" in failed.why
