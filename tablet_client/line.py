"""The window's connection to one robot: its session, and the guard of its STOP. Another robot's takes its place."""

from __future__ import annotations

from handrail.client import Client, connect
from handrail.link.keys import ClientKeys
from tablet_client.guarding import StopGuard
from tablet_client.session import Session
from tablet_client.window import TabletWindow

_CLOSING_S = 0.5


class Line:
    """Made for a window; `turn_to` begins."""

    def __init__(self, opened: TabletWindow, operator: str, *, guarded: bool = True):
        """`guarded`: with a process that hears STOP while the window hangs."""
        self._opened, self._operator, self._guarded = opened, operator, guarded
        self._session: Session | None = None
        self._guard: StopGuard | None = None

    def turn_to(self, address: str, own: ClientKeys) -> None:
        """Talk to the robot there, and to no other any more."""
        self.close()

        def client() -> Client:
            return connect(address, own, timeout_s=0)

        desk = self._opened.desk
        desk.situation.link.address = address
        self._session = Session(client, desk.inbox)
        desk.serve(self._session)
        self._session.start()
        if self._guarded:
            self._guard = StopGuard(self._opened.window, address, own.folder, self._operator)
            self._guard.pressed.connect(desk.stop)
            self._guard.start()

    def close(self) -> None:
        if self._guard is not None:
            self._guard.close()
        if self._session is not None:
            self._session.close(_CLOSING_S)
        self._guard = self._session = None
