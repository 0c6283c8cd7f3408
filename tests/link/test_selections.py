"""Events that a client has chosen: which, which of their fields, how often."""

from __future__ import annotations

import threading

import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

from handrail.link import keys
from handrail.link.selections import Part, Selection, Selections
from handrail.messages import Deploy, InstanceState, LogLine, Pose, RobotState, RunState
from handrail.watch import watch

_texts = st.text(alphabet="ab*|&=;,@!~?% \nä", max_size=6)


def state(cycle: int) -> RobotState:
    joints = [0.001 * cycle] * 32
    return RobotState(
        time_ns=cycle * 2_000_000, cycle=cycle, position=joints, velocity=joints, torque=joints, command=joints
    )


def run(status: str, active: list[str]) -> RunState:
    return RunState(run="run-1", deployment="d", program="press", hash="0", status=status, active=active)


@pytest.fixture
def robot(stand):
    daemon, engine = stand.daemon(), stand.engine()
    stand.gate()
    return daemon, engine, stand


def test_only_the_states_and_logs_that_were_chosen_come(robot):
    _, engine, stand = robot
    client = stand.client()
    with client.subscribe(
        Selection(LogLine, where={"level": ("warning", "error")}),
        Selection(RunState, where={"active": ("turning", "press*")}),
        timeout_s=30,
    ) as events:
        for level in ("info", "warning", "error"):
            engine.publish(LogLine(source="engine", level=level, text=f"one that is {level}"))
        for active in (["asking"], ["outer", "pressing"], ["turning"]):
            engine.publish(run("running", active))
        got = [events.next(30) for _ in range(4)]
    assert [each.level for each in got[:2]] == ["warning", "error"]
    assert [each.active for each in got[2:]] == [["outer", "pressing"], ["turning"]]


def test_chosen_fields_alone_travel(robot):
    daemon, _, stand = robot
    client = stand.client()
    with client.subscribe(RobotState, fields=["time_ns", "cycle"], timeout_s=30) as events:
        daemon.publish(state(7))
        assert events.next(30) == Part(kind="RobotState", values={"time_ns": 14_000_000, "cycle": 7})
        _, received = client.traffic
        assert 0 < client.traffic_by_kind["RobotState"] <= received
    assert received < 150, "bytes: its positions, velocities, torques take more than 1,000"


def test_what_nobody_chose_costs_the_link_nothing(robot):
    daemon, engine, stand = robot
    client = stand.client()
    with client.subscribe(LogLine, where={"level": "error"}, timeout_s=30) as events:
        _, before = client.traffic
        for cycle in range(200):
            daemon.publish(state(cycle))
            engine.publish(LogLine(source="engine", level="info", text="all is well"))
        engine.publish(LogLine(source="engine", level="error", text="it is not"))
        assert events.next(30).text == "it is not"
        _, after = client.traffic
    assert after - before < 150, "bytes, for 401 events of which one was chosen"


def test_another_clients_choice_is_not_sent_to_this_one(robot):
    _, engine, stand = robot
    everything, errors = stand.client(), stand.client()
    with (
        everything.events(LogLine, timeout_s=30) as all_lines,
        errors.subscribe(LogLine, where={"level": "error"}, timeout_s=30) as few,
    ):
        for number in range(20):
            engine.publish(LogLine(source="engine", level="info", text=str(number)))
        engine.publish(LogLine(source="engine", level="error", text="last"))
        assert [all_lines.next(30).text for _ in range(21)][-1] == "last"
        assert few.next(30).text == "last"
        assert few.next(0) is None


def test_what_a_peer_sends_that_is_no_subscription_ends_nobody_elses_choice(robot):
    _, engine, stand = robot
    chosen, own = Selection(LogLine, where={"level": ("error",)}), keys.for_client(stand.keys)
    with (
        stand.client().subscribe(chosen, timeout_s=30) as events,
        zmq.Context() as context,
        context.socket(zmq.XSUB) as peer,
    ):
        peer.setsockopt(zmq.LINGER, 0)
        peer.setsockopt(zmq.CURVE_SERVERKEY, own.server)
        peer.setsockopt(zmq.CURVE_PUBLICKEY, own.public)
        peer.setsockopt(zmq.CURVE_SECRETKEY, own.secret)
        peer.connect(f"tcp://127.0.0.1:{stand.port + 1}")
        peer.send(b"\x01sync.begun")
        assert peer.poll(30_000) and peer.recv_multipart()[0] == b"sync.begun"
        peer.send(b"\x05" + chosen.topic())
        peer.send_multipart([b"\x05", b"\x00" + chosen.topic()])
        peer.send(b"")
        peer.send(b"\x01sync.done")
        assert peer.poll(30_000) and peer.recv_multipart()[0] == b"sync.done"
        engine.publish(LogLine(source="engine", level="error", text="still heard"))
        assert events.next(30).text == "still heard"


