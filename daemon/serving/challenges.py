"""Which challenge each owner with a keepalive has to answer next (handrail.keepalive)."""

from __future__ import annotations

import hmac
import secrets

from handrail.keepalive import answer
from handrail.topics import refuse


class Challenges:
    """One open challenge an owner; each is good for one answer."""

    def __init__(self) -> None:
        self._open: dict[str, str] = {}

    def issue(self, owner: str) -> str:
        """A new challenge, in place of the one before."""
        self._open[owner] = secrets.token_hex(16)
        return self._open[owner]

    def check(self, owner: str, given: str) -> None:
        """Raises RefusedError unless `given` answers the open challenge, which is closed then. A wrong answer closes nothing."""
        challenge = self._open.get(owner)
        if challenge is None or not hmac.compare_digest(given, answer(challenge, owner)):
            raise refuse("a wrong answer: it does not count", "answer", given[:80], "the answer to the last challenge")
        del self._open[owner]

    def forget(self, owner: str) -> None:
        """He has nothing to answer."""
        self._open.pop(owner, None)
