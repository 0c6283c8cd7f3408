"""Sensors and power of the robot measure what is the case in the world."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hal.device import MEASURED
from hal.drives.lifecycle import CONTROLWORD, Command, DriveError, State
from hal.plant.bullet import pybullet as p
from hal.plant.power import WINDING_RESISTANCE
from hal.plant.sensor_noise import DEFAULTS, Noise, without_noise
from hal.plant.world import World
from handrail.config import ConfigError
from handrail.robot import library as robots

WEIGHT = 9.81


@pytest.fixture(scope="module")
def world(robot):
    world = World(without_noise(robot))
    yield world
    world.close()


@pytest.fixture(scope="module")
def row(robot):
    return {device.name: number for number, device in enumerate(robot.devices)}


def _measured(world, row, name):
    return world.devices.measure().values[row[name]]


def test_a_standing_imu_feels_gravity_upwards_in_its_own_axes(robot, kinematics, world, row):
    position = robot.home_position()
    position[robot.index(["torso_1_joint", "torso_2_joint"])] = 0.4, 0.3
    world.place(position)
    world.advance(3)
    _measured(world, row, "torso_imu")
    world.advance(2)
    values = _measured(world, row, "torso_imu")
    frame = kinematics.frame(world.position, "imu_link").rotation
    np.testing.assert_allclose(pin.Quaternion(*values[[3, 0, 1, 2]]).matrix(), frame, atol=1e-5)
    np.testing.assert_allclose(values[4:7], 0.0, atol=1e-4)
    np.testing.assert_allclose(values[7:10], frame.T @ [0, 0, WEIGHT], atol=0.01)


def test_a_moving_imu_feels_rotation_and_acceleration(robot, kinematics, world, row):
    world.place(robot.home_position())
    joint = world.robot.joints["torso_1_joint"]
    velocity = 0.0
    for cycle in range(60):  # the torso turns ever faster: 5 rad/s²
        velocity = 0.005 * (cycle + 1)
        p.setJointMotorControl2(
            world.robot.number,
            joint,
            p.VELOCITY_CONTROL,
            targetVelocity=velocity,
            force=1e4,
            physicsClientId=world.client,
        )
        world.step()
        values = _measured(world, row, "torso_imu").copy()
    pose = kinematics.frame(world.position, "imu_link")
    np.testing.assert_allclose(values[4:7], pose.rotation.T @ [0, 0, velocity], atol=0.01)
    across = np.cross([0, 0, 1.0], pose.translation)
    expected = 5.0 * across + velocity**2 * np.cross([0, 0, 1.0], across) + [0, 0, WEIGHT]
    np.testing.assert_allclose(pose.rotation @ values[7:10], expected, atol=0.05)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_wrist_sensor_carries_the_weight_beyond_it(robot, kinematics, world, row, side):
    position = robot.home_position()
    position[robot.index(f"arm_{side}_5_joint")] = 0.7
    world.place(position)
    world.advance(300)  # brakes give a little at first
    wrench = _measured(world, row, f"wrist_{side}_ft")
    sensor = kinematics.frame(world.position, f"wrist_{side}_ft_link")
    # The stub, 8 cm from its root, and the sensor's own two parts (talos_full_v2.urdf).
    parts = {f"tool_{side}": (0.3, [0, 0, -0.08]), f"wrist_{side}_ft_link": (0.095, [0, 0, -0.00785 + 0.00785]),
             f"wrist_{side}_ft_tool_link": (0.001, [0, 0, 0])}  # fmt: skip
    force = sum(mass for mass, _ in parts.values()) * sensor.rotation.T @ [0, 0, -WEIGHT]
    np.testing.assert_allclose(wrench[:3], force, atol=0.02)
    tool = kinematics.frame(world.position, f"tool_{side}")
    lever = sensor.rotation.T @ (tool.act(np.array([0, 0, -0.08])) - sensor.translation)
    moment = np.cross(lever, 0.3 * sensor.rotation.T @ [0, 0, -WEIGHT])
    np.testing.assert_allclose(wrench[3:6], moment, atol=0.02)  # the sensor's own mass has no lever to speak of


def test_a_wrist_sensor_feels_what_pushes_the_tool(robot, kinematics, world, row):
    world.place(robot.home_position())
    world.advance(300)
    free = _measured(world, row, "wrist_right_ft").copy()
    sensor = kinematics.frame(world.position, "wrist_right_ft_link")
    tip = kinematics.frame(world.position, "tool_right_tip").translation
    push = np.array([-12.0, 5.0, 3.0])
    for _ in range(150):
        p.applyExternalForce(
            world.robot.number, world.robot.links["wrist_right_ft_link"], push.tolist(), tip.tolist(), p.WORLD_FRAME,
            physicsClientId=world.client,
        )  # fmt: skip
        world.step()
    felt = _measured(world, row, "wrist_right_ft") - free
    np.testing.assert_allclose(sensor.rotation @ felt[:3], push, atol=0.3)
    np.testing.assert_allclose(sensor.rotation @ felt[3:6], np.cross(tip - sensor.translation, push), atol=0.1)


def test_an_open_relay_takes_the_drives_power_until_it_is_closed(host, row):
    host.enable()
    world, drives = host.world, host.world.drives
    world.devices.command(row["battery"], np.zeros(8))
    world.step()
    assert (drives.state == State.FAULT).all()
    assert (drives.error == DriveError.UNDERVOLTAGE).all()
    assert drives.brakes.all()
    assert _measured(world, row, "battery")[4] == 0
    reset = np.full(len(drives), CONTROLWORD[Command.FAULT_RESET])
    drives.control(reset)
    world.step()
    assert (drives.state == State.FAULT).all()  # still no power
    world.devices.command(row["battery"], np.ones(8))
    drives.control(np.full(len(drives), CONTROLWORD[Command.DISABLE_VOLTAGE]))
    host.command.position[:] = world.position
    drives.control(reset)
    host.enable()
    assert (drives.state == State.OPERATION_ENABLED).all()
    assert _measured(world, row, "battery")[4] == 1


def test_the_battery_pays_for_holding_a_load(host, row):
    before = _measured(host.world, row, "battery").copy()
    host.enable()
    host.cycle(200)
    after = _measured(host.world, row, "battery")
    heat = WINDING_RESISTANCE * np.sum(host.world.drives.actuators.current**2)
    assert after[1] - before[1] == pytest.approx(heat / after[0], rel=0.05)
    assert heat > 2.0  # W
    assert after[0] < before[0]  # V
    assert 0.999 < after[2] < before[2]


def test_a_sensors_noise_is_its_density_at_the_robots_rate_and_its_offset_stays(robot, row):
    noise = Noise(robot.devices, robot.period_ns * 1e-9)
    samples = np.zeros((3000, len(robot.devices), MEASURED))
    for at in range(len(samples)):
        samples[at] = noise.draw()
    imu, wrist = samples[:, row["torso_imu"]], samples[:, row["wrist_right_ft"]]
    half_rate = np.sqrt(0.5e9 / robot.period_ns)
    for got, what, family in (
        (imu[:, 4:7], "angular_velocity", "imu"),
        (imu[:, 7:10], "linear_acceleration", "imu"),
        (wrist[:, 0:3], "force", "force_torque"),
        (wrist[:, 3:6], "torque", "force_torque"),
    ):
        np.testing.assert_allclose(got.std(axis=0), getattr(DEFAULTS[family], what) * half_rate, rtol=0.08)
        white = np.corrcoef(got[:-1, 0], got[1:, 0])[0, 1]
        assert abs(white) < 0.07, f"{what}: a sample tells nothing of the next"
    first, last = wrist[:1500, 0:3].mean(axis=0), wrist[1500:, 0:3].mean(axis=0)
    assert np.abs(first).max() > 0.02
    np.testing.assert_allclose(first, last, atol=0.006)
    exact = np.delete(samples, [*range(4, 10)], axis=2)[:, [row["torso_imu"], row["battery"]]]
    assert not exact.any(), "orientation and power are as they are"
    again = Noise(robot.devices, robot.period_ns * 1e-9).draw()
    assert (again == samples[0]).all(), "the same in every run"


def test_a_robot_says_what_noise_its_own_sensors_have(tmp_path):
    device = "network: {devices: [{name: imu, family: imu, channel: can0, link: lower_arm, noise: {%s}}]}"
    text = f"extends: sea_bench\nname: noisy\nmodel: {{file: {robots.find('sea_bench').parent}/bench.urdf}}\n"
    (tmp_path / "robot.yaml").write_text(text + device % "angular_velocity: 0.01, linear_acceleration: 0")
    noisy = robots.load(tmp_path)
    samples = np.zeros((2000, 1, MEASURED))
    noise = Noise(noisy.devices, noisy.period_ns * 1e-9)
    for at in range(len(samples)):
        samples[at] = noise.draw()
    np.testing.assert_allclose(samples[:, 0, 4:7].std(axis=0), 0.01 * np.sqrt(250), rtol=0.08)
    np.testing.assert_allclose(samples[:, 0, 7:10].std(axis=0), 0.0, atol=1e-12)
    (tmp_path / "robot.yaml").write_text(text + device % "force: 0.1")
    with pytest.raises(
        ConfigError, match=r"robot.yaml:4: network.devices\[0\].noise.force: imu has no such noise; expected"
    ):
        robots.load(tmp_path)
