"""The instances' side of the desk: what is placed, what is selected and how it stands, and the fingers' way to its handle."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from handrail.messages import ListLibrary, MakePlan, Message, SaveTemplate
from tablet_client.models.bench import Bench
from tablet_client.models.move import Move
from tablet_client.models.quantities import in_unit
from tablet_client.models.situation import Situation
from tablet_client.models.view import View
from tablet_client.rows import Rows
from tablet_client.scene.stage import Stage

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_TAP = 24.0  # px from a template that are still on it
_SLIDER = ("name", "title", "unit", "value", "low", "high", "step", "text")
_WAYPOINT = ("name", "state", "constraint", "about", "size")
_INSTANCE = ("name", "template", "selected", "heldBy")
_COMMANDS = ("edit", "delete", "copy", "undo", "redo", "plan", "place", "attach", "save")
_SENT_AS = {"delete": "RemoveInstance", "plan": "MakePlan", "save": "SaveTemplate"}


class BenchDesk(QObject):
    """What QML reads of the instances, and calls."""

    changed = Signal()
    handleChanged = Signal()

    def __init__(self, situation: Situation, stage: Stage, send: Callable[[Message], None], soon: Callable[[], None]):
        super().__init__()
        self._situation, self._stage, self._send, self._soon = situation, stage, send, soon
        self._bench = situation.bench
        self._view: dict[str, Any] = {}
        self._hot = ""
        self._lists = {
            "instances": Rows(_INSTANCE, "name"),
            "parameters": Rows(_SLIDER, "name"),
            "joints": Rows(_SLIDER, "name"),
            "waypoints": Rows(_WAYPOINT, "name"),
        }
        self.build()

    def _list(name: str) -> Callable[[BenchDesk], Rows]:  # type: ignore[misc]
        return lambda self: self._lists[name]

    instances = Property(QObject, _list("instances"), constant=True)
    parameters = Property(QObject, _list("parameters"), constant=True)
    joints = Property(QObject, _list("joints"), constant=True)
    waypoints = Property(QObject, _list("waypoints"), constant=True)

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(str, notify=handleChanged)
    def hot(self) -> str:
        """The part of the handle that a finger is on."""
        return self._hot

    # -------------------------------------------------------------------------------------------------------- fingers

    @property
    def _held(self) -> Bench | Move:
        """Whose handle there is: the tool's target, where there is one, or the selected instance's."""
        return self._bench if self._situation.move.target is None else self._situation.move

    @Slot(float, float, _MAP, result=str)
    def grasp(self, x: float, y: float, camera: dict[str, Any]) -> str:
        """A finger or the left button comes down on the scene: the handle's part that it is on."""
        if self._held is self._bench and self._situation.only_looks:
            return ""
        part = self._held.grasp(_seen(camera), x, y)
        self._note_hot()
        return part

    @Slot(float, float, _MAP)
    def drag(self, x: float, y: float, camera: dict[str, Any]) -> None:
        """It moves, with a part of the handle."""
        self._held.drag(_seen(camera), x, y)
        self._soon()

    @Slot()
    def release(self) -> None:
        """It is lifted."""
        self._held.release()
        self._note_hot()
        self._soon()

    @Slot(float, float, _MAP, result=bool)
    def tap(self, x: float, y: float, camera: dict[str, Any]) -> bool:
        """Select what a finger has tapped on; beside everything: nothing. Whether something is there."""
        view, depths = _seen(camera), dict[str, float]()
        for name, vertices, faces in self._stage.solids():
            depths[name] = view.hit(x, y, vertices, faces, _TAP)
        nearest = min(depths, key=depths.__getitem__, default="")
        self.select(nearest if nearest and depths[nearest] < float("inf") else "")
        return bool(self._bench.selected)

    # -------------------------------------------------------------------------------------------------------- buttons

    @Slot(str)
    def select(self, name: str) -> None:
        """Work on an instance; empty: on none."""
        self._bench.select(name)
        self._soon()

    @Slot(int, float, result=str)
    def put(self, row: int, value: float) -> str:
        """A number of the selected instance's place was typed in."""
        if self.why("edit"):
            return self.why("edit")
        problem = self._bench.put(row, value)
        self._soon()
        return problem

    @Slot(str, int)
    def nudge(self, part: str, steps: int) -> None:
        """Move or turn the selected instance by a step along one of its axes."""
        if not self.why("edit"):
            self._bench.nudge(part, steps)
            self._soon()

    @Slot(bool)
    def setFine(self, on: bool) -> None:
        self._bench.fine = on
        self._soon()

    @Slot(bool)
    def setSnap(self, on: bool) -> None:
        self._bench.snap = on
        self._soon()

    @Slot(str, float)
    def turn(self, parameter: str, value: float) -> None:
        """A parameter's slider moves."""
        if not self.why("edit"):
            self._bench.turn(parameter, value)
            self._soon()

    @Slot(str)
    def letGo(self, parameter: str) -> None:
        """A parameter's slider is let go."""
        self._bench.edits.drop(self._bench.selected)
        self._soon()

    @Slot(str, float)
    def lookAt(self, joint: str, position: float) -> None:
        self._bench.look_at(joint, position)
        self._soon()

    @Slot()
    def lookAway(self) -> None:
        self._bench.look_away()
        self._soon()

    @Slot(str)
    def chooseTrajectory(self, name: str) -> None:
        self._bench.trajectory = name
        self._soon()

    @Slot(str)
    def chooseArm(self, name: str) -> None:
        self._bench.arm = name
        self._soon()

    @Slot(str)
    def add(self, template: str) -> None:
        """Place a template; it is selected as soon as it is there."""
        if not self.why("place"):
            self._bench.wanted = self._bench.add(template)
            self._soon()

    @Slot(str)
    def do(self, name: str) -> None:
        """`delete`, `copy`, `undo`, `redo`, `plan`; does nothing while the button says why it can't."""
        if self.why(name):
            return
        bench = self._bench
        if name == "delete":
            bench.edits.remove(bench.selected)
        elif name == "copy":
            bench.wanted = bench.copy()
        elif name == "undo":
            bench.edits.undo()
        elif name == "redo":
            bench.edits.redo()
        elif name == "plan":
            self._send(MakePlan(instance=bench.selected, trajectory=bench.chosen, arm=bench.hand))
        self._soon()

    @Slot(str)
    def saveTemplate(self, name: str) -> None:
        """The selected instance as a template, in the engine's workspace; then the library is asked for anew."""
        if not self.why("save"):
            self._bench.saved = ("saving", "")
            self._send(SaveTemplate(instance=self._bench.selected, name=name))
            self._send(ListLibrary())

    @Slot()
    def forgetSaved(self) -> None:
        """What became of the last one has been read."""
        self._bench.saved = ("", "")
        self._soon()

    @Slot(str, str)
    def attach(self, kind: str, name: str) -> None:
        """Have the selected instance go along with a `link` or an `instance`, or with nothing: the `world`."""
        if not self.why("attach"):
            self._bench.attach(kind, name)
            self._soon()

    @Slot()
    def believe(self) -> None:
        """Tell the robot that the selected instance's joints are where they are looked at."""
        if not self.why("edit"):
            self._bench.believe()
            self._soon()

    def why(self, command: str) -> str:
        """Code of the reason why something can't be done with instances now; empty when it can."""
        situation, bench = self._situation, self._bench
        if _SENT_AS.get(command) in situation.pending:
            return "sending"
        if situation.only_looks:
            return situation.only_looks
        if not situation.link.attached:
            return "no_robot"
        if not situation.link.engine:
            return "no_engine"
        if command == "undo":
            return "" if bench.edits.can_undo else "nothing_done"
        if command == "redo":
            return "" if bench.edits.can_redo else "nothing_undone"
        if command == "place":
            return ""
        if bench.state is None:
            return "nothing_selected"
        if command == "plan":
            return "" if bench.chosen and bench.hand else "no_trajectory"
        return ""

    # -------------------------------------------------------------------------------------------------------- looking

    def build(self) -> None:
        """Look at the models anew."""
        bench, state = self._bench, self._bench.state
        self._lists["instances"].show(
            [
                {
                    "name": name,
                    "template": each.template,
                    "selected": name == bench.selected,
                    "heldBy": bench.held_by(name),
                }
                for name, each in self._situation.world.instances.items()
            ]
        )
        self._lists["parameters"].show([asdict(each) | {"text": _text(each)} for each in bench.parameters])
        self._lists["joints"].show([asdict(each) | {"text": _text(each)} for each in bench.joints])
        waypoints = bench.waypoints
        self._lists["waypoints"].show(
            [
                {
                    "name": each.name,
                    "state": each.reach.state if each.reach else "",
                    "constraint": each.reach.constraint if each.reach else "",
                    "about": each.reach.about if each.reach else "",
                    "size": in_unit(each.reach.unit or "rad", each.reach.by) if each.reach else "",
                }
                for each in waypoints
            ]
        )
        view = {
            "selected": bench.selected if state else "",
            "template": state.template if state else "",
            "version": state.version if state else 0,
            "numbers": [round(number, 2) + 0.0 for number in bench.numbers],
            "fine": bench.fine,
            "snap": bench.snap,
            "looked": bench.looked,
            "trajectories": bench.trajectories,
            "trajectory": bench.chosen,
            "arms": list(bench.arms),
            "arm": bench.hand,
            "hasJoints": bool(bench.joints),
            "targets": [asdict(each) for each in bench.targets],
            "saved": {"code": bench.saved[0], "text": bench.saved[1]},
            "reached": sum(each.reach is not None and each.reach.state != "not" for each in waypoints),
            "known": sum(each.reach is not None for each in waypoints),
            "reachProblem": bench.reach_problem,
            "templates": [
                entry.name for entry in self._situation.library if entry.kind == "template" and not entry.problem
            ],
            "why": {name: self.why(name) for name in _COMMANDS},
        }
        if view != self._view:
            self._view = view
            self.changed.emit()

    def send(self, now: float | None = None) -> bool:
        """Send what is due; True while there is something to look after."""
        for call in self._bench.want(time.monotonic() if now is None else now):
            self._send(call)
        return self._bench.edits.waiting

    def _note_hot(self) -> None:
        if self._hot != self._held.hot:
            self._hot = self._held.hot
            self.handleChanged.emit()


def _seen(camera: dict[str, Any]) -> View:
    x, y, z = camera["x"], camera["y"], camera["z"]
    names = ("yaw", "pitch", "distance", "field", "width", "height")
    return View(focus=(x, y, z), **{name: float(camera[name]) for name in names})


def _text(slider: Any) -> str:
    try:
        return in_unit(slider.unit, slider.value)
    except KeyError:
        return f"{slider.value:g} {slider.unit}".strip()
