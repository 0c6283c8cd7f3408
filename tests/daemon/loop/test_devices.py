"""Grippers live and stop with the robot; a device that is lost stops nothing but itself."""

import dataclasses

import numpy as np
import pytest

from daemon.exchange import Answer, Flag, Kind
from hal.device import SILENT_AFTER
from hal.drives.lifecycle import State
from hal.hardware import LOST_AFTER
from handrail.robot.description import Device

IMU, HAND, BATTERY = 0, 1, 2
SPEED, EFFORT = 0.8, 40.0
POSITION, VELOCITY, FORCE, ENABLE = range(4)


class Hand:
    """A bench whose robot has a gripper, and what the bus would say of that."""

    def __init__(self, bench):
        self.bench, self.answers = bench, True
        self.told = bench.hardware.device_command
        self.position = 0.3

    def run(self, cycles: int = 1) -> np.ndarray:
        for _ in range(cycles):
            devices = self.bench.hardware.devices
            if self.answers:
                devices.values[HAND, POSITION] = self.position
                devices.age[[HAND, BATTERY]] = -1
            devices.age[[HAND, BATTERY]] += 1
            self.bench.run()
        return self.bench.snapshot()

    def enable(self) -> None:
        self.run(3)
        assert self.ask_kind(Kind.ENABLE) is Answer.ACCEPTED
        for _ in range(50):
            if self.run()["flags"] & Flag.ENABLED:
                return
        raise AssertionError("the robot did not come to be enabled")

    def ask_kind(self, kind: Kind) -> Answer:
        self.bench.post(kind)
        return Answer(int(self.run()["answer"]))

    def ask(self, *values: float, row: int = HAND) -> Answer:
        self.bench.post_device(row, values)
        return Answer(int(self.run()["answer"]))

    def switch(self, close: bool, force: bool = False, row: int = BATTERY) -> Answer:
        self.bench.post_device(row, (close, force), Kind.RELAY)
        return Answer(int(self.run()["answer"]))

    @property
    def relay(self) -> tuple[bool, float]:
        return bool(self.told.commanded[BATTERY]), float(self.told.values[BATTERY, 0])

    @property
    def column(self) -> list[float]:
        return self.told.values[HAND, :4].tolist()


@pytest.fixture
def hand(talos, make_bench) -> Hand:
    devices = (
        Device("imu", "imu", 0, "can0", "torso_2_link", ""),
        Device("hand", "gripper", 0, "can0", "", "finger_joint"),
        Device("battery", "power", 0, "can1", "", ""),
    )
    limits = {"finger_joint": (0.0, 1.0, SPEED, EFFORT)}
    return Hand(make_bench(dataclasses.replace(talos, devices=devices, device_limits=limits)))


def test_a_gripper_is_told_nothing_before_the_robot_is_enabled_and_then_holds_where_it_is(hand: Hand) -> None:
    hand.run(20)
    assert not hand.told.commanded.any()
    hand.enable()
    hand.run()
    assert hand.column == [0.3, SPEED, EFFORT, 1.0]
    assert hand.told.commanded.tolist() == [False, True, False], "a sensor is told nothing"


def test_an_order_is_followed_from_the_cycle_that_took_it_and_goes_on_until_the_next(hand: Hand) -> None:
    hand.enable()
    assert hand.ask(0.6, 0.5, 20.0) is Answer.ACCEPTED
    assert hand.column == [0.6, 0.5, 20.0, 1.0]
    hand.position = 0.45
    hand.run(100)
    assert hand.column == [0.6, 0.5, 20.0, 1.0]


def test_an_order_is_refused_while_the_robot_is_not_enabled_or_stopped(hand: Hand) -> None:
    hand.run(3)
    assert hand.ask(0.6, 0.5, 20.0) is Answer.NOT_ENABLED
    hand.enable()
    hand.bench.loop.life.stop("test")
    assert hand.ask(0.6, 0.5, 20.0) is Answer.STOP_LATCHED
    assert hand.column[ENABLE] == 0.0


def test_an_order_for_what_is_no_gripper_or_is_no_number_changes_nothing(hand: Hand) -> None:
    hand.enable()
    before = hand.told.values.copy()
    assert hand.ask(0.6, 0.5, 20.0, row=IMU) is Answer.MALFORMED
    assert hand.ask(0.6, 0.5, 20.0, row=7) is Answer.MALFORMED
    assert hand.ask(float("nan"), 0.5, 20.0) is Answer.MALFORMED
    assert (hand.told.values == before).all()


def test_the_loop_keeps_a_gripper_within_its_limits_whatever_it_is_ordered(hand: Hand) -> None:
    hand.enable()
    assert hand.ask(1.7, 3.0, 900.0) is Answer.ACCEPTED
    assert hand.column == [1.0, SPEED, EFFORT, 1.0]


