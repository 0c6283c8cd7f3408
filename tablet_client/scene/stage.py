"""What the 3-D view shows: the robot where it is, the ghost where it would go, the templates where they are believed to stand."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import Property, QObject, Signal, Slot
from PySide6.QtGui import QQuaternion, QVector3D

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from handrail.config import ConfigError
from handrail.messages import InstanceState, Pose, RobotInfo
from handrail.robot.description import RobotDescription
from tablet_client.models import handle
from tablet_client.models.bench import Bench
from tablet_client.models.clouds import Seen
from tablet_client.models.move import Move
from tablet_client.models.plans import Track
from tablet_client.models.situation import Situation
from tablet_client.scene import marks, solids
from tablet_client.scene import robot as drawn
from tablet_client.scene.bodies import Bodies, placed
from tablet_client.scene.geometry import Cloud, LineGeometry, MeshGeometry
from tablet_client.scene.meshes import EMPTY, Mesh

_GRID = (0.42, 0.5, 0.58, 0.55)
_FRESH, _STALE = (0.35, 0.72, 1.0, 1.0), (1.0, 0.36, 0.32, 1.0)
_TRAIL_SAMPLES = 160
_TRAIL_RADIUS = 0.0035  # m
# A ghost's body that coincides with the robot's would flicker: it is left out until it is this far away.
_APART = 0.004  # m
_TURNED = 0.02  # rad
# A robot that holds still trembles by its sensors' noise: less than this (a tenth of a millimetre at the hand) is not drawn anew.
_STILL = 1.5e-4  # rad
_BASE_STILL = 2e-4  # m, and of its axes
DIFFERS = "differs"
_LIST: Any = "QVariantList"  # PySide takes the names of Qt's types; its stubs do not

Describe = Callable[[str], RobotDescription]


class Stage(QObject):
    """The scene's contents as QML sees them. `show` brings it up to date; robots load on a thread of their own."""

    changed = Signal()
    _loaded = Signal(object)
    _failed = Signal(str, str)
    _progressed = Signal(int, int)

    def __init__(self, describe: Describe, cache: Path):
        """`describe(name)` reads a robot's description; prepared meshes are kept in `cache`."""
        super().__init__()
        self._describe, self._cache = describe, cache
        self._robot: drawn.DrawnRobot | None = None
        self._asked = ""
        self._state, self._problem, self._progress = "none", "", 0.0
        self._bodies, self._ghost, self._templates, self._clouds = Bodies(), Bodies(), Bodies(), Bodies()
        self._waypoints, self._way = Bodies(), MeshGeometry()
        self._states: list[str | None] = []
        """of the drawn waypoints, by their reach"""
        self._marked: tuple[object, ...] = ()
        self._handles = Bodies()
        self._handles.replace([(part, MeshGeometry(marks.part(part))) for part in handle.PARTS])
        self._handle, self._handle_turn = QVector3D(), QQuaternion()
        self._selected = ""
        self._cloud_on = True
        self._drawn_clouds: dict[str, Seen] = {}
        self._trail = MeshGeometry()
        self._grid = LineGeometry(*solids.floor_grid(3.0, 0.25, _GRID))
        self._geometries: list[MeshGeometry] = []
        self._drawn_instances: dict[str, InstanceState] = {}
        self._problems: dict[str, str] = {}
        self._arrived = 0
        self._meshes: dict[str, Mesh] = {}
        self._drawn_pose: tuple[object, ...] = ()
        self._drawn_position, self._drawn_base = np.zeros(0), np.eye(4)
        self._base_source, self._base_problem = "fixed", ""
        self._closed = threading.Event()
        self._drawn_trail: tuple[object, ...] = ()
        self._ghost_shown = self._ghost_stale = False
        self._focus = QVector3D(0.3, -0.15, 0.15)
        self._loaded.connect(self._take_robot)
        self._failed.connect(self._take_failure)
        self._progressed.connect(self._take_progress)

    def _get(name: str) -> Callable[[Stage], object]:  # type: ignore[misc]
        return lambda self: getattr(self, name)

    bodies = Property(QObject, _get("_bodies"), constant=True)
    ghost = Property(QObject, _get("_ghost"), constant=True)
    templates = Property(QObject, _get("_templates"), constant=True)
    clouds = Property(QObject, _get("_clouds"), constant=True)
    cloudOn = Property(bool, _get("_cloud_on"), notify=changed)
    waypoints = Property(QObject, _get("_waypoints"), constant=True)
    way = Property(QObject, _get("_way"), constant=True)
    handles = Property(QObject, _get("_handles"), constant=True)
    """the parts of the handle"""
    handle = Property(QVector3D, _get("_handle"), notify=changed)
    """m, world: where the handle of the selected instance stands"""
    handleTurn = Property(QQuaternion, _get("_handle_turn"), notify=changed)
    selected = Property(str, _get("_selected"), notify=changed)
    trail = Property(QObject, _get("_trail"), constant=True)
    grid = Property(QObject, _get("_grid"), constant=True)
    state = Property(str, _get("_state"), notify=changed)
    """`none`, `loading`, `ready` or `failed`"""
    problem = Property(str, _get("_problem"), notify=changed)
    progress = Property(float, _get("_progress"), notify=changed)
    ghostShown = Property(bool, _get("_ghost_shown"), notify=changed)
    ghostStale = Property(bool, _get("_ghost_stale"), notify=changed)
    focus = Property(QVector3D, _get("_focus"), notify=changed)
    """m, world: the first template instance, where the work is"""

    baseSource = Property(str, _get("_base_source"), notify=changed)
    """what tells where the robot's base is: handrail.messages.Base.source"""
    baseProblem = Property(str, _get("_base_problem"), notify=changed)

    @Property(_LIST, notify=changed)
    def problems(self) -> list[dict[str, str]]:
        """Instances that are not drawn as the robot knows them: name and reason (`differs`: another version of the template)."""
        return [{"name": name, "why": why} for name, why in self._problems.items() if why]

    @Property(float, notify=changed)
    def floor(self) -> float:
        """m, world"""
        return self._robot.floor if self._robot else 0.0

    def show(self, situation: Situation) -> bool:
        """Draw what the models know. True when that needs a new frame."""
        replay, info, state = situation.replay, situation.robot.info, situation.robot.state
        if replay.active and info is not None:
            state = replay.state(info.joints) or state
        if info is not None and info.name != self._asked:
            self._load(info.name)
        shown = replay.instances() if replay.active else situation.bench.shown()
        moved = self._show_instances(shown, situation.templates.arrived)
        moved |= self._show_bench(situation.bench, situation.move)
        moved |= self._show_clouds({} if replay.active else situation.clouds.seen)
        if self._robot is None or state is None or info is None:
            return moved
        situation.hands.spans = self._robot.grippers
        plans, told = situation.plans, state.base
        source, problem = ("fixed", "") if told is None else (told.source, told.problem)
        if (source, problem) != (self._base_source, self._base_problem):
            self._base_source, self._base_problem = source, problem
            self.changed.emit()
            moved = True
        position, base = self._ordered(info.joints, state.position), _matrix(state.base_in_world)
        if situation.robot.state is not None:
            self._meet(situation, info)
        by_hand = situation.move.posture
        pose = (self._robot, plans.shown, plans.time, situation.move.stamp, replay.active)
        still = np.abs(base - self._drawn_base).max() < _BASE_STILL
        if pose == self._drawn_pose and still and np.abs(position - self._drawn_position).max() < _STILL:
            return moved
        self._drawn_pose, self._drawn_position, self._drawn_base = pose, position, base
        poses = base @ self._robot.chain.poses(position)
        self._bodies.pose(poses)
        if replay.active:
            self._tell_ghost(False, False)
            self._ghost.hide()
            self._draw_trail(None, ())
        elif by_hand is None:
            self._show_ghost(situation, position, poses)
        else:
            self._tell_ghost(True, not situation.move.reached)
            self._draw_trail(None, ())
            self._place_ghost(by_hand, poses)
        return True

    def solids(self) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """Every instance as it is drawn: name, vertices (n, 3) m in the world, triangles (f, 3)."""
        found = []
        for name, state in self._drawn_instances.items():
            mesh = self._meshes.get(name, EMPTY).transformed(_matrix(state.pose_in_world))
            found.append((name, mesh.vertices.astype(float), mesh.faces))
        return found

    @Slot(bool)
    def showCloud(self, on: bool) -> None:
        """Show what the depth cameras see, or not."""
        self._cloud_on = on
        self.changed.emit()

    @property
    def loaded(self) -> bool:
        """True once the robot is drawn."""
        return self._robot is not None

    def close(self) -> None:
        """Nothing that is still loading will be shown."""
        self._closed.set()

    # ---------------------------------------------------------------------------------------------------------- robot

    def _load(self, name: str) -> None:
        self._asked, self._state, self._progress, self._problem = name, "loading", 0.0, ""
        self._robot = None
        self._bodies.replace([])
        self._ghost.replace([])
        self.changed.emit()

        def tell(signal: Any, *values: object) -> None:
            if not self._closed.is_set():
                with contextlib.suppress(RuntimeError):  # Qt's half of this object has just gone
                    signal.emit(*values)

        def work() -> None:
            try:
                robot = drawn.load(self._describe(name), self._cache, lambda done, of: tell(self._progressed, done, of))
            except (ConfigError, OSError, ValueError, KeyError) as error:
                tell(self._failed, name, str(error))
            else:
                tell(self._loaded, robot)

        threading.Thread(target=work, name="tablet-model", daemon=True).start()

    def _take_robot(self, robot: drawn.DrawnRobot) -> None:
        if robot.name != self._asked:
            return
        self._robot = robot
        self._geometries = [MeshGeometry(mesh) for mesh in robot.meshes]
        named = list(zip(robot.chain.bodies, self._geometries, strict=True))
        self._bodies.replace(named)
        self._ghost.replace(named)
        self._ghost.hide()
        self._bodies.pose(robot.chain.poses(np.zeros(len(robot.chain.joints))))
        self._drawn_pose = ()
        self._state = "ready"
        self.changed.emit()

    def _take_failure(self, name: str, problem: str) -> None:
        if name == self._asked:
            self._state, self._problem = "failed", problem
            self.changed.emit()

    def _take_progress(self, done: int, of: int) -> None:
        self._progress = done / max(of, 1)
        self.changed.emit()

    def _meet(self, situation: Situation, info: RobotInfo) -> None:
        """Tell what is moved by hand which robot there is, and where it is commanded to be."""
        robot, state = self._robot, situation.robot.state
        assert robot is not None and state is not None
        lower, upper, pace = (
            self._ordered(info.joints, each) for each in (info.lower, info.upper, info.velocity_limit)
        )
        situation.move.meet(
            robot,
            robot.chain,
            robot.tips,
            robot.arm_joints,
            (lower, upper, pace),
            feet=robot.feet,
            cameras=robot.cameras,
        )
        command, on_feet = (
            self._ordered(info.joints, state.command),
            state.base is not None and state.base.source == "feet",
        )
        situation.move.stands(command, _matrix(state.base_in_world), situation.robot.moving, on_feet=on_feet)

    def _ordered(self, joints: list[str], position: list[float]) -> np.ndarray:
        """The robot's position in the order of the drawn chain."""
        assert self._robot is not None
        told = dict(zip(joints, position, strict=False))
        return np.array([told.get(joint, 0.0) for joint in self._robot.chain.joints])

    # ---------------------------------------------------------------------------------------------------------- ghost

    def _show_ghost(self, situation: Situation, position: np.ndarray, poses: np.ndarray) -> None:
        plans, robot = situation.plans, self._robot
        track, plan = plans.track, plans.shown
        assert robot is not None
        shown, stale = plan is not None, plan is not None and not plan.fresh
        self._tell_ghost(shown, stale)
        if plan is None or track is None:
            self._ghost.hide()
            self._draw_trail(None, ())
            return
        self._place_ghost(track.posture(robot.chain.joints, position, plans.time), poses)
        base = self._drawn_base[:3].round(2).ravel().tolist()  # a trail costs many poses: only where it is seen to move
        self._draw_trail(track, (plan.id, stale, track, *base), position)

    def _tell_ghost(self, shown: bool, stale: bool) -> None:
        if (shown, stale) != (self._ghost_shown, self._ghost_stale):
            self._ghost_shown, self._ghost_stale = shown, stale
            self.changed.emit()

    def _place_ghost(self, posture: np.ndarray, poses: np.ndarray) -> None:
        assert self._robot is not None
        ghost = self._robot.chain.poses(posture)
        base = self._drawn_base
        if self._base_source == "feet" and self._robot.feet:  # the sole stays, and where legs move the base does not
            sole = self._robot.chain.frames[self._robot.feet[0]]
            base = poses[sole.body] @ sole.pose_in_body @ np.linalg.inv(ghost[sole.body] @ sole.pose_in_body)
        ghost = base @ ghost
        moved = np.linalg.norm(ghost[:, :3, 3] - poses[:, :3, 3], axis=1) > _APART
        cosine = (np.einsum("bij,bij->b", ghost[:, :3, :3], poses[:, :3, :3]) - 1) / 2
        self._ghost.pose(ghost, moved | (np.arccos(np.clip(cosine, -1, 1)) > _TURNED))

    def _draw_trail(self, track: Track | None, key: tuple[object, ...], position: np.ndarray | None = None) -> None:
        if key == self._drawn_trail:
            return
        self._drawn_trail = key
        robot = self._robot
        if track is None or robot is None or position is None:
            self._trail.show(solids.tube(np.zeros((0, 3)), _TRAIL_RADIUS, _FRESH))
            return
        times = np.linspace(0.0, track.duration, _TRAIL_SAMPLES)
        postures = np.array([track.posture(robot.chain.joints, position, time) for time in times])
        color = _STALE if key[1] else _FRESH
        lines = []
        for arm, tip in robot.tips.items():
            own = set(robot.arm_joints[arm]) & set(track.joints)
            others = {joint for other, joints in robot.arm_joints.items() if other != arm for joint in joints}
            if own - others:  # the torso moves both arms' tips; only the arm that the plan is for leaves a trail
                along = robot.chain.positions(tip, postures) @ self._drawn_base[:3, :3].T + self._drawn_base[:3, 3]
                lines.append(solids.tube(along, _TRAIL_RADIUS, color))
        self._trail.show(solids.merged(lines))

    # --------------------------------------------------------------------------------------------------------- clouds

    def _show_clouds(self, seen: dict[str, Seen]) -> bool:
        """True when something changed. While they are hidden nothing is drawn."""
        if not self._cloud_on or seen == self._drawn_clouds:
            return False
        if list(seen) != self._clouds.names():
            self._clouds.replace([(camera, Cloud()) for camera in seen])
            self._drawn_clouds = {}
        for row, (camera, picture) in enumerate(seen.items()):
            if self._drawn_clouds.get(camera) is not picture:
                geometry = self._clouds.geometry(row)
                assert isinstance(geometry, Cloud)
                geometry.show(picture.points.positions, picture.points.colours)
        self._drawn_clouds = dict(seen)
        return True

    # ------------------------------------------------------------------------------------------------------ templates

    def _show_instances(self, instances: dict[str, InstanceState], arrived: int) -> bool:
        """True when something changed. `arrived`: how many templates have come."""
        if arrived != self._arrived:
            self._arrived, self._drawn_instances = arrived, {}
        if instances == self._drawn_instances:
            return False
        if list(instances) != self._templates.names():
            self._templates.replace([(name, MeshGeometry()) for name in instances])
            self._drawn_instances = {}
            self._problems, self._meshes = {}, {}
        poses = []
        for row, (name, state) in enumerate(instances.items()):
            before = self._drawn_instances.get(name)
            if before is None or _shape(before) != _shape(state):
                geometry = self._templates.geometry(row)
                assert isinstance(geometry, MeshGeometry)
                mesh, self._problems[name] = _template(state)
                geometry.show(mesh)
                self._meshes[name] = mesh
            poses.append(_matrix(state.pose_in_world))
        self._templates.pose(np.array(poses))
        self._drawn_instances = dict(instances)
        first = next(iter(instances.values()), None)
        if first is not None:
            self._focus = QVector3D(*first.pose_in_world.position)
        self.changed.emit()
        return True

    # ---------------------------------------------------------------------------------------------------------- bench

    def _show_bench(self, bench: Bench, move: Move) -> bool:
        """The handle, of the target or of the selected instance, and that one's waypoints. True when something changed."""
        pose, parts = (bench.pose, handle.PARTS) if move.target is None else (move.target, move.parts)
        waypoints = bench.waypoints
        key: tuple[object, ...] = (bench.selected, None if pose is None else pose.tobytes(), bench.chosen, parts)
        key += tuple((each.name, each.reach.state if each.reach else "") for each in waypoints)
        key += tuple(each.pose.tobytes() for each in waypoints)
        if key == self._marked:
            return False
        self._marked = key
        self._selected = "" if pose is None else bench.selected or "target"
        if pose is not None:
            self._handle, self._handle_turn = placed(pose)
            self._handles.pose(np.tile(np.eye(4), (6, 1, 1)), np.array([part in parts for part in handle.PARTS]))
        states = [each.reach.state if each.reach else "" for each in waypoints]
        names = [each.name for each in waypoints]
        if names != self._waypoints.names():
            # A geometry of its own for each: one that no model uses any more must not outlive the window.
            self._waypoints.replace([(name, MeshGeometry()) for name in names])
            self._states = [None] * len(names)
        for row, (state, before) in enumerate(zip(states, self._states, strict=True)):
            if state != before:
                geometry = self._waypoints.geometry(row)
                assert isinstance(geometry, MeshGeometry)
                geometry.show(marks.waypoint(state))
        self._states = list(states)
        self._waypoints.pose(np.array([each.pose for each in waypoints]).reshape(-1, 4, 4))
        line = np.array([each.pose[:3, 3] for each in waypoints]).reshape(-1, 3)
        self._way.show(solids.tube(line, 0.0015, marks.WAY))
        self.changed.emit()
        return True


def _shape(state: InstanceState) -> tuple[object, ...]:
    return state.template, state.template_hash, state.parameters, state.joint_state


def _template(state: InstanceState) -> tuple[Mesh, str]:
    """An instance's shapes, and what is wrong with them (nothing: empty)."""
    try:
        template = catalogue.load(state.template)
        instance = Instance(
            state.name, template, state.pose_in_world, state.parameters, state.joint_state, state.version
        )
        mesh = solids.shapes(instance.resolve().shapes)
    except (ConfigError, ValueError) as error:
        return EMPTY, str(error)
    return mesh, "" if template.hash == state.template_hash else DIFFERS


def _matrix(pose: Pose) -> np.ndarray:
    x, y, z, w = pose.orientation
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = pose.position
    return matrix
