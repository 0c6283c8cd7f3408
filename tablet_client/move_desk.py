"""Moving by hand, as QML sees it: what may be moved, the buttons' and sliders' way down, and the clock of a button that is held."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Property, QObject, QTimer, Signal, Slot

from handrail.messages import Jog, Message
from tablet_client.models.move import AIMS, MODES, TURNS
from tablet_client.models.quantities import in_unit
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

PERIOD = 100
"""ms between two places that are sent while a button is held: the robot stops 0.4 s after the last one"""
_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_JOINT = ("name", "title", "unit", "value", "low", "high", "step", "text")


class MoveDesk(QObject):
    """What QML reads of what is moved by hand, and calls."""

    changed = Signal()

    def __init__(
        self,
        situation: Situation,
        send: Callable[[Message], None],
        move: Callable[[Jog], None],
        soon: Callable[[], None],
    ):
        """`send` a call that is shown as on its way; `move`: the next place to go to, which makes older ones needless."""
        super().__init__()
        self._situation, self._send, self._out, self._soon = situation, send, move, soon
        self._move = situation.move
        self._joints = Rows(_JOINT, "name")
        self._view: dict[str, Any] = {}
        self._problem = ""
        self._pulse = QTimer(self, interval=PERIOD)
        self._pulse.timeout.connect(self._beat)
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(QObject, constant=True)
    def joints(self) -> Rows:
        return self._joints

    # -------------------------------------------------------------------------------------------- taps, held buttons

    @Slot(str, int)
    def press(self, what: str, sign: int) -> None:
        """A button goes down: `tx` ... `rz` of the tool, or a joint."""
        if not self.why("jog"):
            self._tell(self._move.press(what, sign))
            if self._move.held:
                self._pulse.start()
            self._soon()

    @Slot()
    def letGo(self) -> None:
        """It is let go, or is not to be seen any more."""
        self._pulse.stop()
        last = self._move.let_go()
        if last is not None and not self.why("jog"):
            self._out(last)
        self._soon()

    def close(self) -> None:
        """Nothing is sent any more."""
        self._pulse.stop()

    def _beat(self) -> None:
        further = "" if self.why("jog") else self._move.hold()
        if isinstance(further, Jog):
            self._out(further)
            return
        self._pulse.stop()
        self._move.let_go()
        self._problem = further or self._problem
        self._soon()

    def _tell(self, made: Jog | str) -> None:
        self._problem = made if isinstance(made, str) else ""
        if isinstance(made, Jog):
            self._out(made)

    # ------------------------------------------------------------------------------------------------------- choices

    @Slot(str)
    def chooseArm(self, arm: str) -> None:
        self._move.choose(arm)
        self._soon()

    @Slot(str)
    def chooseAxes(self, axes: str) -> None:
        """`world` or `tool`"""
        self.letGo()
        self._move.axes = axes if axes in ("world", "tool") else self._move.axes
        self._soon()

    @Slot(str)
    def chooseMode(self, mode: str) -> None:
        """`fine`, `coarse`, `hold`"""
        self.letGo()
        self._move.mode = mode if mode in MODES else self._move.mode
        self._soon()

    @Slot(str)
    def chooseTurn(self, turn: str) -> None:
        """What of the target's orientation counts: `all`, `z`, `none`."""
        if turn in TURNS:
            self._move.count(turn)
            self._soon()

    @Slot(str, bool)
    def choose(self, what: str, on: bool) -> None:
        """`seen`, `relax`, `fine`, `snap`"""
        if what in ("seen", "relax", "fine", "snap"):
            setattr(self._move, what, on)
            self._soon()

    # ---------------------------------------------------------------------------------------------- only shown, plans

    @Slot(str)
    def showTarget(self, aim: str) -> None:
        """A handle at the tool (`tool`) or at the centre of mass (`mass`), to drag where it is to go; empty: none."""
        if aim in AIMS and not self.why("target"):
            self._situation.bench.select("")
            self._move.show_target(aim)
        elif not aim:
            self._move.drop_target()
        self._soon()

    @Slot(int, float)
    def place(self, axis: int, millimetres: float) -> None:
        """The target's place along the world's x, y or z is typed."""
        self._move.place(axis, millimetres / 1000.0)
        self._soon()

    @Slot(str, bool)
    def keep(self, what: str, on: bool) -> None:
        """Something is to hold while it goes there (tablet_client.models.whole_body.KEPT), or not any more."""
        self._move.keep(what, on)
        self._soon()

    @Slot(str, float)
    def slide(self, joint: str, value: float) -> None:
        if not self.why("target"):
            self._move.slide(joint, value)
            self._soon()

    @Slot()
    def reset(self) -> None:
        """Show the robot as it is."""
        self._move.drop_target()
        self._move.reset()
        self._soon()

    @Slot()
    def plan(self) -> None:
        """Ask for a plan to what is shown; does nothing while the button says why it can't."""
        call = None if self.why("plan") else self._move.plan()
        if call is not None:
            self._send(call)

    def why(self, command: str) -> str:
        """Code of the reason why `jog`, `target` or `plan` can't be done now; empty when it can."""
        situation = self._situation
        if not situation.link.attached or not self._move.ready:
            return "no_robot"
        if command == "target":
            return ""
        if situation.only_looks:
            return situation.only_looks
        if not situation.link.engine:
            return "no_engine"
        if command == "plan":
            if "PlanMotion" in situation.pending:
                return "planning"
            if not self._move.plannable:
                return "nothing_to_plan"
            return "" if self._move.reached or self._move.relax else "beyond_reach"
        return situation.why_not_jog()

    # ------------------------------------------------------------------------------------------------------- looking

    def build(self) -> None:
        """Look at the models anew."""
        move = self._move
        if move.target is not None and self._situation.bench.selected:
            move.drop_target()  # one handle at a time
        self._joints.show(
            [
                {
                    "name": name,
                    "title": name.removesuffix("_joint").replace("_", " "),
                    "unit": "rad",
                    "value": round(value, 4),
                    "low": low,
                    "high": high,
                    "step": 0.0,
                    "text": in_unit("rad", value),
                }
                for name, value, low, high in move.joints
            ]
        )
        off, turned = move.misses
        view = {
            "arms": move.arms,
            "arm": move.arm,
            "axes": move.axes,
            "mode": move.mode,
            "turn": move.turn,
            "seen": move.seen,
            "relax": move.relax,
            "fine": move.fine,
            "snap": move.snap,
            "target": "" if move.target is None else move.aim,
            "place": [] if move.target is None else [round(1000.0 * float(x), 1) for x in move.target[:3, 3]],
            "fixed": [each for each in "xyz" if f"t{each}" not in move.parts],
            "offered": move.offered if move.target is not None else [],
            "kept": sorted(move.kept),
            "lost": move.lost,
            "on_feet": move.on_feet,
            "shown": move.plannable,
            "reached": move.reached,
            "off": in_unit("m", off),
            "turned": in_unit("rad", turned),
            "held": move.held,
            "problem": self._problem,
            "told": move.told,
            "why": {name: self.why(name) for name in ("jog", "target", "plan")},
        }
        if view != self._view:
            self._view = view
            self.changed.emit()
