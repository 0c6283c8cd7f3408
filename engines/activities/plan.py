"""`do: plan`: plan a template's stroke or the way to one of its waypoints for an arm, or a motion to goals, from where the robot is
commanded to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from affordance_templates.instance import Instance
from engines.activities.base import Activity, ActivityFailed, Argument, Kind
from engines.activities.meetings import hands, legs, way_together
from engines.activities.waypoints import asked_for, chosen, there_is, way_to
from engines.runs.preconditions import Precondition, at_posture
from handrail.messages import PlanMotion
from handrail.topics import RefusedError

_STROKE = ("instance", "trajectory")
_ENTRY = ("arc", "entry_shift")
_TO = ("waypoint", "way", "leaving", "other")
_MOTION = ("goals", "through", "keep", "joints", "clearance")


class PlanActivity(Activity):
    """Plans one stroke (`instance`, `trajectory`), the way to one `waypoint` of a trajectory that is none, or a motion (`goals`, or
    `along`).

    With an `other` arm the way is that of two hands to a point of a template's `sync`, as `do: trajectory` has it, in one plan.
    The later strokes of a task pass the `arc` that the first one chose. `way` and `leaving` are those of `do: trajectory`.
    """

    arguments = {
        "instance": Argument(Kind.INSTANCE, required=False),
        "trajectory": Argument(Kind.TEXT, required=False),
        "waypoint": Argument(Kind.TEXT, required=False, default=""),
        "way": Argument(Kind.CHOICE, required=False, default="forwards", choices=("forwards", "backwards")),
        "leaving": Argument(Kind.TEXT, required=False, default=""),
        "arm": Argument(Kind.ARM, required=False, default=""),
        "other": Argument(Kind.ARM, required=False, default=""),
        "arc": Argument(Kind.NUMBER, required=False, unit="rad"),
        "entry_shift": Argument(Kind.NUMBER, required=False, default=0.0, unit="rad"),
        "goals": Argument(Kind.GOALS, required=False, default=()),
        "along": Argument(Kind.ALONG, required=False),
        "through": Argument(Kind.KEY_FRAMES, required=False, default=()),
        "keep": Argument(Kind.GOALS, required=False, default=()),
        "joints": Argument(Kind.NAMES, required=False, default=()),
        "clearance": Argument(Kind.NUMBER, required=False, default=0.01, unit="m"),
        "relax": Argument(Kind.NAMES, required=False, default=()),
        "after": Argument(Kind.VALUE, required=False),
    }
    outputs = frozenset({"plan", "arc_centre", "clearance", "limit_margin", "duration"})

    @classmethod
    def problem(cls, given: Mapping[str, Any]) -> tuple[str, str]:
        """See Activity."""
        if "arm" not in given and "joints" not in given:
            return "arm", "missing; expected an arm, or joints that move"
        if "along" in given:
            odd = [name for name in (*_STROKE, *_ENTRY, *_TO, "goals", "through") if name in given]
            return (odd[0], "beside along; expected one of both") if odd else ("", "")
        if "goals" in given:
            odd = [name for name in (*_STROKE, *_ENTRY, *_TO) if name in given]
            return (odd[0], "beside goals; expected one of both") if odd else ("", "")
        if "arm" not in given:
            return "arm", "missing; a stroke needs it"
        if missing := [name for name in _STROKE if name not in given]:
            return missing[0], "missing; plan needs it (with instance, trajectory), or goals, or along"
        if odd := [name for name in _MOTION if name in given]:
            return odd[0], "without goals; expected goals"
        wrong = (*_ENTRY, "relax") if "waypoint" in given else _TO
        if odd := [name for name in wrong if name in given]:
            other = "beside" if "waypoint" in given else "without"
            return odd[0], f"{other} waypoint; expected a stroke, or the way to a waypoint"
        return "", ""

    def run(self) -> dict[str, Any]:
        from engines.plans.making import make_motion, make_plan  # which imports this package

        self.services.daemon.hold_time(self.context.hold_s)
        values = self.values
        self._from = self.services.daemon.command()
        after = str(values["after"] or "")
        call: PlanMotion | None = None
        if values["waypoint"]:
            call = self._way()
        elif values["goals"] or values["along"]:
            call = PlanMotion(
                goals=list(values["goals"]),
                along=values["along"],
                arm=values["arm"],
                through=list(values["through"]),
                keep=list(values["keep"]),
                joints=list(values["joints"]),
                clearance=values["clearance"],
                relax=list(values["relax"]),
                after=after,
            )
        if call is not None:
            record, preview = make_motion(
                self.services, call, run=self.context.run, seeds=self.context.seeds, cancelled=self.cancelled.is_set
            )
        else:
            record, preview = make_plan(
                self.services,
                values["instance"],
                values["trajectory"],
                values["arm"],
                arc=values["arc"],
                entry_shift=values["entry_shift"] or 0.0,
                after=after,
                relax=list(values["relax"]),
                run=self.context.run,
                cancelled=self.cancelled.is_set,
            )
        self.context.notes.planned(preview)
        return {
            "plan": record.plan.id,
            "arc_centre": record.plan.outputs.get("arc_centre"),
            "clearance": preview.clearance,
            "limit_margin": preview.limit_margin,
            "duration": preview.duration,
        }

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        values, here, before = self.values, self.services.daemon.command(), getattr(self, "_from", None)
        if values["instance"]:
            yield there_is(self.services, values["instance"])
        if values["after"]:
            try:
                self.services.plans.get(str(values["after"]))
            except RefusedError as refused:
                yield Precondition("there is the plan from whose end it is planned", False, str(refused))
        elif here is None:
            yield Precondition(
                "it is known where the robot is", False, "the daemon has not told it", "a daemon that runs"
            )
        elif before is not None:
            joints = self.services.description.joints
            yield at_posture("the plan that is being made starts at the robot's present posture", joints, before, here)

    def _way(self) -> PlanMotion:
        """To the waypoint. Raises ActivityFailed."""
        values = self.values
        instance = asked_for(self.services, values["instance"])
        if values["other"]:
            return self._way_together(instance)
        (waypoint,) = chosen(
            self.services.description,
            instance,
            values["trajectory"],
            values["arm"],
            first=values["waypoint"],
            last=values["waypoint"],
            back=values["way"] == "backwards",
            leaving=values["leaving"],
        )
        call = way_to(waypoint, instance)
        if call is None:
            raise ActivityFailed(
                "refused",
                f"waypoint: {values['waypoint']} is gone to {waypoint.waypoint.approach}, which nobody plans; "
                "expected one that is gone to freely, or along a joint that is held",
            )
        return call

    def _way_together(self, instance: Instance) -> PlanMotion:
        """To the point of a sync. Raises ActivityFailed."""
        values, robot = self.values, self.services.description
        arms = hands(instance, values["trajectory"], (values["arm"], values["other"]), robot)
        at = values["waypoint"]
        (leg,) = legs(
            robot, instance, values["trajectory"], arms, first=at, last=at,
            back=values["way"] == "backwards", leaving=values["leaving"],
        )  # fmt: skip
        call = way_together(leg, instance)
        if call is None:
            raise ActivityFailed(
                "refused", f"waypoint: not both hands go to {at} freely; expected a point that both do"
            )
        return call
