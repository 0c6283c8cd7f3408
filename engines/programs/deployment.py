"""Deploying: a checked program, its resources bound to parts of this robot and instances of this world, its parameters given."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from engines import identifiers
from engines.programs.program import TEMPLATE, Program
from engines.programs.schema import Resource
from handrail import workspace
from handrail.messages import Deploy
from handrail.robot.description import RobotDescription
from handrail.topics import refuse


@dataclass(frozen=True)
class Deployed:
    """What `Run` runs."""

    id: str
    program: Program
    bindings: Mapping[str, str]
    """resource → arm or instance"""
    parameters: Mapping[str, Any]
    """every parameter's value"""
    templates: Mapping[str, str] = field(default_factory=dict)
    """resource that is an instance → the template that it is of"""
    folder: Path | None = None
    """of the release that it was made from: its nodes and behaviours are found there, whatever is deployed meanwhile"""

    def names(self) -> dict[str, Any]:
        """What the program's expressions see."""
        templates = {f"{TEMPLATE}{name}": template for name, template in self.templates.items()}
        return {**self.program.variables, **self.parameters, **self.bindings, **templates}

    def newer_than(self, other: Deployed) -> bool:
        """Whether it is another version of the same program, bound to the same."""
        same = (self.program.name, self.bindings) == (other.program.name, other.bindings)
        return same and not self.program.same_as(other.program)


def deploy(request: Deploy, program: Program, description: RobotDescription, affordances: AffordanceServer) -> Deployed:
    """Bind a program. Refused, naming field, value and expectation, where a binding or a parameter is missing, unknown or wrong."""
    for name, bound in request.bindings.items():
        if name not in program.resources:
            known = ", ".join(program.resources) or "none"
            raise refuse(
                f"program {program.name} has no resource {name!r}", f"bindings.{name}", bound, f"one of: {known}"
            )
    placed = affordances.instances()
    for name, resource in program.resources.items():
        found = fitting(resource, description, placed)
        bound = request.bindings.get(name, "")
        if bound not in found:
            what = f"resource {name!r} is not bound" if not bound else f"resource {name!r} can't be bound to {bound!r}"
            raise refuse(what, f"bindings.{name}", bound or "nothing", _listed(resource, found))
    check_parameters(program, request.parameters)
    parameters = {name: parameter.default for name, parameter in program.parameters.items()} | request.parameters
    id = identifiers.new(program.name)
    of_template = {each.name: each.template.name for each in placed}
    templates = {name: of_template[request.bindings[name]] for name in program.instances}
    return Deployed(id, program, dict(request.bindings), parameters, templates, workspace.deployed())


def check_parameters(program: Program, parameters: Mapping[str, Any]) -> None:
    """Refuse the first parameter that is unknown or can't have its value."""
    for name, value in parameters.items():
        problem, expected = program.problem(name, value)
        if problem:
            raise refuse(f"parameter {name}: {problem}", f"parameters.{name}", value, expected)


def check_breakpoints(deployed: Deployed, states: Iterable[str]) -> None:
    """Refuse the first state that the program does not have, or that does nothing before which one could wait."""
    doing = [state.id for state in deployed.program.states() if state.file.do]
    for k, id in enumerate(states):
        if id not in doing:
            raise refuse("no state that does something", f"states[{k}]", id, f"one of: {', '.join(doing)}")


def still_bound(deployed: Deployed, description: RobotDescription, affordances: AffordanceServer) -> None:
    """Refuse a deployment whose instances have been removed since."""
    for name, resource in deployed.program.resources.items():
        found = fitting(resource, description, affordances.instances())
        if deployed.bindings[name] not in found:
            gone = deployed.bindings[name]
            raise refuse(
                f"what {name!r} was bound to is gone: deploy again",
                f"bindings.{name}",
                gone,
                _listed(resource, found),
            )


def fitting(resource: Resource, description: RobotDescription, instances: Iterable[Instance]) -> list[str]:
    """What a resource can be bound to, where these instances are placed."""
    if resource.kind == "arm":
        return list(description.arms)
    return [each.name for each in instances if not resource.templates or each.template.name in resource.templates]


def _listed(resource: Resource, fitting: list[str]) -> str:
    if fitting:
        return f"one of: {', '.join(fitting)}"
    if resource.kind == "arm":
        return "an arm; this robot has none"
    return f"an instance of {' or '.join(resource.templates) or 'any template'}; there is none, place one first"
