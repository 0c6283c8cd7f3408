"""Templates that only the robot has, or has otherwise than this machine: each is fetched once, and then found as a workspace's."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path

from affordance_templates import catalogue, travelling
from handrail import workspace
from handrail.config import ConfigError
from handrail.messages import GetTemplate, InstanceState, Message, TemplateSource
from tablet_client.models import bench, sliders


class Templates:
    """What is asked for, and where what came is kept."""

    def __init__(self) -> None:
        self.arrived = 0
        """how many have come: whoever has drawn instances before draws them anew"""
        self.problem = ""
        self._seen: set[tuple[str, str]] = set()
        """(template, hash) that is here, or was asked for"""
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def want(self, instances: Iterable[InstanceState]) -> list[Message]:
        """The calls that are due: for each template that these are of and that is not here as they are of it, once."""
        calls: list[Message] = []
        for state in instances:
            if (key := (state.template, state.template_hash)) not in self._seen:
                self._seen.add(key)
                if _hash(state.template) != state.template_hash:
                    calls.append(GetTemplate(template=state.template))
        return calls

    def take(self, source: TemplateSource) -> None:
        """One has come: from now on it is the one of its name, here."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="handrail-templates-")
        try:
            travelling.put(source, Path(self._folder.name))
        except (ValueError, OSError) as problem:
            self.problem = str(problem)
            return
        workspace.use(Path(self._folder.name))
        bench.forget()
        sliders.schema.cache_clear()
        self.arrived += 1

    def anew(self) -> None:
        """Another robot, or the same one again: ask for what differs."""
        self._seen.clear()


def _hash(template: str) -> str:
    try:
        return catalogue.load(template).hash
    except ConfigError:
        return ""
