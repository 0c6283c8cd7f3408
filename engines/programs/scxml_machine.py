"""SCXML files that say more than a program can, and ask for nothing of the robot: they run whole, in a process node.

`rtc_programs/nodes/statechart.py` carries such a file out, as python-statemachine does: loops, scripts, machines that it invokes,
events with computed names, delays and data. The program that it becomes has one state that does this, and the file's own final
states to end in. Only files whose data model is a programming language's are taken: a `datamodel="handrail"`, and a file with
activities or attributes of ours in it, is a program or it is wrong.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

from engines.programs.scxml_elements import OWN, SCXML
from handrail.config import Document
from handrail.yaml_file import Map, Seq

NODE = "statechart"
_FAILED = "failed"
"""where it ends when the node fails, unless the file has a final state of that name for it"""
_MACHINES = ("scxml", "http://www.w3.org/TR/scxml", "http://www.w3.org/TR/scxml/")
_FILE = re.compile(r"file:([\w][\w.-]*)")


def read(file: Path) -> Document | None:
    """The document of the program; None where the file is no such one. Raises OSError."""
    try:
        text = file.read_text("utf-8")
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            return None
        root = ElementTree.fromstring(text)
    except (UnicodeDecodeError, ElementTree.ParseError):
        return None
    finals = [each for each in root if _name(each) == "final" and each.get("id")]
    if _name(root) != "scxml" or root.get("datamodel") == "handrail" or not finals or _asks_ours(root):
        return None
    ids = {each.get("id", "") for each in finals}
    own = next(name for name in ("machine", *(f"machine_{k}" for k in range(len(ids)))) if name not in ids)
    beside = {each.name: each.read_text() for each in parts(file)}
    params = {"source": repr(text), **({"files": repr(json.dumps(beside))} if beside else {})}
    ended = f"done.invoke.{own}"
    ways = [_map(event=ended, cond=f"_event.data.final == {id!r}", target=id) for id in sorted(ids)]
    ways.append(_map(event="error.execution", target=_FAILED))
    doing = {"node": NODE, "params": _map(**params), "outputs": _list(["final"])}
    states = {own: _map(initial=True, do="node", **{"with": _map(**doing), "transitions": _list(ways)})}
    states |= {_FAILED: _map(final=True, outcome="failed", detail="{failure}")}
    states |= {each.get("id", ""): _map(final=True, **_ends(each)) for each in finals}
    return Document(file, _map(title=root.get("name", file.stem), states=_map(**states)))


def parts(file: Path) -> Iterator[Path]:
    """The files beside it that it names (`file:NAME`)."""
    for name in sorted(set(_FILE.findall(file.read_text("utf-8")))):
        if (found := file.parent / name).is_file():
            yield found


def _name(element: ElementTree.Element) -> str:
    """Of an element of SCXML's, whether the file says so of it or not; of others their whole tag."""
    return element.tag.removeprefix(f"{{{SCXML}}}")


def _asks_ours(root: ElementTree.Element) -> bool:
    """Whether anything in it is the robot's: an activity, a resource, a parameter."""
    return any(
        any(name.startswith(f"{{{OWN}}}") for name in each.attrib)
        or (_name(each) == "invoke" and each.get("type", "scxml") not in _MACHINES)
        for each in root.iter()
    )


def _ends(final: ElementTree.Element) -> dict[str, str]:
    """How the program ends there: its outcome and detail, where they are written as texts."""
    found = {"outcome": "succeeded"}
    for each in final.iter():
        if _name(each) == "param" and each.get("name") in ("outcome", "detail"):
            try:
                found[each.get("name", "")] = str(ast.literal_eval(each.get("expr", "")))
            except (ValueError, SyntaxError):
                continue
    return found


def _map(**fields: object) -> Map:
    made = Map()
    for name, value in fields.items():
        made[name], made.lines[name] = value, 1
    return made


def _list(values: Sequence[object]) -> Seq:
    made = Seq()
    made += values
    made.lines += [1] * len(values)
    return made
