"""The sources of nodes and programs as they are edited here: what was read, what has become of it, what an engine says to it.

Nothing that was typed is lost by what happens around it: a link that goes, an engine that is started anew, somebody else who saves.
"""

from __future__ import annotations

import keyword
from dataclasses import dataclass
from typing import Any

from handrail.messages import (
    GetNodeSource,
    GetProgram,
    ListNodes,
    Message,
    NodeEntry,
    NodeState,
    ReloadNode,
    SaveNode,
    SaveProgram,
)
from tablet_client.models.code_check import Problem, check, told

NEW_NODE = '''"""What it does, in a sentence."""

from engines.nodes import Input, Node, Output, Param


class {name}(Node):
    """What it does, in a sentence."""

    value = Input("number")
    gain = Param(2.0, "what it is multiplied by", low=0.0, high=10.0)
    result = Output("number")

    def step(self) -> None:
        self.result = self.gain * self.value
'''
NEW_GRAPH = "title: What it does, in a sentence\nnodes: {}\noutputs: {}\n"
NEW_PROGRAM = """\
title: What it does, in a sentence
states:
  begin:
    title: Begin
    transitions:
      - {target: done}
  done: {final: true, outcome: succeeded}
"""


@dataclass
class Document:
    """A file that is open here."""

    kind: str
    """`node`, `program`"""
    name: str
    engine: str
    """empty: the first"""
    file: str = ""
    was: str = ""
    """the engine's text that this one began from; empty: it has none of that name"""
    text: str = ""
    loaded: bool = False
    builtin: bool = False
    revision: int = 0
    """rises whenever the text became another one by something else than typing"""
    theirs: str | None = None
    """what somebody else has saved since, while this one was edited, too"""
    sent: str | None = None
    """a text that is on its way"""
    release: int = 0
    """that it was saved as from here; 0: it was not"""
    said: Problem | None = None
    """what the engine said against `refused`"""
    refused: str = ""
    _checked: tuple[str, Problem | None] = ("", None)

    @property
    def key(self) -> str:
        return f"{self.kind}:{self.name}@{self.engine}"

    @property
    def dirty(self) -> bool:
        return self.loaded and self.text != self.was

    @property
    def problem(self) -> Problem | None:
        """What is wrong with the text as it stands: what can be told here, else what the engine has said to this very text."""
        if self._checked[0] != self.text:
            self._checked = self.text, check(self.text, self.file)
        return self._checked[1] or (self.said if self.text == self.refused else None)

    def take(self, text: str, file: str, builtin: bool) -> None:
        """The engine's text, now."""
        self.file, self.builtin = file, builtin
        if not self.loaded:
            self.was = self.text = text
            self.loaded = True
            self.revision += 1
        elif text in (self.was, self.text):
            self.was, self.theirs = text, None
        elif self.dirty:
            self.theirs = text
        else:
            self.was = self.text = text
            self.revision += 1

    def fetch(self) -> Message:
        if self.kind == "node":
            return GetNodeSource(node=self.name, engine=self.engine)
        return GetProgram(program=self.name, engine=self.engine)

    def saved_by(self, note: str) -> Message:
        if self.kind == "node":
            wired = self.file.endswith(".yaml")
            return SaveNode(node=self.name, text=self.text, was=self.was, wired=wired, note=note, engine=self.engine)
        return SaveProgram(program=self.name, text=self.text, was=self.was, note=note, engine=self.engine)


