"""A fake robot's local processes behind a real gate, for tests."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from handrail.client import connect
from handrail.link import keys as link_keys
from handrail.messages import DaemonCall, EngineCall
from handrail.runtime import Runtime
from handrail.topics import Publisher, Service
from tablet_client.models.arrivals import Inbox
from tablet_client.session import Session


class Behind:
    """A robot's local processes (fake), its gate (real), and a tablet's session."""

    def __init__(self, robot: Any, folder: Path):
        self.robot, self.folder = robot, folder
        self.runtime = Runtime.at(folder / "r")
        link_keys.ensure(folder / "k")
        self.stops: list[str] = []
        self._over = threading.Event()
        self._events = Publisher(self.runtime.endpoint("daemon.events"))
        self._prompts = Publisher(self.runtime.endpoint("engine.events"))
        self._threads = [
            threading.Thread(target=self._serve, args=("daemon.call", DaemonCall)),
            threading.Thread(target=self._serve, args=("engine.call", EngineCall)),
            threading.Thread(target=self._obey),
        ]
        for thread in self._threads:
            thread.start()
        self.port = _free_port()
        self.gate: subprocess.Popen[bytes] | None = None
        self.inbox = Inbox()
        self.heard: list[Any] = []
        self.session: Session | None = None

    def _serve(self, name: str, kinds: Any) -> None:
        service = Service(self.runtime.endpoint(name), kinds, self.robot.answer)
        while not self._over.is_set():
            service.poll(0.05)
        service.close()

    def _obey(self) -> None:
        """The daemon loop's stop socket."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stop:
            stop.bind(str(self.runtime.stop))
            stop.settimeout(0.05)
            while not self._over.is_set():
                try:
                    text, sender = stop.recvfrom(512)
                except TimeoutError:
                    continue
                self.stops.append(text.decode())
                stop.sendto(b"stopped", sender)

    def open_gate(self) -> None:
        command = (sys.executable, "-m", "handrail.link.gate", "--runtime", str(self.runtime.folder))
        place = ("--port", str(self.port), "--keys", str(self.folder / "k"))
        self.gate = subprocess.Popen((*command, *place), stdout=subprocess.PIPE)
        assert self.gate.stdout is not None and self.gate.stdout.readline() == b"link ready\n"

    def kill_gate(self) -> None:
        if self.gate is not None:
            self.gate.send_signal(signal.SIGKILL)
            self.gate.communicate(timeout=10)
            self.gate = None

    def open_tablet(self) -> None:
        address, own = f"tcp://127.0.0.1:{self.port}", self.folder / "k"
        self.session = Session(lambda: connect(address, own, timeout_s=0), self.inbox, heartbeat=0.1, retry=0.1)
        self.session.start()

    def publish(self, event: Any) -> None:
        self._events.send(event)

    def publish_prompt(self, event: Any) -> None:
        self._prompts.send(event)

    def has(self, kind: type, **fields: Any) -> list[Any]:
        self.heard += self.inbox.take()
        return [
            item
            for item in self.heard
            if isinstance(item, kind) and all(getattr(item, name) == value for name, value in fields.items())
        ]

    def close(self) -> None:
        if self.session is not None:
            self.session.close()
        self.kill_gate()
        self._over.set()
        for thread in self._threads:
            thread.join(5)
        self._events.close()
        self._prompts.close()


def _free_port() -> int:
    while True:  # the gate wants two in a row
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port
