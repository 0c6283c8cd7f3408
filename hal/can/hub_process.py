"""A virtual bus as a process, without a robot, for tests and tools.

python -m hal.can.hub_process --runtime DIR --channels can0,can1
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Sequence

from hal.can import faults
from hal.can.hub import Hub
from hal.can.timing import BusTiming
from hal.realtime import RealTime
from handrail.config import ConfigError
from handrail.runtime import Runtime

_PRIORITY = 60  # below plant and daemon


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a hub by itself until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(
        prog="python -m hal.can.hub_process", description="A virtual CAN bus without a robot."
    )
    parser.add_argument("--runtime", help="the robot's runtime folder (default: $HANDRAIL_RUNTIME, else this user's)")
    parser.add_argument("--channels", default="can0", help="channel names, separated by commas (default: can0)")
    parser.add_argument("--bitrate", type=int, default=1_000_000, help="bit/s (default: 1000000)")
    parser.add_argument(
        "--data-bitrate", type=int, default=5_000_000, help="bit/s of CAN FD's data phase (default: 5000000)"
    )
    parser.add_argument("--timing", action="store_true", help="frames take the time that they would on a real bus")
    parser.add_argument("--faults", help="YAML file of faults that lie on the bus from the start")
    options = parser.parse_args(arguments)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        channels = [BusTiming(name, options.bitrate, options.data_bitrate) for name in options.channels.split(",")]
        script = faults.read(options.faults) if options.faults else []
        hub = Hub(Runtime.at(options.runtime).bus, channels, timing=options.timing)
        for fault in script:
            hub.add_fault(fault)
    except (ConfigError, OSError, ValueError) as error:
        sys.exit(str(error))
    if options.timing:  # a bus that sleeps through a frame's end has lost the time until it wakes
        for warning in RealTime(priority=_PRIORITY).warnings:
            print(f"hub: {warning}", file=sys.stderr)
    print("hub ready", flush=True)
    with contextlib.closing(hub):
        while True:
            hub.poll(None)


if __name__ == "__main__":
    main()
