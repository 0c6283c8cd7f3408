"""The library and the deployments as QML sees them, and the buttons' way down."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from handrail.messages import Message, SetRunParameters
from tablet_client.models.given import ROLES
from tablet_client.models.launch import Slot as Resource
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

GOALS = ("run", "check")
_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_HASH = 8  # digits that are shown of a program's


class LibraryDesk(QObject):
    """What QML reads of programs that could be run and of code that engines have, and calls."""

    changed = Signal()

    def __init__(self, situation: Situation, send: Callable[[Message], None], soon: Callable[[], None]):
        """`send` sends what a button asked for, `soon` has the models looked at anew."""
        super().__init__()
        self._situation, self._send, self._soon = situation, send, soon
        self._view: dict[str, Any] = {}
        self._programs = Rows(("name", "title", "problem", "chosen"), "name")
        self._slots = Rows(("name", "title", "kind", "template", "fitting", "bound"), "name")
        self._parameters = Rows(ROLES, "name")
        self._engines = Rows(("name", "up", "host", "program", "status", "release", "chosen"), "name")
        self._held = Rows(("program", "bundle", "number", "by", "since", "match"), "program")
        self._releases = Rows(("number", "program", "by", "since", "note", "changed", "inForce"), "number")
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(QObject, constant=True)
    def programs(self) -> Rows:
        return self._programs

    @Property(QObject, constant=True)
    def slots(self) -> Rows:
        return self._slots

    @Property(QObject, constant=True)
    def parameters(self) -> Rows:
        return self._parameters

    @Property(QObject, constant=True)
    def engines(self) -> Rows:
        return self._engines

    @Property(QObject, constant=True)
    def held(self) -> Rows:
        return self._held

    @Property(QObject, constant=True)
    def releases(self) -> Rows:
        return self._releases

    # -------------------------------------------------------------------------------------------------------- buttons

    @Slot(bool)
    def open(self, on: bool) -> None:
        """Someone looks at the engines: they are asked."""
        self._situation.deployments.open = on
        self._soon()

    @Slot(str)
    def at(self, engine: str) -> None:
        """Have another engine's library and releases before one."""
        self._situation.deployments.choose(engine)
        first = next(iter(self._situation.deployments.engines), "")
        self._situation.launch.at("" if engine == first else engine)
        self._soon()

    @Slot(str)
    def choose(self, program: str) -> None:
        self._situation.launch.choose(program)
        self._soon()

    @Slot(str, str)
    def bind(self, resource: str, to: str) -> None:
        self._situation.launch.bind(resource, to)
        self._soon()

    @Slot(str, float)
    def turn(self, parameter: str, value: float) -> None:
        """A number is set, in the parameter's own unit."""
        whole = any(row["name"] == parameter and row["type"] == "integer" for row in self._parameters.lines)
        number: float | int = round(value) if whole and math.isfinite(value) else float(f"{value:.6g}")
        self._situation.launch.give(parameter, number)
        self._soon()

    @Slot(str, str)
    def write(self, parameter: str, text: str) -> None:
        self._situation.launch.give(parameter, text)
        self._soon()

    @Slot(str, bool)
    def switch(self, parameter: str, on: bool) -> None:
        self._situation.launch.give(parameter, on)
        self._soon()

    @Slot(str)
    def do(self, goal: str) -> None:
        """`run` or `check`: deployed, if it is not yet, and then that; nothing while the button says why it can't."""
        if goal in GOALS and not self.why(goal):
            self._situation.launch.wish(goal)
            self._soon()

    @Slot()
    def apply(self) -> None:
        """Give the run that is under way what was set here: each value counts from its next use."""
        if not self.why("set"):
            self._send(SetRunParameters(parameters=self._situation.launch.changes))

    @Slot(int)
    def rollBack(self, number: int) -> None:
        """Bring the chosen engine's code of an earlier release back into force."""
        call = None if self.why("roll_back") else self._situation.deployments.back(number)
        if call is not None:
            self._send(call)

    @Slot(str, str)
    def bring(self, what: str, engine: str) -> None:
        """Have what was deployed to the engine that is looked at at another one, too; nothing while `why` says why not."""
        if not self.why("bring"):
            self._situation.bringing.begin(what, self._situation.deployments.chosen, engine)
            self._soon()

    def why(self, command: str) -> str:
        """Code of the reason why `run`, `check`, `set`, `roll_back` or `bring` can't be done now; empty when it can."""
        situation = self._situation
        if situation.only_looks:
            return situation.only_looks
        if not situation.link.attached:
            return "no_robot"
        if not situation.link.engine:
            return "no_engine"
        if command == "bring":
            return "sending" if situation.bringing.busy else ""
        if command == "roll_back":
            info = situation.deployments.engines.get(situation.deployments.chosen)
            if info is None or not info.up:
                return "no_engine"
            return "sending" if "RollBack" in situation.pending else ""
        if situation.others_command and command in ("run", "set"):
            return situation.others_command
        if command == "set":
            return "sending" if "SetRunParameters" in situation.pending else situation.launch.why_not_set()
        if why := situation.launch.why_not(self._resources()):
            return why
        return "run_under_way" if self._busy() in ("running", "paused") else ""

    def _busy(self) -> str:
        """How the run of the engine stands that this would be run at."""
        engine = self._situation.launch.engine
        if not engine:
            return self._situation.task.status
        info = self._situation.deployments.engines.get(engine)
        return info.status if info else ""

    def _running(self) -> dict[str, Any]:
        """The values that the run under way has of the program's parameters; none where it is another program's."""
        launch, run = self._situation.launch, self._situation.task.run
        here = run is not None and not launch.engine and run.program == launch.program
        if run is None or not here or self._busy() not in ("running", "paused") or launch.source is None:
            return {}
        names = [each.name for each in launch.source.parameters]
        return {name: run.data[name] for name in names if name in run.data}

    def _resources(self) -> list[Resource]:
        robot = self._situation.robot.info
        return self._situation.launch.slots(tuple(robot.arms) if robot else (), self._situation.world.instances)

    # -------------------------------------------------------------------------------------------------------- looking

    def want(self) -> list[Message]:
        """The calls that are due."""
        return (
            self._situation.launch.want(self._resources())
            + self._situation.deployments.want()
            + self._situation.bringing.want()
        )

    def build(self) -> None:
        """Look at the models anew."""
        launch = self._situation.launch
        launch.running = self._running()
        self._programs.show(
            [
                {"name": each.name, "title": each.title, "problem": each.problem, "chosen": each.name == launch.program}
                for each in launch.programs
            ]
        )
        slots = self._resources()
        self._slots.show(
            [
                {
                    "name": each.resource.name,
                    "title": each.resource.title,
                    "kind": each.resource.kind,
                    "template": " or ".join(each.resource.templates),
                    "fitting": list(each.fitting),
                    "bound": each.bound,
                }
                for each in slots
            ]
        )
        self._parameters.show([each.shown() for each in launch.parameters])
        self._build_engines()
        entry = next((each for each in launch.programs if each.name == launch.program), None)
        view = {
            "program": launch.program,
            "title": entry.title if entry else "",
            "about": launch.about,
            "hash": entry.hash[:_HASH] if entry else "",
            "known": bool(launch.entries),
            "problem": launch.problem,
            "started": launch.started,
            "running": bool(launch.running),
            "deployed": launch.deployment is not None,
            "warnings": list(launch.deployment.warnings) if launch.deployment else [],
            "check": self._check(),
            "why": {name: self.why(name) for name in (*GOALS, "set", "roll_back", "bring")},
            "others": self._others(),
            "brought": dict(zip(("code", "what", "engine", "why"), self._situation.bringing.said, strict=True)),
            "engine": self._situation.deployments.chosen,
            "engineProblem": self._situation.deployments.problem,
            "runs": self._runs(),
        }
        if view != self._view:
            self._view = view
            self.changed.emit()

    def _others(self) -> list[str]:
        """Engines that are there, but for the one that is looked at."""
        deployments = self._situation.deployments
        return [each.name for each in deployments.engines.values() if each.up and each.name != deployments.chosen]

    def _build_engines(self) -> None:
        deployments = self._situation.deployments
        chosen = deployments.chosen
        self._engines.show(
            [
                {
                    "name": each.name,
                    "up": each.up,
                    "host": each.host,
                    "program": each.program,
                    "status": each.status,
                    "release": each.release,
                    "chosen": each.name == chosen,
                }
                for each in deployments.engines.values()
            ]
        )
        self._held.show(
            [
                {
                    "program": each.program,
                    "bundle": each.bundle,
                    "number": each.release.number if each.release else 0,
                    "by": each.release.by if each.release else "",
                    "since": _when(each.release.at_ns) if each.release else "",
                    "match": each.match,
                }
                for each in deployments.held(chosen)
            ]
        )
        found = deployments.releases.get(chosen)
        kept = found.releases if found else []
        self._releases.show(
            [
                {
                    "number": each.number,
                    "program": each.program,
                    "by": each.by,
                    "since": _when(each.at_ns),
                    "note": each.note,
                    "changed": list(each.changed),
                    "inForce": each is kept[-1],
                }
                for each in reversed(kept)
            ]
        )

    def _runs(self) -> dict[str, Any]:
        """Whether what ran last at the engine that is looked at is what its library has in force now."""
        situation = self._situation
        deployments, run = situation.deployments, situation.task.run
        first = deployments.chosen == next(iter(deployments.engines), deployments.chosen)
        if first:
            program, hash_ = (run.program, run.hash) if run is not None else ("", "")
        else:
            info = deployments.engines[deployments.chosen]
            program, hash_ = info.program, info.hash
        if not program or not hash_:
            return {"program": "", "hash": "", "match": ""}
        library = situation.library if first else situation.launch.entries
        entry = next((each for each in library if each.name == program), None)
        match = "unknown" if entry is None or not entry.hash else "same" if entry.hash == hash_ else "differs"
        return {"program": program, "hash": hash_[:_HASH], "match": match}

    def _check(self) -> dict[str, Any]:
        check = self._situation.launch.check
        if check is None:
            return {"done": False, "feasible": False, "where": "", "why": "", "motions": 0, "unknown": 0}
        bad = next((step for step in check.steps if step.problem), None)
        return {
            "done": True,
            "feasible": check.feasible,
            "where": check.first_infeasible,
            "why": bad.problem if bad else check.detail,
            "motions": sum(not step.problem and not step.unknown for step in check.steps),
            "unknown": sum(step.unknown for step in check.steps),
        }


def _when(at_ns: int) -> str:
    return datetime.fromtimestamp(at_ns / 1e9).astimezone().strftime("%Y-%m-%d %H:%M")
