"""What a client can do with a template that is placed: what of it can be reached, and it runs alone (docs/templates.md)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from handrail.link.events import Events
from handrail.messages import ExpandTemplate, GetReach, OnFailure, Reach, RunState, RunTemplate, TemplateProgram

_LASTS_S, _RENEWED_S = 10.0, 4.0


class TemplateCalls:
    """Part of `handrail.client.Client`."""

    if TYPE_CHECKING:  # the client has them

        def call(self, message: Any, timeout_s: float | None = None) -> Any: ...
        def events(self, *kinds: type, timeout_s: float = 5.0) -> Events: ...

    def reach(self, instance: str, trajectory: str, arm: str = "", *, clearance: float = 0.015) -> Reach:
        """Which waypoints of an instance's trajectory an arm can reach, near which limits, or by how much they are missed.

        `clearance`: m to keep from everything. Refused where instance, trajectory or arm are not there.
        """
        return self.call(GetReach(instance=instance, trajectory=trajectory, arm=arm, clearance=clearance))

    def watch_reach(
        self, instance: str, trajectory: str, arm: str = "", *, clearance: float = 0.015, rate: float = 10.0
    ) -> Iterator[Reach]:
        """The same, now and whenever an instance or what carries the arm moves, at most `rate` times a second, for as long as one
        iterates. Each Reach says of which version of the instance it is.
        """
        watch = GetReach(
            instance=instance, trajectory=trajectory, arm=arm, clearance=clearance, rate=rate, lasts=_LASTS_S
        )
        with self.events(Reach) as told:
            last = first = self.call(watch)
            yield first
            renewed = time.monotonic()
            while not told.closed:
                event = told.next(_RENEWED_S / 4)
                about = (instance, trajectory, first.arm)
                if (
                    isinstance(event, Reach)
                    and (event.instance, event.trajectory, event.arm) == about
                    and event != last
                ):
                    last = event
                    yield event
                if time.monotonic() - renewed >= _RENEWED_S:
                    self.call(watch)
                    renewed = time.monotonic()

    def expand_template(
        self, instance: str, trajectory: str, arm: str = "", *, other: str = "", first: str = "", steps: int = 0,
        backwards: bool = False, loop: int = 1,
    ) -> TemplateProgram:  # fmt: skip
        """The program that `run_template` would run: its file's text, to be saved and changed, and what it would be bound to."""
        call = ExpandTemplate(
            instance=instance, trajectory=trajectory, arm=arm, other=other, first=first, steps=steps, backwards=backwards,
            loop=loop,
        )  # fmt: skip
        return self.call(call)

    def run_template(
        self, instance: str, trajectory: str, arm: str = "", *, other: str = "", first: str = "", steps: int = 0,
        backwards: bool = False, loop: int = 1, on_failure: OnFailure = "end",
    ) -> RunState:  # fmt: skip
        """Go along an instance's trajectory as an ordinary run, one state a waypoint: planned ways are shown before they are gone,
        and asked about at autonomy `high` and below (`set_autonomy`). `stop_run` ends it in the midst of a motion.

        Of a `sync` both hands go, `arm` its first one, `other` the second; both left out: as its hands are named.

        `first`: the waypoint to begin with; `steps`: how many to go to (1: the next one from where the last such run left the
        hand); `backwards`: each leg as it was gone forwards; `loop`: how often, forwards; `on_failure`: as for `run`.
        """
        call = RunTemplate(
            instance=instance, trajectory=trajectory, arm=arm, other=other, first=first, steps=steps, backwards=backwards,
            loop=loop, on_failure=on_failure,
        )  # fmt: skip
        return self.call(call)
