"""Everything that the loop takes in beside its bus, through one narrow place: so it can be written down, and told again later.

What a cycle does rests on the frames that its port received, on what stands here, and on nothing else: clocks are read for waiting
and for telling only, but for `waits_on`. `daemon.replay.taping` writes all of it down, `daemon.replay.player` tells it again.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from daemon import exchange
from daemon.actions.motion_maker import MotionMaker
from daemon.controllers.base import Gains
from daemon.controllers.workshop import Workshop
from daemon.exchange import CommandReader
from daemon.exchange.mailbox import MailboxReader
from daemon.safety.stop_socket import StopRequest, StopSocket
from hal.joint import JointState
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime


class Stops(Protocol):
    """The operator stop's own way in (daemon.safety.stop_socket)."""

    def fileno(self) -> int: ...

    def waiting(self) -> bool: ...

    def requests(self) -> Iterator[StopRequest]: ...

    def close(self) -> None: ...


class Inputs:
    """As they are: sockets, shared memory, threads and clocks."""

    def __init__(self, runtime: Runtime):
        """Raises ValueError when another loop listens there."""
        self.stops: Stops = StopSocket(runtime.stop)
        self.mailbox: CommandReader = MailboxReader(runtime.mailbox, exchange.COMMAND)

    def waits_on(self, patient: bool) -> bool:
        """Whether to wait on for drives that have not answered, where the wall clock says `patient`."""
        return patient

    def workshop(self, kinematics: Kinematics, gains: Gains, joints: JointState, period: float, file: Path) -> Workshop:
        """Where controllers are made that are loaded by name: in which cycle they are there is an input."""
        return Workshop(kinematics, gains, joints, period, file)

    def maker(self, kinematics: Kinematics, gains: Gains, period: float, lockstep: bool) -> MotionMaker:
        """The same for whole-body motions."""
        return MotionMaker(kinematics, gains, period, lockstep)
