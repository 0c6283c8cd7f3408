"""Local topics and calls."""

import threading

import msgpack
import pytest
import zmq

from handrail import messages
from handrail.topics import Caller, Publisher, RefusedError, Service, Subscriber, Unreachable, refuse


@pytest.fixture
def context():
    context = zmq.Context()
    yield context
    context.destroy(linger=0)


@pytest.fixture
def service(context, request):
    handled = []

    def handle(message):
        handled.append(message)
        if isinstance(message, messages.CancelAction):
            raise refuse("no such action", "id", message.id, "the id of a running action")

    endpoint = f"inproc://{request.node.name}"
    service = Service(endpoint, messages.Stop | messages.CancelAction, handle, context=context)
    running = threading.Event()

    def serve():
        while not running.is_set():
            service.poll(0.02)

    thread = threading.Thread(target=serve)
    thread.start()
    yield endpoint, handled
    running.set()
    thread.join()
    service.close()


def test_a_call_is_answered(context, service):
    endpoint, handled = service
    caller = Caller(endpoint, context=context)
    assert isinstance(caller.call(messages.Stop(reason="test")), messages.Ok)
    assert handled == [messages.Stop(reason="test")]


def test_a_refusal_names_field_value_and_expectation(context, service):
    caller = Caller(service[0], context=context)
    with pytest.raises(RefusedError) as refused:
        caller.call(messages.CancelAction(id="a9"))
    assert refused.value.refusal.field == "id"
    assert "a9" in str(refused.value)
    assert "running action" in str(refused.value)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        msgpack.packb({"type": "Format", "disk": 1}),
        msgpack.packb({"type": "Stop", "reason": 5}),
        b"\x91" * 100_000,
    ],
)
def test_malformed_calls_are_refused_and_never_handled(context, service, payload):
    endpoint, handled = service
    socket = context.socket(zmq.DEALER)
    socket.connect(endpoint)
    socket.send(payload)
    assert socket.poll(2000)
    assert msgpack.unpackb(socket.recv())["type"] == "Refused"
    assert handled == []
    socket.close(0)


def test_a_silent_service_is_said_to_be_unreachable(context):
    socket = context.socket(zmq.ROUTER)
    socket.bind("inproc://silent")
    caller = Caller("inproc://silent", timeout_s=0.05, context=context)
    with pytest.raises(Unreachable, match="Stop: no answer"):
        caller.call(messages.Stop())
    caller.close()
    socket.close(0)


def test_a_late_answer_is_never_taken_for_the_next_calls(context):
    router = context.socket(zmq.ROUTER)
    router.bind("inproc://late")
    caller = Caller("inproc://late", timeout_s=0.05, context=context)
    with pytest.raises(Unreachable):
        caller.call(messages.GetRobot())
    identity, _ = router.recv_multipart()
    router.send_multipart([identity, msgpack.packb({"type": "Refused", "message": "late"})])
    answers = threading.Thread(
        target=lambda: router.send_multipart([router.recv_multipart()[0], msgpack.packb({"type": "Ok"})])
    )
    answers.start()
    assert isinstance(caller.call(messages.Stop(), timeout_s=30.0), messages.Ok)
    answers.join()
    router.close(0)


def test_a_subscriber_gets_only_the_types_it_asked_for(context):
    publisher = Publisher("inproc://events", context=context)
    subscriber = Subscriber("inproc://events", messages.Prompt | messages.PromptClosed, context=context)
    while not subscriber.socket.poll(5):  # a subscription takes a moment to arrive: publish until one gets through
        publisher.send(messages.LogLine(source="test", level="info", text="x"))
        publisher.send(messages.PromptClosed(id="p1"))
    assert {type(message) for message in subscriber.drain()} == {messages.PromptClosed}
    subscriber.close()
    publisher.close()


def test_a_busy_subscriber_is_given_every_event_but_of_a_stream_only_its_newest_value(context):
    publisher = Publisher("inproc://newest", context=context)
    subscriber = Subscriber("inproc://newest", messages.RobotState | messages.ActionEvent, context=context)

    def state(cycle):
        return messages.RobotState(time_ns=cycle, cycle=cycle, position=[], velocity=[], torque=[], command=[])

    while not subscriber.newest(0.005):  # a subscription takes a moment to arrive
        publisher.send(state(0))
    list(subscriber.drain())
    for cycle in range(1, 6):
        publisher.send(state(cycle))
        publisher.send(messages.ActionEvent(id=f"a{cycle}", state="running", time_ns=cycle, cycle=cycle))
    assert subscriber.socket.poll(2000)
    heard = subscriber.newest(0.0)
    assert [event.id for event in heard if isinstance(event, messages.ActionEvent)] == ["a1", "a2", "a3", "a4", "a5"]
    assert [event.cycle for event in heard if isinstance(event, messages.RobotState)] == [5]
    assert subscriber.newest(0.0) == []
    subscriber.close()
    publisher.close()
