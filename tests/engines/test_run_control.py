"""Pause, resume, stop and the end of the daemon act on the motion, and say so."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from engines.daemon_client import DaemonClient
from engines.programs.statechart import Event
from engines.runs.autonomy import Question
from engines.runs.motion import Motion, MotionFailed
from engines.runs.parts import Parts
from engines.runs.run import ProgramRun
from handrail import messages as m
from handrail.topics import Publisher, RefusedError, Unreachable

ROBOT = SimpleNamespace(joints=("a",), velocity_limit=np.ones(1))
ELSEWHERE = m.Pose(position=(0.5, -0.3, 0.3))


def begin(stack, daemon, wait_until, **parameters):
    """A run whose first action is under way and stays so."""
    daemon.slow = True
    stack.place()
    stack.run(**parameters)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    wait_until(daemon.started)
    wait_until(lambda: stack.engine._run._motion._running)
    return daemon.started()[0]


def test_pause_stops_the_action_and_resume_lets_it_go_on(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until, goal_deg=10)
    stack.call(m.PauseRun())
    assert [call.id for call in daemon.calls if isinstance(call, m.PauseAction)] == [action.id]
    assert stack.call(m.GetEngine()).run.status == "paused"
    stack.call(m.ResumeRun())
    assert [call.id for call in daemon.calls if isinstance(call, m.ResumeAction)] == [action.id]
    daemon.slow = False
    daemon.finish()
    assert stack.ended().status == "succeeded"


def test_nothing_new_starts_while_paused_even_when_the_action_just_ended(stack, daemon, wait_until):
    begin(stack, daemon, wait_until, goal_deg=10)
    stack.call(m.PauseRun())
    daemon.finish()
    wait_until(lambda: daemon.action is None)
    wait_until(lambda: not stack.engine._run._motion._running)
    assert len(daemon.started()) == 1
    daemon.slow = False
    stack.call(m.ResumeRun())
    assert stack.ended().status == "succeeded"
    assert len(daemon.started()) > 1


def test_stop_cancels_the_motion_and_ends_the_run(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until)
    stack.call(m.StopRun())
    ended = stack.ended()
    assert ended.status == "stopped"
    assert [call.id for call in daemon.calls if isinstance(call, m.CancelAction)] == [action.id]
    assert len(daemon.started()) == 1
    assert daemon.kinds()[-1] == "ReleaseTime"


def test_stop_of_a_paused_run_starts_nothing(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    stack.call(m.PauseRun())
    daemon.finish()
    wait_until(lambda: daemon.action is None)
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    assert len(daemon.started()) == 1


def test_stop_withdraws_an_open_prompt(stack, daemon):
    stack.place()
    stack.run()
    prompt = stack.prompt()
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    closed = stack.wait(lambda e: isinstance(e, m.PromptClosed))
    assert closed.id == prompt.id and closed.answer == ""
    assert stack.call(m.GetEngine()).prompts == []
    assert "withdrawn" in stack.refusal(m.AnswerPrompt(id=prompt.id, answer="approve")).message


def test_the_operator_stop_fails_the_run_by_name(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.operator_stop()
    ended = stack.ended()
    assert ended.status == "failed"
    assert "operator stop" in ended.detail


def test_a_silent_daemon_fails_the_run_instead_of_leaving_it_running(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.close()
    ended = stack.ended()
    assert ended.status == "failed"
    assert "daemon has gone silent" in ended.detail


def test_a_daemon_that_was_started_anew_fails_the_run_whose_action_it_does_not_know(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.running.clear()
    ended = stack.ended()
    assert ended.status == "failed"
    assert "started anew" in ended.detail


def test_control_without_a_run_is_refused(stack):
    for call in (m.PauseRun(), m.ResumeRun(), m.StopRun()):
        assert stack.refusal(call).message == "nothing is running"


def test_resume_of_what_is_not_paused_is_refused(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    refusal = stack.refusal(m.ResumeRun())
    assert (refusal.field, refusal.value, refusal.expected) == ("status", "running", "paused")


def test_a_second_run_is_refused_while_one_runs(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "left", "valve": "wheel_1"}))
    assert "busy" in stack.refusal(m.Run(deployment=deployed.id)).message


def test_the_engine_stays_answering_while_a_plan_is_computed(stack, planner, wait_until):
    stack.place()
    planner.pace.clear()
    stack.run()
    wait_until(lambda: stack.call(m.GetEngine(), timeout_s=30).run.active == ["planning"])
    stack.call(m.StopRun())
    planner.pace.set()
    assert stack.ended().status == "stopped"


def test_the_engine_checks_in_while_it_lives(stack, daemon, wait_until):
    wait_until(lambda: any(isinstance(call, m.CheckIn) and call.owner == "engine" for call in daemon.calls))


def test_what_was_moved_during_a_pause_is_not_started_afterwards(stack, daemon):
    stack.place()
    stack.run(goal_deg=10)
    first = stack.prompt()
    stack.call(m.PauseRun())
    stack.call(m.AnswerPrompt(id=first.id, answer="approve"))
    stack.wait(lambda e: isinstance(e, m.RunState) and e.waiting == ["stroking"])
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=ELSEWHERE))
    assert "wheel_1 was moved" in stack.refusal(m.ResumeRun()).message
    stack.call(m.ResumeRun())
    assert stack.prompt(2).plan == "plan-2"
    assert not daemon.started()


def test_a_motion_that_waits_for_the_end_of_a_pause_is_asked_about_again_before_it_starts():
    daemon, reasons, outdated = Mute(), [], []
    motion = Motion(daemon, SimpleNamespace(hold=lambda message: message), robot=ROBOT)  # type: ignore[arg-type]
    trajectory = m.JointTrajectory(joints=["a"], times=[0, 1], positions=[[0], [1]], velocities=[[0], [0]])

    def run():
        with pytest.raises(MotionFailed) as failed:
            motion.run(trajectory, (), threading.Event(), still=lambda: " ".join(outdated))
        reasons.append(failed.value.reason)

    motion.pause()
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    outdated.append("wheel_1 was moved")
    motion.resume()
    thread.join(30)
    assert reasons == ["stale"] and not daemon.calls


def test_a_motion_whose_instance_was_moved_during_a_pause_is_not_resumed(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until)
    stack.call(m.PauseRun())
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=ELSEWHERE))
    assert "wheel_1 was moved" in stack.refusal(m.ResumeRun()).message
    stack.call(m.ResumeRun())
    assert not any(isinstance(call, m.ResumeAction) for call in daemon.calls)
    assert [call.id for call in daemon.calls if isinstance(call, m.CancelAction)] == [action.id]
    assert stack.prompt(2).plan == "plan-2"
    assert len(daemon.started()) == 1


def test_a_stopped_run_has_ended_only_when_its_motion_has(stack, daemon, wait_until, monkeypatch):
    settling, settled = threading.Event(), Motion.settled
    monkeypatch.setattr(Motion, "settled", lambda motion, _: settling.set() or settled(motion, 60))
    begin(stack, daemon, wait_until)
    action = daemon.action
    daemon._ended, ended = lambda outcome, share, action=None: None, daemon._ended
    stack.call(m.StopRun())
    wait_until(lambda: any(isinstance(call, m.CancelAction) for call in daemon.calls))
    deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "left", "valve": "wheel_1"}))
    assert settling.wait(30)
    assert daemon.action is action and stack.call(m.GetEngine()).run.status == "running"
    assert "busy" in stack.refusal(m.Run(deployment=deployed.id)).message
    for call in (m.PauseRun(), m.ResumeRun()):
        assert "being stopped" in stack.refusal(call).message
    daemon._todo.append(lambda: ended("cancelled", 0.5))
    assert stack.ended().status == "stopped"


def test_a_crash_before_the_first_state_fails_the_run(stack, monkeypatch):
    def crash(chart):
        raise RuntimeError("no machine")

    monkeypatch.setattr("engines.programs.statechart.Chart.begin", crash)
    stack.place()
    stack.run()
    ended = stack.ended()
    assert ended.status == "failed" and "no machine" in ended.detail


def test_the_runs_data_are_its_parameters_and_its_variables(stack):
    stack.place()
    data = stack.run(goal_deg=120).data
    assert (data["goal_deg"], data["max_strokes"]) == (120, 10)
    assert (data["turned_deg"], data["stroke"]) == (0.0, 0)


def test_a_run_takes_what_it_moves_and_returns_it_at_its_end(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until)
    (lease,) = daemon.leases.held()
    assert (lease.part, lease.owner) == ("tool", "engine")
    assert action.lease == lease.epoch
    stack.call(m.StopRun())
    stack.ended()
    wait_until(lambda: not daemon.leases.held())


def test_who_takes_over_cancels_the_run_which_says_so(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.take_over("operator", "tool")
    ended = stack.ended()
    assert ended.status == "failed"
    assert "operator has taken over tool" in ended.detail
    assert len(daemon.started()) == 1
    assert [lease.owner for lease in daemon.leases.held()] == ["operator"]


def test_a_run_does_not_move_what_somebody_else_has(stack, daemon, wait_until):
    daemon.leases.take("operator", "body")
    stack.place()
    stack.run(goal_deg=90)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    ended = stack.ended()
    assert ended.status == "failed"
    assert "operator's" in ended.detail
    assert not daemon.started()


def test_two_engines_do_not_command_one_arm(runtime, daemon):
    motion = m.JointTrajectory(joints=["depth"], times=[0, 1], positions=[[-0.3], [-0.2]], velocities=[[0], [0]])
    daemon.slow = True
    one, other = (DaemonClient(runtime, 3, owner=name) for name in ("engine", "engine_2"))
    try:
        first, second = (Parts(client, {"tool": ("angle", "depth")}) for client in (one, other))
        start = m.StartAction(id="a", owner="engine", motion=motion)
        assert first.hold(start).lease == 1
        with pytest.raises(RefusedError, match="tool is engine's"):
            second.hold(msgspec.structs.replace(start, owner="engine_2"))
        numbers = [first.hold(start).sequence for _ in range(2)]
        assert numbers[1] > numbers[0] > 0
        whole = m.WholeBody(compound="posture", joints=["depth"])
        assert first.hold(msgspec.structs.replace(start, motion=whole)).lease == 1, "no more than its joints' part"
        first.give_back()
        assert second.hold(msgspec.structs.replace(start, owner="engine_2")).lease == 2
    finally:
        one.close()
        other.close()


class Mute:
    """A daemon that answers nothing but the start of a motion, which never ends."""

    def __init__(self):
        self.calls, self.answers = [], True

    def call(self, message, timeout_s=2.0):
        self.calls.append(message)
        if not self.answers:
            raise Unreachable("no answer")

    def watch(self, action):
        return DaemonClient.watch(self, action)

    def __getattr__(self, name):
        return {
            "owner": "engine",
            "_lock": threading.Lock(),
            "_watches": {},
            "forget": lambda watch: None,
            "release_time": lambda: None,
            "alive": lambda: True,
            "command": lambda: np.zeros(1),
        }[name]

    def runs(self, action):
        return any(call.id == action for call in self.calls if isinstance(call, m.StartAction))


def test_a_pause_that_did_not_reach_the_daemon_is_none_and_a_cancel_is_said_again(wait_until):
    daemon, cancelled = Mute(), threading.Event()
    motion = Motion(daemon, SimpleNamespace(hold=lambda message: message), robot=ROBOT)  # type: ignore[arg-type]
    trajectory = m.JointTrajectory(joints=["a"], times=[0, 1], positions=[[0], [1]], velocities=[[0], [0]])
    threading.Thread(target=motion.run, args=(trajectory, (), cancelled), daemon=True).start()
    wait_until(lambda: motion._running)
    daemon.answers = False
    with pytest.raises(Unreachable):
        motion.pause()
    assert not motion.paused
    cancelled.set()
    with pytest.raises(Unreachable):
        motion.interrupt()
    assert not motion.settled(0.05)
    wait_until(lambda: sum(isinstance(call, m.CancelAction) for call in daemon.calls) > 1)


def test_a_loop_that_was_started_anew_is_believed_though_it_counts_its_cycles_from_the_start(runtime, wait_until):
    def state(time_s, cycle, at):
        return m.RobotState(
            time_ns=round(time_s * 1e9), cycle=cycle, position=[at], velocity=[0], torque=[0], command=[at]
        )

    publisher = Publisher(runtime.endpoint("daemon.events"))
    client = DaemonClient(runtime, 1)

    def hears(message, command):
        def heard():
            publisher.send(message)
            return client.command() is not None and np.array_equal(client.command(), [command])

        wait_until(heard)

    hears(state(100.0, 50_000, 0.1), 0.1)
    hears(state(102.0, 3, 0.2), 0.2)
    for message in (state(101.5, 2, 0.3), state(102.002, 4, 0.4)):  # late, then in time
        publisher.send(message)
    wait_until(lambda: client.time_ns == 102_002_000_000)
    assert client.command() == [0.4]
    hears(state(0.5, 250, 0.5), 0.5)  # the plant, whose clock it is, was started anew
    client.close()
    publisher.close()


def test_a_run_that_crashes_takes_its_motion_and_its_questions_with_it(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until)
    chart, run = stack.engine._run._chart, stack.engine._run
    run._permissions.ask(Question("stroking", 0, "full", "Go on?", {}))
    chart.post(Event(None))  # type: ignore[arg-type]  # what the machine can't make anything of
    ended = stack.ended()
    assert ended.status == "failed" and "the engine's own error" in ended.detail
    assert [call.id for call in daemon.calls if isinstance(call, m.CancelAction)] == [action.id]
    assert daemon.action is None
    assert stack.call(m.GetEngine()).prompts == []
    assert not daemon.leases.held()


def test_what_a_state_waits_to_move_is_cancelled_without_what_another_moves(wait_until):
    daemon, reasons = Mute(), []
    motion = Motion(daemon, SimpleNamespace(hold=lambda message: message), robot=ROBOT)  # type: ignore[arg-type]
    trajectory = m.JointTrajectory(joints=["a"], times=[0, 1], positions=[[0], [1]], velocities=[[0], [0]])
    moving, waiting = threading.Event(), threading.Event()

    def wait():
        with pytest.raises(MotionFailed) as failed:
            motion.run(trajectory, (), waiting)
        reasons.append(failed.value.reason)

    threading.Thread(target=motion.run, args=(trajectory, (), moving), daemon=True).start()
    wait_until(lambda: motion._running)
    second = threading.Thread(target=wait, daemon=True)
    second.start()
    waiting.set()
    motion.interrupt()
    second.join(30)
    assert reasons == ["cancelled"]
    assert not any(isinstance(call, m.CancelAction) for call in daemon.calls)
    moving.set()
    motion.interrupt()
    assert any(isinstance(call, m.CancelAction) for call in daemon.calls)


def test_a_motion_of_which_the_daemon_does_not_tell_whether_it_began_is_cancelled():
    daemon = Mute()
    daemon.answers = False
    motion = Motion(daemon, SimpleNamespace(hold=lambda message: message), robot=ROBOT)  # type: ignore[arg-type]
    trajectory = m.JointTrajectory(joints=["a"], times=[0, 1], positions=[[0], [1]], velocities=[[0], [0]])
    with pytest.raises(MotionFailed, match="no answer") as failed:
        motion.run(trajectory, (), threading.Event())
    start, cancel = daemon.calls
    assert isinstance(cancel, m.CancelAction) and cancel.id == start.id
    assert failed.value.started, "nobody knows that it has not"


@pytest.fixture
def arriving(stack, monkeypatch):
    """A run whose first activity has come to a breakpoint and not told so yet; call it to have that happen."""
    stack.place()
    arrived, let = threading.Event(), threading.Event()
    waits = ProgramRun._waits

    def late(run, why):
        arrived.set()
        assert let.wait(30)
        waits(run, why)

    monkeypatch.setattr(ProgramRun, "_waits", late)
    stack.call(m.SetBreakpoints(states=["planning"]))
    stack.run()
    assert arrived.wait(30)
    yield let.set
    let.set()


def test_an_activity_that_comes_to_a_breakpoint_as_its_run_ends_does_not_wake_it(stack, arriving):
    stack.wait(lambda e: isinstance(e, m.RunState) and e.active == ["planning"])
    stack.call(m.TakeTransition(state="planning", way=1))
    assert stack.ended().waiting == []
    told = stack.call(m.GetEngine()).run
    arriving()
    stack.engine._run._chart.gate.wake()
    for thread in threading.enumerate():
        if "statemachine" in str(getattr(thread, "_target", "")) or thread.name.endswith("(_run_sync_handler)"):
            thread.join(30)
    assert stack.call(m.GetEngine()).run == told and told.status == "failed"


def test_who_has_paused_and_gone_on_as_a_breakpoint_was_reached_is_not_paused_by_it(stack, arriving):
    stack.call(m.PauseRun())
    stack.call(m.ResumeRun())
    arriving()
    stack.prompt()
    assert stack.call(m.GetEngine()).run.status == "running"
