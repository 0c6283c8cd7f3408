"""The actuators' firmware: the paper's figures, modes, limits, sensors."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from benchmarks import sea
from benchmarks.cli import bench
from hal.joint import Mode
from hal.plant.actuator import Actuators
from hal.plant.actuator_kernels import APPROACH_RATE
from hal.plant.actuator_model import (
    CURRENT_RESERVE,
    GEAR_RATIO,
    TORQUE_CONSTANT,
    ActuatorModel,
    actuators_of,
    sized_for,
)
from handrail.robot.description import Actuator


def test_the_firmware_reproduces_the_papers_figures(tmp_path):
    rows = {row.name: row for row in sea.rows(tmp_path)}
    assert [name for name, row in rows.items() if not row.holds] == []
    assert rows["open loop, −3 dB"].value == pytest.approx(13.0, abs=0.5)
    assert rows["closed loop, −3 dB"].value == pytest.approx(72.0, abs=2.0)
    assert (tmp_path / "bode.png").stat().st_size > 20_000
    table = np.genfromtxt(tmp_path / "bode.csv", delimiter=",", names=True)
    resonance = table["open_db"].argmax()
    assert 7 <= table["frequency_hz"][resonance] <= 9
    assert table["closed_db"][resonance] == pytest.approx(0.0, abs=0.1)


def test_a_benchmark_that_draws_nothing_refuses_a_folder_for_pictures(tmp_path):
    cli = typer.Typer()
    cli.command()(bench)
    result = CliRunner().invoke(cli, ["can_codec", "--out", str(tmp_path / "pictures")])
    assert result.exit_code == 2
    assert "can_codec draws no pictures" in " ".join(result.output.split())
    assert not (tmp_path / "pictures").exists()


def _settled(actuators: Actuators, position: np.ndarray) -> np.ndarray:
    still = np.zeros(len(actuators))
    for _ in range(500):
        actuators.step(position, still, 5)
    return actuators.spring_torque.copy()


def _one(mode: Mode, limit: float = 100.0, **more) -> Actuators:
    actuators = Actuators(dataclasses.replace(sized_for(np.array([limit])), **more))
    actuators.mode[:], actuators.powered[:] = mode, True
    actuators.relax(np.zeros(1))
    return actuators


def test_torque_mode_gives_the_torque_that_is_asked_for():
    actuators = _one(Mode.TORQUE)
    actuators.torque[:] = 37.0
    assert _settled(actuators, np.zeros(1))[0] == pytest.approx(37.0, rel=0.001)


def test_impedance_mode_is_torque_plus_stiffness_plus_damping():
    actuators = _one(Mode.IMPEDANCE)
    actuators.position[:], actuators.stiffness[:], actuators.torque[:] = 0.3, 50.0, 4.0
    assert _settled(actuators, np.array([0.1]))[0] == pytest.approx(4.0 + 50.0 * 0.2, rel=0.01)
    actuators.velocity[:], actuators.damping[:] = 0.5, 6.0
    assert _settled(actuators, np.array([0.1]))[0] == pytest.approx(4.0 + 50.0 * 0.2 + 6.0 * 0.5, rel=0.01)


def test_damping_mode_works_against_the_velocity_and_ignores_the_set_point():
    actuators = _one(Mode.DAMPING)
    actuators.damping[:], actuators.torque[:], actuators.stiffness[:] = 5.0, 90.0, 900.0
    position, velocity = np.zeros(1), np.full(1, 0.4)
    for _ in range(500):
        actuators.step(position, velocity, 5)
        position += velocity * 1e-3
    assert actuators.measured_velocity[0] == pytest.approx(0.4, abs=0.02)
    assert actuators.goal[0] == pytest.approx(-2.0, abs=0.1)
    assert actuators.spring_torque[0] == pytest.approx(-2.0, rel=0.1)


def test_without_power_the_spring_goes_slack():
    actuators = _one(Mode.TORQUE)
    actuators.torque[:] = 37.0
    _settled(actuators, np.zeros(1))
    actuators.powered[:] = False
    assert abs(_settled(actuators, np.zeros(1))[0]) < 0.01


def test_position_mode_ends_at_its_goal_although_gravity_pulls(host):
    host.enable()
    world = host.world
    goal = world.position.copy()
    goal[world.description.index("arm_right_4_joint")] += 0.3
    host.command.mode[:], host.command.torque[:] = Mode.POSITION, 0.0
    start = world.position.copy()
    for cycle in range(1500):  # no gravity torque from the host: the drives' integrators find it
        share = min(1.0, cycle / 500)
        host.command.position[:] = start + share * (goal - start)
        world.drives.command(host.command)
        world.advance(2)
    np.testing.assert_allclose(world.position, goal, atol=0.01)


MODES = list(itertools.permutations(Mode, 2))


def test_any_change_of_mode_leaves_the_torque_where_it_was_and_then_goes_over():
    before, after = (np.array([int(pair[i]) for pair in MODES], np.uint8) for i in range(2))
    n, rated, still = len(MODES), 100.0, np.zeros(len(MODES))
    actuators = Actuators(sized_for(np.full(n, rated)))
    actuators.set_position_gains(np.full(n, 300.0), np.full(n, 3.0))
    actuators.position_ki[:] = 0.0
    actuators.powered[:], actuators.mode[:] = True, before
    # What the modes ask for at rest is far apart: nothing, 60, −20 and 30 N·m.
    actuators.torque[:] = np.where((before == Mode.TORQUE) | (after == Mode.TORQUE), 60.0, 0.0)
    actuators.stiffness[:], actuators.position[:] = -200.0, 0.1
    asked = {Mode.DAMPING: 0.0, Mode.TORQUE: 60.0, Mode.IMPEDANCE: -20.0, Mode.POSITION: 30.0}
    _settled(actuators, still)
    actuators.torque[:] = np.where(after == Mode.TORQUE, 60.0, 0.0)
    goal, torque = actuators.goal.copy(), actuators.spring_torque.copy()
    actuators.mode[:] = after
    largest = np.zeros(n)
    for _ in range(1500):
        actuators.step(still, still, 1)
        largest = np.maximum(largest, np.abs(actuators.goal - goal))
        goal, torque = actuators.goal.copy(), np.maximum(np.abs(torque), np.abs(actuators.spring_torque))
    assert largest.max() <= 0.01 * rated
    for row, mode in enumerate(after):
        if mode != Mode.POSITION:  # whose integrator carries what was there
            assert actuators.goal[row] == pytest.approx(asked[Mode(mode)], abs=0.01 * rated)


def test_without_smoothing_a_new_mode_acts_in_its_first_cycle():
    actuators = _one(Mode.TORQUE)
    actuators.torque[:] = 60.0
    _settled(actuators, np.zeros(1))
    actuators.smooth[:], actuators.mode[:] = False, Mode.DAMPING
    actuators.step(np.zeros(1), np.zeros(1), 1)
    assert actuators.goal[0] == 0.0


def test_torque_saturates_at_the_rated_torque_and_current_at_its_limit():
    actuators = _one(Mode.TORQUE, limit=20.0)
    actuators.torque[:] = 1e6
    largest, limited = 0.0, 0
    for _ in range(500):
        actuators.step(np.zeros(1), np.zeros(1), 5)
        largest = max(largest, actuators.current[0])
        limited += actuators.limited[0]
    assert actuators.spring_torque[0] == pytest.approx(20.0, rel=0.01)
    assert largest == pytest.approx(CURRENT_RESERVE * 20.0 / (GEAR_RATIO * TORQUE_CONSTANT), rel=0.01)
    assert limited == 500


class Pendulum:
    """A joint that carries an inertia, stepped every millisecond."""

    def __init__(self, actuators: Actuators, inertia: float, position: float = 0.0):
        self.actuators, self.inertia = actuators, inertia
        self.position, self.velocity = np.array([position]), np.zeros(1)
        actuators.relax(self.position)

    def step(self, external: float = 0.0) -> None:
        torque = self.actuators.step(self.position, self.velocity, 5)
        self.velocity += (torque + external) / self.inertia * 1e-3
        self.position += self.velocity * 1e-3


def _limited(velocity: float, lower: float = -1e3, upper: float = 1e3) -> Actuators:
    actuators = _one(Mode.TORQUE)
    actuators.set_limits(np.array([lower]), np.array([upper]), np.array([velocity]), np.array([20.0]))
    return actuators


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_a_torque_that_would_run_away_is_held_at_the_speed_limit(direction):
    actuators = _limited(velocity=2.0)
    load = Pendulum(actuators, inertia=0.2)
    actuators.torque[:] = 20.0 * direction
    speeds = []
    for _ in range(1000):
        load.step()
        speeds.append(load.velocity[0] * direction)
    assert max(speeds) < 2.0 * 1.5  # it would have tripped at twice the limit
    assert speeds[-1] == pytest.approx(2.0, rel=0.02)
    assert actuators.limited[0]


def test_below_the_speed_limit_no_torque_is_taken_away():
    actuators = _limited(velocity=2.0)
    load = Pendulum(actuators, inertia=1.0)
    actuators.torque[:] = 10.0
    for _ in range(150):
        load.step()
        assert actuators.goal[0] == 10.0
    assert not actuators.limited[0]
    assert load.velocity[0] == pytest.approx(1.5, rel=0.1)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_a_joint_slows_down_towards_its_end_and_does_not_push_beyond_it(direction):
    actuators = _limited(velocity=4.0, lower=-0.5, upper=0.5)
    load = Pendulum(actuators, inertia=0.2)
    actuators.torque[:] = 15.0 * direction
    farthest = 0.0
    for _ in range(2000):
        load.step()
        farthest = max(farthest, load.position[0] * direction)
        room = 0.5 - load.position[0] * direction
        if room > 0.02:  # what it would take to stop was kept in mind all the way
            assert load.velocity[0] * direction <= APPROACH_RATE * room + 1.0
    assert 0.45 < farthest < 0.52
    assert actuators.limited[0]
    assert actuators.goal[0] * direction < 1.0


def test_a_set_point_beyond_the_joints_end_is_taken_as_the_end():
    actuators = _limited(velocity=4.0, lower=-0.5, upper=0.5)
    load = Pendulum(actuators, inertia=0.2)
    actuators.mode[:] = Mode.IMPEDANCE
    actuators.position[:], actuators.stiffness[:], actuators.damping[:] = 0.9, 100.0, 9.0
    for _ in range(2000):
        load.step()
    assert load.position[0] == pytest.approx(0.5, abs=0.005)
    assert actuators.limited[0]


def test_a_derated_drive_gives_that_much_less():
    actuators = _one(Mode.TORQUE)
    actuators.torque[:], actuators.derating[:] = 90.0, 0.4
    assert _settled(actuators, np.zeros(1))[0] == pytest.approx(40.0, rel=0.01)
    assert actuators.limited[0]


def _readings(actuators: Actuators, position: float, count: int) -> np.ndarray:
    at, still, found = np.array([position]), np.zeros(1), []
    for _ in range(count):
        actuators.step(at, still, 1)
        found.append(actuators.measured_position[0])
    return np.array(found)


def test_the_encoder_reads_in_steps():
    actuators = _one(Mode.TORQUE, encoder_bits=np.array([10]))
    quantum = 2 * np.pi / 2**10
    for position in (0.1, 0.1 + 0.4 * quantum, -1.0):
        reading = _readings(actuators, position, 1)[0]
        assert reading / quantum == pytest.approx(round(reading / quantum), abs=1e-9)
        assert abs(reading - position) <= quantum / 2


def test_the_encoders_noise_is_as_given_and_the_same_for_the_same_seed():
    model = dataclasses.replace(sized_for(np.full(1, 50.0)), encoder_noise=np.array([2e-3]))

    def read(seed: int) -> np.ndarray:
        return _readings(Actuators(model, seed=seed), 0.3, 4000)

    first = read(1)
    assert first.std() == pytest.approx(2e-3, rel=0.05)
    assert first.mean() == pytest.approx(0.3, abs=2e-4)
    assert abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 0.06
    np.testing.assert_array_equal(first, read(1))
    assert (first != read(2)).any()


def test_an_uncalibrated_encoder_reads_wrong_until_its_offset_is_known():
    actuators = _one(Mode.IMPEDANCE, encoder_offset=np.array([0.05]))
    actuators.stiffness[:] = 100.0
    torque = _settled(actuators, np.zeros(1))[0]
    assert actuators.measured_position[0] == pytest.approx(0.05, abs=1e-4)
    assert torque == pytest.approx(-5.0, rel=0.01)
    actuators.move_encoder(0, -0.05)
    assert _settled(actuators, np.zeros(1))[0] == pytest.approx(0.0, abs=0.01)


def test_within_its_backlash_the_gear_carries_nothing():
    still, slack = np.zeros(1), 0.02
    actuators = _one(Mode.TORQUE, backlash=np.array([slack]))
    actuators.powered[:] = False
    actuators.relax(np.zeros(1))
    for angle, carries in ((0.45 * slack, False), (-0.45 * slack, False), (slack, True)):
        actuators.relax(np.zeros(1))
        actuators.step(np.array([angle]), still, 1)
        assert (actuators.spring_torque[0] != 0.0) == carries
    # Under torque control it is taken up, and then the torque is what was asked for.
    actuators.powered[:], actuators.torque[:] = True, 20.0
    assert _settled(actuators, still)[0] == pytest.approx(20.0, rel=0.01)


def test_loops_that_close_on_the_motor_hold_what_is_measured_there_and_the_encoder_tells_the_joint():
    actuators = _one(Mode.IMPEDANCE, servo_on_motor=np.ones(1), motor_offset=np.array([0.05]))
    actuators.stiffness[:] = 100.0
    assert _settled(actuators, np.zeros(1))[0] == pytest.approx(-5.0, rel=0.01)
    assert actuators.measured_position[0] == pytest.approx(0.0, abs=1e-4)


def test_before_the_gear_the_backlash_is_in_what_is_measured():
    actuators = _one(Mode.IMPEDANCE, servo_on_motor=np.ones(1), backlash=np.array([0.04]))
    actuators.stiffness[:] = 50.0
    for set_point, torque in ((0.1, 4.0), (-0.1, -4.0)):
        actuators.position[:] = set_point
        assert _settled(actuators, np.zeros(1))[0] == pytest.approx(torque, rel=0.01)


def test_damping_at_the_motor_is_of_the_joints_own_velocity():
    actuators = _one(Mode.IMPEDANCE, servo_on_motor=np.ones(1))
    actuators.damping[:] = 5.0
    for step in range(200):
        actuators.step(np.array([step * 0.0005]), np.array([0.5]), 5)
    assert actuators.spring_torque[0] == pytest.approx(-2.5, rel=0.02)


def test_a_robots_actuators_are_what_its_description_says(robot):
    special = Actuator(
        spring_stiffness=1000.0, gear_ratio=50.0, torque_constant=0.1, current_limit=12.0, encoder_bits=16
    )
    row = robot.index("arm_left_4_joint")
    actuators = tuple(special if j == row else Actuator() for j in range(len(robot.joints)))
    model, transmissions = actuators_of(dataclasses.replace(robot, actuators=actuators))
    plain = sized_for(robot.torque_limit)
    assert transmissions == ()
    assert (model.stiffness[row], model.torque_per_current[row], model.current_limit[row]) == (1000.0, 5.0, 12.0)
    assert (model.encoder_bits[row], model.encoder_bits[0]) == (16, 19)
    natural = np.sqrt(model.stiffness / model.rotor_inertia)
    np.testing.assert_allclose(natural, natural[0])  # what is left out follows
    others = np.arange(len(robot.joints)) != row
    for field in dataclasses.fields(ActuatorModel):
        np.testing.assert_allclose(getattr(model, field.name)[others], getattr(plain, field.name)[others])
