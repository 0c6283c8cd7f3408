"""`handrail stop`: the operator stop over the loop's own socket, which works when everything else hangs.

One datagram to ``Runtime.stop``, read first in every cycle of the daemon's loop; the loop answers the sender. Nothing between
the two: no server, no link, no ZeroMQ.
"""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Annotated

import typer

from handrail.runtime import Runtime

_LONGEST_REASON = 200
"""bytes of UTF-8, as in messages.Stop"""


class NoAnswer(ConnectionError):
    """The loop did not say that it stopped; str() tells what is known and what to do."""


def request(stop_socket: Path, text: str, timeout_s: float = 1.0) -> str:
    """Send one datagram (``STOP reason``, ``CLEAR``) to the loop and return its answer. Raises NoAnswer."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.bind("")  # an abstract address of the kernel's choice (unix(7)): no file to leave behind
        sender.settimeout(timeout_s)
        try:
            sender.sendto(text.encode(errors="replace"), str(stop_socket))
            return sender.recv(1024).decode(errors="replace")
        except TimeoutError as error:
            raise NoAnswer(
                f"the daemon's loop did not answer at {stop_socket} within {timeout_s:g} s: it hangs. "
                "Use the robot's emergency stop; then end the loop: its drives quick-stop by their own watchdog"
            ) from error
        except OSError as error:
            raise NoAnswer(
                f"no daemon loop listens at {stop_socket} ({error.strerror}). Drives that get no commands quick-stop by "
                "their own watchdog. If the robot's runtime folder is another one, name it with --runtime or HANDRAIL_RUNTIME; "
                "if the robot moves, use its emergency stop"
            ) from error


def leave(stop_socket: Path, text: str) -> bool:
    """Send one datagram to a loop that is still starting, which reads it in its first cycle. False: there is no loop."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sender:
        try:
            sender.sendto(text.encode(), str(stop_socket))
        except (FileNotFoundError, ConnectionRefusedError, BlockingIOError):
            return False
    return True


def stop_now(runtime: Runtime, reason: str = "", timeout_s: float = 1.0) -> str:
    """Operator stop: every drive quick-stops within two cycles, latched until cleared. The loop's answer; raises NoAnswer."""
    reason = " ".join(reason.split()).encode(errors="replace")[:_LONGEST_REASON].decode(errors="ignore")
    return request(runtime.stop, f"STOP {reason}".rstrip(), timeout_s)


def clear_stop(runtime: Runtime, timeout_s: float = 1.0) -> str:
    """Unlatch the operator stop; nothing moves before Enable. The loop's answer; raises NoAnswer."""
    return request(runtime.stop, "CLEAR", timeout_s)


def stop(
    reason: Annotated[str, typer.Argument(help="Why, for the others to read.")] = "handrail stop",
    clear: Annotated[
        bool, typer.Option("--clear", help="Unlatch the stop instead. Nothing moves before Enable.")
    ] = False,
    runtime: Annotated[Path | None, typer.Option(help="The robot's runtime folder (default: yours).")] = None,
    timeout: Annotated[float, typer.Option(min=0.01, help="How long to wait for the loop's answer, s.")] = 1.0,
) -> None:
    """Operator stop: every drive quick-stops within two cycles and stays stopped until `handrail stop --clear`.

    Works over a local socket that the daemon's loop reads first in every cycle, with everything else dead.
    Exit status 0: the loop answered; 1: it did not; 2: wrong use.
    """
    try:
        place = Runtime.at(runtime, make=False)
    except ValueError as error:
        typer.echo(f"handrail stop: {error}", err=True)
        raise typer.Exit(2) from error
    try:
        answer = clear_stop(place, timeout) if clear else stop_now(place, reason, timeout)
    except NoAnswer as error:
        typer.echo(f"handrail stop: {error}", err=True)
        raise typer.Exit(1) from error
    typer.echo(answer)
    expected = "cleared" if clear else "stopped"
    if not answer.startswith(expected):
        typer.echo(f"handrail stop: the loop answered {answer!r}; expected {expected!r}", err=True)
        raise typer.Exit(1)
