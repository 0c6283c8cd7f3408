"""`handrail can up | stats | bridge | check | interfaces`: the bus itself, its health and its neighbours."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import can
import typer

from hal.can.capture import Decoder, Interrupt
from hal.can.cli_options import BitRate, DataBitRate, DbcFile, Place, RuntimeFolder, fail, in_words, on_a_bus
from hal.can.interface import HandrailBus
from hal.drives.family import dbc_files
from handrail.runtime import Runtime

if TYPE_CHECKING:
    from hal.can.listening import ListenedBus


def up(
    channels: Annotated[str, typer.Argument(help="Names of the channels, with commas between.")] = "can0",
    timing: Annotated[
        bool, typer.Option("--timing", help="Frames take the time that they would on a real bus.")
    ] = False,
    bitrate: Annotated[int, typer.Option(min=1, help="bit/s")] = 1_000_000,
    data_bitrate: Annotated[int, typer.Option(min=1, help="bit/s of CAN FD's data phase")] = 5_000_000,
    faults: Annotated[Path | None, typer.Option(help="Faults to begin with: a YAML file.", dir_okay=False)] = None,
    runtime: RuntimeFolder = None,
) -> None:
    """Start a virtual bus by itself, without a robot; Ctrl-C ends it. (`handrail up` brings its own.)

    Exit status 0: ended as asked; 1: it can't be started.
    """
    from hal.can import hub_process  # its compiled kernels cost half a second, which the other verbs needn't wait for

    arguments = ["--channels", channels, "--bitrate", str(bitrate), "--data-bitrate", str(data_bitrate)]
    arguments += ["--timing"] * timing
    arguments += ["--faults", str(faults)] if faults else []
    arguments += ["--runtime", str(runtime)] if runtime else []
    hub_process.main(arguments)


@on_a_bus
def stats(
    place: Place,
    once: Annotated[bool, typer.Option("--once", help="Print one table (of half a second) and end.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print it once, as JSON.")] = False,
    everything: Annotated[bool, typer.Option("--all", help="Show every identifier and node.")] = False,
    period: Annotated[float, typer.Option(min=0.1, help="s between two looks.")] = 0.5,
    dbc: DbcFile = None,
    channel: Annotated[str | None, typer.Option("--channel", "-c", help="Of a real bus.")] = None,
) -> None:
    """The bus's load by channel and identifier, its nodes' error counters and its faults, live until Ctrl-C.

    Of a real bus (--interface) it shows what can be heard: load by identifier, and this computer's controller where it tells.

    Load and frames/s are by the bus's own clock: a simulation that stands still shows `-`.
    Exit status 0: ended as asked; 1: there is no bus, or it ended.
    """
    from hal.can import bus_table
    from hal.can.control import HubControl

    with in_words("stats"):
        decoder = Decoder(*([dbc] if dbc else dbc_files().values()))
        bus: HubControl | ListenedBus
        if place.interface == "handrail":
            bus = HubControl(Runtime.at(place.runtime, make=False).bus, timeout_s=1.0)
        else:
            from hal.can.listening import ListenedBus

            real = place.open(channel, "can-stats")
            bus = ListenedBus(real, str(channel), *place.rates, place.interface)
        interrupt = Interrupt()
        try:
            before = bus.report()
            interrupt.wait(period)
            now = bus.report()
            if as_json:
                print(bus_table.as_json(now, before).decode())
                return
            from rich.console import Console
            from rich.live import Live

            console = Console()
            live = not once and console.is_terminal
            rows = None if everything or not live else max(5, (console.height - 16 - len(now.channels)) // 2)

            def shown() -> Any:
                return bus_table.tables(now, before, decoder.name, identifiers=rows, nodes=rows)

            if not live:
                console.print(shown())
                return
            with Live(shown(), console=console, auto_refresh=False, screen=not everything) as table:
                while not interrupt.wait(period):
                    before, now = now, bus.report()
                    table.update(shown(), refresh=True)
        finally:
            bus.close()


def bridge(
    channel: Annotated[str, typer.Argument(help="Channel of the virtual bus.")],
    to: Annotated[str, typer.Option("--to", help="The other bus's channel, e.g. can0, PCAN_USBBUS1.")],
    interface: Annotated[str, typer.Option("--interface", "-i", help="The other bus's interface (see `interfaces`).")],
    bitrate: BitRate = 1_000_000,
    data_bitrate: DataBitRate = 5_000_000,
    option: Annotated[list[str] | None, typer.Option(help="NAME=VALUE for python-can's interface. Repeatable.")] = None,
    runtime: RuntimeFolder = None,
) -> None:
    """Join a channel of the virtual bus to a real one: what one carries the other does too, until Ctrl-C.

    Error frames stay where they are, and no frame comes back as an echo. Every frame is a little late on the other side; a real
    bus that is slower drops what it can't take, and this says how much.
    Exit status 0: ended as asked; 1: there is no such bus, one of them ended (an adapter was unplugged), or wrong use.
    """
    from hal.can import bridge as bridges
    from hal.can import real_port

    with in_words("bridge"):
        folder = Runtime.at(runtime, make=False).folder
        options = dict(_option(text) for text in option or [])
        if interface == "handrail" and Path(str(options.get("runtime", folder))).absolute() == folder and to == channel:
            raise ValueError(f"{channel} to itself; expected another bus (--option runtime=FOLDER names one)")
        virtual = HandrailBus(channel, runtime=runtime, timeout=1.0, name=f"bridge-{interface}-{os.getpid()}")
        try:
            with bridges.only_bridge(folder, f"handrail {channel}", f"{interface} {to}"):
                real = real_port.open_bus(interface, to, bitrate, data_bitrate, options)
                sides = (
                    bridges.Side(f"handrail {channel}", virtual),
                    bridges.Side(f"{interface} {to}", real, echoes=interface in bridges.ECHOING),
                )
                joint, interrupt = bridges.Bridge(*sides), Interrupt()
                joint.start()
                print(f"bridge ready: {sides[0].name} and {sides[1].name}; Ctrl-C ends it", file=sys.stderr, flush=True)
                while not joint.ended.is_set() and not interrupt.wait(0.2):
                    pass
                joint.end()
        finally:
            virtual.shutdown()
    for side, other in (sides, sides[::-1]):
        refused = f", {side.refused} that it did not take ({side.why_refused})" if side.refused else ""
        errors = f", {side.errors} error frames left out" if side.errors else ""
        print(f"{side.name} to {other.name}: {side.taken} frames{refused}{errors}", file=sys.stderr)
    if joint.problem:
        fail("bridge", joint.problem)


def _option(text: str) -> tuple[str, Any]:
    from can.util import cast_from_string

    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise ValueError(f"--option {text!r}; expected NAME=VALUE")
    return name, cast_from_string(value)


def check(
    robot: Annotated[str, typer.Argument(help="Name or folder of the robot.")],
    runtime: RuntimeFolder = None,
) -> None:
    """Is a robot's network as its description says: interfaces, bit rates, and does every drive answer?

    Only listens where a host is on the bus; else it polls the drives with controlwords that leave them switched off.
    Exit status 0: all is well; 1: something is not, and what to do about it.
    """
    from hal.can import bus_check
    from hal.can.port import open_port
    from hal.drives.protocol import LimbProtocol
    from handrail.robot import library as robots

    with in_words("check"):
        description = robots.load(robot)
        bus_check.check_channels(description.channels)
        protocol, place = LimbProtocol(description), Runtime.at(runtime, make=False)
        port = open_port(description, place, timeout_s=1.0, name=f"can-check-{os.getpid()}")
        try:
            found = bus_check.survey(description, port, protocol)
        finally:
            port.close()
        states = {}
        if any(channel.interface == "handrail" for channel in description.channels):
            from hal.can.control import HubControl

            control = HubControl(place.bus, timeout_s=1.0)
            states = {(node.name, node.channel): node.state for node in control.report().nodes}
            control.close()
    names: dict[str, list[str]] = {channel.name: [] for channel in description.channels}
    for limb in description.limbs:
        names[limb.channel] += limb.joints
    for device in description.devices:
        names[device.channel].append(device.name)
    for channel in description.channels:
        members, state = names[channel.name], found.controllers.get(channel.name)
        own = f", own controller {state}" if state else ""
        print(
            f"{channel.name}: {channel.interface}, {channel.bitrate:,} and {channel.data_bitrate:,} bit/s, "
            f"{len(set(members) & set(found.answered))} of {len(members)} drives and devices answer{own}"
        )
    if not found.asked:
        print("a host is on the bus: this only listened")
    if said := bus_check.refusal(description, found, states):
        fail("check", said)


def interfaces() -> None:
    """List python-can's interfaces, and the channels that their drivers show on this computer."""
    import logging

    from hal.can import real_port

    logging.disable(logging.CRITICAL)  # every driver that is not installed would say so
    names = real_port.interfaces()
    found = can.detect_available_configs([name for name in names if name != "virtual"])
    for name in names:
        channels = [str(config["channel"]) for config in found if config["interface"] == name]
        print(f"{name:<15} {', '.join(channels)}".rstrip())
