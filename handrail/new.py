"""`handrail new ...`: a workspace, and things in it that begin as copies of what Handrail brings."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from handrail import workspace

app = typer.Typer(help="Begin something of your own.", no_args_is_help=True, add_completion=False)


@dataclass(frozen=True)
class _Kind:
    """A kind of thing that is one file."""

    folder: str
    """of the workspace"""
    package: str
    built_in: str
    """folder of the package with those that Handrail brings"""
    like: str
    """what a new one begins as"""
    then: str
    """a command to go on with"""
    document: str
    suffix: str = ".yaml"
    marks: tuple[str, ...] = ()
    """what is in each of those files, where the folder holds others, too"""


_KINDS = {
    "program": _Kind("rtc_programs", "rtc_programs", "", "press", "handrail program check {name}", "docs/programs.md"),
    "behaviour": _Kind(
        "behaviours",
        "rtc_programs",
        "behaviours",
        "press",
        "handrail behaviour check {name}",
        "docs/compliant_motion.md",
    ),
    "scene": _Kind(
        "scenes", "rtc_programs", "scenes", "valve", "handrail up talos_upper --scene {name}", "docs/robots.md"
    ),
    "template": _Kind(
        "affordance_templates",
        "affordance_templates",
        "library",
        "wheel",
        "handrail template check {name}",
        "docs/templates.md",
    ),
    "controller": _Kind(
        "controllers",
        "daemon",
        "controllers",
        "gravity_compensation",
        "handrail controllers load {name} --joints JOINTS",
        "docs/controllers.md",
        ".py",
        ("from daemon.controllers.base import", "def make(cls, setup"),
    ),
}
_KINDS["node"] = _Kind(
    "nodes", "rtc_programs", "nodes", "low_pass", "handrail node test {name}", "docs/nodes.md", ".py", ("(Node):",)
)
_README = """# A Handrail workspace

`export HANDRAIL_WORKSPACE={folder}` makes it count: what lies here is found before what Handrail brings.

| folder | what is in it | begin one |
| --- | --- | --- |
{rows}

Robots (`robots/NAME/robot.yaml`), drive families (`drives/NAME/`) and compound tasks (`compound_tasks/NAME.yaml`) have their place
here, too: docs/robots.md, docs/drives.md and docs/wbc.md of Handrail.
"""


@app.command("workspace")
def workspace_(folder: Annotated[Path, typer.Argument(help="A folder that is not there yet, or is empty.")]) -> None:
    """Make a folder for your own programs, nodes, behaviours, scenes, templates and controllers."""
    rows = "\n".join(
        f"| `{kind.folder}/` | NAME{kind.suffix} | `handrail new {name} NAME` |" for name, kind in _KINDS.items()
    )
    try:
        if folder.exists() and not folder.is_dir():
            sys.exit(f"handrail new workspace: {folder}: is a file; expected a folder to be made")
        if folder.exists() and any(folder.iterdir()):
            sys.exit(f"handrail new workspace: {folder}: is there and not empty; expected a folder to be made")
        for kind in _KINDS.values():
            (folder / kind.folder).mkdir(parents=True)
        (folder / "README.md").write_text(_README.format(folder=folder.resolve(), rows=rows))
    except OSError as problem:
        sys.exit(f"handrail new workspace: {folder}: can't be made: {problem}")
    print(f"export HANDRAIL_WORKSPACE={folder.resolve()}")


def begin(what: str, name: str, like: str) -> None:
    """Copy what `like` names into the workspace as `name`; exits with a line that says what is wrong."""
    kind, me = _KINDS[what], f"handrail new {what}"
    own = os.environ.get("HANDRAIL_WORKSPACE")
    if not own:
        sys.exit(
            f"{me}: HANDRAIL_WORKSPACE is not set; expected your workspace's folder (handrail new workspace FOLDER)"
        )
    if not name.isidentifier():
        sys.exit(f"{me}: {name}: not a name; expected letters, digits and _, beginning with a letter")
    found = workspace.files(workspace.search_path(kind.folder, kind.package, kind.built_in), kind.suffix)
    texts = {each: file.read_text() for each, file in found.items()}
    known = {each: text for each, text in texts.items() if all(mark in text for mark in kind.marks)}
    if like not in known:
        sys.exit(f"{me}: --like {like}: no such {what}; expected one of {', '.join(sorted(known))}")
    file = Path(own) / kind.folder / f"{name}{kind.suffix}"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("x") as new:
            new.write(known[like])
    except FileExistsError:
        sys.exit(f"{me}: {file}: is there already; expected a new name")
    except OSError as problem:
        sys.exit(f"{me}: {file}: can't be made: {problem}; expected HANDRAIL_WORKSPACE to be a folder to write to")
    print(f"{file}: begun as {like}. Go on with: {kind.then.format(name=name)} ({kind.document})")


def _verb(what: str) -> None:
    option = typer.Option(_KINDS[what].like, help=f"The {what} that it begins as.")

    @app.command(what, help=f"Begin a {what} of your own as a copy of one that is there.")
    def verb(name: Annotated[str, typer.Argument(help="What to call it.")], like: str = option) -> None:
        begin(what, name, like)


for _what in _KINDS:
    _verb(_what)
