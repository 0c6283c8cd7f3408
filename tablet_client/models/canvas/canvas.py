"""The program that is open, as a picture that is edited: what is selected, what is changed, and back again.

Every edit changes the text of the document that the code page has open, too: they are one thing, saved as one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import yaml

from handrail import yaml_file
from handrail.program_edit import ProgramText
from tablet_client.models.canvas import picture
from tablet_client.models.canvas.chart import Chart, State, read
from tablet_client.models.canvas.editing import Editing
from tablet_client.models.canvas.picture import Picture
from tablet_client.models.code import Code, Document

WAY = ("event", "cond", "after", "target", "set", "autonomy")
"""fields of a transition"""
TEXTS = ("title", "do", "outcome", "detail", "event", "cond", "target", "autonomy")
"""fields that are texts as they are typed"""


class Canvas(Editing[ProgramText, Chart, Picture]):
    """What is drawn, and what one does with it."""

    def __init__(self, code: Code):
        super().__init__(code)
        self.way = -1
        """one of the selected state's transitions, from 0; -1: none"""

    # ---------------------------------------------------------------------------------------------------------- shown

    def _shows(self, document: Document) -> bool:
        return document.kind == "program"

    def _why_never(self, document: Document) -> str:
        if document.file.endswith((".yaml", ".yml")):
            return ""
        return f"{document.file}: expected a program in YAML; this one is edited as text"

    def _open(self, text: str) -> ProgramText:
        return ProgramText(text)

    def _read(self, text: str) -> Chart:
        return read(text)

    def _lay_out(self, read: Chart) -> Picture:
        return picture.of(read)

    def _took(self, read: Chart) -> None:
        if self.selected not in read.states:
            self.select("")
        elif self.way >= len(read.states[self.selected].ways):
            self.way = -1

    @property
    def chart(self) -> Chart | None:
        """The program as it stands; of a text that can't be read the last one that could be."""
        return self.read

    @property
    def state(self) -> State | None:
        chart = self.chart
        return chart.states.get(self.selected) if chart is not None else None

    def with_text(self) -> str:
        """What the selected state's activity is given, a line each."""
        return _dumped(self.state.fields.get("with"), None) if self.state is not None else ""

    def set_text(self) -> str:
        """What the selected way sets, on one line."""
        way = self.state.ways[self.way] if self.state is not None and self.way >= 0 else None
        return _dumped(way.fields.get("set"), True) if way is not None else ""

    # ------------------------------------------------------------------------------------------------------- selected

    def select(self, state: str, way: int = -1) -> None:
        self.selected, self.way, self.joining, self.said = state, way, False, ""

    def touch(self, state: str) -> None:
        """A state was touched: it is selected, or the end of a new way."""
        if self.joining and self.selected and state:
            self.connect(self.selected, state)
        else:
            self.select(state)

    def beside(self, step: int) -> None:
        """Select the next state, or the one before, in the file's order."""
        if (chart := self.chart) is not None and chart.states:
            names = list(chart.states)
            at = names.index(self.selected) + step if self.selected in names else 0
            self.select(names[at % len(names)])

    # --------------------------------------------------------------------------------------------------------- edited

    def add(self, *, within: bool = False) -> None:
        """A new state after the selected one, or in it."""
        chart = self.chart
        if chart is None:
            return
        number = 1
        while (name := f"state_{number}") in chart.states:
            number += 1
        state = self.state
        if within and state is not None:
            self._edit(lambda text: text.add_state(name, {"title": "New state"}, within=state.name))
        else:
            parent, after = (state.parent, state.name) if state is not None else ("", "")
            self._edit(lambda text: text.add_state(name, {"title": "New state"}, within=parent, after=after))
        if not self.said:
            self.select(name)

    def rename(self, to: str) -> None:
        name = self.selected
        if name and to != name and self._edit(lambda text: text.rename_state(name, to)):
            self.select(to)

    def remove(self) -> None:
        """The selected way, else the selected state with all that is in it and leads there."""
        name, way = self.selected, self.way
        if way >= 0:
            if self._edit(lambda text: text.disconnect(name, way)):
                self.select(name)
        elif name and self._edit(lambda text: text.remove_state(name)):
            self.select("")

    def nest(self, into: str) -> None:
        """Put the selected state into a new one in its place."""
        name = self.selected
        if name and self._edit(lambda text: text.nest([name], into)):
            self.select(into)

    def move(self, within: str) -> None:
        """Put the selected state into another one; empty: into the program itself."""
        name = self.selected
        if name:
            self._edit(lambda text: text.move_state(name, within=within))

    def connect(self, source: str, target: str) -> None:
        """A new way, taken once the source's activity is done; where it has none, at once."""
        chart, self.joining = self.chart, False
        if chart is None or source not in chart.states:
            return
        event = {"event": f"done.invoke.{source}"} if chart.states[source].fields.get("do") else {}
        place = len(chart.states[source].ways)
        if self._edit(lambda text: text.connect(source, target, **event)):
            self.select(source, place)

    def put(self, field: str, typed: str) -> None:
        """A field of the selected way, else of the selected state, as it was typed; empty: it has none."""
        state, way = self.state, self.way
        if state is None:
            return
        of_way = way >= 0 and field in WAY
        path: list[str | int] = ["transitions", way, field] if of_way else [field]
        had = state.ways[way].fields if of_way else state.fields
        try:
            value = typed.strip() if field in TEXTS else self._value(field, typed)
            self._sound(field, value)
        except ValueError as problem:
            self.said = f"{field}: {problem}"
            return
        if value in ("", None, {}):
            if field in had:
                self._edit(lambda text: text.remove_field(state.name, path))
        elif had.get(field) != value:
            self._edit(lambda text: _laid(text, state.name, path, had.get(field), value))

    def mark(self, field: str, on: bool) -> None:
        """Whether the selected state is initial, final or parallel. Only one of those beside it is initial."""
        state, chart = self.state, self.chart
        if state is None or chart is None:
            return

        def change(text: ProgramText) -> None:
            if field == "initial":
                for other in chart.within(state.parent):
                    if chart.states[other].fields.get("initial"):
                        text.remove_field(other, ["initial"])
            if on:
                text.set_field(state.name, [field], True)
            elif state.fields.get(field) and field != "initial":
                text.remove_field(state.name, [field])

        self._edit(change)

    @staticmethod
    def _value(field: str, typed: str) -> Any:
        try:
            value = yaml_file.parse(typed) if typed.strip() else None
        except yaml_file.NotYAML as problem:
            raise ValueError(problem.problem) from problem
        if field in ("with", "set") and value is not None and not isinstance(value, Mapping):
            raise ValueError(f"got {typed!r}; expected name: value, each on a line or all of them in braces")
        return value

    def _sound(self, field: str, value: Any) -> None:
        """Raise ValueError for what can be told at once; all else is checked by the engine as it is saved."""
        if field == "target" and value:
            known = self.chart.states if self.chart is not None else {}
            if unknown := next((name for name in value.split() if name not in known), ""):
                raise ValueError(f"no state {unknown!r}; expected one of {', '.join(known)}")
        if field == "after" and value is not None and not isinstance(value, str):
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not 0.0 < value < math.inf:
                raise ValueError(f"got {value!r}; expected a time in s above 0, or an expression")


def _laid(text: ProgramText, state: str, path: list[str | int], had: Any, value: Any) -> None:
    """Write what is other than before, as deep as it goes: what stands beside it keeps its comments."""
    if not isinstance(had, Mapping) or not isinstance(value, Mapping) or not had:
        text.set_field(state, path, value)
        return
    for name in had:
        if name not in value:
            text.remove_field(state, [*path, name])
    for name, each in value.items():
        if name not in had:
            text.set_field(state, [*path, name], each)
        elif had[name] != each:
            _laid(text, state, [*path, name], had[name], each)


def _dumped(given: Any, flow: bool | None) -> str:
    if not isinstance(given, Mapping) or not given:
        return ""
    plain = msgspec.to_builtins(given)
    return yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, default_flow_style=flow, width=1000).strip()
