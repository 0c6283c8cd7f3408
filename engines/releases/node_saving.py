"""A process node's file read and saved over the link, for tools that edit it: saved, it is a release (docs/deployment.md)."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path

from engines.nodes import library
from engines.nodes.failure import NodeFailed
from engines.nodes.host import NodeProcess
from engines.releases.closure import bundle_of_node, holds_node
from engines.releases.store import ReleaseStore
from handrail import messages as m
from handrail import workspace
from handrail.bundles import pieces
from handrail.topics import RefusedError, refuse

_LONGEST = 400
"""characters of what a trial said"""


def listing() -> m.NodeLibrary:
    """All that there are, and which of them come with Handrail."""
    return m.NodeLibrary(
        nodes=[
            m.NodeEntry(name=name, file=file.name, builtin=_builtin(file))
            for name, file in sorted(library.files().items())
        ]
    )


def source(call: m.GetNodeSource) -> m.NodeSource:
    """The file as it is in force. Refused where there is none of that name."""
    known = library.files()
    file = known.get(call.node)
    if file is None:
        raise refuse("no such node", "node", call.node, f"one of: {', '.join(sorted(known)) or 'none'}")
    return m.NodeSource(node=call.node, file=file.name, text=file.read_text(encoding="utf-8"), builtin=_builtin(file))


def save(call: m.SaveNode, releases: ReleaseStore) -> m.BundleState:
    """Bring a node's text into force, with the modules beside it. Refused where it can't be loaded, or was edited meanwhile."""
    file = library.files().get(call.node)
    if file is not None and _builtin(file):
        raise refuse(
            f"{call.node} comes with Handrail: save it under a name of its own", "node", call.node, "another name"
        )
    if (file.read_text(encoding="utf-8") if file is not None else "") != call.was:
        raise refuse(
            "the node is another one by now: read it anew", "was", f"{len(call.was)} bytes", "its present text"
        )
    if not call.node.isidentifier():
        raise refuse("no node can be called so", "node", call.node, "letters, digits and _")
    with tempfile.TemporaryDirectory() as folder:
        nodes = Path(folder) / "nodes"
        beside = file.parent if file is not None else _deployed_nodes()
        if beside is None:
            nodes.mkdir()
        else:  # what it may import, and what it may wire together
            shutil.copytree(beside, nodes, ignore=shutil.ignore_patterns("__pycache__"))
        fresh = nodes / (file.name if file is not None else f"{call.node}.{'yaml' if call.wired else 'py'}")
        fresh.write_text(call.text, encoding="utf-8")
        try:
            _try(fresh)
            bundle = bundle_of_node(call.node, fresh)
        except (RefusedError, ValueError, OSError, SyntaxError) as problem:
            told = problem.refusal.expected if isinstance(problem, RefusedError) else str(problem)
            raise refuse("the node can't be saved", "text", call.node, told.replace(f"{nodes}/", "")) from problem
    releases.take([m.Piece(address=each, data=pieces.pack(part)) for each, part in bundle.contents.items()])
    return releases.put(m.PutBundle(bundle=bundle.address, note=call.note, by=call.by))


def _builtin(file: Path) -> bool:
    own = workspace.search_path("nodes", "rtc_programs", "nodes")[-1:]
    return file.parent in own


def _deployed_nodes() -> Path | None:
    deployed = workspace.deployed()
    return deployed / "nodes" if deployed is not None and (deployed / "nodes").is_dir() else None


def _try(file: Path) -> None:
    """Load it in a process of its own, as it will be when it runs. Raises ValueError (FILE:LINE: why), RefusedError."""
    if file.suffix == ".py":
        try:
            compile(file.read_bytes(), str(file), "exec")
        except SyntaxError as problem:
            raise ValueError(f"{file}:{problem.lineno or 1}: {problem.msg}") from problem
        if not holds_node(file):
            return  # a module that nodes import
    try:
        with workspace.pinned(file.parent.parent):
            NodeProcess(file, restarts=0, said=_unheard, noted=_unheard).close()
    except NodeFailed as failed:
        raise refuse("", expected=_where(failed, file)) from failed


def _unheard(line: str) -> None:
    """What a node prints while it is tried is nobody's."""


def _where(failed: NodeFailed, file: Path) -> str:
    """Why, after the line of the file that its traceback names last."""
    lines = re.findall(rf'File "{re.escape(str(file))}", line (\d+)', failed.traceback)
    why = failed.why[:_LONGEST]
    return f"{file}:{lines[-1]}: {why}" if lines else why