class Code:
    """Which nodes an engine's library has, and the documents that are open. `watched`: somebody looks."""

    def __init__(self) -> None:
        self.documents: dict[str, Document] = {}
        """in the order in which they were opened"""
        self.current = ""
        self.engine = ""
        """whose library is listed; empty: the first engine's"""
        self.nodes: list[NodeEntry] = []
        self.running: list[NodeState] = []
        """at the first engine"""
        self.problem = ""
        self.watched = False
        self.nodes_watched = False
        """somebody looks at a page that shows which nodes there are"""
        self._listed = False
        self._stale: set[str] = set()  # keys of documents that have to be read (anew)
        self._out: dict[str, Message] = {}

    @property
    def document(self) -> Document | None:
        return self.documents.get(self.current)

    # ------------------------------------------------------------------------------------------------ what one does here

    def at(self, engine: str) -> None:
        """List another engine's nodes."""
        if engine != self.engine:
            self.engine, self._listed, self.nodes = engine, False, []
            self._out.pop("list", None)

    def open(self, kind: str, name: str) -> None:
        """Show a document; read it, where it is not open yet."""
        fresh = Document(kind, name, self.engine)
        if fresh.key not in self.documents:
            self.documents[fresh.key] = fresh
            self._stale.add(fresh.key)
        self.current, self.problem = fresh.key, ""

    def close(self, key: str) -> bool:
        """Show a document no more; False: it has edits that were not saved."""
        document = self.documents.get(key)
        if document is None or document.dirty or document.sent is not None:
            return False
        del self.documents[key]
        self._stale.discard(key)
        if self.current == key:
            self.current = next(reversed(self.documents), "")
        return True

    def why_not_begin(self, name: str, kind: str = "node") -> str:
        """Code of the reason why no new node, or program, can be called that."""
        if not name.isidentifier() or keyword.iskeyword(name) or not name.isascii():
            return "no_name"
        here = Document(kind, name, self.engine).key in self.documents
        return "name_taken" if here or (kind == "node" and any(each.name == name for each in self.nodes)) else ""

    def begin(self, name: str, like: Document | None = None) -> None:
        """A new node, that nobody knows until it is saved; `like`: it begins as this one stands."""
        if self.why_not_begin(name):
            return
        file = f"{name}.yaml" if like is not None and like.file.endswith(".yaml") else f"{name}.py"
        title = "".join(part.capitalize() for part in name.split("_")) or name
        self._begin("node", name, file, like.text if like is not None else NEW_NODE.format(name=title))

    def begin_drawing(self, kind: str, name: str) -> None:
        """A new `program`, or `node` that is made of nodes, with nothing in it yet."""
        if not self.why_not_begin(name, kind):
            self._begin(kind, name, f"{name}.yaml", NEW_PROGRAM if kind == "program" else NEW_GRAPH)

    def _begin(self, kind: str, name: str, file: str, text: str) -> None:
        fresh = Document(kind, name, self.engine, file=file, text=text, loaded=True, revision=1)
        self.documents[fresh.key] = fresh
        self.current, self.problem = fresh.key, ""

    def edit(self, key: str, text: str) -> None:
        """It was typed."""
        if (document := self.documents.get(key)) is not None and document.loaded:
            document.text = text

    def put(self, key: str, text: str) -> None:
        """It was changed by something else than typing."""
        document = self.documents[key]
        document.text = text
        document.revision += 1

    def revert(self) -> None:
        """Back to the engine's text."""
        if (document := self.document) is not None and document.was:
            document.was = document.theirs if document.theirs is not None else document.was
            document.text, document.theirs, document.said = document.was, None, None
            document.revision += 1

    def overrule(self) -> None:
        """Keep what is typed here in place of what somebody else has saved: the next save brings it into force."""
        if (document := self.document) is not None and document.theirs is not None:
            document.was, document.theirs = document.theirs, None

    def why_not_save(self) -> str:
        """Code of the reason why the document can't be saved now, as far as it is known here."""
        document = self.document
        if document is None or not document.loaded:
            return "loading"
        if document.sent is not None:
            return "sending"
        if document.builtin and document.kind == "node":
            return "builtin"
        if document.theirs is not None:
            return "saved_by_others"
        if not document.dirty:
            return "nothing_to_save"
        found = document.problem
        return "unsound" if found is not None and document.text != document.refused else ""

    def save(self, note: str = "") -> Message | None:
        """The call that brings the document into force."""
        document = self.document
        if document is None or self.why_not_save():
            return None
        document.sent, document.said = document.text, None
        call = self._out[f"save {document.key}"] = document.saved_by(note)
        return call

    def reloads(self) -> list[Message]:
        """What has the document's nodes that run go on in the version that was saved."""
        document = self.document
        if document is None or document.engine:
            return []
        return [ReloadNode(name=each.name) for each in self.running if each.node == document.name]

    # ------------------------------------------------------------------------------------------------------- its calls

    def want(self) -> list[Message]:
        """The calls that are due, each once."""
        calls: list[Message] = []
        if (self.watched or self.nodes_watched) and not self._listed:
            self._listed = True
            calls.append(self._out.setdefault("list", ListNodes(engine=self.engine)))
        for key in list(self._stale):
            self._stale.discard(key)
            if key in self.documents and f"read {key}" not in self._out:
                call = self._out[f"read {key}"] = self.documents[key].fetch()
                calls.append(call)
        return calls

    def take(self, call: Message, answer: Any) -> None:
        """An answer to one of these calls; others count for nothing."""
        what, _, key = self._returned(call).partition(" ")
        document = self.documents.get(key)
        if what == "list":
            self.nodes = answer.nodes
        elif document is not None and what == "read":
            document.take(answer.text, answer.file, getattr(answer, "builtin", False))
        elif document is not None and what == "save":
            if answer.release is not None:
                document.was, document.release = document.sent or "", answer.release.number
            document.sent = None
            self._listed = False

    def failed(self, call: Message, why: str) -> None:
        """One of them was refused, or not answered."""
        what, _, key = self._returned(call).partition(" ")
        document = self.documents.get(key)
        if what == "list" or (what == "read" and (document is None or not document.loaded)):
            self.problem = why
        elif document is not None and what == "save":
            document.said, document.refused, document.sent = told(why, document.file), document.sent or "", None
            if document.was:
                self._stale.add(key)  # it may be refused because somebody else has saved it

    def _returned(self, call: Message) -> str:
        what = next((what for what, each in self._out.items() if each is call), "")
        self._out.pop(what, None)
        return what

    def anew(self) -> None:
        """The engine has come back, or has other code: read everything again, and keep what was typed."""
        self._listed = False
        self._out = {what: call for what, call in self._out.items() if what.startswith("save ")}
        self._stale.update(key for key, each in self.documents.items() if each.was or not each.loaded)
