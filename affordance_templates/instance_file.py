"""The instances on disk: written whole with every edit, read when the engine starts."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from affordance_templates.history import History, Mark
from affordance_templates.instance import Instance
from affordance_templates.template_file import Template
from handrail.messages import InstanceState


@dataclass(frozen=True)
class Kept:
    """All that is kept, at one moment; an edit makes a new one."""

    instances: Mapping[str, Instance] = field(default_factory=dict)
    versions: Mapping[str, int] = field(default_factory=dict)
    """the last version of every name ever used"""
    marks: Mapping[str, Mapping[str, Mark]] = field(default_factory=dict)
    """instance → field → who wrote it"""
    histories: Mapping[str, History] = field(default_factory=dict)
    """operator → what he can take back"""
    written: int = 0
    """the last mark's number"""
    unusable: Mapping[str, InstanceState] = field(default_factory=dict)
    """those whose templates are not there, or have no such shape"""

    def with_instance(self, instance: Instance, marks: Mapping[str, Mark]) -> Kept:
        """With an instance that is new, or as it is now."""
        return replace(
            self,
            instances={**self.instances, instance.name: instance},
            versions={**self.versions, instance.name: instance.version},
            marks={**self.marks, instance.name: marks},
            unusable={name: state for name, state in self.unusable.items() if name != instance.name},
        )

    def without(self, name: str) -> Kept:
        """Without an instance."""
        left = {each: instance for each, instance in self.instances.items() if each != name}
        return replace(self, instances=left, marks={each: one for each, one in self.marks.items() if each != name})

    def with_history(self, by: str, steps: History) -> Kept:
        """With an operator's steps."""
        return replace(self, histories={**self.histories, by: steps})


class _Saved(msgspec.Struct, kw_only=True):
    """The file. Those written before operators were told apart have only the first two."""

    instances: list[InstanceState] = []
    versions: dict[str, int] = {}
    marks: dict[str, dict[str, Mark]] = {}
    histories: dict[str, History] = {}
    written: int = 0


def write(file: Path, kept: Kept) -> None:
    """Write all, whole: a crash leaves the old file or the new one. Who holds what is not written. Raises OSError."""
    saved = _Saved(
        instances=[
            *(msgspec.structs.replace(each.state(), held_by="") for each in kept.instances.values()),
            *kept.unusable.values(),
        ],
        versions=dict(kept.versions),
        marks={name: dict(marks) for name, marks in kept.marks.items()},
        histories=dict(kept.histories),
        written=kept.written,
    )
    beside = file.with_suffix(".new")
    beside.write_bytes(msgspec.json.format(msgspec.json.encode(saved)))
    os.replace(beside, file)


def read(file: Path, find: Callable[[str], Template]) -> tuple[Kept, list[str]]:
    """What was kept, and what was wrong with it, for people. A file that is none is put aside.

    :param find: a template by its name; raises ConfigError
    """
    problems: list[str] = []
    saved = _read(file, problems)
    found: dict[str, Instance] = {}
    unusable: dict[str, InstanceState] = {}
    versions = dict(saved.versions)
    for state in saved.instances:
        try:
            template = find(state.template)
            # A template that was edited meanwhile is an edit of the instance.
            version = state.version + (state.template_hash != template.hash)
            joints = template.resolve(template.values(state.parameters)).joints
            known = {joint: at for joint, at in state.joint_state.items() if joint in joints}
            instance = replace(Instance.of(state, template), joint_state=known, version=version)
        except ValueError as problem:  # ConfigError among them
            unusable[state.name] = state
            problems.append(f"instance {state.name}: {problem}; kept on disk, not in the world")
            continue
        found[state.name] = instance
        versions[state.name] = max(version, versions.get(state.name, 0))
    return Kept(found, versions, saved.marks, saved.histories, saved.written, unusable), problems


def _read(file: Path, problems: list[str]) -> _Saved:
    try:
        return msgspec.json.decode(file.read_bytes(), type=_Saved)
    except FileNotFoundError:
        return _Saved()
    except (msgspec.DecodeError, UnicodeDecodeError) as problem:
        aside = file.with_suffix(".unreadable")
        os.replace(file, aside)
        problems.append(f"{file}: not the instances' file ({problem}); put aside as {aside.name}, starting without any")
        return _Saved()
