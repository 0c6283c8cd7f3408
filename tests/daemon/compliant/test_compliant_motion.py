"""Compliant motion on TALOS' right arm, judged by the plant: what presses, gives way, swings, and what stays where it is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Kind, Outcome
from hal.plant.scene import EMPTY, Box, Scene
from handrail.messages import Compliance, CompliantMotion, Dither, Pose
from handrail.robot.kinematics import Kinematics
from tests.daemon.compliant.conftest import TIP, InPlant, wall_before

TOOL = "tool_right"


def compliant(robot: InPlant, duration: float, *axes: Compliance, **more) -> CompliantMotion:
    joints = list(robot.description.arms["right"].joints)
    return CompliantMotion(frame=TIP, joints=joints, duration=duration, compliance=list(axes), **more)


class Track:
    """Where the tip really was, and how hard it really pushed the wall, cycle by cycle."""

    def __init__(self, robot: InPlant):
        self._robot, self._start = robot, robot.tip()
        self.places: list[np.ndarray] = []
        self.forces: list[np.ndarray] = []

    def __call__(self) -> None:
        self.places.append(self._robot.tip().translation - self._start.translation)
        if "wall" in self._robot.world.contact_force:
            self.forces.append(self._robot.force_on("wall"))

    @property
    def place(self) -> np.ndarray:
        """m (cycles, 3) from the start."""
        return np.array(self.places)

    @property
    def force(self) -> np.ndarray:
        """N (cycles, 3)"""
        return np.array(self.forces)


@pytest.mark.parametrize("by", ["sensor", "joints"])
def test_it_presses_a_wall_with_the_force_it_was_told(in_plant, talos, ready, by: str) -> None:
    """20 N within 2 N, for each cycle of the last 0.4 s."""
    robot = in_plant(wall_before(ready, 0.004), talos if by == "sensor" else dataclasses.replace(talos, devices=()))
    track = Track(robot)
    assert robot.start(compliant(robot, 1.5, Compliance(axis="x", force=20.0))) is Answer.ACCEPTED
    assert robot.run_to_end(each=track) is Outcome.DONE
    pressed = track.force[-200:, 0]
    assert abs(pressed - 20.0).max() < 2.0, f"N: {pressed.min():.2f} to {pressed.max():.2f}"
    touch = np.convolve(track.force[:, 0], np.full(10, 0.1))
    assert touch.max() < 40.0, "N, 20 ms of the touch"


@pytest.mark.parametrize("by", ["sensor", "joints"])
def test_it_twists_against_a_post_with_the_torque_it_was_told(in_plant, talos, ready, by: str) -> None:
    """2 N·m within 0.2 about the tool's root, 15 cm from where the stub's end leans against the post."""
    root = Kinematics(talos).frame(talos.home_position(), TOOL).translation
    place = root + np.array([0.145, 0.012 + 0.005 + 0.01, 0.0])  # the stub's radius, a gap, half the post
    post = Scene(
        EMPTY.file,
        {"post": Box(pose_in_world=None, size=(0.02, 0.02, 0.3), friction=0.3)},
        {"post": Pose(position=tuple(place.tolist()))},
    )
    robot = in_plant(post, talos if by == "sensor" else dataclasses.replace(talos, devices=()))
    torques: list[float] = []

    def measure() -> None:
        about = robot.kinematics.frame(robot.world.position, TOOL).translation
        torques.append(float(robot.moment_on("post", about)[2]))

    joints = list(robot.description.arms["right"].joints)
    twist = CompliantMotion(frame=TOOL, joints=joints, duration=1.6, compliance=[Compliance(axis="rz", force=2.0)])
    assert robot.start(twist) is Answer.ACCEPTED
    assert robot.run_to_end(each=measure) is Outcome.DONE
    held = np.array(torques[-200:])
    assert abs(held - 2.0).max() < 0.2, f"N·m: {held.min():.3f} to {held.max():.3f}"


def test_it_slides_along_a_wall_that_it_presses_in_the_frames_own_axes(in_plant, ready) -> None:
    """The stub points along the frame's −z, the world's +x; the frame's y is the world's (0, 0.83, −0.55)."""
    robot = in_plant(wall_before(ready, 0.002, friction=0.2))
    track = Track(robot)
    robot.start(compliant(robot, 1.8, Compliance(axis="z", force=-15.0), shift=(0, 0.05, 0), axes_in="frame"))
    assert robot.run_to_end(each=track) is Outcome.DONE
    touching = track.force[350:, 0]
    assert abs(touching.mean() - 15.0) < 1.5
    assert touching.min() > 8.0, "N: it never lets go"
    went = track.place[-1] @ ready.rotation[:, 1]
    assert went == pytest.approx(0.05, abs=0.02), "m, less what friction keeps back"


def test_an_axis_is_the_spring_that_it_was_told_and_the_others_stay_stiff(in_plant) -> None:
    robot = in_plant()
    robot.start(compliant(robot, 4.0, Compliance(axis="y", stiffness=200.0, damping=60.0, speed=0.5)))
    robot.run(30)
    track = Track(robot)
    robot.push((0.0, 8.0, 8.0))
    robot.run(450, track)
    assert track.place[-1, 1] == pytest.approx(8.0 / 200.0, rel=0.1), "m"
    assert track.place[-1, 2] == pytest.approx(8.0 / 600.0, rel=0.35), "m: the motion's own stiffness"
    robot.push((0.0, 0.0, 0.0))


def test_a_damper_goes_as_fast_as_it_is_pushed_but_no_faster_than_it_may_and_no_farther(in_plant) -> None:
    robot = in_plant()
    guided = Compliance(axis="z", damping=200.0, speed=0.06, reach=0.03)
    robot.start(compliant(robot, 4.0, guided))
    track = Track(robot)
    robot.push((0.0, 0.0, 6.0))
    robot.run(300, track)
    speeds = np.diff(track.place[:, 2]) / 0.002
    assert speeds[150:].mean() == pytest.approx(6.0 / 200.0, rel=0.15), "m/s"
    robot.push((0.0, 0.0, -16.0))
    track = Track(robot)
    robot.run(450, track)
    speeds = np.diff(track.place[:, 2]) / 0.002
    assert speeds[150:300].mean() == pytest.approx(-0.06, rel=0.15), "m/s: no faster than that"
    assert robot.loop.actions.slots[0].controller.offset[2] == -0.03, "m: no farther than that from the path"
    robot.push((0.0, 0.0, 0.0))


def test_a_set_point_in_the_air_goes_at_its_speed_to_the_end_of_its_reach_about_an_axis_too(in_plant) -> None:
    robot = in_plant()
    before = robot.tip()
    axes = (
        Compliance(axis="z", force=15.0, speed=0.04, reach=0.035),
        Compliance(axis="rz", force=1.0, speed=0.3, reach=0.15),
    )
    track = Track(robot)
    robot.start(compliant(robot, 1.4, *axes))
    assert robot.run_to_end(each=track) is Outcome.DONE
    assert np.diff(track.place[150:400, 2]).mean() / 0.002 == pytest.approx(0.04, rel=0.15)
    assert track.place[-1, 2] == pytest.approx(0.035, abs=0.004)
    turned = robot.tip().rotation @ before.rotation.T
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.15, abs=0.03), "rad"


def test_a_dither_swings_as_told_about_the_path_and_stands_while_it_is_paused(in_plant) -> None:
    robot = in_plant()
    swing = Dither(axis="y", amplitude=0.006, frequency=2.0)
    serial = robot.post_start(compliant(robot, 9.0, dither=[swing]))
    robot.run(250)
    track = Track(robot)
    robot.run(500, track)
    times = 0.002 * np.arange(500)
    waves = np.column_stack((np.sin(4 * np.pi * times), np.cos(4 * np.pi * times), np.ones(500)))
    (sine, cosine, _), rest, *_ = np.linalg.lstsq(waves, track.place[:, 1], rcond=None)
    assert np.hypot(sine, cosine) == pytest.approx(0.006, rel=0.2), "m"
    assert np.sqrt(rest[0] / 500) < 0.001, "m: at no other frequency"
    assert np.ptp(track.place[:, 0]) < 0.002, "m: nowhere else"
    assert robot.ask(Kind.PAUSE, action=serial) is Answer.ACCEPTED
    robot.run(300)
    assert robot.action()[0] is ActionState.PAUSED
    track = Track(robot)
    robot.run(100, track)
    assert np.ptp(track.place, axis=0).max() < 5e-4
