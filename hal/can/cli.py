"""`handrail can ...`: looking at a bus, feeding it, and (hal.can.cli_bus, hal.can.fault_cli) the bus itself."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NoReturn

import can
import typer

from hal.can import cli_bus, fault_cli, sending
from hal.can.capture import Decoder, Interrupt, check_log, line, watch
from hal.can.cli_options import (
    Channels,
    DbcFile,
    Filter,
    Place,
    fail,
    in_words,
    matches,
    names_of,
    on_a_bus,
    parse_filter,
)
from hal.can.replay import channel_of, read_log, replay
from hal.drives.family import dbc_files

app = typer.Typer(help="The CAN bus.", no_args_is_help=True, add_completion=False)


@app.callback()
def _group() -> None:
    """The CAN bus: of a simulated robot, of a hub by itself (`up`), or a real one (--interface).

    The virtual bus is a python-can interface, too: `python -m can.viewer -i handrail -c can0`.
    """


app.command()(cli_bus.up)


@app.command()
@on_a_bus
def dump(
    place: Place,
    channel: Channels = None,
    decode: Annotated[
        bool,
        typer.Option("--decode", help="Also say what every frame means, by all families' DBCs, your own first."),
    ] = False,
    dbc: DbcFile = None,
    log: Annotated[
        Path | None, typer.Option(help="Also write frames to this file: .blf, .asc, .log (candump's), .csv, ...")
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, help="End after so many frames.", show_default="never")] = None,
    filters: Filter = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print no frames (with --log).")] = False,
) -> None:
    """Print every frame on the bus, as candump does, and log it if asked. Ctrl-C ends it.

    Times are the bus's own: simulated time, where a simulated robot runs it.
    Exit status 0: ended as asked; 1: there is no bus, it ended, or wrong use.
    """
    with in_words("dump"):
        decoder = Decoder(*([dbc] if dbc else dbc_files().values())) if decode or dbc else None
        if log is not None:
            check_log(log)
        bus = place.open(channel, "can-dump", filters)

    def show(message: can.Message) -> None:
        meaning = decoder.text(message) if decoder else ""
        sys.stdout.write(f"{line(message)}  :: {meaning}\n" if meaning else f"{line(message)}\n")

    _watch("dump", bus, [] if quiet else [show], log, count=count, idle=sys.stdout.flush)


@app.command()
@on_a_bus
def record(
    place: Place,
    file: Annotated[Path, typer.Argument(help="Where to: .blf, .asc, .log (candump's), .csv, .mf4, .trc, .db.")],
    channel: Channels = None,
    duration: Annotated[float | None, typer.Option(min=0.0, help="End after so many s.", show_default="Ctrl-C")] = None,
    count: Annotated[int | None, typer.Option(min=1, help="End after so many frames.", show_default="never")] = None,
    filters: Filter = None,
) -> None:
    """Write every frame on the bus to a log file that CAN tools read, until Ctrl-C.

    Exit status 0: ended as asked; 1: there is no bus, it ended, or wrong use. The file is whole in any case.
    """
    with in_words("record"):
        check_log(file)
        bus = place.open(channel, "can-record", filters)
    if sys.stderr.isatty():
        print(f"recording {bus.channel_info} to {file}; Ctrl-C ends it", file=sys.stderr)
    _watch("record", bus, [], file, count=count, duration_s=duration)


def _watch(
    verb: str,
    bus: can.BusABC,
    sinks: list[Callable[[can.Message], object]],
    log: Path | None,
    *,
    idle: Callable[[], object] | None = None,
    **until: Any,
) -> NoReturn:
    """Give the bus's messages to the sinks and the log until asked to end; then say how many there were, and exit."""
    interrupt, frames, ended = Interrupt(), 0, ""

    def counted(_: can.Message) -> None:
        nonlocal frames
        frames += 1

    try:
        logger = can.Logger(log) if log is not None else None
    except OSError as error:
        bus.shutdown()
        fail(verb, f"log file {log}: {error.strerror}; expected a file that this user may write")
    try:
        watch(bus, [counted, *sinks, *([logger] if logger else [])], idle=idle, interrupt=interrupt, **until)
        sys.stdout.flush()
    except can.CanOperationError as error:
        ended = str(error)
    except BrokenPipeError:
        # `| head` has seen enough; python would complain again when it flushes at exit.
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    except OSError as error:
        ended = f"log file {log}: {error.strerror or error}"  # the disk is full
    finally:
        if logger is not None:
            logger.stop()
        bus.shutdown()
    dropped = getattr(bus, "lost", 0)
    lost = f", {dropped} lost since this process read too slowly" if dropped else ""
    print(f"{frames} frames{lost}{f' in {log}' if log else ''}{f'; {ended}' if ended else ''}", file=sys.stderr)
    sys.exit(1 if ended else 0)


