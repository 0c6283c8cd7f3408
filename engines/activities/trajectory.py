"""`do: trajectory`: an arm and its hand go along a template's trajectory, one waypoint after the other.

Free ways are planned, clear of everything. The last bit to an object, on a line or until a force is felt, is a compliant motion of
the control loop, which gives way where the object is not quite where the template is; so is a push, with a force that the template
names, along a joint or around it. What is held goes along its joint on a plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from affordance_templates.binding import BoundWaypoint
from affordance_templates.instance import Instance
from affordance_templates.placement import (
    Array,
    of_message,
    to_message,
)
from affordance_templates.template import ResolvedJoint
from engines.activities import lines
from engines.activities.around import MOST, Circle, Push, at_stop
from engines.activities.base import Activity, ActivityFailed, Argument, Kind
from engines.activities.carrying import let_go, take
from engines.activities.execute import execute, fresh
from engines.activities.hand import OPEN, poses_of, shape_hand
from engines.activities.meetings import hands, legs, way_together
from engines.activities.together import Together
from engines.activities.waypoints import asked_for, chosen, pushes, there_is, way_to
from engines.runs.motion import MotionFailed
from engines.runs.preconditions import Precondition
from handrail.messages import (
    Compliance,
    CompliantMotion,
    ContactEnd,
    EndCondition,
    PlanMotion,
    Pose,
    TravelEnd,
)
from handrail.robot.description import Arm
from handrail.topics import RefusedError

_PRESS_S = 3.0
"""for which a push along a joint goes on, if its waypoint names no duration"""
_FELT = 0.25
"""share of the way to a stop that has to be left when something is felt: its touch may have pressed it the rest of the way"""
_CLOSED = "closed"
"""the hand pose that takes hold"""


class TrajectoryActivity(Activity):
    """Goes along the waypoints of an instance's trajectory, all or `first` to `last`, either one left out for the trajectory's own.
    Those before count as gone to already. The first way is the `plan` of `do: plan`, where one was made for it.

    The `way` backwards comes from the last one, and at each waypoint the hand gets the shape that it had before it: what a way
    in took hold of, the way back puts down. It comes to `last` on a line, or, `leaving` the waypoint behind that, as it went there.
    Done with the `waypoint` that it ended at, whether the hand `holds` something, and `moved`, rad or m that it moved the last
    joint by. Fails with `stale` before it goes on to where the instance is no more, and with `no_hand` where the hand is to change
    its shape and the arm carries a rigid tool.

    `still` is another arm, which holds something meanwhile: joints that both have (a torso) stand, so that it stays where it is.

    What the hand takes hold of stays where it is, or turns about its joints; with the `grip` `carried` it goes along with the
    hand from then on (engines.activities.carrying), until that opens.

    With an `other` arm the trajectory is a template's `sync`, of two hands: the arm goes along the first of its trajectories, the
    other one along the second, at one time, from point to point (engines.activities.meetings); `first`, `last` and `leaving` are
    points then.
    """

    arguments = {
        "instance": Argument(Kind.INSTANCE),
        "trajectory": Argument(Kind.TEXT),
        "arm": Argument(Kind.ARM),
        "first": Argument(Kind.TEXT, required=False, default=""),
        "last": Argument(Kind.TEXT, required=False, default=""),
        "way": Argument(Kind.CHOICE, required=False, default="forwards", choices=("forwards", "backwards")),
        "leaving": Argument(Kind.TEXT, required=False, default=""),
        "plan": Argument(Kind.VALUE, required=False),
        "still": Argument(Kind.ARM, required=False, default=""),
        "other": Argument(Kind.ARM, required=False, default=""),
        "grip": Argument(Kind.CHOICE, required=False, default="fixed", choices=("fixed", "carried")),
    }
    outputs = frozenset({"waypoint", "holds", "moved"})
    _executed = ""
    """id of the plan that is under way"""
    _hands: Mapping[str, TrajectoryActivity] = MappingProxyType({})
    """of a sync: trajectory → who goes along it"""

    @classmethod
    def problem(cls, given: Mapping[str, Any]) -> tuple[str, str]:
        """See Activity."""
        odd = [name for name in ("still", "grip") if name in given and "other" in given]
        return (odd[0], "beside other; expected one of both") if odd else ("", "")

    def run(self) -> dict[str, Any]:
        self._set_out(asked_for(self.services, self.values["instance"]))
        self._plan = str(self.values["plan"] or "")
        if self.values["other"]:
            return self._together()
        waypoints = self._chosen(self._instance)
        self.go(waypoints)
        return {"waypoint": waypoints[-1].waypoint.name, "holds": self._holds, "moved": self._moved}

    def _set_out(self, instance: Instance) -> None:
        self._instance, self._holds, self._moved, self._plan = instance, False, 0.0, ""

    def go(self, waypoints: Sequence[BoundWaypoint]) -> None:
        """To all of them, one after the other. Raises ActivityFailed."""
        for waypoint in waypoints:
            try:
                self._still_there()
                self._reach(self._instance, waypoint)
                self.shape(waypoint)
            except ActivityFailed as failed:
                raise ActivityFailed(failed.reason, f"{waypoint.waypoint.name}: {failed}") from failed

    def _together(self) -> dict[str, Any]:
        values, instance, robot = self.values, self._instance, self.services.description
        arms = hands(instance, values["trajectory"], (values["arm"], values["other"]), robot)
        way = legs(
            robot, instance, values["trajectory"], arms, first=values["first"], last=values["last"],
            back=values["way"] == "backwards", leaving=values["leaving"],
        )  # fmt: skip
        beside = {values["arm"]: values["other"], values["other"]: values["arm"]}
        own = {"plan": None, "other": "", "first": "", "last": "", "leaving": ""}
        found = {
            name: TrajectoryActivity(
                self.context, {**values, **own, "trajectory": name, "arm": arm, "still": beside[arm]}
            )
            for name, arm in arms.items()
        }
        for name, hand in found.items():
            hand._set_out(instance)
            hand._check_poses([waypoint for leg in way for waypoint in leg.ways[name]])
        self._hands, both = found, Together(found, self.context.motion)
        if self.cancelled.is_set():  # before there were hands to tell
            both.stop()
        for leg in way:
            if (call := way_together(leg, instance)) is None:
                both.go(leg)
                continue
            try:
                self._still_there()
                self._planned(call)
                both.shape(leg)
            except ActivityFailed as failed:
                raise ActivityFailed(failed.reason, f"{leg.name}: {failed}") from failed
        moved = max((hand._moved for hand in found.values()), key=abs)
        return {"waypoint": way[-1].name, "holds": any(hand._holds for hand in found.values()), "moved": moved}

    def cancel(self) -> None:
        super().cancel()
        for hand in self._hands.values():
            hand.cancelled.set()
        self.context.motion.interrupt()

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        name, plans, begun = self.values["instance"], self.services.plans, hasattr(self, "_instance")
        yield there_is(self.services, name)
        if begun:
            why = self._outdated()
            yield Precondition(f"{name} is where it was when the hand set out", not why, why)
        executed = self._executed if begun else str(self.values["plan"] or "")
        if executed:
            try:
                yield from fresh(self.services, self.context.motion, plans.get(executed), ())
            except RefusedError as refused:
                yield Precondition("there is the plan of its first way", False, str(refused))
        yield from super().preconditions()
        for hand in self._hands.values():
            yield from self.context.motion.preconditions(hand.cancelled)

    def _outdated(self) -> str:
        """Why the waypoints are not where they were when it began, in words; empty: they are. Its joints may have moved."""
        before = self._instance
        try:
            now = self.services.affordances.get(before.name)
        except RefusedError:
            return f"{before.name} was removed while it was being used"
        if now.version == before.version:
            return ""
        return (
            f"{before.name} was moved or edited while it was being used (version {before.version}, now {now.version})"
        )

    def _still_there(self) -> None:
        if why := self._outdated():
            raise ActivityFailed("stale", why)

    def _chosen(self, instance: Instance) -> Sequence[BoundWaypoint]:
        """The waypoints to go to, in order, for the arm."""
        values = self.values
        waypoints = chosen(
            self.services.description,
            instance,
            values["trajectory"],
            values["arm"],
            first=values["first"],
            last=values["last"],
            back=values["way"] == "backwards",
            leaving=values["leaving"],
        )
        self._check_poses(waypoints)
        return waypoints

    def _check_poses(self, waypoints: Sequence[BoundWaypoint]) -> None:
        """Raises ActivityFailed where the hand is to change its shape and there is none."""
        if len({each.waypoint.hand_pose for each in waypoints} - {""}) > 1:
            poses_of(self.services, self.values["arm"])

    # ------------------------------------------------------------------------------------------------------ one waypoint

    def _reach(self, instance: Instance, waypoint: BoundWaypoint) -> None:
        call = way_to(waypoint, instance, self._arm.joints if self.values["still"] else ())
        if call is not None:
            self._planned(call)
            self._moved = call.along.by if call.along is not None else self._moved
        elif not pushes(waypoint):
            self._straight(waypoint)
        elif instance.resolve().joints[waypoint.waypoint.joint].kind == "prismatic":
            self._push(waypoint)
        else:
            self._push_around(waypoint)

    def _planned(self, call: PlanMotion) -> None:
        """Run the plan that was made for it, or make one, to its end."""
        from engines.plans.making import make_motion  # which imports this package

        given, self._plan = self._plan, ""
        if given:
            try:
                record = self.services.plans.get(given)
            except RefusedError as refused:
                raise ActivityFailed("refused", f"plan: {refused}") from refused
        else:
            self.services.daemon.hold_time(self.context.hold_s)
            record, preview = make_motion(
                self.services, call, run=self.context.run, seeds=self.context.seeds, cancelled=self.cancelled.is_set
            )
            self.context.notes.planned(preview)
        self._executed = record.plan.id
        try:
            ended = execute(self.services, self.context.motion, record, (), self.cancelled, still=self._outdated)
        finally:
            self._executed = ""
        if ended["outcome"] != "done":
            raise ActivityFailed("guarded", f"it was ended by {ended['outcome']} in {ended['segment']}")

    def standing(self) -> Array:
        """(4, 4): where the arm's tip is commanded to be now, in the world. Raises ActivityFailed before the daemon was heard."""
        command = self.services.daemon.command()
        if command is None:
            raise ActivityFailed("unknown_state", "the daemon has not told where the robot is: is it running?")
        position, orientation = (each.tolist() for each in self.services.tip_pose(command, self.values["arm"]))
        return of_message(Pose(position=tuple(position), orientation=tuple(orientation)))

    def _straight(self, waypoint: BoundWaypoint) -> None:
        asked, force = waypoint.waypoint, waypoint.force_in_world
        line = lines.to(waypoint, self.standing())
        assert line is not None, f"{asked.name} is gone to {asked.approach}"
        there, duration = line
        if not duration:
            return
        ends: list[EndCondition] = []
        if asked.until is not None:
            ends.append(ContactEnd(frame=self._arm.tip, threshold=asked.until))
        motion = CompliantMotion(
            frame=self._arm.tip,
            joints=list(self._arm.joints),
            duration=duration,
            goal_in_world=to_message(there),
            axes=lines.axes_along(force),
            compliance=[] if force is None else [Compliance(axis="x", force=float(np.linalg.norm(force)))],
        )
        outcome = self._run(motion, ends, asked.name, "done" if asked.until is None else "contact")
        if asked.until is not None and outcome == "done":
            raise ActivityFailed(
                "met_nothing",
                f"{asked.until:g} N were not felt until {lines.BEYOND * 100:g} cm behind where it was to touch",
            )

    def _push(self, waypoint: BoundWaypoint) -> None:
        """Press until what slides has moved as far as it is to."""
        assert waypoint.force_in_world is not None
        instance, asked = self._instance, waypoint.waypoint
        joint, by = instance.resolve().joints[asked.joint], float(asked.to)
        direction = instance.rotation @ joint.axis * math.copysign(1.0, by)
        x, y, z = direction.tolist()
        size = abs(float(waypoint.force_in_world @ direction))
        motion = CompliantMotion(
            frame=self._arm.tip,
            joints=list(self._arm.joints),
            duration=asked.duration or _PRESS_S,
            axes=lines.axes_along(direction),
            compliance=[Compliance(axis="x", force=size, speed=asked.speed or 0.0)],
        )
        end, before = TravelEnd(frame=self._arm.tip, distance=abs(by), axis=(x, y, z)), self._measured()
        if self._run(motion, [end], asked.name, "travel") == "done" and not self._at_stop(joint, by, direction, before):
            raise ActivityFailed(
                "stuck",
                f"{asked.joint} has not moved by {abs(by) * 1000:.3g} mm under {size:.3g} N in {motion.duration:g} s",
            )
        self._note_moved(asked.joint, by)

    def _at_stop(self, joint: ResolvedJoint, by: float, direction: Array, before: Array | None) -> bool:
        """Whether what slides goes no further because it is at its end, (3,) m `before` being where the hand pushed it from."""
        here = self._measured()
        if before is None or here is None:
            return False
        return at_stop(joint, by, math.copysign(float((here - before) @ direction), by), _FELT)

    def _push_around(self, waypoint: BoundWaypoint) -> None:
        """Push until what turns has turned as far as it is to."""
        assert waypoint.force_in_world is not None
        asked, by = waypoint.waypoint, float(waypoint.waypoint.to)
        size = float(np.linalg.norm(waypoint.force_in_world))
        now = self.services.affordances.get(self._instance.name)
        free = waypoint.tolerance.rotation[2] >= math.pi
        circle = Circle.of(now, asked.joint, self.standing(), free=free, lag=lines.slack(waypoint))
        speed = abs(by) * circle.radius / asked.duration if asked.duration else asked.speed or lines.SPEED
        chords = circle.chords(by, size, speed, self._arm)
        for first in range(0, len(chords), MOST):
            self._still_there()
            push = Push(chords[first : first + MOST])
            try:
                ended = self.context.motion.run_behaviour(
                    push, self.services.description, self.cancelled, what=asked.name
                )
            except MotionFailed as failed:
                raise ActivityFailed(failed.reason, str(failed)) from failed
            if ended.outcome == "done":
                at = next(number for number, chord in enumerate(chords) if chord.name == ended.step)
                gone = by * at / len(chords)
                if at_stop(now.resolve().joints[asked.joint], by, gone):
                    break
                self._note_moved(asked.joint, gone)
                raise ActivityFailed(
                    "stuck",
                    f"{asked.joint} has turned by {math.degrees(gone):.0f}° of {math.degrees(by):.0f}° and goes no further "
                    f"under {size:.3g} N",
                )
        self._note_moved(asked.joint, by)

    def _note_moved(self, joint: str, by: float) -> None:
        """What a joint is believed to have moved by, rad or m."""
        self._moved, affordances, name = by, self.services.affordances, self._instance.name
        try:
            now = affordances.get(name).resolve().joints[joint]
            affordances.set_joint(
                name, joint, min(max(now.position + by, now.lower), now.upper)
            )  # a spring had it back
        except RefusedError as gone:
            raise ActivityFailed("stale", f"{name} was removed while it was being used") from gone

    def shape(self, waypoint: BoundWaypoint) -> None:
        """Give the hand the shape that the waypoint asks for, if it asks for one. Raises ActivityFailed."""
        if not waypoint.fingers:
            return
        self._still_there()
        holds = shape_hand(self.context, self._arm, waypoint.fingers, self.cancelled)
        self._holds = holds and waypoint.waypoint.hand_pose == _CLOSED
        if not holds or waypoint.waypoint.hand_pose == OPEN:
            self._instance = let_go(self.services, self._arm, self._instance) or self._instance
        elif self._holds and self.values["grip"] == "carried":
            self._instance = take(self.services, self._instance, self._arm)

    def _run(self, motion: CompliantMotion, ends: list[EndCondition], what: str, hoped: str) -> str:
        try:
            return self.context.motion.run(
                motion, ends, self.cancelled, what=what, still=self._outdated, hoped=hoped
            ).outcome
        except MotionFailed as failed:
            raise ActivityFailed(failed.reason, str(failed)) from failed

    def _measured(self) -> Array | None:
        """(3,) m, where the hand was when the run's last motion ended; None: there was none."""
        ended = self.context.motion.ended
        return None if ended is None else self.services.tip_pose(np.array(ended.position), self.values["arm"])[0]

    @property
    def _arm(self) -> Arm:
        """With the joints that it may move."""
        arms = self.services.description.arms
        arm, still = arms[self.values["arm"]], self.values["still"]
        shared = arms[still].joints if still else ()
        return replace(arm, joints=tuple(joint for joint in arm.joints if joint not in shared))
