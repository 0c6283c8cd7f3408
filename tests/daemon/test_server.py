"""The server against a loop that is none: it takes from a real mailbox and writes a real ring, and does what a test tells it."""

from __future__ import annotations

import dataclasses
import math
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import zmq

from daemon import exchange
from daemon.exchange import ActionState, Answer, Command, Flag, Kind, Outcome
from daemon.exchange.doorbell import Bell, Doorbell, loop_doorbell, server_doorbell
from daemon.exchange.mailbox import MailboxReader
from daemon.exchange.ring import StateRingWriter
from daemon.server import Server
from daemon.serving import loop_door
from daemon.state import bus_watch
from hal.can.faults import Fault
from hal.can.hub import Hub
from hal.can.port import HubPort
from hal.drives.lifecycle import State, statusword
from handrail import messages as m
from handrail.keepalive import answer
from handrail.robot import library as robots
from handrail.robot.description import Device, RobotDescription
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber

PATIENCE_S = 30.0


class FakeLoop:
    """Holds still at `ready`; accepts everything unless told otherwise by `answers`."""

    def __init__(self, description: RobotDescription, runtime: Runtime):
        self._frames = exchange.frame_names(description)
        self._devices = [device.name for device in description.devices]
        self.mailbox = MailboxReader(runtime.mailbox, exchange.COMMAND)
        self.ring = StateRingWriter(runtime.state_ring, exchange.snapshot_dtype(description))
        self.snapshot = self.ring.record
        self.snapshot["command"][0] = self.snapshot["position"] = description.home_position("ready")
        self.snapshot["status"] = statusword(State.OPERATION_ENABLED)
        self.snapshot["flags"] = Flag.ENABLED
        self.snapshot["claims"] = 1
        self.snapshot["actions"]["joint"] = -1
        self.answers: dict[Kind, tuple[Answer, int, float]] = {}
        self.commands: list[Command] = []
        self._doorbell = Doorbell(loop_doorbell(runtime.folder))
        self._server = Bell(server_doorbell(runtime.folder))
        self._lock = threading.Lock()
        self._ending = self.deaf = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ending:
            self._doorbell.wait(PATIENCE_S)
            while not self.deaf and (mail := self.mailbox.take()) is not None:
                command = exchange.decode(*mail, self._frames, self._devices)
                self.mailbox.done()
                self.commands.append(command)
                begun = command.kind is Kind.PREPARE and command.text  # it will be there when it is asked for
                usual = Answer.NOT_READY if begun else Answer.ACCEPTED
                answer = self.answers.get(command.kind, (usual, -1, 0.0))
                with self._lock:
                    self.snapshot["answered"] = command.serial
                    self.snapshot["answer"], self.snapshot["answer_joint"], self.snapshot["answer_value"] = answer
                    if command.kind in (Kind.START, Kind.BEHAVIOUR) and answer[0] is Answer.ACCEPTED:
                        slot = self.snapshot["actions"][0]
                        slot["serial"], slot["owner"], slot["state"] = (
                            command.serial,
                            command.owner,
                            ActionState.RUNNING,
                        )
                        slot["before"], slot["steps_taken"] = -1, len(command.steps) > 0
                    self._cycle()

    def _cycle(self) -> None:
        self.snapshot["cycle"] += 1
        self.snapshot["time_ns"] += 2_000_000
        self.ring.publish()
        self._server.ring()

    def cycle(self, count: int = 1, **fields: Any) -> None:
        """Publish snapshots with some fields changed."""
        with self._lock:
            for name, value in fields.items():
                self.snapshot[name] = value
            for _ in range(count):
                self._cycle()

    def end_action(self, outcome: Outcome, **fields: Any) -> None:
        with self._lock:
            slot = self.snapshot["actions"][0]
            slot["state"], slot["outcome"] = ActionState.ENDED, outcome
            slot["cycle"], slot["time_ns"] = self.snapshot["cycle"] + 1, self.snapshot["time_ns"] + 2_000_000
            slot["position"], slot["command"] = self.snapshot["position"], self.snapshot["command"][0]
            for name, value in fields.items():
                slot[name] = value
            self._cycle()

    def wait_for(self, kind: Kind) -> Command:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if found := [command for command in self.commands if command.kind is kind]:
                return found[0]
            time.sleep(0.005)
        raise AssertionError(f"no {kind.name} came; got {self.commands}")

    def live(self, seconds: float) -> None:
        """Its time goes on with the wall's."""
        for _ in range(round(seconds / 0.05)):
            time.sleep(0.05)
            self.cycle(25)

    def live_until(self, kind: Kind) -> Command:
        deadline = time.monotonic() + PATIENCE_S
        while not any(command.kind is kind for command in self.commands) and time.monotonic() < deadline:
            self.live(0.05)
        return self.wait_for(kind)

    def die(self) -> None:
        self._ending = True
        self.ring_own_bell()
        self._thread.join()
        self._doorbell.close()

    def ring_own_bell(self) -> None:
        Bell(self._doorbell._path).ring()


