"""A picture of a template: its solids, its joints' axes, and the hand at every waypoint of a trajectory, with names.

A small rasteriser of triangles of its own: no screen, no GPU, no plant.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from affordance_templates.placement import Array, placed, pointing, shortest_turn
from affordance_templates.template import ResolvedTemplate, ResolvedTrajectory, Shape

WIDTH, HEIGHT = 960, 720
_FINER = 2
"""pixels across a pixel of the picture"""
_BACKGROUND = (236, 239, 242)
_AXIS_COLOUR, _TEXT = (0.95, 0.55, 0.1, 1.0), (30, 40, 50)
_HANDS = ((0.10, 0.45, 0.85, 1.0), (0.15, 0.62, 0.35, 1.0), (0.62, 0.25, 0.72, 1.0), (0.85, 0.35, 0.25, 1.0))
_LIGHT = np.array([-0.45, -0.55, 0.7])
_LENS = 1.9
"""focal length over half the picture's height"""

_LETTERS, _LINE = 14, 18  # pixels

Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Solid:
    mesh: trimesh.Trimesh
    colour: Colour


def solid(shape: Shape) -> trimesh.Trimesh:
    """A shape's surface in the template's frame, m."""
    match shape.kind:
        case "box":
            mesh = trimesh.creation.box(extents=shape.size)
        case "cylinder":
            mesh = trimesh.creation.cylinder(radius=shape.size[0], height=shape.size[1], sections=32)
        case "capsule":
            mesh = trimesh.creation.capsule(radius=shape.size[0], height=shape.size[1], count=[24, 12])
            mesh.apply_translation(-mesh.bounds.mean(axis=0))
        case "sphere":
            mesh = trimesh.creation.icosphere(subdivisions=3, radius=shape.size[0])
        case "torus":
            mesh = trimesh.creation.torus(shape.size[0], shape.size[1], major_sections=64, minor_sections=16)
        case "mesh":
            mesh = trimesh.load_mesh(shape.file)
            mesh.apply_scale(shape.size)
    mesh.apply_transform(shape.pose_in_template)
    return mesh


def render(resolved: ResolvedTemplate, trajectories: Sequence[str] = (), *, yaw: float = -140.0) -> NDArray[np.uint8]:
    """The template seen from behind the operator's shoulder, (720, 960, 3).

    :param trajectories: whose waypoints are drawn
    :param yaw: deg, where the eye stands about the template's z, from its x
    :raises ValueError: a trajectory that is not there
    """
    solids = [_Solid(solid(shape), shape.color) for shape in resolved.shapes]
    size = min(0.25, _extent(solids))
    solids += [_axis(joint.origin, joint.axis, size) for joint in resolved.joints.values()]
    labels = [(joint.origin + joint.axis * 0.55 * size, name) for name, joint in resolved.joints.items()]
    for number, name in enumerate(trajectories):
        if name not in resolved.trajectories:
            raise ValueError(f"trajectory: got {name!r}; expected one of {', '.join(resolved.trajectories) or 'none'}")
        colour = _HANDS[number % len(_HANDS)]
        solids += _hands(resolved.trajectories[name], colour, size)
        labels += _labels(resolved.trajectories[name])
    eye = _Eye(solids, yaw)
    picture = _Canvas(eye)
    for each in solids:
        picture.draw(each)
    return picture.finished(labels)


def _extent(solids: Iterable[_Solid]) -> float:
    """m, how large it is about; of nothing 0.3"""
    corners = [bounds for each in solids for bounds in each.mesh.bounds]
    return max(0.08, float(np.ptp(np.array(corners), axis=0).max())) if corners else 0.3


def _axis(origin: Array, axis: Array, size: float) -> _Solid:
    mesh = trimesh.creation.cylinder(radius=0.006 * size, height=1.1 * size, sections=8)
    mesh.apply_transform(placed(origin, shortest_turn((0.0, 0.0, 1.0), axis)))
    return _Solid(mesh, _AXIS_COLOUR)


def _hands(trajectory: ResolvedTrajectory, colour: Colour, size: float) -> list[_Solid]:
    """A two-fingered hand at each waypoint, and the way between them."""
    scale = min(0.12, 0.35 * size)
    parts = [
        ((0.25, 0.9, 0.15), (0.0, 0.0, 0.75)),
        ((0.2, 0.1, 0.6), (0.0, 0.4, 0.4)),
        ((0.2, 0.1, 0.6), (0.0, -0.4, 0.4)),
    ]
    found = []
    before = None
    for waypoint in trajectory.waypoints:
        pose = waypoint.pose_in_template
        for extents, centre in parts:
            mesh = trimesh.creation.box(extents=np.array(extents) * scale)
            mesh.apply_translation(np.array(centre) * scale)
            mesh.apply_transform(pose)
            found.append(_Solid(mesh, colour))
        here = waypoint.position
        if before is not None and (length := float(np.linalg.norm(here - before))) > 1e-4:
            way = trimesh.creation.cylinder(radius=0.03 * scale, height=length, sections=8)
            way.apply_transform(placed((here + before) / 2, shortest_turn((0.0, 0.0, 1.0), (here - before) / length)))
            found.append(_Solid(way, colour))
        before = here
    return found


