"""Enables TALOS and balances it on its feet until Ctrl-C: `handrail up talos --scene empty --let-down`, then this."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

from handrail import messages as m
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber

PATIENCE_S = 120.0
"""of wall time, for drives that come to life, a gantry that lets down, and libraries that load"""
ANSWER_S = 20.0
"""for an answer, while the daemon's server loads libraries beside a plant that takes a core"""
CHECK_IN_S = 0.2
"""between two signs of life: whoever is silent for a second loses the action"""


def stand(runtime: Runtime, seconds: float = float("inf"), owner: str = "stand") -> m.ActionEvent | None:
    """Balance it for so long, or until something else ends that: then how it ended."""
    robot, news = Caller(runtime.endpoint("daemon.call"), timeout_s=ANSWER_S), runtime.endpoint("daemon.events")
    actions, gives_up = Subscriber(news, m.ActionEvent), time.monotonic() + PATIENCE_S

    def wait(kinds: Any, wanted: Callable[..., object], what: str) -> Any:
        with contextlib.closing(Subscriber(news, kinds)) as told:
            while (left := gives_up - time.monotonic()) > 0.0:
                if (event := told.receive(left)) is not None and wanted(event):
                    return event
        raise TimeoutError(f"{what}: not within {PATIENCE_S:g} s")

    while True:
        try:
            wait(m.DaemonStatus, answers, "the loop runs and every drive answers")
            robot.call(m.Enable())
            wait(m.DaemonStatus, lambda status: status.enabled, "every drive holds")
            wait(m.DaemonStatus | m.RobotState, stands_or_fails, "its feet hold")
            robot.call(m.StartAction(id="stand", owner=owner, motion=m.WholeBody(compound="stand")))
            break
        except (
            RefusedError
        ):  # drives have failed, a foot has bounced, or libraries are being loaded, of which nobody tells
            if time.monotonic() > gives_up:
                raise
    print("it stands", flush=True)
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        robot.call(m.CheckIn(owner=owner))
        event = actions.receive(CHECK_IN_S)
        if event is not None and event.id == "stand" and event.state == "ended":
            return event
    robot.call(m.CancelAction(id="stand"))
    return None


def answers(status: m.DaemonStatus) -> bool:
    """There is a loop, and nothing is wrong with any drive."""
    return status.loop.cycles > 0 and not any(drive.problem for drive in status.drives)


def stands_or_fails(event: m.DaemonStatus | m.RobotState) -> bool:
    """Every foot holds; or the robot is enabled no more, and none ever will."""
    if isinstance(event, m.DaemonStatus):
        return not event.enabled
    return event.base is not None and all(foot.holds for foot in event.base.feet)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        if ended := stand(Runtime.at()):
            raise SystemExit(f"it stands no more: {ended.outcome} {ended.detail}".rstrip())