class Rig:
    """Server, fake loop and a caller, in one process."""

    def __init__(self, description: RobotDescription, clock: Literal["wall", "lockstep"] = "lockstep"):
        self.description, self.clock = description, clock
        self.runtime = Runtime.at(tempfile.mkdtemp(prefix="hr"))
        self.context = zmq.Context()
        self.loop: FakeLoop | None = None
        self.start_server()
        self.caller = Caller(self.runtime.endpoint("daemon.call"), context=self.context, timeout_s=PATIENCE_S)
        self.events = Subscriber(self.runtime.endpoint("daemon.events"), m.DaemonEvent, context=self.context)
        self.until(m.DaemonStatus, lambda _: True)  # the subscription stands

    def start_server(self) -> None:
        self._server_context = zmq.Context()
        columns = {"odd": ("oddness",)}
        self.server = Server(self.description, self.runtime, self.clock, columns=columns, context=self._server_context)
        self.server.take_over()
        self._ending = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ending:
            self.server.step(0.02)
        self.server.close()

    def stop_server(self) -> None:
        self._ending = True
        self._thread.join()
        self._server_context.term()

    def start_loop(self) -> FakeLoop:
        self.loop = FakeLoop(self.description, self.runtime)
        self.loop.cycle()
        self.until(m.DaemonStatus, lambda status: status.enabled)
        return self.loop

    def until(self, kind: type, what: Callable[[Any], bool], patience_s: float = PATIENCE_S) -> Any:
        """The first event of a kind that fulfils `what`."""
        deadline = time.monotonic() + patience_s
        seen = []
        while (left := deadline - time.monotonic()) > 0:
            message = self.events.receive(left)
            if isinstance(message, kind):
                if what(message):
                    return message
                seen.append(message)
        raise AssertionError(f"no such {kind.__name__}; got {seen[-3:]}")

    def call(self, message: Any) -> Any:
        return self.caller.call(message)

    def refusal(self, message: Any) -> m.Refused:
        with pytest.raises(RefusedError) as caught:
            self.call(message)
        return caught.value.refusal

    def trajectory(self, **changes: Any) -> m.JointTrajectory:
        joints = [*self.description.arms["right"].joints]
        start = self.description.home_position("ready")[self.description.index(joints)]
        given: dict[str, Any] = {
            "joints": joints,
            "times": [0.0, 1.0, 2.0],
            "positions": [start.tolist(), (start + 0.05).tolist(), (start + 0.1).tolist()],
            "velocities": [[0.0] * len(joints), [0.05] * len(joints), [0.0] * len(joints)],
        }
        return m.JointTrajectory(**{**given, **changes})

    def action(self, id: str = "a1", motion: Any = None, **fields: Any) -> m.StartAction:
        return m.StartAction(**{"id": id, "owner": "test", "motion": motion or self.trajectory(), **fields})

    def close(self) -> None:
        self.stop_server()
        if self.loop is not None and not self.loop._ending:
            self.loop.die()
        self.caller.close()
        self.events.close()
        self.context.term()
        shutil.rmtree(self.runtime.folder)


@pytest.fixture(scope="module")
def talos() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture
def rig(talos: RobotDescription) -> Iterator[Rig]:
    made = Rig(talos)
    yield made
    made.close()


def test_it_tells_which_robot_this_is_even_without_a_loop(rig: Rig, talos: RobotDescription) -> None:
    info = rig.call(m.GetRobot())
    assert info.name == "talos_upper"
    assert info.joints == list(talos.joints)
    assert info.tools == {"right": talos.arms["right"].tool, "left": talos.arms["left"].tool}
    assert info.home["ready"].keys() == set(talos.joints)


def test_without_a_loop_nothing_is_enabled_no_drive_is_known_and_commands_are_refused(rig: Rig) -> None:
    status = rig.call(m.GetStatus())
    assert not status.enabled
    assert {drive.state for drive in status.drives} == {"unknown"}
    assert "loop" in rig.refusal(m.Enable()).message
    assert "loop" in rig.refusal(rig.action()).message
    assert "loop" in rig.refusal(m.GetTiming()).message
    assert "loop" in rig.refusal(m.GetBase()).message
    assert {part.life for part in rig.call(m.GetHardware()).components} == {"unknown"}


def test_robot_states_go_out_at_100_hz_of_the_robots_time(rig: Rig) -> None:
    loop = rig.start_loop()
    list(rig.events.drain())
    loop.cycle(100)  # 200 ms of the robot's time
    states = [rig.until(m.RobotState, lambda _: True) for _ in range(20)]
    assert np.diff([state.time_ns for state in states]).tolist() == [10_000_000] * 19
    assert states[0].position == rig.description.home_position("ready").tolist()


def test_status_shows_drives_controllers_and_loop_as_in_the_snapshot(rig: Rig) -> None:
    loop = rig.start_loop()
    status = np.full(len(rig.description.joints), statusword(State.OPERATION_ENABLED))
    status[3] = statusword(State.FAULT)
    age = np.zeros(len(rig.description.joints))
    age[5] = 50
    loop.cycle(5, status=status, flags=0, age=age, misses=7, work_ns=80_000, late_ns=20_000)
    told = rig.until(m.DaemonStatus, lambda status: status.loop.cycles == loop.snapshot["cycle"])
    assert not told.enabled
    assert told.drives[3].state == "fault"
    assert told.drives[3].joint == rig.description.joints[3]
    assert told.drives[5].state == "unknown"
    assert told.drives[4].state == "operation_enabled"
    assert told.controllers == {"hold": list(rig.description.joints)}
    assert told.loop.misses == 7
    assert told.loop.work_p50_us == pytest.approx(80.0)
    assert told.clock == "lockstep"


def test_a_latched_stop_is_told_at_once_with_its_reason(rig: Rig) -> None:
    loop = rig.start_loop()
    loop.cycle(flags=Flag.STOPPED, stop_reason=b"smoke")
    told = rig.until(m.DaemonStatus, lambda status: status.stopped)
    assert told.stop_reason == "smoke"
    assert not told.enabled


def test_bus_load_is_the_share_of_the_last_second(rig: Rig) -> None:
    loop = rig.start_loop()
    first = loop.snapshot["cycle"]  # of what was before it came the server sees the newest only
    rig.until(m.DaemonStatus, lambda status: status.loop.cycles == first)
    for number in range(1, 601):  # 1.2 s of the robot's time, 0.5 ms of 2 busy on the first channel
        loop.cycle(busy_ns=[number * 500_000, 0], frames_sent=[number, 0])
    last = loop.snapshot["cycle"]
    told = rig.until(m.DaemonStatus, lambda status: status.loop.cycles == last)
    assert told.buses[0].load == pytest.approx(0.25, abs=0.01)
    assert told.buses[1].load == 0.0
    assert told.buses[0].frames_sent == 600