def test_of_what_comes_more_often_than_chosen_the_newest_goes_when_it_is_due():
    chosen = Selections()
    topic = Selection(LogLine, rate=2.0).topic()
    chosen.add(topic)
    lines = [f"line {number}".encode() for number in range(100)]
    sent = []
    for number, line in enumerate(lines):  # at 20 Hz for 5 s
        now = number * 0.05
        sent += [(now, data) for _, data in chosen.due(now)] + [
            (now, data) for _, data in chosen.take(b"LogLine", line, now)
        ]
    assert [now for now, _ in sent] == pytest.approx([k * 0.5 for k in range(10)])
    assert [data for _, data in sent] == [lines[0], *(lines[10 * k - 1] for k in range(1, 10))]
    assert chosen.next_due_s == pytest.approx(5.0)
    assert [data for _, data in chosen.due(5.0)] == [lines[-1]], "the last one is never left out"
    assert chosen.next_due_s == float("inf")


def test_a_rate_counts_for_each_instance_by_itself(robot):
    _, engine, stand = robot
    client = stand.client()

    def moved(name: str, version: int) -> InstanceState:
        return InstanceState(
            name=name,
            template="wheel",
            template_hash="0",
            version=version,
            pose_in_world=Pose(),
            parameters={},
            joint_state={},
        )

    with client.subscribe(InstanceState, rate=0.01, timeout_s=30) as events:
        for version in (1, 2, 3):
            engine.publish(moved("wheel_1", version))
            engine.publish(moved("wheel_2", version))
        engine.publish(LogLine(source="engine", level="info", text="x"))
        assert {events.next(30).name, events.next(30).name} == {"wheel_1", "wheel_2"}
        assert events.next(0) is None


def test_a_last_value_is_told_to_who_chooses_it_late(robot):
    daemon, _, stand = robot
    client = stand.client()
    with client.events(RobotState, timeout_s=30) as all_of_it:
        daemon.publish(state(3))
        assert all_of_it.next(30).cycle == 3
    with client.subscribe(RobotState, fields=["cycle"], timeout_s=30) as events:
        assert events.next(30).values == {"cycle": 3}


def test_what_there_is_not_is_refused_before_it_is_sent(robot):
    client = robot[2].client()
    for wrong, why in (
        (lambda: client.subscribe(RobotState, fields=["elbow"]), "RobotState has no field 'elbow'; expected some of"),
        (lambda: client.subscribe(RobotState, where={"elbow": "1"}), "no field 'elbow'"),
        (lambda: client.subscribe(RobotState, rate=-1), "rate: got -1 Hz"),
        (lambda: client.subscribe(Deploy), "Deploy does not travel over the link"),
    ):
        with pytest.raises(ValueError, match=why):
            wrong()


@pytest.mark.parametrize(
    "topic", [b"~", b"~!", b"~Deploy!", b"~RobotState@x!", b"~RobotState;elbow!", b"~LogLine@0.5", b"~\xff!"]
)
def test_a_topic_that_is_no_selection_is_refused(topic):
    with pytest.raises(ValueError):
        Selections().add(topic)


@settings(max_examples=50, deadline=None)
@given(
    st.floats(0.01, 500).map(lambda rate: float(f"{rate:g}")) | st.just(0.0),
    st.lists(st.sampled_from(["time_ns", "text", "level"]), unique=True),
    st.dictionaries(st.sampled_from(["text", "source"]), st.lists(_texts, min_size=1, max_size=3).map(tuple)),
)
def test_a_selection_is_read_from_its_topic_as_it_was(rate, fields, where):
    chosen = Selection(LogLine, rate, tuple(fields), where)
    assert Selection.read(chosen.topic()) == chosen


def test_the_command_shows_what_was_chosen_and_what_it_cost(robot, capsys):
    _, engine, stand = robot
    done = threading.Event()

    def publish() -> None:
        while not done.wait(0.02):  # until the command has subscribed
            engine.publish(LogLine(source="engine", level="info", text="well"))
            engine.publish(LogLine(source="engine", level="error", text="badly"))

    publishing = threading.Thread(target=publish)
    publishing.start()
    try:
        watch(["LogLine"], fields="text", where=["level=error"], count=2, robot=stand.address, keys=stand.keys)
    finally:
        done.set()
        publishing.join()
    told = capsys.readouterr()
    assert told.out == '{"type":"LogLine","text":"badly"}\n' * 2
    assert told.err.startswith("2 events, ")
    with pytest.raises(SystemExit) as ended:
        watch(["LogLines"], robot=stand.address, keys=stand.keys)
    assert ended.value.code == 1
    assert "got 'LogLines', no type of events; expected some of ActionEvent" in capsys.readouterr().err
