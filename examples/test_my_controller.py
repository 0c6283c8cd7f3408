"""A controller of your own on the real control loop, against emulated drives and a bus with faults: `pytest examples`."""

import numpy as np
import pytest

from daemon.controllers.base import Controller


class Sway(Controller):
    """Swings its joints by 0.2 rad and back, once a second."""

    def activate(self, robot, last):
        self.start, self.phase = last.position[self.joints].copy(), 0.0

    def update(self, robot, out):
        self.phase += 2 * np.pi * robot.period
        position = self.start + 0.1 * (1 - np.cos(self.phase))
        velocity = np.full(len(self.joints), 0.2 * np.pi * np.sin(self.phase))
        self.write_impedance(robot, out, position, velocity)


def test_it_sways_within_limits_on_a_bus_that_loses_a_third_of_the_frames(control_loop, bus, plant):
    control_loop.use(Sway, "arm_left")
    before = plant.truth().joints["arm_left_4_joint"]
    with bus.fault("drop", probability=0.3) as lost, plant.window() as window:
        control_loop.run(0.5)
    assert plant.truth().joints["arm_left_4_joint"] == pytest.approx(before + 0.2, abs=0.02)
    assert lost.hits > 1000
    plant.assert_within_limits(window.seen)
