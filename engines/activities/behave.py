"""`do: behave`: run a behaviour, a chain of motions that the control loop follows by itself, with an arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from engines.activities.base import Activity, ActivityFailed, Argument, Kind
from engines.runs.motion import MotionFailed
from engines.runs.preconditions import Precondition
from handrail.behaviour_file import SOME_ARM, BehaviourFile, Part, find
from handrail.config import ConfigError


class BehaveActivity(Activity):
    """Runs a behaviour as its file is now. Done with the `step` in which it ended and the `outcome`: `done`, the end condition that
    ended it (`contact`), or what the file leads to `end`.
    """

    arguments = {"behaviour": Argument(Kind.BEHAVIOUR), "arm": Argument(Kind.ARM, required=False, default="")}
    outputs = frozenset({"outcome", "step"})

    @classmethod
    def problem(cls, given: Mapping[str, Any]) -> tuple[str, str]:
        try:
            BehaviourFile(find(str(given["behaviour"])), SOME_ARM if "arm" in given else None)
        except ConfigError as problem:
            return "arm", str(problem)
        return "", ""

    def run(self) -> dict[str, Any]:
        name, description = self.values["behaviour"], self.services.description
        arm = description.arms.get(self.values["arm"])
        try:
            behaviour = BehaviourFile(find(name), Part(arm.tip, arm.joints) if arm else None)
            ended = self.context.motion.run_behaviour(behaviour, description, self.cancelled, what=name)
        except ConfigError as problem:
            raise ActivityFailed("refused", str(problem)) from problem
        except MotionFailed as failed:
            raise ActivityFailed(failed.reason, str(failed)) from failed
        return {"outcome": ended.outcome, "step": ended.step}

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        name = self.values["behaviour"]
        try:
            find(name)
        except ConfigError as gone:
            yield Precondition(f"there is the behaviour {name}", False, str(gone))
        yield from super().preconditions()

    def cancel(self) -> None:
        super().cancel()
        self.context.motion.interrupt()
