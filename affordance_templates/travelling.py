"""Templates that go to another machine, by name, with the meshes that they name."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from affordance_templates import catalogue
from handrail.config import ConfigError
from handrail.messages import GetTemplate, TemplateSource
from handrail.topics import refuse


def told(call: GetTemplate) -> TemplateSource:
    """Refused where there is none of that name, or it is unsound."""
    try:
        template = catalogue.load(call.template)
    except ConfigError as problem:
        raise refuse("the template can't be told", "template", call.template, problem.problem) from problem
    file = template.document.file
    meshes = {shape.file for shape in template.resolve().shapes if shape.file is not None}
    return TemplateSource(
        template=call.template,
        hash=template.hash,
        text=file.read_text(encoding="utf-8"),
        meshes={mesh.relative_to(file.parent).as_posix(): mesh.read_bytes() for mesh in sorted(meshes)},
    )


def put(source: TemplateSource, workspace: Path) -> None:
    """Into a folder made like a workspace. Raises ValueError for a name that leads out of it, OSError."""
    folder = workspace / "affordance_templates"
    files = {f"{source.template}.yaml": source.text.encode(), **source.meshes}
    for name in files:
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise ValueError(f"template {source.template}: got the file {name!r}; expected one beside it or below")
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
