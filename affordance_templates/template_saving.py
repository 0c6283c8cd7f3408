"""An instance saved as a template by an operator elsewhere, into the workspace of the engine that has it."""

from __future__ import annotations

from affordance_templates import authoring, catalogue
from affordance_templates.server import AffordanceServer
from handrail.config import ConfigError
from handrail.messages import SavedTemplate, SaveTemplate
from handrail.topics import refuse


def save(call: SaveTemplate, server: AffordanceServer) -> SavedTemplate:
    """Raises RefusedError: there is no such instance, there is a template of that name, the engine has no workspace."""
    instance = server.get(call.instance)
    if call.name in catalogue.files():
        raise refuse(f"there is a template {call.name}", "name", call.name, "a name that no template has")
    try:
        file = authoring.own_file(call.name)
        template = authoring.saved_as(instance, file)
    except FileExistsError as there:
        raise refuse(f"{there}: there is such a file", "name", call.name, "a name that no template has") from there
    except (ConfigError, OSError) as problem:
        raise refuse(f"{call.instance} can't be saved: {problem}") from problem
    except ValueError as problem:
        remedy = "letters, digits and _; an engine that was started with a workspace (handrail new workspace FOLDER)"
        raise refuse(f"{call.instance} can't be saved: {problem}", "name", call.name, remedy) from problem
    return SavedTemplate(name=template.name, file=str(file), hash=template.hash)