def _labels(trajectory: ResolvedTrajectory) -> list[tuple[Array, str]]:
    """Names where the waypoints are; of several at one place all in one."""
    found: list[tuple[Array, str]] = []
    for waypoint in trajectory.waypoints:
        for k, (place, text) in enumerate(found):
            if np.linalg.norm(place - waypoint.position) < 0.01:
                found[k] = (place, f"{text}, {waypoint.name}")
                break
        else:
            found.append((waypoint.position, waypoint.name))
    return found


class _Eye:
    """A pinhole that sees everything."""

    def __init__(self, solids: Sequence[_Solid], yaw: float):
        points = np.vstack([each.mesh.vertices for each in solids]) if solids else np.zeros((1, 3))
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        angle, height = np.deg2rad(yaw), np.deg2rad(24.0)
        back = np.array([np.cos(angle) * np.cos(height), np.sin(angle) * np.cos(height), np.sin(height)])
        self.rotation = pointing(
            -back, np.cross(back, np.cross([0.0, 0.0, 1.0], back))
        ).T  # x right, y up, z towards the eye
        radius = max(0.05, float(np.linalg.norm(points - centre, axis=1).max()))
        self.place = centre + back * radius * (_LENS + 0.25)

    def seen(self, points: Array) -> Array:
        """(k, 3): pixels right and down, and m away."""
        local = (points - self.place) @ self.rotation.T
        away = np.maximum(-local[:, 2], 1e-6)
        half = HEIGHT * _FINER / 2
        right = WIDTH * _FINER / 2 + local[:, 0] / away * _LENS * half
        return np.column_stack([right, half - local[:, 1] / away * _LENS * half, away])


class _Canvas:
    """Pixels with depths."""

    def __init__(self, eye: _Eye):
        self._eye = eye
        self._depth = np.full((HEIGHT * _FINER, WIDTH * _FINER), np.inf)
        self._colour = np.full((HEIGHT * _FINER, WIDTH * _FINER, 3), _BACKGROUND, np.float32)

    def draw(self, thing: _Solid) -> None:
        """A solid, lit from the upper left; what is half transparent is mixed with what lies behind it."""
        corners = self._eye.seen(np.asarray(thing.mesh.vertices))[thing.mesh.faces]
        normals = np.asarray(thing.mesh.face_normals)
        light = 0.45 + 0.55 * np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
        centres = np.asarray(thing.mesh.triangles_center)
        facing = np.einsum("ij,ij->i", normals, self._eye.place - centres) > 0
        base = np.array(thing.colour[:3]) * 255
        for number in np.flatnonzero(facing):
            self._triangle(corners[number], base * light[number], thing.colour[3])

    def _triangle(self, corners: Array, colour: Array, opacity: float) -> None:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(area) < 1e-9:
            return
        left, right = max(0, int(corners[:, 0].min())), min(self._depth.shape[1] - 1, int(corners[:, 0].max()) + 1)
        top, bottom = max(0, int(corners[:, 1].min())), min(self._depth.shape[0] - 1, int(corners[:, 1].max()) + 1)
        if right < left or bottom < top:
            return
        x, y = np.arange(left, right + 1)[None, :] + 0.5, np.arange(top, bottom + 1)[:, None] + 0.5
        b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
        c = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
        # What is linear on the screen is the inverse of the distance.
        depth = 1.0 / np.maximum((1 - b - c) / az + b / bz + c / cz, 1e-9)
        window = (slice(top, bottom + 1), slice(left, right + 1))
        drawn = (b >= 0) & (c >= 0) & (b + c <= 1) & (depth < self._depth[window])
        self._colour[window][drawn] = self._colour[window][drawn] * (1 - opacity) + colour * opacity
        self._depth[window][drawn] = depth[drawn]

    def finished(self, labels: Iterable[tuple[Array, str]]) -> NDArray[np.uint8]:
        """The picture in its own size with names at places (3,) m; none over another."""
        whole = self._colour.reshape(HEIGHT, _FINER, WIDTH, _FINER, 3).mean(axis=(1, 3))
        image = Image.fromarray(whole.round().astype(np.uint8))
        pen, taken = ImageDraw.Draw(image), list[tuple[float, float, float, float]]()
        font = ImageFont.load_default(_LETTERS)
        for place, text in labels:
            x, y, _ = (self._eye.seen(place[None])[0] / _FINER).tolist()
            width = pen.textlength(text, font=font)
            x, y = min(max(4.0, x + 8), WIDTH - width - 4), min(max(4.0, y - 6), HEIGHT - 20.0)
            while any(
                x < right and left < x + width and y < low and high < y + _LINE for left, high, right, low in taken
            ):
                y += _LINE
            taken.append((x, y, x + width, y + _LINE))
            pen.rectangle((x - 2, y, x + width + 2, y + _LINE - 1), fill=(255, 255, 255))
            pen.text((x, y), text, fill=_TEXT, font=font)
        return np.asarray(image)
