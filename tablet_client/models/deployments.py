"""The robot's engines: what each runs, which code it has and since when, and what it can be rolled back to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from handrail.messages import (
    CodeChanged,
    EngineInfo,
    GetEngines,
    GetReleases,
    Message,
    Release,
    Releases,
    RollBack,
)

_SHOWN = 8  # digits of a bundle's hash: as many as one can compare by eye


@dataclass(frozen=True)
class Held:
    """A program that was deployed to an engine."""

    program: str
    bundle: str
    """the first digits of the hash of everything that it came with"""
    release: Release | None
    """the one that it came with; None: it is not kept any more"""
    match: str
    """`same`, `differs`: than what the other engines have of it; `only`: they have nothing of it"""


class Deployments:
    """What is known of all engines. `open`: someone looks, so that it is asked for."""

    def __init__(self) -> None:
        self.engines: dict[str, EngineInfo] = {}
        """by name, the first one first"""
        self.releases: dict[str, Releases] = {}
        self.engine = ""
        """the one whose releases are looked at; empty: the first"""
        self.open = False
        self.problem = ""
        self._listed = False
        self._asked: set[str] = set()

    @property
    def chosen(self) -> str:
        return self.engine if self.engine in self.engines else next(iter(self.engines), "")

    def choose(self, engine: str) -> None:
        self.engine, self.problem = engine, ""

    def want(self) -> list[Message]:
        """The calls that are due, each once."""
        if not self.open:
            return []
        calls: list[Message] = []
        if not self._listed:
            self._listed = True
            calls.append(GetEngines())
        for name, info in self.engines.items():
            if info.up and name not in self.releases and name not in self._asked:
                self._asked.add(name)
                calls.append(GetReleases(engine=name))
        return calls

    def take(self, call: Message, answer: Any) -> None:
        if isinstance(call, GetEngines):
            self.engines = {each.name: each for each in answer.engines}
        elif isinstance(call, GetReleases) and call.engine in self._asked:
            self._asked.discard(call.engine)
            self.releases[call.engine] = answer
        elif isinstance(call, RollBack):
            self.problem = ""

    def failed(self, call: Message, why: str) -> None:
        """Whatever could not be asked is asked again when the engine is there again."""
        if isinstance(call, RollBack | GetEngines | GetReleases):
            self.problem = why

    def info(self, told: EngineInfo) -> None:
        """An engine has come, gone, or does something else."""
        before = self.engines.get(told.name)
        self.engines[told.name] = told
        if before is None or before.up != told.up:
            self._forget(told.name)

    def changed(self, told: CodeChanged) -> None:
        self._forget(told.engine)

    def anew(self) -> None:
        """The robot has come back: ask for everything again."""
        self.engines.clear()
        self.releases.clear()
        self._asked.clear()
        self._listed, self.problem = False, ""

    def _forget(self, engine: str) -> None:
        self.releases.pop(engine, None)
        self._asked.discard(engine)

    # ------------------------------------------------------------------------------------------------------- what is so

    def held(self, engine: str) -> list[Held]:
        """What was deployed to an engine; of all else it has the robot's own library."""
        found = self.releases.get(engine)
        if found is None:
            return []
        return [
            Held(
                program,
                bundle[:_SHOWN],
                next((each for each in reversed(found.releases) if each.bundle == bundle), None),
                self._match(engine, program, bundle),
            )
            for program, bundle in sorted(found.programs.items())
        ]

    def _match(self, engine: str, program: str, bundle: str) -> str:
        others = {
            each.programs[program]
            for name, each in self.releases.items()
            if name != engine and program in each.programs
        }
        return "only" if not others else "same" if others == {bundle} else "differs"

    def back(self, number: int) -> Message | None:
        """What takes the chosen engine back to a release; None where that is not there, or in force."""
        found = self.releases.get(self.chosen)
        if found is None or number not in [each.number for each in found.releases[:-1]]:
            return None
        return RollBack(number=number, engine=self.chosen)
