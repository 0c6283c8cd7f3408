"""`do: prompt`: ask the operator, and wait for the answer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from engines import identifiers
from engines.activities.base import Activity, ActivityFailed, Argument, Kind
from engines.runs.preconditions import Precondition
from handrail.messages import Prompt
from handrail.topics import RefusedError

_HOLD_S = 10.0


class PromptActivity(Activity):
    """Asks with a text, options and, where there is one, the plan that it is about (drawn as a ghost)."""

    arguments = {
        "text": Argument(Kind.TEXT),
        "options": Argument(Kind.NAMES, required=False, default=("approve", "reject")),
        "plan": Argument(Kind.VALUE, required=False, default=""),
        "severity": Argument(Kind.CHOICE, required=False, default="confirm", choices=("info", "confirm", "warning")),
    }
    outputs = frozenset({"answer", "by"})

    def run(self) -> dict[str, Any]:
        if self.values["severity"] != "info":
            # Simulated time waits for a quick answer (a script's), not for a person's.
            self.services.daemon.hold_time(min(_HOLD_S, self.context.hold_s))
        self._id = identifiers.new("prompt", 10)
        values = self.values
        self.services.prompts.ask(
            Prompt(
                id=self._id,
                run=self.context.run,
                text=values["text"],
                options=list(values["options"]),
                plan=values["plan"] or "",
                severity=values["severity"],
                details=self._details(values["plan"]),
            )
        )
        if self.cancelled.is_set():
            self.services.prompts.withdraw(self._id)
        closed = self.services.prompts.wait(self._id)
        if not closed.answer:
            raise ActivityFailed("cancelled", "the prompt was withdrawn")
        self.services.daemon.hold_time(self.context.hold_s)
        return {"answer": closed.answer, "by": closed.by}

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity: whoever approves of a plan must not approve of one that can't be executed any more."""
        if not (plan := self.values["plan"]):
            return
        try:
            record = self.services.plans.get(plan)
        except RefusedError as refused:
            yield Precondition("there is the plan that it asks about", False, str(refused))
            return
        if record.reached < 0:
            for cause in self.services.plans.causes(record):
                yield Precondition(
                    f"{plan} ({record.plan.label}), which it asks about, can be executed", False, cause.words
                )

    def _details(self, plan: str | None) -> dict[str, float]:
        if not plan:
            return {}
        try:
            preview = self.services.plans.preview(self.services.plans.get(plan))
        except RefusedError as refused:
            raise ActivityFailed("refused", str(refused)) from refused
        return {
            "clearance_m": preview.clearance,
            "limit_margin_rad": preview.limit_margin,
            "duration_s": preview.duration,
        }

    def cancel(self) -> None:
        super().cancel()
        if hasattr(self, "_id"):
            self.services.prompts.withdraw(self._id)
