"""`do: plan`: plan a template's trajectory for an arm, or a motion to goals, from where the robot is commanded to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from engines.activities.base import Activity, Argument, Kind
from handrail.messages import PlanMotion

_STROKE = ("instance", "trajectory")
_MOTION = ("goals", "through", "keep", "joints", "clearance", "relax")


class PlanActivity(Activity):
    """Plans one visit (`instance`, `trajectory`), or a motion (`goals`, or `along`).

    The later strokes of a task pass the `arc` that the first one chose.
    """

    arguments = {
        "instance": Argument(Kind.INSTANCE, required=False),
        "trajectory": Argument(Kind.NAME, required=False),
        "arm": Argument(Kind.ARM),
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
        if "along" in given:
            odd = [name for name in (*_STROKE, "arc", "entry_shift", "goals", "through") if name in given]
            return (odd[0], "beside along; expected one of both") if odd else ("", "")
        if "goals" in given:
            odd = [name for name in (*_STROKE, "arc", "entry_shift") if name in given]
            return (odd[0], "beside goals; expected one of both") if odd else ("", "")
        if missing := [name for name in _STROKE if name not in given]:
            return missing[0], "missing; plan needs it (with instance, trajectory), or goals, or along"
        odd = [name for name in _MOTION if name in given]
        return (odd[0], "without goals; expected goals") if odd else ("", "")

    def run(self) -> dict[str, Any]:
        from engines.plans.making import make_motion, make_plan  # which imports this package

        self.services.daemon.hold_time(self.context.hold_s)
        values = self.values
        after = str(values["after"] or "")
        if values["goals"] or values["along"]:
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