@app.command()
@on_a_bus
def send(
    place: Place,
    frame: Annotated[str, typer.Argument(help="123#DEADBEEF, CAN FD 123##1DEADBEEF, 123#R8, or a message's name.")],
    signals: Annotated[list[str] | None, typer.Argument(help="Of a message by name: SIGNAL=VALUE ...")] = None,
    channel: Annotated[str | None, typer.Option("--channel", "-c", show_default="the first")] = None,
    count: Annotated[int, typer.Option(min=0, help="So many times; 0: until Ctrl-C.")] = 1,
    period: Annotated[float, typer.Option(min=0.0, help="s between two.")] = 0.1,
    dbc: DbcFile = None,
) -> None:
    """Send a frame, as cansend does, or a message by its name in the DBC.

    Exit status 0: sent; 1: there is no bus, it ended, or wrong use.
    """
    with in_words("send"):
        if "#" in frame:
            message = sending.parse_frame(frame)
            if signals:
                raise ValueError(
                    f"{frame}: got {signals[0]!r} behind it; expected no signals, since the data are given"
                )
        else:
            message = sending.encode_message(frame, signals or [], [dbc] if dbc else list(dbc_files().values()))
        bus = place.open(channel, "can-send")
        interrupt, sent = Interrupt(), 0
        try:
            while True:
                bus.send(message, timeout=1.0)
                sent += 1
                if sent == count or interrupt.wait(period):
                    break
        finally:
            bus.shutdown()


@app.command("replay")
@on_a_bus
def replay_file(
    place: Place,
    file: Annotated[Path, typer.Argument(help="A log: .blf, .asc, .log (candump's), .csv, .mf4, .trc, .db.")],
    channel: Annotated[
        str | None, typer.Option("--channel", "-c", help="Send all on this one.", show_default="as logged")
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.0, help="Times as fast as it was; 0: as fast as the bus takes it.")
    ] = 1.0,
    repeat: Annotated[int, typer.Option(min=0, help="So many times; 0: until Ctrl-C.")] = 1,
    filters: Filter = None,
) -> None:
    """Send a log's frames again at the times (of this computer's clock) that they had. Ctrl-C ends it.

    Exit status 0: all sent, or ended as asked; 1: no such log, no bus, it ended, or wrong use.
    """
    sent = skipped = latest = 0
    with in_words("replay"):
        if place.interface != "handrail" and channel is None:
            raise ValueError(f"--interface {place.interface}: --channel is missing")
        wanted = [parse_filter(text) for text in filters or []]
        next(read_log(file), None)  # is it a log at all
        bus = place.open(channel, "can-replay")
        names = names_of(bus, channel)

        def route(message: can.Message) -> str:
            to = names[0] if channel is not None else channel_of(message.channel, names)
            if to is None:
                raise ValueError(
                    f"log file {file}: a frame of channel {message.channel}; the bus has {', '.join(names)} "
                    "(--channel sends all on one)"
                )
            return to

        interrupt, rounds = Interrupt(), 0
        try:
            while (repeat == 0 or rounds < repeat) and not interrupt.set:
                messages = (m for m in read_log(file) if not wanted or any(matches(m, f) for f in wanted))
                done = replay(messages, bus, route, speed=speed, ended=interrupt.wait)
                rounds, sent, skipped = rounds + 1, sent + done.sent, skipped + done.skipped
                latest = max(latest, done.latest_ns)
                if not done.sent:
                    break
        finally:
            bus.shutdown()
    without = f", {skipped} error frames left out" if skipped else ""
    print(f"{sent} frames sent{without}; the latest {latest * 1e-6:.1f} ms after its time", file=sys.stderr)


for verb in (cli_bus.stats, cli_bus.bridge, cli_bus.check, cli_bus.interfaces):
    app.command()(verb)
app.add_typer(fault_cli.app, name="fault")


if __name__ == "__main__":
    app()
