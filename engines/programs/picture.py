"""A program drawn as a statechart, laid out by Graphviz's `dot`."""

from __future__ import annotations

import html
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from engines.programs.program import Program, State, Transition

FORMATS = ("svg", "png", "pdf", "dot")
_WIDE = 34
_INK, _DIM, _FILL, _ACTIVE = "#1f2933", "#616e7c", "#eef4fb", "#ffd97a"
_ENDS = {"succeeded": "#2f9e5b", "failed": "#cc3d3d"}


class CanNotDraw(Exception):
    """The picture could not be made; says what is missing."""


def draw(program: Program, file: Path, active: frozenset[str] = frozenset(), *, expand: bool = False) -> None:
    """Write a picture; the file's suffix says which kind (see `FORMATS`). Raises CanNotDraw.

    :param active: states to light up
    :param expand: with the states of the programs that states run, instead of a box for each
    """
    kind = file.suffix.removeprefix(".")
    if kind not in FORMATS:
        raise CanNotDraw(f"{file}: got {file.suffix or 'no suffix'!r}; expected one of {', '.join(FORMATS)}")
    text = graph(program if expand else _collapsed(program), active)
    if kind == "dot":
        file.write_text(text, encoding="utf-8")
        return
    dot = shutil.which("dot")
    if dot is None:
        raise CanNotDraw(
            "Graphviz's `dot` is not installed; expected e.g. `apt-get install graphviz` (or write a .dot file)"
        )
    done = subprocess.run([dot, f"-T{kind}", "-o", str(file)], input=text, text=True, capture_output=True, check=False)
    if done.returncode:
        raise CanNotDraw(f"{file}: dot could not draw it: {done.stderr.strip()}")


def _collapsed(program: Program) -> Program:
    """Without the states of the programs that it runs."""

    def alone(state: State) -> State:
        return replace(state, children=[] if state.called else [alone(child) for child in state.children])

    return replace(program, roots=tuple(alone(root) for root in program.roots))


def graph(program: Program, active: frozenset[str] = frozenset()) -> str:
    """The program in Graphviz's language."""
    return "\n".join(
        [
            f"digraph {_quoted(program.name)} {{",
            f"  graph [label=<<b>{_text(program.title)}</b>>, labelloc=t, compound=true, newrank=true,",
            '    fontname="DejaVu Sans", fontsize=16,',
            f'    color="{_DIM}", fontcolor="{_INK}", style="rounded,filled", fillcolor="#fbfcfe", nodesep=0.35, ranksep=0.55];',
            f'  node [fontname="DejaVu Sans", fontsize=11, color="{_DIM}", fontcolor="{_INK}", shape=box, style="rounded,filled",',
            f'    fillcolor="{_FILL}", margin="0.14,0.08"];',
            f'  edge [fontname="DejaVu Sans", fontsize=9, color="{_DIM}", fontcolor="{_INK}", arrowsize=0.7];',
            '  "in" [shape=circle, label="", width=0.14, fixedsize=true, style=filled, fillcolor="#1f2933"];',
            *(line for root in program.roots for line in _state(root, "  ", active)),
            *_entry("in", _first(program.roots)),
            *(line for state in program.states() for line in _ways(program, state)),
            "}",
            "",
        ]
    )


def _state(state: State, indent: str, active: frozenset[str]) -> Iterator[str]:
    lit = f', fillcolor="{_ACTIVE}"' if state.id in active else ""
    if state.file.final:
        color = _ENDS.get(state.file.outcome, _DIM)
        yield f'{indent}{_quoted(state.id)} [label={_label(state)}, color="{color}", peripheries=2{lit}];'
    elif not state.children:
        shape = ", shape=component" if state.called else ""
        yield f"{indent}{_quoted(state.id)} [label={_label(state)}{shape}{lit}];"
    else:
        style = ', style="rounded,filled,dashed"' if state.file.parallel else ""
        yield f"{indent}subgraph {_quoted('cluster_' + state.id)} {{"
        yield f"{indent}  graph [label={_label(state)}, fontsize=12, labeljust=l{style}{lit}];"
        for child in state.children:
            yield from _state(child, indent + "  ", active)
        for name in state.history:
            deep = "H*" if state.history_type[name] == "deep" else "H"
            yield f'{indent}  {_quoted(name)} [label="{deep}", shape=circle, margin=0.02];'
        if not state.file.parallel:
            dot = f"in {state.id}"
            yield f'{indent}  {_quoted(dot)} [shape=circle, label="", width=0.1, fixedsize=true, style=filled, fillcolor="{_INK}"];'
            yield from _entry(dot, state.initial_children()[0], indent + "  ")
        yield f"{indent}}}"


def _entry(dot: str, first: State, indent: str = "  ") -> Iterator[str]:
    head = f" [lhead={_quoted('cluster_' + first.id)}]" if first.children else ""
    yield f"{indent}{_quoted(dot)} -> {_quoted(_inner(first))}{head};"


def _ways(program: Program, state: State) -> Iterator[str]:
    by_id = {each.id: each for each in program.states()}
    histories = [(name, way) for name, ways in state.history.items() for way in ways]
    for source, way in [*((state.id, way) for way in state.transitions), *histories]:
        for target in (way.file.target or "").split():
            goal = by_id.get(target)
            extra = f", lhead={_quoted('cluster_' + target)}" if goal is not None and goal.children else ""
            extra += f", ltail={_quoted('cluster_' + source)}" if state.children and source == state.id else ""
            tail = _inner(state) if source == state.id else source
            head = target if goal is None else _inner(goal)
            yield f"  {_quoted(tail)} -> {_quoted(head)} [label={_way_label(state, way)}{extra}];"


def _label(state: State) -> str:
    lines = [f"<b>{_text(state.name)}</b>"]
    if state.file.title:
        lines += [_text(line) for line in _wrapped(state.file.title)]
    if state.file.do:
        what = f"{state.file.do} {state.called.name}" if state.called else state.file.do
        lines.append(f'<font color="{_DIM}" point-size="9">{_text(what)}</font>')
    return f"<{'<br/>'.join(lines)}>"


def _way_label(state: State, way: Transition) -> str:
    short = {f"done.invoke.{state.id}": "done", f"done.state.{state.id}": "done", "error.execution": "failed"}
    lines = [short.get(event, event) for event in (way.file.event or "").split()]
    if way.file.after is not None:
        lines.append(f"after {way.file.after} s")
    if way.file.cond:
        lines += _wrapped(f"[{way.file.cond.replace('_event.data.', '')}]")
    told = [f'<font color="{_DIM}">{_text(line)}</font>' for name in way.file.set for line in _wrapped(f"sets {name}")]
    return f"<{'<br/>'.join([*map(_text, lines), *told])}>"


def _first(states: tuple[State, ...]) -> State:
    return next((state for state in states if state.file.initial), states[0])


def _inner(state: State) -> str:
    """The node that stands for a state: an arrow ends at a node, and is cut off where the cluster begins."""
    while state.children:
        state = state.initial_children()[0]
    return state.id


def _wrapped(text: str) -> list[str]:
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) > _WIDE:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return [line for line in lines if line]


def _text(text: str) -> str:
    return html.escape(text, quote=False)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', r"\"") + '"'
