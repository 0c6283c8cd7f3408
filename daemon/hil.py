"""A test's own control loop: the real one, in the test's process, cycle by cycle on the rig's bus (pytest plugin; docs/hil.md).

For controllers that are being written: the fixture `control_loop` runs them between the real robot state and the real limits,
against the plant's drives, with nothing else of the daemon running.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, TypeVar

import pytest

if TYPE_CHECKING:
    from daemon.controllers.base import Controller
    from hal.hil.rig import Rig

    AnyController = TypeVar("AnyController", bound=Controller)

_ENABLING_CYCLES = 500


def warm_up(robot: str) -> None:
    """All that a loop and a server of this robot compile and load, ahead of their start (hal.hil.nursery)."""
    import daemon.server
    from daemon.warm_up import warm_up
    from hal.drives.protocol import LimbProtocol
    from handrail.robot import library as robots
    from handrail.robot.kinematics import Kinematics

    assert daemon.server
    description = robots.load(robot)
    LimbProtocol(description)
    warm_up(Kinematics(description))


class ControlLoop:
    """The daemon's loop, run by the test. Between two runs simulated time is held."""

    def __init__(self, rig: Rig):
        from daemon.loop import Loop
        from daemon.warm_up import warm_up
        from hal.can.port import open_port
        from hal.drives.protocol import LimbProtocol
        from hal.hardware import Hardware
        from handrail.robot.kinematics import Kinematics

        self._rig, self._bus = rig, rig.bus
        self._used: list[Controller] = []
        kinematics, protocol = Kinematics(rig.description), LimbProtocol(rig.description)
        warm_up(kinematics)
        hardware = Hardware(rig.description, open_port(rig.description, rig.runtime), protocol)
        self.loop = Loop(hardware, kinematics, True, rig.runtime)
        """daemon.loop.Loop, with all its parts"""

    def run(self, seconds: float) -> None:
        """So many seconds of the robot's time, cycle by cycle."""
        self.cycles(round(seconds * 1e9 / self.loop.period_ns))

    def cycles(self, count: int) -> None:
        """So many cycles. Raises what a controller in use raised: its joints are held from that cycle on."""
        self._bus.holding = False
        try:
            for _ in range(count):
                self.loop.cycle()
                for controller in self._used:
                    if controller.error is not None:
                        raise controller.error
        finally:
            self._bus.holding = True

    def enable(self) -> None:
        """Take every drive to operation enabled; the robot holds. Raises AssertionError when it does not come to that."""
        self.cycles(3)
        refusal = self.loop.life.enable()
        assert refusal is None, f"the robot can't be enabled: {refusal}"
        for _ in range(_ENABLING_CYCLES):
            self.cycles(1)
            if self.loop.life.enabled:
                return self.run(0.1)  # the brakes open meanwhile
        raise AssertionError("the robot did not come to be enabled")

    def use(self, controller: type[AnyController], joints: str | Iterable[str]) -> AnyController:
        """Make a controller with the robot's own gains, and let it take these joints over in the next cycle.

        joints: a joint, a glob, a limb or a group. The rest is held. Raises daemon.controllers.manager.ClaimError.
        """
        from hal.hil.names import joints_of

        rows = self._rig.description.index(tuple(joints_of(self._rig.description, joints)))
        made = controller(rows, self.loop.manager.gains)
        self.loop.manager.switch([], [made], self.loop.written)
        self._used.append(made)
        return made

    def release(self, controller: Controller) -> None:
        """Give its joints back to `hold`."""
        self._used.remove(controller)
        self.loop.manager.switch([controller], [], self.loop.written)

    def close(self) -> None:
        self._bus.holding = False
        self.loop.close()


@pytest.fixture
def control_loop(handrail_rig: Rig) -> Iterator[ControlLoop]:
    """The real control loop in the test's own process, enabled and holding."""
    if handrail_rig.options.clock != "lockstep":
        raise pytest.UsageError("control_loop: clock='wall'; expected lockstep, since the test runs the cycles")
    control_loop = ControlLoop(handrail_rig)
    try:
        control_loop.enable()
        yield control_loop
    finally:
        control_loop.close()
