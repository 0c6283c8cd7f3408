"""`handrail can ...`: looking at the bus."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import can
import typer

from hal.can.capture import Decoder, Interrupt, check_log, line, watch
from hal.can.interface import HandrailBus
from hal.drives import DBC_FILES

app = typer.Typer(help="The CAN bus.", no_args_is_help=True, add_completion=False)


@app.callback()
def _group() -> None:
    """Look at the CAN bus of a simulated robot. (A real one is a python-can interface: use `python -m can.logger`.)"""


@app.command()
def dump(
    channel: Annotated[
        str | None, typer.Argument(help="A channel, or several with commas between.", show_default="all channels")
    ] = None,
    decode: Annotated[bool, typer.Option("--decode", help="Also say what every frame means, by the DBC.")] = False,
    dbc: Annotated[
        Path | None, typer.Option(help="The DBC that --decode uses.", show_default="limb_fd.dbc", dir_okay=False)
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Write frames to this file: .blf, .asc, .log (candump's) or .csv.")
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, help="End after so many frames.", show_default="never")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print no frames (with --log).")] = False,
    runtime: Annotated[
        Path | None,
        typer.Option(help="The robot's runtime folder.", show_default="$HANDRAIL_RUNTIME, else this user's"),
    ] = None,
) -> None:
    """Print every frame on the bus, as candump does, and log it if asked. Ctrl-C ends it.

    Times are the bus's own: simulated time, where a simulated robot runs it.
    Exit status 0: ended as asked; 1: there is no bus, it ended, or wrong use.
    """
    try:
        decoder = Decoder(dbc or DBC_FILES["limb_fd"]) if decode or dbc else None
        if log is not None:
            check_log(log)
        bus = HandrailBus(channel, runtime=runtime, timeout=1.0)
    except (ValueError, can.CanError) as error:
        sys.exit(f"handrail can dump: {error}")
    interrupt, frames, ended = Interrupt(), 0, ""

    def show(message: can.Message) -> None:
        meaning = decoder.text(message) if decoder else ""
        sys.stdout.write(f"{line(message)}  :: {meaning}\n" if meaning else f"{line(message)}\n")

    def counted(_: can.Message) -> None:
        nonlocal frames
        frames += 1

    try:
        logger = can.Logger(log) if log is not None else None
    except OSError as error:
        bus.shutdown()
        sys.exit(f"handrail can dump: log file {log}: {error.strerror}; expected a file that this user may write")
    sinks: list[Callable[[can.Message], object]] = [counted]
    if not quiet:
        sinks.append(show)
    if logger is not None:
        sinks.append(logger)
    try:
        watch(bus, sinks, count=count, idle=sys.stdout.flush, interrupt=interrupt)
        sys.stdout.flush()
    except can.CanOperationError as error:
        ended = str(error)
    except BrokenPipeError:
        # `| head` has seen enough; python would complain again when it flushes at exit.
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    finally:
        if logger is not None:
            logger.stop()
        bus.shutdown()
    lost = f", {bus.lost} lost since this process read too slowly" if bus.lost else ""
    print(f"{frames} frames{lost}{f' in {log}' if log else ''}{f'; {ended}' if ended else ''}", file=sys.stderr)
    sys.exit(1 if ended else 0)


if __name__ == "__main__":
    app()
