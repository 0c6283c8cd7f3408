"""Messages: every one states how it travels and can be read by any MessagePack library."""

import msgpack
import msgspec
import pytest

from handrail import messages
from handrail.messages import Message

CALLS_AND_EVENTS = [
    *messages.DaemonCall.__args__,
    *messages.DaemonEvent.__args__,
    *messages.EngineCall.__args__,
    *messages.EngineEvent.__args__,
    *messages.GuestCall.__args__,
    *messages.ServiceCall.__args__,
    *messages.GateCall.__args__,
    messages.PointCloud,
    messages.GroundTruth,
]


@pytest.mark.parametrize("kind", CALLS_AND_EVENTS, ids=lambda kind: kind.__name__)
def test_every_message_says_how_it_travels(kind):
    spec = messages.spec(kind)
    assert 0 <= spec.priority <= 7
    assert spec.reliable or spec.superseded_by
    for field in spec.superseded_by:
        assert field == "type" or field in kind.__struct_fields__


def test_nothing_outranks_stop():
    assert messages.spec(messages.Stop).priority == 0
    assert [kind for kind in CALLS_AND_EVENTS if messages.spec(kind).priority == 0] == [messages.Stop]


def test_the_ground_truth_never_crosses_the_link():
    assert not messages.spec(messages.GroundTruth).remote


def test_the_msgpack_package_reads_what_we_write():
    event = messages.ActionEvent(id="a1", state="ended", time_ns=2, cycle=1, outcome="done", position=[0.5])
    assert msgpack.unpackb(msgspec.msgpack.encode(event)) == {
        "type": "ActionEvent",
        "id": "a1",
        "state": "ended",
        "time_ns": 2,
        "cycle": 1,
        "outcome": "done",
        "detail": "",
        "position": [0.5],
        "command": [],
        "path_force": 0.0,
        "speed": 1.0,
        "step": "",
    }


def test_an_unknown_field_is_refused():
    packed = msgpack.packb({"type": "Stop", "reason": "", "really": True})
    with pytest.raises(msgspec.ValidationError, match="really"):
        msgspec.msgpack.decode(packed, type=messages.Stop)


def test_every_message_class_is_a_call_an_event_or_an_answer():
    known = {*CALLS_AND_EVENTS, *messages.Answer.__args__}
    assert {kind for kind in Message.__subclasses__() if kind.__module__.startswith("handrail.messages")} == known
