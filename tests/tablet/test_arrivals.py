"""The inbox between the network's threads and the window."""

from __future__ import annotations

from handrail.messages import GetEngine, LogLine
from tablet_client.models.arrivals import EngineAttached, Inbox


def test_of_a_stream_only_the_newest_message_waits(robot):
    inbox = Inbox()
    for _ in range(1000):
        inbox.put(robot.state())
    last = robot.state(head_1_joint=0.7)
    inbox.put(last)
    assert inbox.take() == [last]


def test_streams_with_a_key_keep_one_message_a_key(robot):
    inbox = Inbox()
    inbox.put(robot.wheel(name="a", version=1))
    inbox.put(robot.wheel(name="b", version=1))
    inbox.put(robot.wheel(name="a", version=2))
    assert [(state.name, state.version) for state in inbox.take()] == [("b", 1), ("a", 2)]


def test_reliable_messages_all_arrive_in_order(robot):
    inbox = Inbox()
    runs = [robot.running(active=[str(number)]) for number in range(50)]
    for run in runs:
        inbox.put(run)
        inbox.put(robot.state())
    assert [item for item in inbox.take() if item in runs] == runs


def test_the_window_is_woken_once_until_it_has_looked(robot):
    woken: list[None] = []
    inbox = Inbox(lambda: woken.append(None))
    for _ in range(10):
        inbox.put(robot.running())
    assert len(woken) == 1
    inbox.take()
    inbox.put(robot.running())
    assert len(woken) == 2


def test_what_happens_while_a_snapshot_is_fetched_comes_after_it(robot):
    inbox = Inbox()
    inbox.hold()
    inbox.put(robot.prompt())
    assert inbox.take() == []
    snapshot = EngineAttached(robot.connect().call(GetEngine()))
    inbox.release(snapshot)
    assert inbox.take() == [snapshot, robot.prompt()]


def test_a_window_that_never_looks_costs_bounded_memory():
    inbox = Inbox(limit=100)
    for number in range(1000):
        inbox.put(LogLine(source="engine", level="info", text=str(number)))
    assert inbox.dropped == 900
    assert inbox.take()[-1].text == "999"
