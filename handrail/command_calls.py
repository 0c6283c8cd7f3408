"""Who commands, as a client sees and settles it (docs/safety.md, Command)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from handrail.messages import ClientIdentity, GetIdentity, ReturnCommand, TakeCommand


class CommandCalls:
    """Part of `handrail.client.Client`."""

    if TYPE_CHECKING:  # the client has it

        def call(self, message: Any, timeout_s: float | None = None) -> Any: ...

    def identity(self) -> ClientIdentity:
        """Whose key this client has, what it may do, and who has the command."""
        return self.call(GetIdentity())

    def take_command(self, *, take_over: bool = False) -> ClientIdentity:
        """From now on only who has this key moves the robot over the link, until he returns it or makes no call for 10 s.

        STOP, cancel and pause stay everybody's, what runs goes on. Refused where somebody else has it, unless it is taken over.
        """
        return self.call(TakeCommand(take_over=take_over))

    def return_command(self) -> ClientIdentity:
        """Whoever is connected may command again. Refused where somebody else has the command."""
        return self.call(ReturnCommand())
