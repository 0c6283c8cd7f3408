"""What a program's states can do, by the name that `do:` gives."""

from __future__ import annotations

from collections.abc import Mapping

from engines.activities.base import Activity
from engines.activities.behave import BehaveActivity
from engines.activities.control import ControlActivity
from engines.activities.execute import ExecuteActivity
from engines.activities.hand import HandActivity
from engines.activities.node import NodeActivity
from engines.activities.plan import PlanActivity
from engines.activities.prompt import PromptActivity
from engines.activities.retreat import RetreatActivity
from engines.activities.trajectory import TrajectoryActivity

ACTIVITIES: Mapping[str, type[Activity]] = {
    "plan": PlanActivity,
    "execute": ExecuteActivity,
    "prompt": PromptActivity,
    "retreat": RetreatActivity,
    "behave": BehaveActivity,
    "control": ControlActivity,
    "node": NodeActivity,
    "hand": HandActivity,
    "trajectory": TrajectoryActivity,
}
