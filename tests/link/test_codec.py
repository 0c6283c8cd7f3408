"""Payloads of the link: what is packed comes back; whatever else arrives is Malformed and nothing worse."""

from __future__ import annotations

import datetime

import msgpack
import msgspec
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from handrail.link import codec
from handrail.messages import (
    CheckIn,
    Deploy,
    Enable,
    FrameGoal,
    GroundTruth,
    HoldTime,
    PlaceInstance,
    PlanMotion,
    PlanPreview,
    PlanSegment,
    Pose,
    StartAction,
    Stop,
    spec,
)

CALLS = codec.Unpacker(codec.REMOTE_CALL, codec.LARGEST_CALL)
ANSWERS = codec.Unpacker(codec.REMOTE_ANSWER, codec.LARGEST_ANSWER)


def preview(knots: int) -> PlanPreview:
    segment = PlanSegment(
        name="turn", times=[0.1 * k for k in range(knots)], positions=[[0.5] * 9 for _ in range(knots)]
    )
    return PlanPreview(id="p", label="turn", joints=["j"] * 9, segments=[segment], made_from={"wheel_1": 2}, fresh=True)


def test_a_message_comes_back_as_it_was_sent():
    call = PlaceInstance(
        name="w", template="wheel", pose_in_world=Pose(position=(0.5, -0.3, 0.3)), parameters={"radius": 0.15}
    )
    assert CALLS.unpack(codec.Packer().pack(call)) == call


def test_a_goal_that_is_free_along_an_axis_can_be_asked_for_over_the_link():
    goal = FrameGoal(pose=Pose(position=(0.5, -0.3, 0.3)), below=(None, 0.02, 0.0), above=(None, 0.0, 0.0))
    call = PlanMotion(goals=[goal], arm="right")
    arrived = CALLS.unpack(codec.Packer().pack(call))
    codec.check_plain(arrived)
    assert arrived == call


def test_large_messages_are_compressed_and_small_ones_are_not():
    packer = codec.Packer()
    large = packer.pack(preview(500))
    assert large[:1] == b"\x01"
    assert len(large) < 0.5 * len(msgspec.msgpack.encode(preview(500)))
    assert ANSWERS.unpack(large) == preview(500)
    assert packer.pack(Enable())[:1] == b"\x00"


def test_any_messagepack_reader_reads_a_payload():
    assert msgpack.unpackb(codec.Packer().pack(Stop(reason="why"))[1:]) == {"type": "Stop", "reason": "why"}


@given(st.binary(max_size=300))
@settings(max_examples=400, deadline=None)
def test_arbitrary_bytes_are_malformed(noise):
    with pytest.raises(codec.Malformed):
        CALLS.unpack(noise)


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_a_message_with_bytes_changed_is_malformed_or_another_valid_call(data):
    payload = bytearray(
        codec.Packer().pack(Deploy(program="turn_valve", bindings={"arm": "right"}, parameters={"goal": 285.0}))
    )
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        message = CALLS.unpack(bytes(payload))
        codec.check_plain(message)
    except codec.Malformed:
        return
    assert spec(type(message)).remote


class TestABomb:
    def test_that_says_its_size_is_not_unpacked(self):
        bomb = zstandard.ZstdCompressor().compress(bytes(codec.LARGEST_CALL + 1))
        with pytest.raises(codec.Malformed, match="too large"):
            CALLS.unpack(b"\x01" + bomb)

    def test_that_hides_its_size_is_not_unpacked(self):
        bomb = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(1 << 26))
        with pytest.raises(codec.Malformed, match="too large"):
            CALLS.unpack(b"\x01" + bomb)

    def test_of_nesting_is_not_followed(self):
        deep = b"\x91" * 200_000
        call = msgspec.msgpack.encode({"type": "Deploy", "program": "p", "bindings": {}, "parameters": {"x": None}})
        with pytest.raises(codec.Malformed, match="nested"):
            CALLS.unpack(b"\x00" + call[:-1] + deep)


@pytest.mark.parametrize("kind", [StartAction, CheckIn, HoldTime, GroundTruth])
def test_messages_of_the_inside_are_not_known(kind):
    assert not spec(kind).remote
    with pytest.raises(codec.Malformed, match=kind.__name__):
        CALLS.unpack(b"\x00" + msgspec.msgpack.encode({"type": kind.__name__}))
    assert kind.__name__ not in codec.REMOTE_EVENTS


@pytest.mark.parametrize(
    "value",
    [
        float("nan"),
        float("-inf"),
        [1.0, {"deep": [float("inf")]}],
        b"bytes",
        {1: "key"},
        msgspec.msgpack.Ext(5, b"x"),
        datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC),
    ],
    ids=["nan", "infinity", "nested", "bytes", "number as key", "extension", "timestamp"],
)
def test_values_that_no_call_means_are_refused(value):
    call = Deploy(program="p", bindings={}, parameters={"x": value})
    with pytest.raises(codec.Malformed):
        codec.check_plain(CALLS.unpack(codec.Packer().pack(call)))


def test_a_wrong_field_is_named():
    payload = b"\x00" + msgspec.msgpack.encode(
        {"type": "PlaceInstance", "name": "w", "template": "t", "pose_in_world": {"position": [0, 0]}}
    )
    with pytest.raises(codec.Malformed) as caught:
        CALLS.unpack(payload)
    assert caught.value.where == "pose_in_world.position"
