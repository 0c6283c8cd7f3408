"""What a depth camera sees, as a picture from where it stands: its cloud in perspective, near points over far ones."""

from __future__ import annotations

import numpy as np

_POINT = 0.005  # m, as cameras thin their clouds out
_NEAREST = 0.05  # m
_MOST = 25_000  # points: as many as can be told apart in an inset
_WIDEST = 3  # pixels that a point reaches to each side at most
_MARGIN = 1.05
_GROUND = (13, 18, 23)


def picture(
    positions: np.ndarray, colours: np.ndarray | None, camera: tuple[float, float, float], width: int, height: int
) -> np.ndarray:
    """uint8 (height, width, 3), red, green, blue.

    The camera looks to the middle of what it sees, with the world's z upwards: how it is turned is not told with a cloud.
    Points without colours are the paler the nearer.

    :param positions: m, world frame, (n, 3)
    :param colours: uint8 (n, 3), or None
    :param camera: m, world frame: where it stands
    """
    image = np.full((height, width, 3), _GROUND, np.uint8)
    stride = max(1, -(-len(positions) // _MOST))
    ways = np.asarray(positions[::stride], float) - camera
    distance = np.linalg.norm(ways, axis=1)
    far = distance > _NEAREST
    ways, distance = ways[far], distance[far]
    shades = None if colours is None else colours[::stride][far]
    if not len(ways):
        return image
    right, up, ahead = _axes((ways / distance[:, None]).mean(axis=0))
    depth = ways @ ahead
    before = depth > _NEAREST
    ways, depth = ways[before], depth[before]
    if not len(ways):
        return image
    x, y = ways @ right / depth, ways @ up / depth
    # Nearly all of it fits: a single stray point does not make everything small.
    half = max(np.percentile(np.abs(x), 99) / width, np.percentile(np.abs(y), 99) / height, 1e-3 / width) * _MARGIN
    focal = 0.5 / half
    columns = np.rint(width / 2 + focal * x).astype(int)
    rows = np.rint(height / 2 - focal * y).astype(int)
    shades = _by_depth(depth) if shades is None else shades[before]
    reach = np.clip(np.rint(0.5 * _POINT * stride**0.5 * focal / depth), 0, _WIDEST).astype(int)
    order = np.argsort(-depth)
    columns, rows, shades, reach = columns[order], rows[order], shades[order], reach[order]
    # Around each point in turn, so that the nearest is written last in every pixel.
    sides = np.arange(-reach.max(), reach.max() + 1)
    touched = np.full((height, width), -1)
    for down in sides:
        for across in sides:
            covers = reach >= max(abs(down), abs(across))
            r, c, which = rows[covers] + down, columns[covers] + across, np.flatnonzero(covers)
            inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
            layer = np.full((height, width), -1)
            layer[r[inside], c[inside]] = which[inside]  # of several in one pixel the last stays
            np.maximum(touched, layer, out=touched)
    drawn = touched >= 0
    image[drawn] = shades[touched[drawn]]
    return image


def _axes(ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and ahead of a camera that looks along `ahead`, upright; unit vectors."""
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    if np.linalg.norm(right) < 1e-3:  # straight up or down: the world's x is up
        right = np.cross(ahead, (1.0, 0.0, 0.0))
    right /= np.linalg.norm(right)
    return right, np.cross(right, ahead), ahead


def _by_depth(depth: np.ndarray) -> np.ndarray:
    low, high = np.percentile(depth, (1, 99))
    shade = np.clip(230 - 170 * (depth - low) / max(high - low, 1e-6), 60, 230)
    return np.repeat(shade[:, None], 3, axis=1).astype(np.uint8)
