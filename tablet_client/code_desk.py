"""The code page's side of the desk: documents as text that is typed, coloured, checked, and saved to an engine."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import Property, QObject, QTimer, Signal, Slot
from PySide6.QtGui import QTextCursor, QTextDocument
from PySide6.QtQuick import QQuickTextDocument

from handrail.messages import Message
from tablet_client.highlighter import Highlighter
from tablet_client.models import indenting
from tablet_client.models.code import Document
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not
_PAUSE = 300  # ms without a key, after which a text is checked
_NONE = {"start": -1, "end": -1}


class CodeDesk(QObject):
    """What QML reads of the documents that are open, and calls. A document is known by its key."""

    changed = Signal()

    def __init__(self, situation: Situation, send: Callable[[Message], None], soon: Callable[[], None]):
        """`send` sends what a button asked for, `soon` has the models looked at anew."""
        super().__init__()
        self._situation, self._code, self._send, self._soon = situation, situation.code, send, soon
        self._entries = Rows(("key", "kind", "name", "builtin", "problem", "current", "dirty"), "key")
        self._documents = Rows(("key", "name", "kind", "file", "readOnly", "dirty"), "key")
        self._texts: dict[str, tuple[QTextDocument, Highlighter]] = {}
        self._fields: dict[str, QQuickTextDocument] = {}  # Python's QTextDocument goes when its field's goes
        self._revisions: dict[str, int] = {}
        self._dark = True
        self._view: dict[str, Any] = {}
        self._settled = True
        self._problem: dict[str, Any] = {"line": 0, "message": "", "here": True, "at": 0}
        self._pause = QTimer(self, singleShot=True, interval=_PAUSE)
        self._pause.timeout.connect(self._settle)
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(QObject, constant=True)
    def entries(self) -> Rows:
        return self._entries

    @Property(QObject, constant=True)
    def documents(self) -> Rows:
        return self._documents

    @property
    def watched(self) -> bool:
        """Somebody looks."""
        return self._code.watched

    # --------------------------------------------------------------------------------------------------------- buttons

    @Slot(bool)
    def watch(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self._code.watched = on
        self._soon()

    @Slot(str, str)
    def open(self, kind: str, name: str) -> None:
        self._code.open(kind, name)
        self._now()

    @Slot(str)
    def close(self, key: str) -> None:
        """Show it no more, unless it has edits that were not saved."""
        if self._code.close(key):
            self._texts.pop(key, None)
            self._fields.pop(key, None)
            self._revisions.pop(key, None)
            self._now()

    @Slot(str, result=str)
    def whyNotBegin(self, name: str) -> str:
        return self._code.why_not_begin(name)

    @Slot(str, bool)
    def begin(self, name: str, copy: bool) -> None:
        """A new node; `copy`: as the one that is shown."""
        self._code.begin(name, self._code.document if copy else None)
        self._now()

    @Slot(str, str, result=str)
    def whyNotDraw(self, kind: str, name: str) -> str:
        """Why no `program`, or `node` that is made of nodes, can be begun under this name."""
        launch = self._situation.launch
        there = kind == "program" and any(each.name == name for each in launch.programs)
        return "name_taken" if there else self._code.why_not_begin(name, kind)

    @Slot(str, str)
    def beginDrawing(self, kind: str, name: str) -> None:
        """A new one of these, with nothing in it yet."""
        if not self.whyNotDraw(kind, name):
            self._code.begin_drawing(kind, name)
            self._now()

    @Slot()
    def revert(self) -> None:
        self._code.revert()
        self._now()

    @Slot()
    def overrule(self) -> None:
        self._code.overrule()
        self._now()

    @Slot(str)
    def save(self, note: str) -> None:
        """Bring it into force; nothing while the button says why it can't."""
        if not self._why_not_save() and (call := self._code.save(note)) is not None:
            self._send(call)
            self._now()

    @Slot()
    def reload(self) -> None:
        """Have the nodes that run go on in what was saved."""
        for call in self._code.reloads():
            self._send(call)

    def _why_not_save(self) -> str:
        if not self._situation.link.attached:
            return "no_robot"
        return self._code.why_not_save() if self._situation.link.engine else "no_engine"

    def refresh(self) -> None:
        """A document was changed by something else than typing."""
        self._settle()

    def _now(self) -> None:
        self._settle()
        self._soon()

    # ------------------------------------------------------------------------------------------------------------ text

    @Slot(str, QQuickTextDocument)
    def attach(self, key: str, shown: QQuickTextDocument) -> None:
        """The text field of a document is there: it gets the text and its colours."""
        text, document = shown.textDocument(), self._code.documents[key]
        self._fields[key] = shown
        self._texts[key] = text, Highlighter(text, document.file, self._dark)
        self._revisions[key] = -1
        self._put_texts()
        text.clearUndoRedoStacks()
        text.contentsChanged.connect(partial(self._typed, key))
        text.setModified(False)

    @Slot(bool)
    def colour(self, dark: bool) -> None:
        """For a dark ground, or a light one."""
        if dark != self._dark:
            self._dark = dark
            for _, highlighter in self._texts.values():
                highlighter.use(dark)

    def _typed(self, key: str) -> None:
        document, (text, _) = self._code.documents.get(key), self._texts[key]
        if document is not None and (plain := text.toPlainText()) != document.text:
            self._code.edit(key, plain)
            self._settled = False
            self._pause.start()
            self.build()

    def _settle(self) -> None:
        self._pause.stop()
        self._settled = True
        self.build()

    def _put_texts(self) -> None:
        """What became another text by something else than typing, as one step that can be undone."""
        for key, (text, _) in self._texts.items():
            document = self._code.documents.get(key)
            if document is None or not document.loaded or self._revisions.get(key) == document.revision:
                continue
            self._revisions[key] = document.revision
            if text.toPlainText() != document.text:
                self._replace(text, 0, len(text.toPlainText()), document.text)

    @staticmethod
    def _replace(text: QTextDocument, start: int, end: int, by: str) -> None:
        cursor = QTextCursor(text)
        cursor.setPosition(start)
        cursor.setPosition(end, QTextCursor.MoveMode.KeepAnchor)
        cursor.insertText(by)

    @Slot(str, str, int, int, result=_MAP)
    def indent(self, key: str, how: str, start: int, end: int) -> dict[str, int]:
        """Tab, back or enter at a selection; what is selected then."""
        document = self._code.documents[key]
        text, _ = self._texts[key]
        change = {"tab": indenting.tab, "back": indenting.back, "enter": indenting.enter}[how](
            text.toPlainText(), start, end, "." + document.file.rpartition(".")[2]
        )
        self._replace(text, change.start, change.end, change.text)
        return {"start": change.selected[0], "end": change.selected[1]}

    @Slot(str, str, int, bool, result=_MAP)
    def find(self, key: str, what: str, at: int, back: bool) -> dict[str, int]:
        """Where a text is found next, around the end, whatever its case; -1: nowhere."""
        plain, what = self._texts[key][0].toPlainText().lower(), what.lower()
        if not what:
            return _NONE
        found = plain.rfind(what, 0, max(0, at)) if back else plain.find(what, at)
        if found < 0:
            found = plain.rfind(what) if back else plain.find(what)
        return _NONE if found < 0 else {"start": found, "end": found + len(what)}

    # --------------------------------------------------------------------------------------------------------- looking

    def build(self) -> None:
        """Look at the model anew."""
        if not (self._code.watched or self._situation.canvas.watched) and self._view:
            return
        self._put_texts()
        self._entries.show([*map(self._node, self._code.nodes), *self._programs(), *self._unsaved()])
        self._documents.show(
            [
                {
                    "key": each.key,
                    "name": each.name,
                    "kind": each.kind,
                    "file": each.file,
                    "readOnly": each.builtin and each.kind == "node",
                    "dirty": each.dirty,
                }
                for each in self._code.documents.values()
                if each.loaded
            ]
        )
        document = self._code.document
        if self._settled:
            self._problem = self._shown_problem(document)
        view = {
            "current": self._code.current,
            "file": document.file if document else "",
            "kind": document.kind if document else "",
            "title": document.name if document else "",
            "loaded": document is not None and document.loaded,
            "readOnly": document is not None and document.builtin and document.kind == "node",
            "dirty": document is not None and document.dirty,
            "theirs": document is not None and document.theirs is not None,
            "release": document.release if document else 0,
            "problem": self._problem,
            "whySave": self._why_not_save() if document else "loading",
            "reloads": len(self._code.reloads()) if document is not None and not document.dirty else 0,
            "said": self._code.problem,
            "engine": self._code.engine,
            "engines": list(self._situation.deployments.engines),
            "unsaved": sum(each.dirty for each in self._code.documents.values()),
        }
        if view != self._view:
            self._view = view
            self.changed.emit()

    def _node(self, entry: Any) -> dict[str, Any]:
        return self._entry("node", entry.name, builtin=entry.builtin)

    def _programs(self) -> list[dict[str, Any]]:
        launch = self._situation.launch
        if launch.engine != self._code.engine:
            return []
        return [self._entry("program", each.name, problem=each.problem) for each in launch.programs]

    def _unsaved(self) -> list[dict[str, Any]]:
        """Nodes and programs that only this window knows yet."""
        known = {("node", each.name) for each in self._code.nodes}
        known |= {("program", each.name) for each in self._situation.launch.programs}
        return [
            self._entry(each.kind, each.name)
            for each in self._code.documents.values()
            if each.loaded and each.engine == self._code.engine and not each.was and (each.kind, each.name) not in known
        ]

    def _entry(self, kind: str, name: str, *, builtin: bool = False, problem: str = "") -> dict[str, Any]:
        key = Document(kind, name, self._code.engine).key
        document = self._code.documents.get(key)
        return {
            "key": key,
            "kind": kind,
            "name": name,
            "builtin": builtin,
            "problem": problem,
            "current": key == self._code.current,
            "dirty": document is not None and document.dirty,
        }

    @staticmethod
    def _shown_problem(document: Document | None) -> dict[str, Any]:
        """The problem with the end of its line in the text, or what the engine said to a text before this one."""
        if document is None:
            return {"line": 0, "message": "", "here": True, "at": 0}
        found, here = document.problem, True
        if found is None and document.said is not None:
            found, here = document.said, False
        if found is None:
            return {"line": 0, "message": "", "here": True, "at": 0}
        at = sum(len(line) + 1 for line in document.text.split("\n")[: found.line]) - 1
        return {"line": found.line, "message": found.message, "here": here, "at": max(0, at)}