@pytest.mark.parametrize("how", ["stop", "disable", "all drives lost"])
def test_whatever_takes_the_robot_out_of_operation_takes_its_gripper_with_it(hand: Hand, how: str) -> None:
    hand.enable()
    hand.ask(0.6, 0.5, 20.0)
    if how == "stop":
        hand.bench.loop.life.stop("test")
    elif how == "disable":
        hand.ask_kind(Kind.DISABLE)
    else:
        hand.bench.drives.silent[:] = True
        hand.run(LOST_AFTER + 2)
    hand.run()
    assert hand.column[ENABLE] == 0.0
    assert hand.told.commanded[HAND], "it goes on being told to stay out of operation"


def test_a_gripper_goes_on_holding_while_a_limb_is_isolated(hand: Hand) -> None:
    hand.enable()
    hand.ask(0.6, 0.5, 20.0)
    hand.bench.drives.life[3] = State.FAULT
    hand.run(5)
    assert hand.bench.loop.life.isolated
    assert hand.column == [0.6, 0.5, 20.0, 1.0]


def test_enabling_anew_does_not_go_on_with_an_old_order(hand: Hand) -> None:
    hand.enable()
    hand.ask(0.9, 0.5, 20.0)
    hand.position = 0.5
    hand.ask_kind(Kind.DISABLE)
    hand.enable()
    hand.run()
    assert hand.column == [0.5, SPEED, EFFORT, 1.0]


def test_a_gripper_that_is_lost_stops_nothing_and_holds_where_it_is_when_it_comes_back(hand: Hand) -> None:
    hand.enable()
    hand.ask(0.9, 0.5, 20.0)
    hand.answers = False
    snapshot = hand.run(LOST_AFTER + 2)
    assert snapshot["flags"] == Flag.ENABLED
    assert hand.column[ENABLE] == 0.0
    assert hand.ask(0.2, 0.5, 20.0) is Answer.DEVICE_SILENT
    hand.answers, hand.position = True, 0.7
    hand.run()
    assert hand.column == [0.7, SPEED, EFFORT, 1.0]


def test_what_devices_measure_leaves_with_the_snapshot(hand: Hand) -> None:
    hand.bench.hardware.devices.values[IMU, :3] = 1.0, 2.0, 3.0
    snapshot = hand.run()
    assert snapshot["device_values"][IMU, :3].tolist() == [1.0, 2.0, 3.0]
    assert snapshot["device_values"][HAND, POSITION] == 0.3
    assert snapshot["device_age"][HAND] <= 1 < LOST_AFTER < snapshot["device_age"][IMU]


def test_a_relay_is_told_nothing_until_somebody_switches_it_and_then_keeps_to_that(hand: Hand) -> None:
    hand.enable()
    assert hand.relay == (False, 0.0)
    assert hand.ask_kind(Kind.DISABLE) is Answer.ACCEPTED
    assert hand.switch(close=False) is Answer.ACCEPTED
    hand.run(20)
    assert hand.relay == (True, 0.0)
    assert hand.switch(close=True) is Answer.ACCEPTED
    assert hand.ask_kind(Kind.ENABLE) is Answer.ACCEPTED
    hand.run(20)
    assert hand.relay == (True, 1.0)


def test_a_relay_does_not_open_while_the_robot_is_enabled_or_about_to_be_unless_it_is_forced(hand: Hand) -> None:
    hand.run(3)
    assert hand.ask_kind(Kind.ENABLE) is Answer.ACCEPTED
    assert hand.switch(close=False) is Answer.ENABLED, "enabling"
    hand.enable()
    assert hand.switch(close=False) is Answer.ENABLED
    assert hand.run()["answer_joint"] == BATTERY
    assert hand.relay == (False, 0.0)
    assert hand.switch(close=True) is Answer.ACCEPTED
    assert hand.switch(close=False, force=True) is Answer.ACCEPTED
    assert hand.relay == (True, 0.0)


def test_a_relay_opens_although_a_stop_is_latched(hand: Hand) -> None:
    hand.enable()
    hand.bench.loop.life.stop("test")
    assert hand.switch(close=False) is Answer.ACCEPTED


def test_a_relay_that_does_not_answer_and_one_that_is_none_are_refused(hand: Hand) -> None:
    hand.run(3)
    assert hand.switch(close=True, row=HAND) is Answer.MALFORMED
    hand.answers = False
    hand.run(SILENT_AFTER)
    assert hand.switch(close=True) is Answer.DEVICE_SILENT
    assert hand.relay == (False, 0.0)
