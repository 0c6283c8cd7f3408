"""The gate with a fake daemon and engine, and real clients."""

from __future__ import annotations

import shutil
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import msgspec
import numpy as np
import pytest
import zmq

from handrail.link import codec, keys
from handrail.link.events import Live
from handrail.messages import (
    AnswerPrompt,
    CheckTask,
    ClearStop,
    DaemonStatus,
    Disable,
    DriveStatus,
    EditPlan,
    Enable,
    GetEngine,
    GetRobot,
    GetStatus,
    JointTrajectory,
    MakePlan,
    PlaceInstance,
    PlanMotion,
    Pose,
    Prompt,
    RankChoices,
    RobotState,
    RunState,
    StartAction,
    Stop,
)
from handrail.topics import RefusedError, Unreachable

STATE = RobotState(time_ns=1, cycle=1, position=[0.1], velocity=[0.0], torque=[0.0], command=[0.1])


def prompt(number: int) -> Prompt:
    return Prompt(id=f"p{number}", run="r", text="turn?", options=["approve", "reject"])


class TestCalls:
    def test_go_to_the_daemon_or_the_engine_by_their_type(self, stand):
        daemon, engine, _ = stand.daemon(), stand.engine(), stand.gate()
        client = stand.client()
        assert client.robot().tools == {"right": "tool_right"}
        client.disable()
        pose = Pose(position=(0.55, -0.35, 0.3))
        assert client.place_instance("wheel_1", "wheel", pose).pose_in_world == pose
        client.answer("p1", "approve")
        assert [type(message) for message in daemon.asked] == [GetRobot, Disable]
        assert engine.asked == [
            PlaceInstance(name="wheel_1", template="wheel", pose_in_world=pose, by="local"),
            AnswerPrompt(id="p1", answer="approve"),
        ]

    def test_to_enable_return_when_the_robot_holds(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        client = stand.client()
        now = {"enabled": False}
        daemon.answers[GetStatus] = lambda _: stand.status(**now)

        def enable(_):
            now["enabled"] = True  # by the time the drives are there; the caller hears of it as an event
            daemon.publish(stand.status(enabled=True))

        daemon.answers[Enable] = enable
        client.enable()
        assert client.status().enabled

    def test_to_enable_name_the_drives_that_do_not_get_there(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        late = [DriveStatus(joint=f"arm_right_{n}_joint", state="fault", problem="fault: undervoltage") for n in (1, 2)]
        slow = DriveStatus(joint="head_1_joint", state="switched_on")
        daemon.answers[GetStatus] = lambda _: stand.status(drives=[*late, slow])
        words = "arm_right_1_joint, arm_right_2_joint: fault: undervoltage; head_1_joint: switched_on"
        with pytest.raises(TimeoutError, match=words):
            stand.client().enable(timeout_s=0.3)

    def test_that_are_refused_raise_with_field_value_and_expectation(self, stand):
        stand.engine(), stand.gate()
        with pytest.raises(RefusedError, match=r"out of reach; field instance, value wheel_1, expected within 0\.9 m"):
            stand.client().plan("wheel_1", "turn")

    def test_to_a_process_that_is_down_say_so_and_are_not_kept_for_later(self, stand):
        stand.gate()
        client = stand.client()
        with pytest.raises(Unreachable, match="the daemon is not running; nothing was done"):
            client.enable()
        daemon = stand.daemon()
        client.robot()
        assert [type(message) for message in daemon.asked] == [GetRobot]

    def test_work_again_after_the_daemon_restarted(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        client = stand.client()
        client.robot()
        daemon.close()
        daemon = stand.daemon()
        _eventually(client.robot)
        assert daemon.asked

    def test_end_at_once_when_the_process_dies_before_answering(self, stand):
        engine, _ = stand.engine(), stand.gate()
        asked = threading.Event()
        client = stand.client()

        def die(_: MakePlan) -> None:
            # A process that is killed takes its socket with it in the middle of the call.
            asked.set()
            engine._service.socket.close()
            raise SystemExit

        engine.answers[MakePlan] = die
        with pytest.raises(Unreachable, match="the engine died before it answered"):
            client.plan("wheel_1", "turn", timeout_s=20)
        assert asked.is_set()

    def test_of_one_thread_do_not_wait_for_those_of_another(self, stand):
        daemon, engine, _ = stand.daemon(), stand.engine(), stand.gate()
        release = threading.Event()

        def slow(call: GetEngine) -> None:
            release.wait(5)

        engine.answers[GetEngine] = slow
        client = stand.client()
        with ThreadPoolExecutor() as pool:
            waiting = pool.submit(client.snapshot)
            assert client.robot().name == "talos_upper"
            assert not waiting.done()
            release.set()
            waiting.result(5)
        assert daemon.asked

    def test_that_time_out_leave_the_connection_usable(self, stand):
        stand.daemon()
        engine, _ = stand.engine(), stand.gate()
        client = stand.client()
        release = threading.Event()
        engine.answers[GetEngine] = lambda _: release.wait(5) and None
        with pytest.raises(Unreachable, match=r"did not answer in 0\.2 s"):
            client.call(GetEngine(), timeout_s=0.2)
        release.set()
        assert client.robot().name == "talos_upper"


class TestTheDoor:
    def test_stays_shut_for_an_unknown_key(self, stand, tmp_path):
        daemon, _ = stand.daemon(), stand.gate()
        stranger = keys.ensure(tmp_path / "stranger")
        shutil.copy(stand.keys / "server.key", stranger / "server.key")
        with pytest.raises(Unreachable, match=r"does not know this client; copy .*client\.key to the robot"):
            stand.client(stranger, timeout_s=0.7)
        assert not daemon.asked

    def test_opens_for_a_key_that_is_allowed_later(self, stand, tmp_path):
        stand.daemon(), stand.gate()
        tablet = keys.ensure(tmp_path / "tablet")
        shutil.copy(stand.keys / "server.key", tablet / "server.key")
        client = stand.client(tablet, timeout_s=0)
        with pytest.raises(Unreachable):
            client.call(GetRobot(), timeout_s=0.5)
        shutil.copy(tablet / "client.key", stand.keys / "allowed" / "tablet.key")
        assert client.call(GetRobot(), timeout_s=10).name == "talos_upper"

    @pytest.mark.parametrize("kind", [zmq.DEALER, zmq.SUB], ids=["calls", "events"])
    def test_gives_an_unauthenticated_peer_nothing(self, stand, kind):
        daemon, _ = stand.daemon(), stand.gate()
        with zmq.Context() as context, context.socket(kind) as peer:
            peer.setsockopt(zmq.LINGER, 0)
            if kind == zmq.SUB:
                peer.subscribe(b"")
                peer.connect(f"tcp://127.0.0.1:{stand.port + 1}")
            else:
                peer.connect(stand.address)
                peer.send_multipart((bytes(8), codec.Packer().pack(GetRobot())))
            trusted = stand.client().events(RobotState)
            daemon.publish(STATE)
            assert trusted.next(5) == STATE
            assert not peer.poll(300)
        assert not daemon.asked

    def test_raw_bytes_on_its_ports_change_nothing(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        noise = np.random.default_rng(1)
        for port in (stand.port, stand.port + 1):
            for _ in range(10):
                with socket.create_connection(("127.0.0.1", port)) as peer:
                    peer.sendall(noise.bytes(200))
        assert stand.client().robot().name == "talos_upper"
        assert [type(message) for message in daemon.asked] == [GetRobot]

    def test_takes_only_messages_that_may_cross_it(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        motion = JointTrajectory(joints=["j"], times=[0.0], positions=[[0.0]], velocities=[[0.0]])
        with pytest.raises(RefusedError, match=r"not a call that the link takes.*StartAction"):
            stand.client().call(StartAction(id="a", owner="tablet", motion=motion))
        with pytest.raises(RefusedError, match="not a call that the link takes"):
            stand.client().call(STATE)
        assert not daemon.asked

    def test_refuses_numbers_that_are_not_finite_and_names_them(self, stand):
        engine, _ = stand.engine(), stand.gate()
        with pytest.raises(RefusedError, match=r"pose_in_world\.position\[1\], value nan, expected a finite number"):
            stand.client().place_instance("w", "wheel", Pose(position=(0.0, float("nan"), 0.0)))
        assert not engine.asked

    def test_survives_an_authenticated_peer_that_talks_nonsense(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        noise = np.random.default_rng(2)
        encode = msgspec.msgpack.encode
        with zmq.Context() as context, context.socket(zmq.DEALER) as peer:
            own = keys.for_client(stand.keys)
            peer.setsockopt(zmq.LINGER, 0)
            for option, value in (
                (zmq.CURVE_SERVERKEY, own.server),
                (zmq.CURVE_PUBLICKEY, own.public),
                (zmq.CURVE_SECRETKEY, own.secret),
            ):
                peer.setsockopt(option, value)
            peer.connect(stand.address)
            number = (1).to_bytes(8, "big")
            for frames in (
                (b"",),
                (b"short", b"\0"),
                (number, b"\0", b"three"),
                *((number, noise.bytes(size)) for size in (0, 1, 2, 50, 5000)),
                (number, b"\0" + b"\x91" * 100_000),
                (number, b"\0" + encode({"type": "Stop", "reason": "x" * 201})),
                (number, b"\0" + encode({"type": "Enable", "joint": 3})),
                (number, b"\0" + encode([{"type": "Enable"}])),
            ):
                peer.send_multipart(frames)
            answered = []
            while peer.poll(500):
                answered.append(peer.recv_multipart())
        unpacker = codec.Unpacker(codec.REMOTE_ANSWER, codec.LARGEST_ANSWER)
        kinds = {type(unpacker.unpack(payload)).__name__ for _, payload in answered}
        assert kinds == {"Refused"}
        assert len(answered) == 9  # those with a number to answer to
        assert stand.client().robot().name == "talos_upper"
        assert [type(message) for message in daemon.asked] == [GetRobot]

    def test_a_closed_gate_is_unreachable_and_the_error_says_what_to_do(self, stand):
        with pytest.raises(Unreachable, match=r"no gate answered.*handrail up ROBOT"):
            stand.client(timeout_s=0.3)


class TestStop:
    def test_goes_to_the_stop_socket_without_the_daemons_server(self, stand):
        stand.gate()
        with _Loop(stand.runtime.stop) as loop:
            stand.client().stop("smoke")
            assert loop.heard == ["STOP smoke"]

    def test_says_so_when_no_loop_confirms_it(self, stand):
        stand.daemon(), stand.gate()
        with pytest.raises(Unreachable, match="no daemon loop listens"):
            stand.client().stop()
        with _Loop(stand.runtime.stop, answers=False), pytest.raises(Unreachable, match="did not answer"):
            stand.client().stop()

    def test_overtakes_calls_that_the_engine_and_daemon_still_work_on(self, stand):
        daemon, engine, _ = stand.daemon(), stand.engine(), stand.gate()
        release = threading.Event()
        daemon.answers[Enable] = engine.answers[GetEngine] = lambda _: release.wait(5) and None
        client = stand.client()
        with ThreadPoolExecutor() as pool, _Loop(stand.runtime.stop) as loop:
            waiting = [pool.submit(client.enable), pool.submit(client.snapshot)]
            client.stop("now")
            assert loop.heard == ["STOP now"]
            assert not any(call.done() for call in waiting)
            release.set()

    def test_tells_who_stopped_when_no_reason_is_given(self, stand):
        stand.gate()
        with _Loop(stand.runtime.stop) as loop:
            stand.client().stop()
            assert loop.heard == ["STOP stopped by local"]

    def test_is_cleared_by_the_daemon_only(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        stand.client().clear_stop()
        assert daemon.asked == [ClearStop()]


class TestEvents:
    def test_flow_from_both_processes_to_every_client(self, stand):
        daemon, engine, _ = stand.daemon(), stand.engine(), stand.gate()
        streams = [stand.client().events(RobotState, Prompt) for _ in range(2)]
        daemon.publish(STATE)
        engine.publish(prompt(1))
        for stream in streams:
            events = {type(event): event for event in (stream.next(5), stream.next(5))}
            assert events == {RobotState: STATE, Prompt: prompt(1)}

    def test_that_are_reliable_all_arrive_in_order(self, stand):
        engine, _ = stand.engine(), stand.gate()
        stream = stand.client().events(Prompt)
        for number in range(300):
            engine.publish(prompt(number))
        assert [stream.next(5).id for _ in range(300)] == [f"p{number}" for number in range(300)]

    def test_of_latest_value_streams_arrive_thinned_out_but_end_with_the_newest(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        stream = stand.client().events(RobotState)
        for cycle in range(1, 1001):
            daemon.publish(msgspec.structs.replace(STATE, cycle=cycle))
        cycles = []
        while not cycles or cycles[-1] < 1000:
            cycles.append(stream.next(5).cycle)
        assert cycles == sorted(set(cycles))
        assert len(cycles) < 500

    def test_not_asked_for_do_not_arrive_even_when_their_name_begins_alike(self, stand):
        engine, _ = stand.engine(), stand.gate()
        client = stand.client()
        prompts = client.events(Prompt)
        client.events(RunState)
        engine.publish(RunState(run="r", deployment="d", program="p", hash="0", status="running", active=[]))
        engine.publish(prompt(7))
        assert prompts.next(5) == prompt(7)
        assert prompts.next(0.1) is None

    def test_reach_a_late_client_with_the_last_value(self, stand):
        daemon, _ = stand.daemon(), stand.gate()
        early = stand.client().events(RobotState)
        daemon.publish(STATE)
        assert early.next(5) == STATE
        assert stand.client().events(RobotState).next(5) == STATE

    def test_that_may_not_cross_the_link_are_refused_by_name(self, stand):
        stand.gate()
        with pytest.raises(ValueError, match="Enable does not travel over the link"):
            stand.client().events(Enable)

    def test_call_a_reaction_that_may_make_calls_itself(self, stand):
        stand.daemon()
        engine, _ = stand.engine(), stand.gate()
        client = stand.client()
        answered = threading.Event()
        engine.answers[AnswerPrompt] = lambda _: answered.set()
        client.on(Prompt, lambda event: client.answer(event.id, event.options[0]))
        engine.publish(prompt(1))
        assert answered.wait(5)

    def test_end_when_the_client_is_closed(self, stand):
        stand.gate()
        client = stand.client()
        stream = client.events(RobotState)
        threading.Timer(0.1, client.close).start()
        assert list(stream) == []
        with pytest.raises(Unreachable, match="closed"):
            client.robot()


class TestARestartedGate:
    def test_finds_its_clients_again_and_their_streams_say_that_they_are_live(self, stand):
        daemon, first = stand.daemon(), stand.gate()
        client = stand.client()
        stream = client.events(Live, DaemonStatus)
        assert isinstance(stream.next(5), Live)
        first.close()
        _eventually(lambda: client.connected and pytest.fail("still connected"))
        stand.gate()
        assert client.robot().name == "talos_upper"
        assert isinstance(stream.next(10), Live)
        from_daemon = client.status()
        daemon.publish(from_daemon)
        assert stream.next(5) == from_daemon

    def test_ends_calls_that_were_open_when_it_died(self, stand):
        engine, gate = stand.engine(), stand.gate()
        client = stand.client()
        asked, release = threading.Event(), threading.Event()

        def slow(_: GetEngine) -> None:
            asked.set()
            release.wait(5)

        engine.answers[GetEngine] = slow
        with ThreadPoolExecutor() as pool:
            waiting = pool.submit(client.snapshot)
            assert asked.wait(5)
            gate.close()
            with pytest.raises(Unreachable, match="may or may not have been carried out"):
                waiting.result(5)
            release.set()

    def test_serves_a_client_that_was_there_first(self, stand):
        stand.daemon()
        client = stand.client(timeout_s=0)
        stream = client.events(Live, DaemonStatus, timeout_s=0)
        assert not client.connected
        stand.gate()
        assert client.robot().name == "talos_upper"
        assert isinstance(stream.next(10), Live)


class _Loop:
    """The daemon loop's stop socket."""

    def __init__(self, path, answers=True):
        self.heard: list[str] = []
        self._answers = answers
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        path.unlink(missing_ok=True)
        self._socket.bind(str(path))
        self._socket.settimeout(0.05)
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        while not self._done.is_set():
            try:
                message, sender = self._socket.recvfrom(1024)
            except TimeoutError:
                continue
            self.heard.append(message.decode())
            if self._answers:
                self._socket.sendto(b"stopped", sender)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._done.set()
        self._thread.join()
        self._socket.close()


def _eventually(act, within_s=5.0):
    """Repeat until it raises nothing."""
    deadline = time.monotonic() + within_s
    while True:
        try:
            return act()
        except (Unreachable, pytest.fail.Exception):
            if time.monotonic() > deadline:
                raise
            threading.Event().wait(0.02)


@pytest.mark.parametrize(
    "kind", [MakePlan, PlanMotion, EditPlan, RankChoices, CheckTask], ids=lambda kind: kind.__name__
)
def test_what_computes_has_longer_to_answer_than_what_only_looks(kind):
    assert codec.timeout_s(kind) >= 60.0 > codec.timeout_s(GetEngine)


def test_stop_has_the_shortest_time_to_answer():
    assert all(codec.timeout_s(Stop) <= codec.timeout_s(kind) for kind in codec.DAEMON_CALLS + codec.ENGINE_CALLS)
