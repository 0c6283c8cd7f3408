"""`handrail node list|show|test|run`: process nodes without an engine."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.table import Table

from engines.nodes import composite, library, remote
from engines.nodes.host import NodeFailed, NodeProcess
from engines.nodes.node import Case, Node, load
from engines.nodes.ports import PortError, plain
from engines.nodes.remote import values as _values
from handrail.config import ConfigError

app = typer.Typer(help="Process nodes.", no_args_is_help=True, add_completion=False)
_LOOK_S = 0.5
"""between two looks at its file"""
_out = Console()
_err = Console(stderr=True)

Name = Annotated[str, typer.Argument(help="Its name in the library, or its file.")]


@app.callback()
def _node() -> None:
    """Process nodes: Python with typed ports, each in a process of its own (docs/nodes.md)."""


@app.command("list")
def list_() -> None:
    """List the nodes that are found by name, and their files."""
    table = Table("node", "file", box=None)
    for name, file in sorted(library.files().items()):
        table.add_row(name, str(file))
    _out.print(table)


@app.command()
def show(node: Name) -> None:
    """A node's ports and parameters, and when it steps."""
    with _running(node, {}) as process:
        hello = process.hello
        _out.print(f"{hello.name}: {hello.doc}", highlight=False, markup=False)
        when = (
            "when it is asked to" if hello.every is None else f"every {hello.every:g} s" if hello.every else "on and on"
        )
        _out.print(f"steps {when}; a step may take {hello.limits.step_s:g} s", highlight=False)
        table = Table("", "name", "kind", "unit", "default", "what it is", box=None)
        for word, ports in (("input", hello.inputs), ("output", hello.outputs), ("parameter", hello.params)):
            for port in ports:
                default = "" if port.default is None else str(port.default)
                table.add_row(word, port.name, port.kind, port.unit, default, port.doc)
        _out.print(table)


@app.command()
def test(node: Name) -> None:
    """Try a node's own cases, each in a new process. Exits with 1 when one fails, or there are none."""
    file = _file(node)
    try:
        kind = composite.read(file) if file.suffix == ".yaml" else load(file)
    except ConfigError as problem:
        _fail(str(problem))
    except Exception as problem:  # noqa: BLE001 (whatever the node's code raises is the test's finding)
        _fail(f"{file}: {type(problem).__name__}: {problem}")
    if not kind.cases:
        _fail(f"{file}: has no cases to try; expected cases, each with inputs and outputs")
    failed = 0
    for number, case in enumerate(kind.cases, 1):
        wrong = _try(file, kind, case)
        failed += bool(wrong)
        line = f"{'failed' if wrong else 'passed'}  {case.name or f'case {number}'}"
        _out.print(f"{line}: {wrong}" if wrong else line, highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(int(failed > 0))


def _try(file: Path, kind: type[Node], case: Case) -> str:
    """What is wrong with one case, in words; empty: nothing."""
    if unknown := [name for name in case.outputs if name not in kind.outputs]:
        return f"output {unknown[0]}: there is none; expected one of {', '.join(kind.outputs) or 'none'}"
    found: dict[str, Any] = {}
    try:
        with NodeProcess(file, case.params, restarts=0) as process:
            for inputs in case.inputs:
                found.update(process.step(inputs))
        wrong = [
            case.missed(kind.outputs[name], found[name]) if name in found else f"output {name}: was not written"
            for name in case.outputs
        ]
    except (NodeFailed, PortError) as problem:
        return str(problem)
    return "; ".join(filter(None, wrong))


@app.command()
def run(
    node: Name,
    set_: Annotated[list[str] | None, typer.Option("--set", help="parameter=VALUE")] = None,
    input_: Annotated[list[str] | None, typer.Option("--input", help="input=VALUE, as JSON; a text as it is.")] = None,
    steps: Annotated[int, typer.Option(min=1, help="End after so many steps.")] = 1,
    reload: Annotated[
        bool, typer.Option(help="Of a node that steps by itself: go on in its file as that changes.")
    ] = True,
) -> None:
    """Run a node in its process and print what it writes, as a line of JSON each step. Ctrl-C ends it.

    Exits with 1 when the node fails, with its traceback.
    """
    done, left = threading.Event(), [steps]
    failures: list[NodeFailed] = []

    def told(outputs: dict[str, Any]) -> None:
        if left[0] > 0:
            left[0] -= 1
            print(json.dumps({name: plain(value) for name, value in outputs.items()}), flush=True)
        if not left[0]:
            done.set()

    def ended(failure: NodeFailed) -> None:
        failures.append(failure)
        done.set()

    with _running(node, _values("--set", set_), told=told, ended=ended) as process:
        try:
            inputs = _values("--input", input_)
            if process.hello.every is None:
                for _ in range(steps):
                    process.step(inputs)
            else:
                process.put(inputs)
                while not done.wait(_LOOK_S):
                    if reload:
                        with contextlib.suppress(NodeFailed):  # it goes on as it was, and has said why
                            process.reload()
        except NodeFailed as failure:
            failures.append(failure)
        except KeyboardInterrupt:
            return
    if failures:
        _fail_as(failures[0])


remote.add_to(app)


def _file(node: str) -> Path:
    try:
        return library.find(node)
    except ValueError as problem:
        _fail(str(problem))


def _running(node: str, params: Mapping[str, Any], **told: Any) -> NodeProcess:
    try:
        return NodeProcess(_file(node), params, restarts=0, **told)
    except NodeFailed as failure:
        _fail_as(failure)


def _fail_as(failure: NodeFailed) -> NoReturn:
    if failure.traceback:
        _err.print(failure.traceback, markup=False, highlight=False, soft_wrap=True)
    _fail(failure.why)


def _fail(text: str) -> NoReturn:
    _err.print(text, style="red", markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(1)
