"""Point clouds on their way: what a camera packed is what the operator's side unpacks, and nothing else is taken."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from handrail import cloud
from handrail.messages import PointCloud

ORIGIN = (0.15, -0.02, 0.56)


def scattered(count: int = 500, reach: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(5)
    return draw.uniform(-reach, reach, (count, 3)), draw.integers(0, 256, (count, 3), np.uint8)


def some(count: int = 500) -> PointCloud:
    return cloud.pack("head", 7, *scattered(count), ORIGIN)


@pytest.mark.parametrize("reach", [3.0, 100.0])
def test_points_come_back_to_half_a_step_and_colours_as_they_were(reach):
    positions, colours = scattered(reach=reach)
    sent = cloud.pack("head", 7, positions, colours, ORIGIN)
    points = cloud.unpack(sent)
    assert np.abs(points.positions - positions).max() <= sent.resolution / 2 + 1e-5
    assert sent.resolution == pytest.approx(1e-3) or reach > 30
    np.testing.assert_array_equal(points.colours, colours)


def test_a_camera_without_colours_and_one_that_sees_nothing_are_carried_too():
    positions, _ = scattered()
    assert cloud.unpack(cloud.pack("head", 7, positions, None, ORIGIN)).colours is None
    nothing = cloud.pack("head", 7, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), ORIGIN)
    assert nothing.count == 0 and len(cloud.unpack(nothing).positions) == 0


def test_what_is_no_cloud_is_not_packed():
    with pytest.raises(ValueError, match="positions"):
        cloud.pack("head", 7, np.full((1, 3), np.nan), None, ORIGIN)
    with pytest.raises(ValueError, match="colours"):
        cloud.pack("head", 7, np.zeros((2, 3)), np.zeros((1, 3), np.uint8), ORIGIN)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"count": 501}, "points"),
        ({"count": 0}, "points"),
        ({"points": b"no zstd"}, "points"),
        ({"points": zstandard.ZstdCompressor(write_content_size=False).compress(bytes(3000))}, "points"),
        ({"points": zstandard.ZstdCompressor().compress(bytes(1 << 26))}, "points"),
        ({"colours": zstandard.ZstdCompressor().compress(bytes(3))}, "colours"),
        ({"resolution": 1e300, "origin": (float("inf"), 0.0, 0.0)}, "origin"),
    ],
    ids=["too many", "none", "no zstd", "hides its size", "bomb", "too few colours", "not finite"],
)
def test_a_cloud_that_is_not_what_it_says_is_refused_by_field(changes, named):
    with pytest.raises(ValueError, match=named), np.errstate(all="ignore"):
        cloud.unpack(msgspec.structs.replace(some(), **changes))


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_bytes_changed_on_the_way_end_in_a_refusal_or_in_a_cloud_of_as_many_points(data):
    sent = some(50)
    packed = bytearray(sent.points)
    for _ in range(data.draw(st.integers(1, 4))):
        packed[data.draw(st.integers(0, len(packed) - 1))] = data.draw(st.integers(0, 255))
    try:
        points = cloud.unpack(msgspec.structs.replace(sent, points=bytes(packed)))
    except ValueError:
        return
    assert points.positions.shape == (50, 3)


def test_clouds_reach_a_client_and_one_that_comes_late_gets_the_last_of_each_camera(stand):
    sensors, _ = stand.sensors(), stand.gate()
    first, second = some(), msgspec.structs.replace(some(), camera="wrist")
    with stand.client().events(PointCloud) as early:
        for sent in (first, second):
            sensors.send(sent)
        assert [early.next(5), early.next(5)] == [first, second]
    late = stand.client().events(PointCloud)
    assert {late.next(5).camera, late.next(5).camera} == {"head", "wrist"}


def test_of_a_cameras_clouds_only_the_newest_waits_for_a_slow_client(stand):
    sensors, _ = stand.sensors(), stand.gate()
    stream = stand.client().events(PointCloud)
    for number in range(100):
        sensors.send(msgspec.structs.replace(some(), time_ns=number))
    times = [stream.next(5).time_ns]
    while times[-1] != 99:
        times.append(stream.next(5).time_ns)
    assert len(times) < 50


def test_foxglove_gets_positions_and_colours_at_their_offsets():
    from handrail import foxglove

    positions, colours = scattered(4)
    written = foxglove.point_cloud(1_500_000_000, "base_link", cloud.Points(positions.astype(np.float32), colours))
    data = json.loads(msgspec.json.encode(written))
    assert {field["name"]: (field["offset"], field["type"]) for field in data["fields"]} == {
        **{"x": (0, 7), "y": (4, 7), "z": (8, 7)},
        **{"red": (12, 1), "green": (13, 1), "blue": (14, 1), "alpha": (15, 1)},
    }
    rows = np.frombuffer(msgspec.json.decode(msgspec.json.encode(data["data"]), type=bytes), np.uint8).reshape(4, 16)
    assert data["point_stride"] == 16
    np.testing.assert_allclose(rows[:, :12].copy().view("<f4"), positions, rtol=1e-6)
    np.testing.assert_array_equal(rows[:, 12:15], colours)
    assert (rows[:, 15] == 255).all()
