"""Point clouds as they travel: points as int16 steps from an origin, colours as bytes, both compressed.

Whoever reads one takes nothing on trust: sizes are checked before memory is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import zstandard

from handrail.messages import PointCloud

FINEST = 1e-3
"""m, of a step; larger where the cloud is too wide for it"""
_REACH = 32_767
_LEVEL = 3


@dataclass(frozen=True)
class Points:
    """A cloud unpacked."""

    positions: np.ndarray
    """m, world frame, float32 (n, 3)"""
    colours: np.ndarray | None
    """uint8 (n, 3) red, green, blue; None where the camera has none"""


def pack(
    camera: str, time_ns: int, positions: np.ndarray, colours: np.ndarray | None, origin: tuple[float, float, float]
) -> PointCloud:
    """A cloud of `positions` (n, 3) m in the world with `colours` uint8 (n, 3), counted from `origin`: best the camera's place."""
    offsets = np.asarray(positions, float).reshape(-1, 3) - origin
    if not np.isfinite(offsets).all():
        raise ValueError("positions: got a number that is not finite; expected m, finite")
    if colours is not None and colours.shape != offsets.shape:
        raise ValueError(f"colours: got shape {colours.shape}; expected {offsets.shape}, one row a point")
    widest = float(np.abs(offsets).max(initial=0.0))
    step = max(FINEST, widest / _REACH)
    compress = zstandard.ZstdCompressor(level=_LEVEL, write_content_size=True).compress
    return PointCloud(
        camera=camera,
        time_ns=time_ns,
        resolution=step,
        origin=origin,
        count=len(offsets),
        points=compress(np.rint(offsets / step).astype("<i2").tobytes()),
        colours=b"" if colours is None else compress(np.ascontiguousarray(colours, np.uint8).tobytes()),
    )


def unpack(cloud: PointCloud) -> Points:
    """The points of a cloud. Raises ValueError, naming the field, for bytes that are not what the message says."""
    steps = np.frombuffer(_expand("points", cloud.points, 6 * cloud.count), "<i2").reshape(-1, 3)
    positions = (steps * cloud.resolution + np.asarray(cloud.origin)).astype(np.float32)
    if not np.isfinite(positions).all():
        raise ValueError(f"origin, resolution: got {cloud.origin}, {cloud.resolution}; expected m, finite")
    if not cloud.colours:
        return Points(positions, None)
    colours = np.frombuffer(_expand("colours", cloud.colours, 3 * cloud.count), np.uint8).reshape(-1, 3)
    return Points(positions, colours)


def _expand(field: str, packed: bytes, size: int) -> bytes:
    try:
        told = zstandard.frame_content_size(packed)
        if told != size:
            raise ValueError(f"{field}: unpacks to {told} bytes; expected {size}, as count says")
        # Zero means "unknown, as much as it takes" to the library: an empty cloud is known to be empty.
        return (
            zstandard.ZstdDecompressor().decompress(packed, max_output_size=size, allow_extra_data=False)
            if size
            else b""
        )
    except zstandard.ZstdError as error:
        raise ValueError(f"{field}: not zstd: {error}") from error
