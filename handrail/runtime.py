"""Where the processes of one robot meet on this machine: one folder, one name per socket.

Every process of a robot is told the same folder (``--runtime``, or ``HANDRAIL_RUNTIME``); everything local is found in it.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

# A Unix socket's path holds 108 bytes with its terminating zero (unix(7)); our longest name has 20.
_LONGEST_FOLDER = 86


def memory_folder() -> Path:
    """Where runtime folders belong: in memory, so that the loop's shared files never wait for a disk."""
    candidates = [os.environ.get("XDG_RUNTIME_DIR"), "/dev/shm", tempfile.gettempdir()]
    return next(Path(folder) for folder in candidates if folder and os.access(folder, os.W_OK | os.X_OK))


def recordings_folder() -> Path:
    """Where recordings are kept that are begun while the robot is up: ``$HANDRAIL_RECORDINGS``, else ``handrail/recordings`` under
    ``$XDG_DATA_HOME`` (else ``~/.local/share``)."""
    if chosen := os.environ.get("HANDRAIL_RECORDINGS"):
        return Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base).absolute() / "handrail" / "recordings"


@dataclass(frozen=True)
class Runtime:
    """The folder in which the local processes of one robot find each other."""

    folder: Path

    @classmethod
    def at(cls, folder: str | os.PathLike[str] | None = None, *, make: bool = True) -> Runtime:
        """The folder named, else ``$HANDRAIL_RUNTIME``, else one of this user's own; made if it is missing.

        `make` False, for who only looks for a robot: it is neither made nor need it be this user's. Raises ValueError where the
        path is too long for Unix sockets, can't be made, is no folder, or is another user's.
        """
        if folder is None:
            folder = os.environ.get("HANDRAIL_RUNTIME") or None
        if folder is None:
            folder = memory_folder() / f"handrail-{os.getuid()}"
        path = Path(folder).absolute()
        if len(os.fsencode(path)) > _LONGEST_FOLDER:
            raise ValueError(
                f"runtime folder: {path} has {len(os.fsencode(path))} bytes; "
                f"expected at most {_LONGEST_FOLDER}, since Unix sockets live in it"
            )
        if not make:
            return cls(path)
        try:
            path.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise ValueError(
                f"runtime folder: {path} can't be made ({error.strerror}); expected a folder that this user may write in"
            ) from error
        if (owner := path.stat().st_uid) != os.getuid():
            raise ValueError(f"runtime folder: {path} belongs to user {owner}; expected this user, {os.getuid()}")
        return cls(path)

    @property
    def bus(self) -> Path:
        """The virtual CAN hub's socket (seqpacket, hal.can.frames records)."""
        return self.folder / "bus.sock"

    @property
    def stop(self) -> Path:
        """The daemon loop's stop socket (datagram), read first in every cycle."""
        return self.folder / "stop.sock"

    @property
    def service(self) -> Path:
        """The socket (seqpacket) of the supervisor of all processes here: `handrail up`."""
        return self.folder / "service.sock"

    @property
    def robot(self) -> Path:
        """Text: the folder of the robot whose service runs here; there while it does."""
        return self.folder / "robot"

    def robot_up(self, instead: str = "") -> str:
        """The folder of the robot whose service runs here. Raises ValueError when none does; `instead`: what else might help."""
        if not self.robot.is_file():
            more = f", or {instead}" if instead else ""
            raise ValueError(
                f"no robot is up in {self.folder}; start one (handrail up), say where it is (--runtime){more}"
            )
        return self.robot.read_text(encoding="utf-8").strip()

    @property
    def state_ring(self) -> Path:
        """Shared memory: what the loop writes each cycle, the server reads."""
        return self.folder / "state.ring"

    @property
    def mailbox(self) -> Path:
        """Shared memory: commands from the server to the loop."""
        return self.folder / "mailbox.ring"

    @property
    def tape(self) -> Path:
        """Shared memory: what goes into the loop and out of it, while that is recorded."""
        return self.folder / "loop.tape"

    @property
    def timing(self) -> Path:
        """Shared memory: how long the loop's cycles worked and how late they were."""
        return self.folder / "loop.timing"

    def endpoint(self, name: str) -> str:
        """ZeroMQ endpoint of a local topic or call, e.g. ``daemon.call``, ``daemon.events``, ``plant.truth``."""
        return f"ipc://{self.folder / name}"
