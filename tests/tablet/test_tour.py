"""The first look around: each step is done when what it asks for has happened, and who has ended it is not asked again."""

from __future__ import annotations

from typing import Any

import pytest

from handrail.messages import GetEngine, GetRobot
from tablet_client.models import arrivals
from tablet_client.models.situation import Situation
from tablet_client.models.tour import STEPS, Tour


@pytest.fixture
def situation() -> Situation:
    return Situation("tcp://somewhere:47800")


@pytest.fixture
def tour(situation) -> Tour:
    made = Tour()
    made.begin()
    made.take(situation)
    return made


def attach(situation: Situation, robot: Any) -> None:
    situation.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    situation.take(arrivals.EngineAttached(robot.answer(GetEngine())))


def test_it_waits_at_each_step_for_what_it_asks_for_and_passes_over_what_is_so_already(situation, tour, robot):
    assert (tour.step, tour.number) == ("connect", 1)
    robot.enabled = False
    attach(situation, robot)
    tour.take(situation)
    assert tour.step == "look"
    tour.next()
    assert tour.step == "enable"
    robot.instances = [robot.wheel()]
    robot.enabled = True
    attach(situation, robot)
    tour.take(situation)
    assert tour.step == "drag", "a wheel was placed already"
    tour.next()
    robot.run = robot.running()
    attach(situation, robot)
    tour.take(situation)
    assert tour.step == "approve", "it runs, and nothing moves yet"
    tour.next()
    robot.run = robot.running(status="succeeded", active=["done"])
    attach(situation, robot)
    tour.take(situation)
    assert tour.step == "stop"
    robot.stopped = "Ada"
    attach(situation, robot)
    tour.take(situation)
    assert (tour.step, tour.number) == ("over", len(STEPS) + 1)
    tour.next()
    assert (tour.step, tour.number) == ("", 0)


@pytest.mark.window
def test_it_is_taken_from_the_robots_page_leads_on_and_is_remembered_as_seen(robot, show, tmp_path, monkeypatch):
    from PySide6.QtCore import QSettings

    from tablet_client import tour_desk
    from tests.tablet.shown import judge

    monkeypatch.setattr(
        tour_desk, "settings", lambda: QSettings(str(tmp_path / "tablet.ini"), QSettings.Format.IniFormat)
    )
    robot.enabled = False
    shown = show().drawn()
    assert not shown.item("tourCard").isVisible() and not tour_desk.seen()
    shown.press("tab_robot")
    shown.press("takeTour")
    shown.until(lambda: shown.desk.tour.view["step"] == "look")
    judge(shown, (1024, 640))
    shown.press("tourNext")
    assert shown.item("tourTitle").property("text") == "Enable the drives"
    robot.enabled = True
    robot.publish(robot.status())
    shown.until(lambda: shown.desk.tour.view["step"] == "place")
    shown.press("tourPage")
    assert shown.words("Pages.current") == "objects"
    shown.press("tourEnd")
    shown.until(lambda: not shown.item("tourCard").isVisible())
    assert tour_desk.seen()
    for step in (*STEPS, "over"):
        words = shown.words(f"Words.tour('{step}')").toVariant()
        assert words["title"] and words["text"], step
