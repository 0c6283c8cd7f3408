"""Enables TALOS and balances it on its feet until Ctrl-C: `handrail up talos --scene empty --let-down`, then this."""

import contextlib
import time

from handrail import messages as m
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError

PATIENCE_S = 120.0
"""of wall time, for drives that come to life, a gantry that lets down, and libraries that load"""


def stand(runtime: Runtime, seconds: float = float("inf"), owner: str = "stand") -> None:
    """Call until it stands, then check in for so long."""
    robot = Caller(runtime.endpoint("daemon.call"))
    start = m.StartAction(id="stand", owner=owner, motion=m.WholeBody(compound="stand"))
    gives_up = time.monotonic() + PATIENCE_S
    while True:
        try:
            robot.call(m.CheckIn(owner=owner))
            robot.call(m.Enable())
            robot.call(start)
            break
        except RefusedError:  # the loop is not there yet, or drives, or feet; or libraries are still being loaded
            if time.monotonic() > gives_up:
                raise
            time.sleep(0.2)
    print("it stands", flush=True)
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        robot.call(m.CheckIn(owner=owner))
        time.sleep(0.2)
    robot.call(m.CancelAction(id="stand"))


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        stand(Runtime.at())
