"""The session through a real gate, with a fake daemon and engine behind it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from handrail.messages import AnswerPrompt, PromptClosed, RobotState
from tablet_client.models import arrivals
from tests.tablet.behind import Behind


def test_an_early_tablet_finds_the_robot_loses_its_link_and_finds_it_again(
    behind: Behind, robot: Any, wait: Callable[..., Any]
):
    behind.open_tablet()
    wait(lambda: behind.has(arrivals.Unanswered))
    behind.open_gate()
    wait(lambda: behind.has(arrivals.Attached) and behind.has(arrivals.EngineAttached))
    wait(lambda: behind.publish(robot.state()) or behind.has(RobotState))

    behind.kill_gate()
    tries = len(behind.has(arrivals.Unanswered))
    wait(lambda: len(behind.has(arrivals.Unanswered)) > tries)
    robot.prompts = [robot.prompt(id="asked-meanwhile")]
    behind.open_gate()
    wait(lambda: [news for news in behind.has(arrivals.EngineAttached) if news.snapshot.prompts])
    behind.heard.clear()
    wait(lambda: behind.publish(robot.state()) or behind.has(RobotState))


def test_answers_and_stop_go_through_the_gate(behind: Behind, robot: Any, wait: Callable[..., Any]):
    robot.prompts = [robot.prompt()]
    behind.open_gate()
    behind.open_tablet()
    wait(lambda: behind.has(arrivals.EngineAttached))
    assert behind.session is not None
    behind.session.send(AnswerPrompt(id="prompt-1", answer="approve", by="Ada"))
    wait(lambda: robot.calls_of(AnswerPrompt))
    closed = PromptClosed(id="prompt-1", answer="approve", by="Ada")
    wait(lambda: behind.publish_prompt(closed) or behind.has(PromptClosed))
    behind.session.stop("Ada, at the tablet")
    wait(lambda: behind.has(arrivals.StopProgress, state="answered"))
    assert behind.stops == ["STOP Ada, at the tablet"]
