"""CURVE keys of the link: who the robot is, and who may talk to it.

One folder holds them, ``$HANDRAIL_KEYS`` or ``handrail/keys`` under ``$XDG_CONFIG_HOME`` (else ``~/.config``):

    server.key          the robot's public key      needed by the robot and by every client
    server.key_secret   the robot's secret key      never leaves the robot
    client.key          this user's public key
    client.key_secret   this user's secret key      never leaves the client
    allowed/*.key       public keys that the robot lets in, one file a client; the file's name is the client's name.
                        They are operators'; those in allowed/developers/ may also bring code, those in allowed/engines/ are
                        other machines' engines, which may command the robot, those in allowed/observers/ may look and stop, and
                        command nothing. This folder's own client.key is a developer's wherever it lies

The first run on a machine makes all of them, with this user's client allowed. To let another machine in, pair the two
(``handrail pair``, `handrail.link.pairing`), or copy its ``client.key`` to the robot as ``allowed/NAME.key`` and the robot's
``server.key`` to it; the gate reads ``allowed`` at every handshake, so nothing has to be restarted. Files are ZeroMQ certificates
(``zmq.auth``).
"""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import zmq
import zmq.auth

_ALLOWED = "allowed"

Role = Literal["operator", "developer", "engine", "observer"]
_ROLES: dict[str, Role] = {
    "": "operator",
    "developers": "developer",
    "engines": "engine",
    "observers": "observer",
}
"""folder below `allowed` → what those in it are"""


class KeysError(Exception):
    """Keys that are missing or can't be used; the text says which file and what to do."""


@dataclass(frozen=True)
class ClientKeys:
    """What a client needs: its own pair and the robot's public key (Z85 text as bytes)."""

    public: bytes
    secret: bytes = field(repr=False)
    server: bytes
    folder: Path | None = None
    """where they came from, for messages to people"""


@dataclass(frozen=True)
class Identity:
    """Whose key it is."""

    name: str
    role: Role


@dataclass(frozen=True)
class GateKeys:
    """What the robot's gate needs: its own pair and the folder of clients that it lets in."""

    public: bytes
    secret: bytes = field(repr=False)
    allowed: Path

    def name_of(self, client: bytes) -> str | None:
        """The name under which a client's public key (Z85) is allowed in; None when it is not."""
        identity = self.identity_of(client)
        return None if identity is None else identity.name

    def identity_of(self, client: bytes) -> Identity | None:
        """Name and role of a client's public key (Z85), None when it is not allowed in. In two folders it is an operator's."""
        for folder, role in _ROLES.items():
            for file in sorted((self.allowed / folder).glob("*.key")):
                if _public(file) == client:
                    own = _public(self.allowed.parent / "client.key") == client
                    return Identity(file.stem, "developer" if own else role)
        return None


def _public(file: Path) -> bytes | None:
    try:
        return zmq.auth.load_certificate(file)[0]
    except (OSError, ValueError):
        return None  # a file that is no certificate lets nobody in


def default_folder() -> Path:
    """Where this user's keys are: ``$HANDRAIL_KEYS``, else ``handrail/keys`` under the user's configuration."""
    if chosen := os.environ.get("HANDRAIL_KEYS"):
        return Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base).absolute() / "handrail" / "keys"


def ensure(folder: Path | str | None = None) -> Path:
    """The folder of keys, made with fresh keys if it is missing or empty. Safe when several processes start at once."""
    folder = Path(folder).absolute() if folder else default_folder()
    if folder.is_dir() and any(folder.iterdir()):
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Made whole under another name, then moved into place in one step: another process sees all of them or none.
    fresh = Path(tempfile.mkdtemp(prefix=".keys-", dir=folder.parent))
    try:
        (fresh / _ALLOWED).mkdir(mode=0o700)
        for name in ("server", "client"):
            _, secret = zmq.auth.create_certificates(fresh, name)
            Path(secret).chmod(0o600)
        shutil.copy(fresh / "client.key", fresh / _ALLOWED / "local.key")
        try:
            fresh.rename(folder)
        except OSError:
            if not (folder.is_dir() and any(folder.iterdir())):
                raise
            # Another process was first: its keys hold.
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    return folder


def for_client(folder: Path | str | None = None) -> ClientKeys:
    """This user's keys for calling a robot; made on the first run. Raises KeysError."""
    folder = ensure(folder)
    public, secret = _pair(folder, "client")
    return ClientKeys(public=public, secret=secret, server=_load(folder / "server.key")[0], folder=folder)


def for_gate(folder: Path | str | None = None) -> GateKeys:
    """The robot's keys for its gate; made on the first run. Raises KeysError."""
    folder = ensure(folder)
    public, secret = _pair(folder, "server")
    return GateKeys(public=public, secret=secret, allowed=folder / _ALLOWED)


def file_for(gate: GateKeys, name: str, role: Role) -> Path:
    """Where a client's public key lies that is let in under a name, as what."""
    folder = next(folder for folder, each in _ROLES.items() if each == role)
    return gate.allowed / folder / f"{name}.key"


def allow(file: Path, public: bytes) -> None:
    """Let a client's public key (Z85) in: its certificate is written to `file` in one step."""
    file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    _write(file, public)


def trust(folder: Path, server: bytes) -> None:
    """Take a robot's public key (Z85) for the one that is talked to; another one that was there is kept beside it."""
    file = folder / "server.key"
    if file.exists() and _public(file) != server:
        file.replace(file.with_name("server.key.before"))
    _write(file, server)


def _write(file: Path, public: bytes) -> None:
    fresh = file.with_name(f".{file.name}.{os.getpid()}")
    fresh.write_text(f'metadata\ncurve\n    public-key = "{public.decode()}"\n', encoding="ascii")
    fresh.replace(file)


def _pair(folder: Path, name: str) -> tuple[bytes, bytes]:
    file = folder / f"{name}.key_secret"
    public, secret = _load(file)
    if secret is None:
        raise KeysError(f"{file}: holds no secret key; expected a certificate written by zmq.auth with `secret-key`")
    return public, secret


def _load(file: Path) -> tuple[bytes, bytes | None]:
    try:
        return zmq.auth.load_certificate(file)
    except (OSError, ValueError) as error:
        raise KeysError(
            f"{file}: no key there that can be used ({error}); copy it from the machine that has it, or move the folder "
            f"{file.parent} away to have a new set made"
        ) from error
