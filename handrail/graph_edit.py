"""Edits of a composite node's file by a tool: what was not edited stays as it was written, comments, order and quotes among it.

Whether the result is a node is for the engine to say that it is saved to (docs/nodes.md). A place is PART.PORT, as in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from ruamel.yaml.comments import CommentedMap, CommentedSeq

from handrail.yaml_edit import block_lines, dumped, kept, loaded, shifted

_ORDER = ("title", "nodes", "inputs", "wires", "params", "outputs", "every")
"""of a file's fields, where a new one has to find its place"""
_STAY = ("nodes", "outputs")
"""fields that a file has, and be they empty"""
_LONG = 120
"""characters of a line beyond which what stands on one gets a line each"""


class GraphText:
    """A composite's file that is being edited. Every edit raises ValueError, naming what is wrong, and then changes nothing."""

    def __init__(self, text: str):
        self._lines = text.splitlines()
        self._data = self._read(self._lines)

    @property
    def text(self) -> str:
        return "\n".join(self._lines) + "\n"

    def parts(self) -> list[str]:
        """Names, in the file's order."""
        return [str(name) for name in self._data["nodes"] or {}]

    def add_part(self, name: str, node: str, params: Mapping[str, Any] | None = None) -> None:
        """A node of the library as a part."""
        self._new(name, self.parts(), "part")
        self.set(["nodes", name], {"node": node, **({"params": dict(params)} if params else {})})

    def rename_part(self, name: str, to: str) -> None:
        """In all that leads to it or comes from it, too."""
        self._part(name)
        self._new(to, self.parts(), "part")
        edits = [(*self._data["nodes"].lc.key(name), name, to)]
        for line, column, text in self._places():
            if text.partition(".")[0] == name:
                edits.append((line, column, name, to))
        self._write(edits)

    def remove_part(self, name: str) -> None:
        """With all that leads to it or comes from it."""
        self._part(name)
        copy = GraphText(self.text)
        for to, source in dict(copy.wires()).items():
            if name in (to.partition(".")[0], source.partition(".")[0]):
                copy.remove(["wires", to])
        for field in ("inputs", "params"):
            for own, places in copy.given(field).items():
                for place in places:
                    if place.partition(".")[0] == name:
                        copy.take(field, own, place)
        for own, source in copy.told().items():
            if source.partition(".")[0] == name:
                copy.remove(["outputs", own])
        copy.remove(["nodes", name])
        self._become(copy._lines)

    def wires(self) -> dict[str, str]:
        """Part's input → the output that it gets."""
        return {str(to): str(source) for to, source in _mapping(self._data.get("wires"))}

    def given(self, field: str) -> dict[str, list[str]]:
        """Own input (`field`: inputs) or parameter (params) → where it goes."""
        return {
            str(own): [str(each) for each in to] if isinstance(to, list) else [str(to)]
            for own, to in _mapping(self._data.get(field))
        }

    def told(self) -> dict[str, str]:
        """Own output → the part's."""
        return {str(own): str(source) for own, source in _mapping(self._data.get("outputs"))}

    def wire(self, to: str, source: str) -> None:
        """A part's input gets another one's output, and nothing else any more."""
        self._place(to)
        self._place(source)
        copy = GraphText(self.text)
        copy._free(to, "inputs")
        copy.set(["wires", to], source)
        self._become(copy._lines)

    def give(self, field: str, own: str, to: str) -> None:
        """A part's input or parameter gets an own one, which is a new one where there is none of that name."""
        self._place(to)
        copy = GraphText(self.text)
        copy._free(to, field)
        places = copy.given(field).get(own)
        if places is None:
            self._new(own, self.own(), "port")
            copy.set([field, own], to)
        else:
            copy.set([field, own], [*places, to])
        self._become(copy._lines)

    def take(self, field: str, own: str, to: str) -> None:
        """An own input or parameter goes there no more; one that goes nowhere is gone."""
        places = self.given(field).get(own, [])
        if to not in places:
            raise ValueError(f"{field}.{own}: got {to!r}; expected one of {', '.join(places) or 'none'}")
        rest = [each for each in places if each != to]
        if rest:
            self.set([field, own], rest[0] if len(rest) == 1 else rest)
        else:
            self.remove([field, own])

    def tell(self, own: str, source: str) -> None:
        """A part's output is one of its own."""
        self._place(source)
        if own not in self.told():
            self._new(own, self.own(), "port")
        self.set(["outputs", own], source)

    def own(self) -> list[str]:
        """Names of its own ports."""
        return [*self.given("inputs"), *self.given("params"), *self.told()]

    def rename_own(self, field: str, name: str, to: str) -> None:
        """Of `inputs`, `params` or `outputs`; in its cases, too."""
        fields = self._data.get(field)
        if not isinstance(fields, CommentedMap) or name not in fields:
            raise ValueError(f"{field}: got {name!r}; expected one of {', '.join(fields or ()) or 'none'}")
        self._new(to, self.own(), "port")
        found = [fields]
        for case in self._data.get("cases") or ():
            said = case.get(field) if isinstance(case, CommentedMap) else None
            found += [each for each in (said if isinstance(said, list) else [said]) if isinstance(each, CommentedMap)]
        self._write([(*each.lc.key(name), name, to) for each in found if name in each])

    def unwire(self, to: str) -> None:
        """A part's input gets nothing any more."""
        copy = GraphText(self.text)
        if not copy._free(to, "inputs"):
            raise ValueError(f"wires: got {to!r}; expected an input that gets something")
        self._become(copy._lines)

    def set(self, path: Sequence[str], value: Any) -> None:
        """A field of the file, or one within: ``set(["nodes", "smooth", "params", "cutoff"], 5.0)``."""
        field, *rest = path
        section = self._data.get(field)
        deep = self._depth(rest, section) if isinstance(section, CommentedMap) else 0
        for name in reversed(rest[deep + 1 :]):
            value = {name: value}
        if not rest:
            self._replace_field(field, lambda whole: whole.__setitem__(field, kept(value)))
        elif not isinstance(section, CommentedMap) or not section:
            fresh = CommentedMap({rest[0]: kept(value)})
            self._replace_field(field, lambda whole: whole.__setitem__(field, fresh))
        else:
            self._change(field, rest[0], lambda whole: _put(whole, rest[: deep + 1], value))

    def remove(self, path: Sequence[str]) -> None:
        """Take a field away; one that held nothing else goes with it."""
        field, *rest = path
        if self._at(path) is None and not (rest and rest[-1] in (self._at(path[:-1]) or ())):
            raise ValueError(f"{'.'.join(path)}: got nothing; expected a field that there is")
        while len(rest) > 1 and len(self._at([field, *rest[:-1]])) == 1:
            rest = rest[:-1]  # what it stands in is empty then
        if not rest:
            self._replace_field(field, None)
        elif len(self._data[field]) == 1 and len(rest) == 1:
            empty = CommentedMap()
            empty.fa.set_flow_style()
            stays = field in _STAY
            self._replace_field(field, (lambda whole: whole.__setitem__(field, empty)) if stays else None)
        else:
            self._change(field, rest[0], lambda whole: _drop(whole, rest), gone=len(rest) == 1)

    # ----------------------------------------------------------------------------------------------------------------- text

    @staticmethod
    def _read(lines: list[str]) -> CommentedMap:
        data = loaded("\n".join(lines))
        if not isinstance(data, CommentedMap) or not isinstance(data.get("nodes"), CommentedMap):
            raise ValueError("nodes: missing; expected the file of a node that is made of nodes")
        if data.fa.flow_style():
            raise ValueError("all of it on one line; expected each field on a line of its own")
        return data

    def _become(self, lines: list[str]) -> None:
        self._data = self._read(lines)  # raises where that is none any more
        self._lines = lines

    def _new(self, name: str, taken: Sequence[str], what: str) -> None:
        if not name.isidentifier():
            raise ValueError(f"{what}: got {name!r}; expected letters, digits and _, beginning with a letter")
        if name in taken:
            raise ValueError(f"{what}: {name!r} is there already; expected another name")

    def _part(self, name: str) -> None:
        if name not in self.parts():
            raise ValueError(f"part: got {name!r}; expected one of {', '.join(self.parts()) or 'none'}")

    def _place(self, text: str) -> None:
        part, _, port = text.partition(".")
        if part not in self.parts() or not port:
            raise ValueError(f"got {text!r}; expected PART.port, of {', '.join(self.parts()) or 'no part'}")

    def _free(self, to: str, field: str) -> bool:
        """Nothing leads to a part's input, or parameter, any more; whether something did."""
        found = False
        if field == "inputs" and to in self.wires():
            self.remove(["wires", to])
            found = True
        for own, places in self.given(field).items():
            if to in places:
                self.take(field, own, to)
                found = True
        return found

    def _places(self) -> Iterator[tuple[int, int, str]]:
        """Line, column and text of each PART.port in the file."""
        for field in ("wires", "inputs", "params", "outputs"):
            fields = self._data.get(field)
            if not isinstance(fields, CommentedMap):
                continue
            for name, value in fields.items():
                if field == "wires":
                    yield (*fields.lc.key(name), str(name))
                if isinstance(value, CommentedSeq):
                    for at, each in enumerate(value):
                        yield (*value.lc.item(at), str(each))
                else:
                    yield (*fields.lc.value(name), str(value))

    def _write(self, edits: list[tuple[int, int, str, str]]) -> None:
        """What stands at (line, column) becomes another text, wherever it is in quotes or not."""
        lines = list(self._lines)
        for line, column, old, new in sorted(edits, reverse=True):
            start = column + (lines[line][column] in "'\"")
            assert lines[line].startswith(old, start), (line, column, old)
            lines[line] = lines[line][:start] + new + lines[line][start + len(old) :]
        self._become(lines)

    def _at(self, path: Sequence[str]) -> Any:
        found: Any = self._data
        for name in path:
            found = found.get(name) if isinstance(found, CommentedMap) else None
        return found

    def _depth(self, rest: Sequence[str], section: CommentedMap) -> int:
        """How many of the names of a path lead to mappings that there are."""
        found, deep = section, 0
        while deep < len(rest) - 1 and isinstance(found.get(rest[deep]), CommentedMap):
            found, deep = found[rest[deep]], deep + 1
        return deep

    def _block(self, field: str) -> tuple[int, int, int]:
        """First line, that of its name, and end of one of the file's fields, with the comments right above it."""
        first = key = self._data.lc.key(field)[0]
        end = min(
            (line for other in self._data if (line := self._data.lc.key(other)[0]) > key), default=len(self._lines)
        )
        while end > key + 1 and (not self._lines[end - 1].strip() or self._lines[end - 1].startswith("#")):
            end -= 1  # what stands there is about the next one
        while first and self._lines[first - 1].startswith("#"):
            first -= 1
        return first, key, end

    def _replace_field(self, field: str, change: Callable[[CommentedMap], Any] | None) -> None:
        """Write one of the file's fields anew, or take it away (None)."""
        if field in self._data:
            first, key, end = self._block(field)
            if change is None:
                self._become(self._lines[:first] + self._lines[end:])
                return
            whole = loaded("\n".join(self._lines[key:end]))
            change(whole)
            self._become(self._lines[:key] + dumped(whole).splitlines() + self._lines[end:])
            return
        assert change is not None
        whole = CommentedMap()
        change(whole)
        known = [other for other in _ORDER[: _ORDER.index(field)] if other in self._data] if field in _ORDER else []
        at = self._block(known[-1])[2] if known else 0 if field == _ORDER[0] else len(self._lines)
        self._become(self._lines[:at] + dumped(whole).splitlines() + self._lines[at:])

    def _change(self, field: str, name: str, change: Callable[[CommentedMap], Any], *, gone: bool = False) -> None:
        """Change what stands at a name in one of the file's fields; only its own lines are written anew."""
        section = self._data[field]
        if section.fa.flow_style():
            whole = loaded("\n".join(self._lines[slice(*self._block(field)[1:])]))
            change(whole[field])
            if len(max(dumped(whole).splitlines(), key=len)) > _LONG:
                whole[field].fa.set_block_style()
            _, key, end = self._block(field)
            self._become(self._lines[:key] + dumped(whole).splitlines() + self._lines[end:])
            return
        indent = section.lc.key(next(iter(section)))[1]
        if name in section:
            first, key, end = block_lines(self._lines, *section.lc.key(name))
            if gone:
                self._become(self._lines[:first] + self._lines[end:])
                return
            whole = loaded("\n".join(line[indent:] for line in self._lines[key:end]))
        else:
            whole = CommentedMap()
            key = end = block_lines(self._lines, *section.lc.key(next(reversed(section))))[2]
        change(whole)
        new = [shifted(line, indent) for line in dumped(whole).splitlines()]
        self._become(self._lines[:key] + new + self._lines[end:])


def _mapping(given: Any) -> list[tuple[Any, Any]]:
    return list(given.items()) if isinstance(given, Mapping) else []


def _put(whole: CommentedMap, path: Sequence[str], value: Any) -> None:
    *above, last = path
    for name in above:
        whole = whole[name]
    whole[last] = kept(value)


def _drop(whole: CommentedMap, path: Sequence[str]) -> None:
    *above, last = path
    for name in above:
        whole = whole[name]
    del whole[last]
