"""A program on its way from the library to being run: what it is bound to, its parameters, its check, its start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from handrail.messages import (
    CheckTask,
    Deploy,
    Deployment,
    GetProgram,
    InstanceState,
    LibraryEntry,
    ListLibrary,
    Message,
    ProgramResource,
    ProgramSource,
    Run,
    TaskCheck,
)
from tablet_client.models.given import Given, of_program


@dataclass(frozen=True)
class Slot:
    """A resource, what it can be bound to, and what it is bound to (empty: nothing yet)."""

    resource: ProgramResource
    fitting: tuple[str, ...]
    bound: str


class Launch:
    """One program of one engine's library (`engine` empty: the first engine's), as the operator has it before her.

    Whoever has a session asks `want` for the calls that are due, each once, and hands their answers to `take` or `failed`.
    """

    def __init__(self) -> None:
        self.entries: list[LibraryEntry] = []
        """the engine's programs and templates, as they are in force now"""
        self.engine = ""
        self.program = ""
        self.source: ProgramSource | None = None
        self.deployment: Deployment | None = None
        """what the robot has bound as it stands here; None where something was changed since, or nothing was deployed"""
        self.check: TaskCheck | None = None
        self.problem = ""
        """what the robot said against it"""
        self.started = 0
        """how many runs were started from here"""
        self.running: Mapping[str, Any] = {}
        """the values that a run of this very program has now; empty: it does not run"""
        self._bound: dict[str, str] = {}
        self._given: dict[str, Any] = {}
        self._goal = ""  # what follows when it is deployed: run, check
        self._listed = False
        self._out: dict[str, Message] = {}  # calls that wait for an answer, by what they are for

    # ------------------------------------------------------------------------------------------------ what the operator does

    def at(self, engine: str) -> None:
        """Look at another engine's library."""
        if engine != self.engine:
            self.engine, self._listed = engine, False
            self._out.pop("library", None)
            self.choose("")

    def choose(self, program: str) -> None:
        """Take a program up, with nothing bound and every parameter as its file has it; empty: none."""
        self.program, self.source = program, None
        self._bound, self._given = {}, {}
        self._out.pop("source", None)
        self._changed()

    def bind(self, resource: str, to: str) -> None:
        self._bound[resource] = to
        self._changed()

    def give(self, parameter: str, value: Any) -> None:
        """Set a parameter; whether it may have the value is told by `parameters`."""
        self._given[parameter] = value
        self._changed()

    def wish(self, goal: str) -> None:
        """`run` or `check` it, deployed before where it is not yet. Only where `why_not` has nothing against it."""
        self._goal, self.problem = goal, ""
        if goal == "check":
            self.check = None

    def _changed(self) -> None:
        self.deployment, self.check, self.problem, self._goal = None, None, "", ""
        for what in ("deploy", "check", "run"):
            self._out.pop(what, None)

    # ------------------------------------------------------------------------------------------------------- what is so

    @property
    def programs(self) -> list[LibraryEntry]:
        return [each for each in self.entries if each.kind == "program"]

    @property
    def about(self) -> str:
        """What the file's author wrote above everything else, without its comment signs."""
        lines = []
        for line in self.source.text.splitlines() if self.source else []:
            if not line.startswith("#"):
                break
            lines.append(line.lstrip("#").strip())
        return " ".join(lines)

    def slots(self, arms: Sequence[str], instances: Mapping[str, InstanceState]) -> list[Slot]:
        """Its resources. What only one thing fits is bound to that."""
        made = []
        for each in self.source.resources if self.source else []:
            if each.kind == "arm":
                fitting = tuple(arms)
            else:
                fitting = tuple(
                    name for name, one in instances.items() if not each.templates or one.template in each.templates
                )
            bound = self._bound.get(each.name, fitting[0] if len(fitting) == 1 else "")
            made.append(Slot(each, fitting, bound if bound in fitting else ""))
        return made

    @property
    def parameters(self) -> list[Given]:
        """With the values that they would be deployed with, or have in the run that is under way."""
        made = []
        for each in self.source.parameters if self.source else []:
            value = self._given.get(each.name, self.running.get(each.name, each.default))
            made.append(of_program(each, value))
        return made

    @property
    def changes(self) -> dict[str, Any]:
        """What was set here and is otherwise in the run that is under way."""
        return {
            each.parameter.name: each.value
            for each in self.parameters
            if each.parameter.name in self.running and each.value != self.running[each.parameter.name]
        }

    def why_not_set(self) -> str:
        """Code of the reason why the run that is under way can't be given what was set here."""
        if not self.running:
            return "not_running"
        if not all(given.fits for given in self.parameters):
            return "bad_parameter"
        return "" if self.changes else "nothing_changed"

    def why_not(self, slots: Sequence[Slot]) -> str:
        """Code of the reason why it can't be deployed yet, as far as it is known here; empty when it can."""
        if not self.program:
            return "no_program_chosen"
        if self.source is None:
            return "loading"
        if self._goal:
            return "sending"
        if any(not slot.bound for slot in slots):
            return "unbound" if all(slot.fitting for slot in slots) else "nothing_fits"
        return "" if all(given.fits for given in self.parameters) else "bad_parameter"

    # ------------------------------------------------------------------------------------------------------- its calls

    def want(self, slots: Sequence[Slot]) -> list[Message]:
        """The calls that are due."""
        calls: list[Message] = []
        if not self._listed:
            self._listed = True
            calls += self._once("library", ListLibrary(engine=self.engine))
        if self.program and self.source is None:
            calls += self._once("source", GetProgram(program=self.program, engine=self.engine))
        if self._goal and self.deployment is None:
            bindings = {slot.resource.name: slot.bound for slot in slots}
            deploy = Deploy(program=self.program, bindings=bindings, parameters=dict(self._given), engine=self.engine)
            calls += self._once("deploy", deploy)
        elif self._goal and self.deployment is not None:
            id = self.deployment.id
            run = Run(deployment=id, on_failure="pause")
            calls += self._once(self._goal, run if self._goal == "run" else CheckTask(deployment=id))
        return calls

    def _once(self, what: str, call: Message) -> list[Message]:
        if what in self._out:
            return []
        self._out[what] = call
        return [call]

    def take(self, call: Message, answer: Any) -> None:
        """An answer to one of `want`'s calls; one to a call that does not fit any more what stands here counts for nothing."""
        what = self._returned(call)
        if what == "library":
            self.entries = answer.entries
        elif what == "source":
            self.source = answer
        elif what == "deploy":
            self.deployment = answer
        elif what:
            self._goal = ""
            if isinstance(answer, TaskCheck):
                self.check = answer
            else:
                self.started += 1

    def failed(self, call: Message, why: str) -> None:
        """One of them was refused, or not answered."""
        what = self._returned(call)
        if not what:
            return
        self.problem, self._goal = why, ""
        if what == "source":
            self.program = ""
        elif what in ("run", "check"):
            self.deployment = None  # what it was bound to may be gone: bound anew the next time

    def _returned(self, call: Message) -> str:
        """What a call was for; empty where it was none of those that stand out."""
        what = next((what for what, each in self._out.items() if each is call), "")
        self._out.pop(what, None)
        return what

    def anew(self) -> None:
        """The engine has come back, or has other code: look at everything again, keep what the operator has chosen."""
        self._listed, self.source = False, None
        self._out.clear()
        self._changed()
