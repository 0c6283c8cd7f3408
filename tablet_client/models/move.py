"""Moving the robot by hand: nudges, motions that last while a button is held, joints' sliders, and a target for the tool.

What a button moves is sent as `Jog`: a place to go to, point to point, guarded by the daemon. While one is held, the place is kept
a fraction of a second ahead of where the robot is commanded to be (`AHEAD`): a stream of velocities in all but name, and when it
ends, for whatever reason, so does the motion. Sliders and the target move a ghost only, until a plan to it is executed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from handrail.messages import Jog, JointsGoal, Message, PlanMotion
from tablet_client.models import handle
from tablet_client.models.limbs import Limb, Solution
from tablet_client.models.posture import Chain
from tablet_client.models.view import Array, View
from tablet_client.models.whole_body import KEPT, Camera, Target, WholeBody

AHEAD, BRAKE = 0.4, 0.15
"""s: how far ahead of the robot a held motion's place is, and how far when it is let go"""
SPEEDS = {"t": 0.04, "r": 0.25, "j": 0.15}
"""m/s of the tool, rad/s of the tool, rad/s (m/s) of a joint, while a button is held"""
STEPS = {"fine": {"t": 0.001, "r": math.radians(1), "j": math.radians(1)}}
STEPS["coarse"] = {"t": 0.01, "r": math.radians(5), "j": math.radians(5)}
"""m, rad: what a tap goes by"""
MODES = (*STEPS, "hold")
AIMS = ("tool", "mass")
"""what a target is of: an arm's tool, the centre of mass"""
TURNS = ("all", "z", "none")
"""what of the target's orientation counts: all, the tool's axis, nothing"""
_NUDGE = 0.1  # share of the velocity limits


@dataclass
class _Hold:
    """A button that is held."""

    what: str
    sign: int
    start: Array
    """(4, 4): where the tip was commanded to be, in the robot's base; of a joint: nothing of it counts"""
    ahead: float = 0.0
    """m or rad along the way: the furthest place that was sent"""
    speed: float = 0.0
    """share of the velocity limits; 0: not known yet"""


