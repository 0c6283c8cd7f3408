"""Is there a robot at the other end, and an engine on it?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tablet_client.models import arrivals

LinkState = Literal["waiting", "attached", "lost"]


@dataclass
class Link:
    """`waiting` until the robot answers for the first time, `lost` when it did and no longer does."""

    address: str
    state: LinkState = "waiting"
    why: str = ""
    """the last error, in the words of whoever raised it"""
    tries: int = 0
    since: float = 0.0
    """s, monotonic: when the state began"""
    engine: bool = False
    engine_why: str = ""

    @property
    def attached(self) -> bool:
        return self.state == "attached"

    def take(self, item: object, now: float) -> bool:
        """Learn from a session's news; True when the state changed."""
        before = (self.state, self.engine)
        if isinstance(item, arrivals.Unanswered):
            self.tries, self.why, self.engine = item.tries, item.why, False
            if self.state == "attached":
                self.state = "lost"
        elif isinstance(item, arrivals.Attached):
            self.state, self.why, self.tries = "attached", "", 0
        elif isinstance(item, arrivals.EngineAttached):
            self.engine, self.engine_why = True, ""
        elif isinstance(item, arrivals.EngineDetached):
            self.engine, self.engine_why = False, item.why
        changed = before != (self.state, self.engine)
        if changed and before[0] != self.state:
            self.since = now
        return changed
