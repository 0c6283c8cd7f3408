"""A first look around: a few steps with the built-in simulation, each done when what it asks for has happened."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from tablet_client.models.situation import Situation

_NEAR = ("reached", "near")


def _within_reach(situation: Situation) -> bool:
    shown = [each.reach.state if each.reach is not None else "" for each in situation.bench.waypoints]
    return bool(shown) and all(state in _NEAR for state in shown)


def _under_way(situation: Situation) -> bool:
    return situation.task.run is not None and situation.task.status in ("running", "paused")


DONE: Mapping[str, Callable[[Situation], bool]] = {
    "connect": lambda situation: situation.link.attached and situation.robot.info is not None,
    "look": lambda situation: False,  # the view's own: one says when one has looked
    "enable": lambda situation: situation.robot.drives == "enabled",
    "place": lambda situation: any(each.template == "wheel" for each in situation.world.instances.values()),
    "drag": _within_reach,
    "run": _under_way,
    "approve": lambda situation: _under_way(situation) and situation.robot.moving,
    "watch": lambda situation: situation.task.status == "succeeded",
    "stop": lambda situation: situation.robot.drives == "stopped",
}
"""step → whether it has happened, in their order"""
STEPS = tuple(DONE)


class Tour:
    """Which step is before one. A step that is done leads to the next one by itself; what is done already is passed over once it
    is come to, but for `watch` and `stop`, which are waited for."""

    def __init__(self) -> None:
        self.step = ""
        """empty: no tour"""

    @property
    def number(self) -> int:
        """From 1; one more than there are: it is over. 0: no tour."""
        if not self.step:
            return 0
        return STEPS.index(self.step) + 1 if self.step in STEPS else len(STEPS) + 1

    def begin(self) -> None:
        self.step = STEPS[0]

    def end(self) -> None:
        self.step = ""

    def next(self) -> None:
        """On to the next step, whether this one is done or not; from the last one to the end."""
        if self.step:
            self.step = (*STEPS, "over", "")[self.number]

    def take(self, situation: Situation) -> None:
        """Look whether the present step is done."""
        while self.step in DONE and DONE[self.step](situation):
            self.next()