def test_enable_is_answered_by_the_loops_own_word(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(m.Enable())
    loop.wait_for(Kind.ENABLE)
    loop.answers[Kind.ENABLE] = (Answer.STOP_LATCHED, -1, 0.0)
    refused = rig.refusal(m.Enable())
    assert refused.field == "stopped"
    loop.answers[Kind.ENABLE] = (Answer.DRIVE_FAULT, 2, 0.0)
    assert rig.description.joints[2] in rig.refusal(m.Enable()).message


def test_an_action_reaches_the_loop_whole_and_its_life_is_told_by_its_id(rig: Rig) -> None:
    loop = rig.start_loop()
    ends = [m.DivergenceEnd(error=0.3), m.ContactEnd(frame=rig.description.arms["right"].tool, threshold=20.0)]
    motion = rig.trajectory(path_force=m.PathForce(frame=rig.description.arms["right"].tip, limit=40.0))
    rig.call(rig.action("stroke 1", motion, ends=ends, hold_after_s=0.5))
    command = loop.wait_for(Kind.START)
    assert isinstance(command.motion, exchange.TrajectoryMotion)
    assert command.motion.joints.tolist() == rig.description.index(motion.joints).tolist()
    assert command.motion.positions.tolist() == motion.positions
    assert command.motion.path_force == motion.path_force
    assert command.ends == tuple(ends)
    assert command.value == 0.5
    assert rig.until(m.ActionEvent, lambda _: True).state == "running"
    assert rig.until(m.DaemonStatus, lambda status: status.action != "").action == "stroke 1"
    loop.end_action(Outcome.CONDITION, condition=1, value=21.5, path_force=12.0)
    ended = rig.until(m.ActionEvent, lambda event: event.state == "ended")
    assert (ended.id, ended.outcome, ended.path_force) == ("stroke 1", "contact", 12.0)
    assert ended.position == rig.description.home_position("ready").tolist()


def behaviour(rig: Rig, *changed: dict[str, Any], **fields: Any) -> m.StartBehaviour:
    """Two steps of the right arm, each with some fields changed."""
    ends = [m.DivergenceEnd(error=0.3)]
    given: list[dict[str, Any]] = [{"name": name, "motion": rig.trajectory(), "ends": ends} for name in ("go", "stay")]
    steps = [m.Step(**{**step, **change}) for step, change in zip(given, [*changed, {}, {}], strict=False)]
    return m.StartBehaviour(**{"id": "b1", "owner": "test", "steps": steps, **fields})


def test_a_behaviour_reaches_the_loop_whole_and_its_steps_are_told_by_their_names(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(behaviour(rig, {"then": {"divergence": "stay"}}))
    command = loop.wait_for(Kind.BEHAVIOUR)
    assert [step.then for step in command.steps] == [(1, 1), (-1, -1)]
    assert [step.ends for step in command.steps] == [(m.DivergenceEnd(error=0.3),)] * 2
    begun = rig.until(m.ActionEvent, lambda _: True)
    assert (begun.id, begun.state, begun.step, begun.detail) == ("b1", "running", "go", "")
    slot = loop.snapshot["actions"][0]
    slot["step"], slot["before"], slot["steps_taken"] = 1, 0, 2
    slot["outcome"], slot["condition"], slot["value"], slot["joint"] = Outcome.CONDITION, 0, 0.31, -1
    loop.cycle()
    told = rig.until(m.ActionEvent, lambda event: event.step == "stay")
    assert (told.state, told.detail) == ("running", "go: ends[0]: divergence reached 0.31")
    loop.end_action(Outcome.DONE, joint=-1)
    ended = rig.until(m.ActionEvent, lambda event: event.state == "ended")
    assert (ended.id, ended.step, ended.outcome) == ("b1", "stay", "done")


def test_whatever_is_wrong_with_a_behaviour_is_refused_with_its_step(rig: Rig) -> None:
    loop = rig.start_loop()
    arms = rig.description.arms
    others = m.CompliantMotion(frame=arms["left"].tip, joints=list(arms["left"].joints), duration=1.0)
    for field, wrong in {
        "steps[1].name": behaviour(rig, {}, {"name": "go"}),
        "steps[0].name": behaviour(rig, {"name": "end"}),
        "steps[0].then": behaviour(rig, {"then": {"contact": "stay"}}),
        "steps[0].then.done": behaviour(rig, {"then": {"done": "fly"}}),
        "steps[1].motion.joints": behaviour(rig, {}, {"motion": others}),
        "steps[1].motion.times": behaviour(rig, {}, {"motion": rig.trajectory(times=[0.0])}),
        "steps[1].ends[0].after": behaviour(rig, {}, {"ends": [m.TimeEnd(after=math.inf)]}),
        "hold_after_s": behaviour(rig, hold_after_s=math.inf),
    }.items():
        refused = rig.refusal(wrong)
        assert refused.field == field, refused
        assert refused.value != ""
        assert refused.expected != ""
    assert loop.commands == []


def test_cancel_pause_and_resume_name_the_action_by_its_id(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action("a1"))
    started = loop.wait_for(Kind.START)
    rig.call(m.PauseAction(id="a1"))
    rig.call(m.ResumeAction(id="a1"))
    rig.call(m.CancelAction(id="a1"))
    assert [loop.wait_for(kind).action for kind in (Kind.PAUSE, Kind.RESUME, Kind.CANCEL)] == [started.serial] * 3
    assert rig.refusal(m.CancelAction(id="a2")).field == "id"
    loop.end_action(Outcome.CANCELLED)
    rig.until(m.ActionEvent, lambda event: event.state == "ended")
    assert rig.refusal(m.CancelAction(id="a1")).field == "id"


def test_a_speed_is_for_all_motions_or_for_one_and_a_new_loop_is_told_it_again(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(m.SetSpeed(share=0.4))
    assert (told := loop.wait_for(Kind.SET_SPEED)).action == 0 and told.value == 0.4
    rig.call(rig.action("a1"))
    rig.call(m.SetSpeed(id="a1", share=0.5))
    assert [command.value for command in loop.commands if command.action == loop.wait_for(Kind.START).serial] == [0.5]
    assert rig.refusal(m.SetSpeed(id="a2", share=0.5)).field == "id"
    loop.cycle(speed=0.4)
    rig.until(m.DaemonStatus, lambda status: status.speed == 0.4)
    loop.die()
    rig.loop = FakeLoop(rig.description, rig.runtime)
    rig.loop.cycle()
    assert rig.loop.wait_for(Kind.SET_SPEED).value == 0.4


def test_an_id_that_runs_already_is_refused(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action("a1"))
    assert rig.refusal(rig.action("a1")).field == "id"
    assert len([command for command in loop.commands if command.kind is Kind.START]) == 1


def test_an_action_that_the_loop_refuses_is_forgotten(rig: Rig) -> None:
    loop = rig.start_loop()
    loop.answers[Kind.START] = (Answer.CLAIMED, 1, 0.0)
    assert rig.description.joints[1] in rig.refusal(rig.action("a1")).message
    del loop.answers[Kind.START]
    rig.call(rig.action("a1"))


def bad_actions(rig: Rig) -> dict[str, m.StartAction]:
    """Field that must be named → an action that is wrong in it."""
    good = rig.trajectory()
    width = len(good.joints)

    def with_number(rows: list[list[float]], knot: int, column: int, value: float) -> list[list[float]]:
        rows = [row.copy() for row in rows]
        rows[knot][column] = value
        return rows

    def motion(**changes: Any) -> m.StartAction:
        return rig.action(motion=rig.trajectory(**changes))

    fast = float(rig.description.velocity_limit[rig.description.index(good.joints[2])])
    frame = rig.description.arms["right"].tip
    cartesian: dict[str, Any] = {"frame": frame, "joints": good.joints, "goal_in_world": m.Pose(), "duration": 1.0}

    def compliant(**changes: Any) -> m.StartAction:
        return rig.action(
            motion=m.CompliantMotion(**{"frame": frame, "joints": good.joints, "duration": 1.0, **changes})
        )

    return {
        "motion.joints[0]": motion(joints=["arm_rigth_1_joint", *good.joints[1:]]),
        "motion.joints[1]": motion(joints=[good.joints[0], good.joints[0], *good.joints[2:]]),
        "motion.joints": motion(joints=[]),
        "motion.times": motion(times=[0.0], positions=good.positions[:1], velocities=good.velocities[:1]),
        "motion.times[0]": motion(times=[0.1, 1.0, 2.0]),
        "motion.times[2]": motion(times=[0.0, 1.0, 1.0]),
        "motion.times[1]": motion(times=[0.0, math.nan, 2.0]),
        "motion.positions": motion(positions=good.positions[:2]),
        "motion.positions[1]": motion(positions=[good.positions[0], good.positions[1][:-1], good.positions[2]]),
        "motion.positions[2][4]": motion(positions=with_number(good.positions, 2, 4, math.inf)),
        "motion.positions[1][3]": motion(positions=with_number(good.positions, 1, 3, 9.0)),
        "motion.positions[0][2]": motion(positions=with_number(good.positions, 0, 2, good.positions[0][2] + 0.021)),
        "motion.velocities[1][2]": motion(velocities=with_number(good.velocities, 1, 2, fast * 1.1)),
        "motion.velocities": motion(velocities=[*good.velocities, [0.0] * width]),
        "motion.velocities[0][0]": motion(times=[0.0, 0.01, 2.0]),
        "motion.path_force.frame": motion(path_force=m.PathForce(frame="gripper")),
        "motion.path_force.gain": motion(path_force=m.PathForce(frame=frame, gain=math.inf)),
        "motion.frame": rig.action(motion=m.CartesianImpedance(**{**cartesian, "frame": "nowhere"})),
        "motion.goal_in_world.orientation": rig.action(
            motion=m.CartesianImpedance(**{**cartesian, "goal_in_world": m.Pose(orientation=(0.0, 0.0, 0.0, 2.0))})
        ),
        "motion.stiffness[1]": rig.action(motion=m.CartesianImpedance(**{**cartesian, "stiffness": (100.0, -1.0)})),
        "motion.shift": compliant(goal_in_world=m.Pose(), shift=(0.1, 0.0, 0.0)),
        "motion.axes": compliant(axes=(0.0, 0.0, 0.0, 0.0)),
        "motion.compliance[1].axis": compliant(compliance=[m.Compliance(axis="x"), m.Compliance(axis="x")]),
        "motion.compliance[0].force": compliant(compliance=[m.Compliance(axis="x", force=math.nan)]),
        "motion.compliance[0].stiffness": compliant(compliance=[m.Compliance(axis="rx", stiffness=20.0)]),
        "motion.dither[0].frequency": compliant(dither=[m.Dither(axis="x", amplitude=0.01, frequency=5.0)]),
        "ends[1].frame": rig.action(ends=[m.TimeEnd(after=1.0), m.ContactEnd(frame="gripper", threshold=1.0)]),
        "ends[0].axis": rig.action(ends=[m.ForceEnd(frame=frame, axis=(0.0, 0.0, 0.0), limit=1.0)]),
        "ends[0].after": rig.action(ends=[m.TimeEnd(after=math.inf)]),
        "ends": rig.action(ends=[m.TimeEnd(after=1.0)] * 17),
        "hold_after_s": rig.action(hold_after_s=math.inf),
        "expires_ns": rig.action(expires_ns=(1 << 64) - 1),
    }


def test_whatever_is_wrong_with_an_action_is_refused_by_field_value_and_expectation(rig: Rig) -> None:
    loop = rig.start_loop()
    for field, action in bad_actions(rig).items():
        refused = rig.refusal(action)
        assert refused.field == field, refused
        assert refused.value != ""
        assert refused.expected != ""
    assert loop.commands == []  # none of them reached the loop


def test_an_action_that_comes_too_late_is_refused(rig: Rig) -> None:
    loop = rig.start_loop()
    loop.cycle(time_ns=5_000_000_000)
    assert rig.refusal(rig.action(expires_ns=4_000_000_000)).field == "expires_ns"
    rig.call(rig.action(expires_ns=6_000_000_000))


def test_a_misspelled_joint_is_answered_with_those_that_look_like_it(rig: Rig) -> None:
    rig.start_loop()
    joints = rig.trajectory().joints
    joints[3] = joints[3].replace("right", "rigth")
    assert rig.trajectory().joints[3] in rig.refusal(rig.action(motion=rig.trajectory(joints=joints))).expected


def test_a_trajectory_beyond_a_limit_only_between_its_knots_is_refused(rig: Rig) -> None:
    rig.start_loop()
    joint = "arm_right_4_joint"
    row = rig.description.index(joint)
    start, fastest = float(rig.description.home_position("ready")[row]), float(rig.description.velocity_limit[row])
    lower = rig.description.lower[row]
    assert start - lower < fastest * 0.25 * 2  # so that the cubic dips below the limit on its way
    motion = m.JointTrajectory(
        joints=[joint], times=[0.0, 2.0], positions=[[start], [start]], velocities=[[-fastest], [fastest]]
    )
    refused = rig.refusal(rig.action(motion=motion))
    assert refused.field == "motion.positions[0][0]"
    assert "between knots 0 and 1" in refused.message


def test_a_robot_that_stands_beyond_a_limit_may_come_back_and_go_no_further(rig: Rig) -> None:
    loop = rig.start_loop()
    joint = "arm_right_7_joint"
    row = rig.description.index(joint)
    beyond = float(rig.description.upper[row]) + 0.01
    command = loop.snapshot["command"].copy()
    command[0][row] = beyond
    loop.cycle(command=command)

    def motion(goal: float) -> m.JointTrajectory:
        return m.JointTrajectory(
            joints=[joint], times=[0.0, 1.0], positions=[[beyond], [goal]], velocities=[[0.0], [0.0]]
        )

    assert rig.refusal(rig.action(motion=motion(beyond + 0.01))).field == "motion.positions[1][0]"
    rig.call(rig.action(motion=motion(beyond - 0.05)))


def test_an_action_is_refused_while_disabled_or_stopped(rig: Rig) -> None:
    loop = rig.start_loop()
    loop.cycle(flags=0)
    assert rig.refusal(rig.action()).field == "enabled"
    loop.cycle(flags=Flag.STOPPED, stop_reason=b"smoke")
    refused = rig.refusal(rig.action())
    assert refused.field == "stopped"
    assert "smoke" in refused.message


def test_an_owner_that_falls_silent_loses_its_action_and_one_that_checks_in_does_not(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action())
    for _ in range(8):  # 1.6 s, more than the timeout
        loop.live(0.2)
        rig.call(m.CheckIn(owner="test"))
    assert not [command for command in loop.commands if command.kind is Kind.LOSE_OWNER]
    assert loop.live_until(Kind.LOSE_OWNER).owner == loop.wait_for(Kind.START).owner
    told = rig.until(m.LogLine, lambda line: line.level == "warning")
    assert (told.level, told.text) == ("warning", "test did not check in: its action is ended")


def test_a_part_that_somebody_has_taken_is_commanded_by_him_alone_until_another_takes_it_over(rig: Rig) -> None:
    loop = rig.start_loop()
    assert rig.call(m.GetStatus()).leases == []
    lease = rig.call(m.TakeLease(owner="test", part="body"))
    assert rig.call(m.GetStatus()).leases == [m.LeaseState(part="body", owner="test", epoch=lease.epoch)]
    assert rig.refusal(m.TakeLease(owner="other", part="arm_right")).field == "part"
    assert rig.refusal(rig.action(owner="other")).field == "owner"
    assert rig.refusal(rig.action(lease=lease.epoch, sequence=lease.sequence)).field == "sequence"
    rig.call(rig.action(lease=lease.epoch, sequence=lease.sequence + 1))
    started = loop.wait_for(Kind.START)
    arm = rig.call(m.TakeLease(owner="other", part="arm_right", take_over=True))
    assert arm.epoch > lease.epoch
    assert loop.wait_for(Kind.CANCEL).action == started.serial, "what moves the part is ended"
    loop.end_action(Outcome.CANCELLED)
    assert rig.refusal(rig.action("a2", lease=lease.epoch, sequence=9)).field == "owner"
    rig.call(rig.action("a2", owner="other", lease=arm.epoch, sequence=1))
    rig.call(m.ReturnLease(owner="other", part="arm_right", epoch=arm.epoch))
    assert rig.call(m.GetStatus()).leases == []


def test_a_keepalive_reaches_the_loop_only_by_the_right_answers(rig: Rig) -> None:
    loop = rig.start_loop()
    bound = rig.call(m.BindKeepalive(owner="test", timeout_s=0.5))
    assert loop.wait_for(Kind.BIND_KEEPALIVE).value == 0.5
    assert rig.refusal(m.KeepAlive(owner="test", answer=bound.challenge)).field == "answer"
    assert not [command for command in loop.commands if command.kind is Kind.KEEP_ALIVE]
    told = rig.call(m.KeepAlive(owner="test", answer=answer(bound.challenge, "test")))
    assert loop.wait_for(Kind.KEEP_ALIVE).owner == loop.wait_for(Kind.BIND_KEEPALIVE).owner
    assert rig.refusal(m.KeepAlive(owner="test", answer=answer(bound.challenge, "test"))).field == "answer"
    rig.call(m.KeepAlive(owner="test", answer=answer(told.challenge, "test")))
    rig.call(m.ReleaseKeepalive(owner="test"))
    assert [command.value for command in loop.commands if command.kind is Kind.BIND_KEEPALIVE] == [0.5, 0.0]


def test_whoever_holds_a_part_and_falls_silent_loses_it(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(m.TakeLease(owner="test", part="head"))
    assert loop.live_until(Kind.LOSE_OWNER).owner != 0
    rig.until(m.DaemonStatus, lambda status: not status.leases)


def test_holds_reach_the_loop_in_lockstep(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(m.HoldTime(owner="test", limit_s=2.5))
    rig.call(m.ReleaseTime(owner="test"))
    held, released = loop.wait_for(Kind.HOLD_TIME), loop.wait_for(Kind.RELEASE_TIME)
    assert held.value == 2.5
    assert held.owner == released.owner != 0
    assert rig.refusal(m.HoldTime(owner="test", limit_s=math.inf)).field == "limit_s"
    loop.cycle(holds=[held.owner, 0, 0, 0, 0, 0, 0, 0])
    assert rig.until(m.DaemonStatus, lambda status: status.holds != []).holds == ["test"]


def test_a_hold_under_the_wall_clock_does_nothing(talos: RobotDescription) -> None:
    rig = Rig(talos, "wall")
    loop = rig.start_loop()
    rig.call(m.HoldTime(owner="test", limit_s=2.5))
    rig.call(m.ReleaseTime(owner="test"))
    rig.call(m.Disable())
    loop.wait_for(Kind.DISABLE)
    assert [command.kind for command in loop.commands] == [Kind.DISABLE]
    rig.close()


def test_stop_and_clear_go_to_the_stop_socket(rig: Rig) -> None:
    rig.start_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(rig.runtime.stop))
        listener.settimeout(PATIENCE_S)
        heard = []

        def answer() -> None:
            for word in ("stopped", "cleared"):
                data, sender = listener.recvfrom(1024)
                heard.append(data.decode())
                listener.sendto(word.encode(), sender)

        thread = threading.Thread(target=answer)
        thread.start()
        rig.call(m.Stop(reason="tablet 2"))
        rig.call(m.ClearStop())
        thread.join()
    assert heard == ["STOP tablet 2", "CLEAR"]
    assert "no daemon loop" in rig.refusal(m.Stop()).message


def test_the_loops_death_ends_its_action_and_nothing_is_enabled(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action("a1"))
    rig.until(m.ActionEvent, lambda event: event.state == "running")
    loop.die()
    ended = rig.until(m.ActionEvent, lambda event: event.state == "ended")
    assert (ended.id, ended.outcome) == ("a1", "stopped")
    assert "loop died" in ended.detail
    status = rig.until(m.DaemonStatus, lambda status: not status.enabled)
    assert {drive.state for drive in status.drives} == {"unknown"}
    assert "not running" in rig.refusal(m.Enable()).message


def test_a_loop_started_anew_is_followed_and_gets_no_command_meant_for_the_old(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action("a1"))
    loop.die()
    rig.until(m.ActionEvent, lambda event: event.state == "ended")
    anew = FakeLoop(rig.description, rig.runtime)
    rig.loop = anew
    anew.cycle(flags=0)
    rig.until(m.DaemonStatus, lambda status: status.drives[0].state == "operation_enabled")
    assert anew.commands == []
    rig.call(m.Enable())
    assert anew.wait_for(Kind.ENABLE)


def test_a_stop_that_was_latched_when_the_loop_died_is_latched_in_the_next(rig: Rig) -> None:
    loop = rig.start_loop()
    loop.cycle(flags=Flag.STOPPED, stop_reason=b"smoke")
    rig.until(m.DaemonStatus, lambda status: status.stopped)
    loop.die()
    status = rig.until(m.DaemonStatus, lambda status: status.drives[0].state == "unknown")
    assert status.stop_reason == "smoke"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(rig.runtime.stop))
        listener.settimeout(PATIENCE_S)
        rig.loop = FakeLoop(rig.description, rig.runtime)
        rig.loop.cycle(flags=0)
        assert listener.recv(1024) == b"STOP smoke"


def test_a_server_started_anew_knows_the_running_action_and_its_owner(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action("a1", ends=[m.DivergenceEnd(error=0.3)]))
    rig.until(m.ActionEvent, lambda event: event.state == "running")
    rig.stop_server()
    rig.start_server()
    rig.until(m.DaemonStatus, lambda status: status.action == "a1")
    rig.call(m.CheckIn(owner="test"))
    rig.call(m.CancelAction(id="a1"))
    assert loop.wait_for(Kind.CANCEL).action == loop.wait_for(Kind.START).serial
    loop.end_action(Outcome.CONDITION, condition=0, value=0.31)
    assert rig.until(m.ActionEvent, lambda event: event.state == "ended").outcome == "divergence"


def test_an_end_that_came_while_no_server_ran_is_told_by_the_next(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(rig.action("a1"))
    rig.until(m.ActionEvent, lambda event: event.state == "running")
    rig.stop_server()
    loop.end_action(Outcome.DONE)
    rig.start_server()
    assert rig.until(m.ActionEvent, lambda event: event.state == "ended").id == "a1"


def test_a_start_that_the_loop_takes_too_late_is_refused_and_then_cancelled(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_door, "ANSWER_TIMEOUT_S", 0.1)
    loop = rig.start_loop()
    loop.deaf = True
    assert "no answer" in rig.refusal(rig.action("a1")).message
    loop.deaf = False
    loop.ring_own_bell()
    assert loop.wait_for(Kind.CANCEL).action == loop.wait_for(Kind.START).serial


def test_malformed_calls_are_refused_and_change_nothing(rig: Rig) -> None:
    loop = rig.start_loop()
    raw = rig.context.socket(zmq.DEALER)
    raw.connect(rig.runtime.endpoint("daemon.call"))
    for frames in ([b"junk"], [b""], [b"\x81\xa4type\xa6Reboot"], [b"a", b"b"], [b"\xff" * 5000]):
        raw.send_multipart(frames)
        assert raw.poll(round(PATIENCE_S * 1000))
        assert b"Refused" in raw.recv()
    raw.close(0)
    rig.call(m.Enable())
    assert [command.kind for command in loop.commands] == [Kind.ENABLE]


def test_health_of_the_services_processes_is_in_the_status(rig: Rig) -> None:
    from daemon.serving.health import write_health

    rig.start_loop()
    write_health(Path(rig.runtime.folder), {"loop": "up", "link": "down, starting anew (died once)"})
    status = rig.until(m.DaemonStatus, lambda status: status.processes != {})
    assert status.processes["link"] == "down, starting anew (died once)"


# ---------------------------------------------------------------------------------------------------------------- devices


@pytest.fixture
def hand_rig(talos: RobotDescription) -> Iterator[Rig]:
    """A robot with an IMU, a gripper, a battery, and something that nobody has heard of."""
    devices = (
        Device("imu", "imu", 0, "can0", "torso_2_link", ""),
        Device("hand", "gripper", 0, "can0", "", "finger_joint"),
        Device("battery", "power", 0, "can1", "", ""),
        Device("oddity", "odd", 0, "can1", "", ""),
    )
    made = Rig(dataclasses.replace(talos, devices=devices, device_limits={"finger_joint": (-0.1, 1.0, 0.8, 40.0)}))
    yield made
    made.close()


def devices_of(rig: Rig, **changes: list[float]) -> np.ndarray:
    """Rows of measurements: everything well, unless told otherwise by device name."""
    well = {
        "imu": [0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3, 0.0, 0.0, 9.81],
        "hand": [0.4, 0.05, 3.0, 30.0, int(State.OPERATION_ENABLED), 1.0],
        "battery": [54.0, 2.0, 0.7, 27.0, 1.0],
        "oddity": [7.0],
    }
    values = np.zeros((len(rig.description.devices), 16))
    for row, device in enumerate(rig.description.devices):
        told = changes.get(device.name, well[device.name])
        values[row, : len(told)] = told
    return values


def test_device_states_go_out_at_25_hz_of_the_robots_time(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    list(hand_rig.events.drain())
    loop.cycle(100, device_values=devices_of(hand_rig), device_age=[0, 1, 40, 0])  # 200 ms of the robot's time
    states = [hand_rig.until(m.DeviceStates, lambda _: True) for _ in range(5)]
    assert np.diff([state.time_ns for state in states]).tolist() == [40_000_000] * 4
    last = states[-1]
    assert last.imus[0].linear_acceleration == (0.0, 0.0, 9.81)
    hand = last.grippers[0]
    assert (hand.name, hand.joint, hand.position, hand.state) == ("hand", "finger_joint", 0.4, "operation_enabled")
    assert hand.holding
    assert last.powers[0].voltage == 54.0
    assert last.powers[0].relay
    assert last.powers[0].age == 40
    assert last.others == [
        m.DeviceValues(name="oddity", age=0, family="odd", columns=["oddness"], values=[7.0]),
    ]


def test_a_robot_without_devices_tells_of_none(talos: RobotDescription) -> None:
    rig = Rig(dataclasses.replace(talos, devices=()))
    try:
        loop = rig.start_loop()
        list(rig.events.drain())
        loop.cycle(200)
        told = {type(rig.until(m.RobotState | m.DeviceStates, lambda _: True)) for _ in range(20)}  # type: ignore[arg-type]
        assert told == {m.RobotState}
    finally:
        rig.close()


def test_what_is_wrong_with_a_device_is_told_at_once_and_the_robot_stays_enabled(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    values = devices_of(hand_rig, battery=[47.0, 2.0, 0.08, 27.0, 1.0])
    loop.cycle(device_values=values, device_age=[300, 0, 40, 0])
    told = hand_rig.until(m.DaemonStatus, lambda status: any(device.problem for device in status.devices))
    assert [device.problem for device in told.devices] == ["does not answer", "", "battery low: 8%", ""]
    assert told.enabled
    loop.cycle(device_values=devices_of(hand_rig, battery=[54.0, 2.0, 0.7, 27.0, 0.0]), device_age=[0, 0, 0, 0])
    told = hand_rig.until(m.DaemonStatus, lambda status: "relay" in status.devices[2].problem)
    assert told.devices[0].problem == ""


def test_a_gripper_is_commanded_by_name_and_what_is_left_out_means_its_limit(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    hand_rig.call(m.CommandGripper(gripper="hand", position=0.7, effort=15.0))
    command = loop.wait_for(Kind.DEVICE)
    assert command.device == 1
    assert command.device_values is not None
    assert command.device_values[:3].tolist() == [0.7, 0.8, 15.0]


@pytest.mark.parametrize(
    ("wrong", "field", "expected"),
    [
        ({"gripper": "hnad"}, "gripper", "hand"),
        ({"gripper": "battery"}, "gripper", "hand"),
        ({"position": 1.2}, "position", "-0.1 to 1"),
        ({"position": math.nan}, "position", "finite"),
        ({"velocity": 0.9}, "velocity", "at most 0.8"),
        ({"effort": 41.0}, "effort", "at most 40"),
    ],
)
def test_a_gripper_command_that_can_not_be_done_is_refused_before_the_loop_sees_it(
    hand_rig: Rig, wrong: dict[str, Any], field: str, expected: str
) -> None:
    loop = hand_rig.start_loop()
    refused = hand_rig.refusal(m.CommandGripper(**{"gripper": "hand", "position": 0.5, **wrong}))
    assert refused.field == field
    assert expected in refused.expected
    assert loop.commands == []


def test_a_behaviours_steps_move_grippers_and_end_by_them_and_what_is_left_out_means_their_limit(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    ends = [m.GripperHoldsEnd(gripper="hand"), m.GripperAtEnd(gripper="hand", position=0.7, tolerance=0.02)]
    hand_rig.call(
        behaviour(hand_rig, {"gripper": m.GripperOrder(gripper="hand", position=0.7, effort=15.0), "ends": ends})
    )
    close, stay = loop.wait_for(Kind.BEHAVIOUR).steps
    assert close.order is not None
    assert (close.gripper, close.order[:3].tolist()) == (1, [0.7, 0.8, 15.0])
    assert close.ends == tuple(ends)
    assert stay.gripper == -1


@pytest.mark.parametrize(
    ("wrong", "field", "expected"),
    [
        ({"gripper": m.GripperOrder(gripper="hnad", position=0.5)}, "gripper.gripper", "hand"),
        ({"gripper": m.GripperOrder(gripper="hand", position=1.2)}, "gripper.position", "-0.1 to 1"),
        ({"ends": [m.GripperHoldsEnd(gripper="battery")]}, "ends[0].gripper", "hand"),
        ({"ends": [m.GripperAtEnd(gripper="hand", position=math.nan, tolerance=0.1)]}, "ends[0].position", "finite"),
    ],
)
def test_what_is_wrong_with_a_steps_gripper_is_refused_with_the_step(
    hand_rig: Rig, wrong: dict[str, Any], field: str, expected: str
) -> None:
    loop = hand_rig.start_loop()
    refused = hand_rig.refusal(behaviour(hand_rig, {}, wrong))
    assert refused.field == f"steps[1].{field}"
    assert expected in refused.expected
    assert loop.commands == []


def test_a_behaviour_moves_no_gripper_whose_part_another_has_taken(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    hand_rig.call(m.TakeLease(owner="other", part="hand"))
    order = m.GripperOrder(gripper="hand", position=0.7)
    assert "other" in str(hand_rig.refusal(behaviour(hand_rig, {}, {"gripper": order})))
    assert [command.kind for command in loop.commands if command.kind is Kind.BEHAVIOUR] == []


def test_a_gripper_that_does_not_answer_is_named_in_the_refusal(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    loop.answers[Kind.DEVICE] = (Answer.DEVICE_SILENT, 1, 0.0)
    assert hand_rig.refusal(m.CommandGripper(gripper="hand", position=0.5)).message == "hand does not answer"


def test_a_sensor_is_tared_by_name_and_what_hinders_it_is_told_with_value_and_expectation(rig: Rig) -> None:
    loop = rig.start_loop()
    row = next(row for row, device in enumerate(rig.description.devices) if device.name == "wrist_left_ft")
    loop.answers[Kind.TARE] = (Answer.ACCEPTED, -1, 3.25)
    assert rig.call(m.TareSensor(sensor="wrist_left_ft")) == m.Tared(sensor="wrist_left_ft", offset=3.25)
    assert loop.wait_for(Kind.TARE).device == row
    for hindered, joint, value, told in (
        (Answer.TOUCHED, row, 7.5, ("force", "7.5 N", "at most 5 N", "wrist_left_ft")),
        (Answer.TWISTED, row, 1.5, ("torque", "1.50 N·m", "at most 1 N·m", "wrist_left_ft")),
        (Answer.MOVING, 3, 0.2, ("velocity", "0.200 rad/s", "at most 0.05 rad/s", rig.description.joints[3])),
    ):
        loop.answers[Kind.TARE] = (hindered, joint, value)
        refused = rig.refusal(m.TareSensor(sensor="wrist_left_ft"))
        assert (refused.field, refused.value) == told[:2]
        assert told[2] in refused.expected
        assert told[3] in refused.message
    assert rig.refusal(m.TareSensor(sensor="torso_imu")).field == "sensor"


def test_a_node_that_the_bus_has_thrown_off_is_shown_so(rig: Rig) -> None:
    hub = Hub(rig.runtime.bus, rig.description.channels)
    joined: list[HubPort] = []
    joining = threading.Thread(target=lambda: joined.append(HubPort(rig.runtime.bus, name=bus_watch.NODE)))
    joining.start()
    rig.start_loop()

    def state_is(state: str) -> bool:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            hub.poll(0.01)
            while (message := rig.events.receive(0)) is not None:
                if isinstance(message, m.DaemonStatus) and message.buses[0].state == state:
                    return True
        return False

    try:
        assert state_is("error_active")
        hub.add_fault(Fault(kind="bus_off", node=bus_watch.NODE))
        assert state_is("bus_off")
        assert rig.call(m.GetStatus()).buses[1].state == "bus_off"
    finally:
        hub.close()
        joining.join()
        joined[0].close()


def test_a_relay_is_switched_by_the_supplys_name(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    hand_rig.call(m.SwitchRelay(power="battery", closed=True))
    command = loop.wait_for(Kind.RELAY)
    assert command.device == 2
    assert command.device_values is not None
    assert command.device_values[:2].tolist() == [1.0, 0.0]


def test_a_relay_that_may_not_open_is_refused_with_what_to_do(hand_rig: Rig) -> None:
    loop = hand_rig.start_loop()
    refused = hand_rig.refusal(m.SwitchRelay(power="hand", closed=False))
    assert (refused.field, refused.value) == ("power", "hand")
    assert "battery" in refused.expected
    assert loop.commands == []
    loop.answers[Kind.RELAY] = (Answer.ENABLED, 2, 0.0)
    refused = hand_rig.refusal(m.SwitchRelay(power="battery", closed=False))
    assert "Disable first" in refused.message and "battery" in refused.message
    assert (refused.field, refused.value, refused.expected) == ("enabled", "true", "false")


def test_a_streams_samples_go_to_the_loop_unanswered_check_their_owner_in_and_are_refused_where_nothing_runs(
    rig: Rig,
) -> None:
    joints = ["arm_right_1_joint", "arm_right_4_joint"]
    sample = m.StreamJoints(id="s", sequence=1, positions=[0.0, -1.5], velocities=[0.1, 0.0], expires_ns=5)
    with pytest.raises(RefusedError, match="no such action is running"):
        rig.call(sample)
    loop = rig.start_loop()
    rig.call(rig.action("s", m.JointStream(joints=joints)))
    loop.deaf = True  # its word is not waited for
    rig.call(sample)
    loop.deaf = False
    rig.call(m.CancelAction(id="s"))
    command = next(command for command in loop.commands if command.kind is Kind.STREAM_JOINTS)
    assert command.sample is not None
    assert (command.sample.sequence, command.expires_ns) == (1, 5)
    assert command.sample.position.tolist() + command.sample.velocity.tolist() == [0.0, -1.5, 0.1, 0.0]
    with pytest.raises(RefusedError) as refused:
        rig.call(m.StreamJoints(id="s", sequence=2, positions=[0.0]))
    assert refused.value.refusal.field == "positions"