class Move:
    """What the operator moves by hand, and what of it is only shown."""

    def __init__(self) -> None:
        self._model: object = None
        self._joints: tuple[str, ...] = ()
        self._limits = (np.zeros(0), np.zeros(0), np.ones(0))
        self._limbs: dict[str, Limb] = {}
        self._command, self._base = np.zeros(0), np.eye(4)
        self._arm = ""
        self.axes = "world"
        """`world` or `tool`: whose axes nudges go along"""
        self.mode = "fine"
        self.turn = "all"
        self.seen = self.relax = False
        self.fine = self.snap = False
        self.hot = ""
        """the part of the target's handle that a finger is on"""
        self.target: Array | None = None
        """(4, 4), world: where the tool, or the centre of mass, is to go; none: the handle is not shown"""
        self.aim = "tool"
        """of AIMS: whose target it is"""
        self.kept: set[str] = set()
        """of KEPT, what was chosen"""
        self._body: WholeBody | None = None
        self.sliders: dict[str, float] = {}
        """joint → rad or m, where it was put on its slider"""
        self.stamp = 0
        """goes up when what is shown changes"""
        self._grip: handle.Grip | None = None
        self._held: _Hold | None = None
        self._sent: Array | None = None
        """(n,): where the robot was last sent by a nudge, as long as it is on its way"""
        self._shown: Solution | None = None
        self._planned = False
        """a plan to what is shown has come: its ghost is shown instead"""
        self.told = ""
        """why the robot refused to go where it was last sent by hand"""

    # ------------------------------------------------------------------------------------------------- what is known

    def meet(
        self, model: object, chain: Chain, tips: Mapping[str, str], arms: Mapping[str, Sequence[str]],
        limits: tuple[Array, Array, Array], *, feet: Sequence[str] = (), cameras: Sequence[Camera] = (),
    ) -> None:  # fmt: skip
        """Another robot: `tips` arm → link, `arms` arm → joints, `limits` lower, upper, velocity (n,) in the chain's order, `feet`
        the soles' links.
        """
        if model is self._model:
            return
        self._model, self._joints, self._limits = model, tuple(chain.joints), limits
        self._limbs, self._command = {}, np.zeros(0)
        for arm, joints in arms.items():
            others = {joint for other, theirs in arms.items() if other != arm for joint in theirs}
            own = [joint for joint in joints if joint not in others]  # the torso would take the other arm along
            if arm in tips and own:
                self._limbs[arm] = Limb(chain, tips[arm], own, limits[0], limits[1])
        self._body = WholeBody(chain, tips, arms, limits[0], limits[1], feet=feet, cameras=cameras)
        self.drop_target()
        self.reset()

    def stands(self, command: Array, base: Array, moving: bool, *, on_feet: bool = False) -> None:
        """Where the robot is commanded to be, rad (n,) in the chain's order, where its base is (4, 4), and whether it stands."""
        if not moving and self._held is None:
            self._sent = None
        if not np.array_equal(self._command, command):
            self._command = command
            if self.target is None and self.sliders:
                self._show()
        self._base = base
        if self._body is not None:
            self._body.stands(command, base, on_feet)

    @property
    def on_feet(self) -> bool:
        """Whether it stands on its feet: legs may help, and balance is kept."""
        return self._body is not None and self._body.on_feet

    @property
    def ready(self) -> bool:
        """Whether it is known what there is to move, and where it is."""
        return bool(self._limbs) and len(self._command) == len(self._joints) > 0

    @property
    def arms(self) -> list[str]:
        return list(self._limbs)

    @property
    def arm(self) -> str:
        """The arm whose tip and joints are meant."""
        first = "right" if "right" in self._limbs else next(iter(self._limbs), "")
        return self._arm if self._arm in self._limbs else first

    def choose(self, arm: str) -> None:
        """Move this arm."""
        self.let_go()
        self._arm = arm
        if self.target is not None and self.ready and self.aim == "tool":
            self.show_target()
        self.reset()

    @property
    def joints(self) -> list[tuple[str, float, float, float]]:
        """Of the arm: name, value as it is shown, lower, upper; rad or m."""
        limb = self._limbs.get(self.arm)
        if limb is None or not self.ready:
            return []
        lower, upper, _ = self._limits
        shown = self._command if self._shown is None else self._shown.position
        return [
            (name, float(shown[row]), float(lower[row]), float(upper[row]))
            for name, row in zip(limb.joints, limb.rows.tolist(), strict=True)
        ]

    @property
    def tip(self) -> Array:
        """(4, 4), world: where the arm's tip is commanded to be."""
        return np.asarray(self._base @ self._limbs[self.arm].tip(self._command))

    # ------------------------------------------------------------------------------------------- taps and held buttons

    def press(self, what: str, sign: int) -> Jog | str:
        """A button of `tx` ... `rz` or of a joint is pressed: what to send, or the code of why it can't be."""
        self.told = ""
        if not self.ready:
            return "no_robot"
        if self.mode == "hold":
            self._held = _Hold(what, sign, self._limbs[self.arm].tip(self._command))
            return self.hold() or ""
        amount = sign * STEPS[self.mode][_kind(what)]
        start = self._command if self._sent is None else self._sent
        goal = self._shifted(what, amount, start, self._limbs[self.arm].tip(start))
        if goal is None:
            return "beyond_reach"
        self._sent = goal
        return self._jog(goal, _NUDGE)

    def hold(self) -> Jog | str | None:
        """What to send next while a button is held; None: none is; a code where it can't go on, which ends it."""
        held = self._held
        if held is None:
            return None
        return self._further(held, AHEAD)

    def let_go(self) -> Jog | None:
        """The one last thing to send when it is let go: the place to come to rest at."""
        held, self._held = self._held, None
        if held is None or held.speed == 0.0:
            return None
        held.ahead = 0.0
        last = self._further(held, BRAKE)
        return last if isinstance(last, Jog) else None

    @property
    def held(self) -> str:
        """The button that is held, `tx+`; empty: none."""
        return "" if self._held is None else self._held.what + ("+" if self._held.sign > 0 else "-")

    def refused(self, why: str) -> None:
        """The robot does not go where it was sent by hand."""
        self._held, self._sent, self.told = None, None, why

    def _further(self, held: _Hold, ahead: float) -> Jog | str:
        kind, limb = _kind(held.what), self._limbs[self.arm]
        pace = SPEEDS[kind]
        if kind == "j":
            row = self._joints.index(held.what)
            lower, upper, velocity = self._limits
            goal = self._command.copy()
            goal[row] = np.clip(goal[row] + held.sign * pace * ahead, lower[row], upper[row])
            if abs(goal[row] - self._command[row]) < 1e-4:
                self._held = None
                return "at_limit"
            held.speed = held.speed or float(pace / velocity[row])
            return self._jog(goal, held.speed, [held.what])
        done = self._travelled(held, limb.tip(self._command))
        held.ahead = max(held.ahead, done + pace * ahead)
        goal_or_none = self._shifted(held.what, held.sign * held.ahead, self._command, held.start)
        if goal_or_none is None:
            self._held = None
            return "beyond_reach"
        if held.speed == 0.0:
            rates = np.abs(goal_or_none - self._command)[limb.rows] / ahead
            held.speed = float(np.clip((rates / self._limits[2][limb.rows]).max(), 0.01, 0.5))
        return self._jog(goal_or_none, held.speed)

    def _axis(self, what: str, start: Array) -> Array:
        """(3,) in the robot's base."""
        turn = start[:3, :3] if self.axes == "tool" else self._base[:3, :3].T
        return np.asarray(turn[:, "xyz".index(what[1])])

    def _travelled(self, held: _Hold, tip: Array) -> float:
        """m or rad along the held button's way, of what was commanded so far."""
        axis = self._axis(held.what, held.start) * held.sign
        if held.what[0] == "t":
            return float(axis @ (tip[:3, 3] - held.start[:3, 3]))
        between = tip[:3, :3] @ held.start[:3, :3].T
        vector = np.array([between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]])
        return math.atan2(float(axis @ vector) / 2, (float(np.trace(between)) - 1) / 2)

    def _shifted(self, what: str, amount: float, position: Array, start: Array) -> Array | None:
        """(n,): the posture near `position` with the tip moved on from `start`, or a joint on from there; None: out of reach."""
        if _kind(what) == "j":
            row = self._joints.index(what)
            goal = position.copy()
            goal[row] += amount
            return goal if self._limits[0][row] <= goal[row] <= self._limits[1][row] else None
        about = np.eye(4)
        axis = self._axis(what, start)
        helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
        side = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
        about[:3, :3] = np.stack([axis, side, np.cross(axis, side)], 1)
        about[:3, 3] = start[:3, 3]
        moved = handle.shifted(about, what[0] + "x", amount) @ np.linalg.inv(about) @ start
        found = self._limbs[self.arm].solve(position, moved)
        return found.position if found.reached else None

    def _jog(self, goal: Array, speed: float, joints: Sequence[str] = ()) -> Jog:
        names = tuple(joints) or self._limbs[self.arm].joints
        return Jog(joints={name: float(goal[self._joints.index(name)]) for name in names}, speed=speed)

    # ------------------------------------------------------------------------------------------------- only shown

    @property
    def posture(self) -> Array | None:
        """(n,) in the chain's order: the robot as its ghost is to show it; None: nothing is to be shown."""
        return None if self._shown is None or self._planned else self._shown.position

    @property
    def misses(self) -> tuple[float, float]:
        """m, rad: how far the ghost's tip is from the target."""
        return (0.0, 0.0) if self._shown is None else (self._shown.off, self._shown.turned)

    @property
    def reached(self) -> bool:
        return self._shown is None or self._shown.reached

    def slide(self, joint: str, value: float) -> None:
        """A joint's slider moves."""
        self.target = None
        limb = self._limbs[self.arm]
        if not self.sliders:
            shown = self._command if self._shown is None else self._shown.position
            self.sliders = {name: float(shown[row]) for name, row in zip(limb.joints, limb.rows.tolist(), strict=True)}
        if joint in self.sliders:
            self.sliders[joint] = value
            self._show()

    def reset(self) -> None:
        """Show the robot as it is."""
        self.sliders = {}
        self._show()

    @property
    def lost(self) -> str:
        """What does not hold in the ghost's posture of that which is to be kept: `feet`, or of KEPT."""
        return "" if self._shown is None else self._shown.lost

    def show_target(self, aim: str = "tool") -> None:
        """A target with a handle, where the tip is, or the centre of mass."""
        if not self.ready or self._body is None:
            return
        self.aim, self.sliders = aim, {}
        self.target = self.tip if aim == "tool" else self._body.centre_of_mass
        self._show()

    @property
    def offered(self) -> list[str]:
        """What may be kept, of KEPT, for what is dragged."""
        return [] if self._body is None or not self.ready else self._body.offered(self._aimed, self.kept)

    def keep(self, what: str, on: bool) -> None:
        """Something is to hold, or not any more."""
        if what in KEPT:
            self.kept = self.kept | {what} if on else self.kept - {what}
            self._show()

    @property
    def parts(self) -> tuple[str, ...]:
        """Of the handle, that can be dragged: on its feet a robot's centre of mass goes up and down only."""
        if self.aim == "tool":
            return handle.PARTS
        return ("tz",) if self.on_feet else ("tx", "ty", "tz")

    def place(self, axis: int, value: float) -> None:
        """The target is put at a place along the world's x, y or z, m."""
        if self.target is not None and math.isfinite(value) and "t" + "xyz"[axis] in self.parts:
            self.target = self.target.copy()
            self.target[axis, 3] = value
            self._show()

    @property
    def _aimed(self) -> str:
        return self.arm if self.aim == "tool" else ""

    def drop_target(self) -> None:
        self.target, self._grip, self.hot = None, None, ""
        self._show()

    def count(self, turn: str) -> None:
        """What of the target's orientation counts."""
        self.turn = turn
        self._show()

    def grasp(self, view: View, x: float, y: float) -> str:
        """A finger comes down: the part of the target's handle that it is on, empty: none."""
        self.hot = "" if self.target is None else handle.part_at(view, self.target, x, y, self.parts)
        self._grip = handle.Grip(self.hot, self.target, x, y) if self.hot and self.target is not None else None
        return self.hot

    def drag(self, view: View, x: float, y: float) -> None:
        """It moves."""
        if self._grip is not None:
            self.target = self._grip.drag(view, x, y, fine=self.fine, snap=self.snap)
            self._show()

    def release(self) -> None:
        """It is lifted."""
        self._grip, self.hot = None, ""

    def _show(self) -> None:
        """Find the posture that is to be shown."""
        self.stamp += 1
        self._planned = False
        body = self._body
        if body is None or not self.ready or (self.target is None and not self.sliders):
            self._shown = None
            return
        if self.target is None:
            position = self._command.copy()
            for joint, value in self.sliders.items():
                position[self._joints.index(joint)] = value
            self._shown = Solution(position, 0.0, 0.0)
            return
        target = Target(self.target, self._aimed, self.turn)
        near = self._command.copy()
        if self._shown is not None:
            rows = [self._joints.index(joint) for joint in body.moving(self._aimed, self.kept)]
            near[rows] = self._shown.position[rows]
        found = body.show(target, self.kept, near)
        if not found.reached and self._shown is not None:  # led astray by the drag: anew from where the robot is
            other = body.show(target, self.kept, self._command)
            found = min(found, other, key=lambda each: (bool(each.lost), each.off + 0.2 * each.turned))
        self._shown = found

    # ------------------------------------------------------------------------------------------------------ its plan

    def planned(self) -> None:
        """There is a plan to what is shown: its ghost goes there from now on."""
        self._planned = True
        self.stamp += 1

    @property
    def plannable(self) -> bool:
        """Whether something is shown that a plan could lead to."""
        return self._shown is not None

    def plan(self) -> Message | None:
        """What to send for a plan to what is shown; None: nothing is."""
        if self.target is not None and self._body is not None:
            target = Target(self.target, self._aimed, self.turn)
            return self._body.plan(target, self.kept, seen=self.seen, relax=self.relax)
        if not self.sliders:
            return None
        goal, relax = JointsGoal(positions=dict(self.sliders)), ["goals[0]"] if self.relax else []
        return PlanMotion(goals=[goal], arm=self.arm, seen=self.seen, relax=relax, label="By hand")


def _kind(what: str) -> str:
    return what[0] if what in handle.PARTS else "j"
