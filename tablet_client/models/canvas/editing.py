"""What is edited on the canvas, whatever it is a picture of: the document that the code page has open, edits, and back again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from tablet_client.models.canvas.history import History
from tablet_client.models.code import Code, Document


class Text(Protocol):
    """A file's text that is edited by a tool."""

    @property
    def text(self) -> str: ...


_Text = TypeVar("_Text", bound=Text)
_Read = TypeVar("_Read")
_Picture = TypeVar("_Picture")


class Editing(Generic[_Text, _Read, _Picture]):
    """Every edit changes the text of the document that the code page has open, too: they are one thing, saved as one.

    `said`: what was wrong with the last edit.
    """

    def __init__(self, code: Code):
        self._code = code
        self.selected = ""
        """what is worked on"""
        self.joining = False
        """what is touched next is where a new line leads"""
        self.said = ""
        self.watched = False
        """somebody looks"""
        self._drawn: tuple[tuple[object, ...], _Read | None, _Picture | None, str] = ((), None, None, "")
        self._history = History(code)

    # ------------------------------------------------------------------------------------- what each kind of picture has

    def _open(self, text: str) -> _Text:
        """To be edited. Raises ValueError."""
        raise NotImplementedError

    def _read(self, text: str) -> _Read:
        """What is drawn. Raises ValueError."""
        raise NotImplementedError

    def _lay_out(self, read: _Read) -> _Picture:
        raise NotImplementedError

    def _shows(self, document: Document) -> bool:
        """Whether it is a document of this kind."""
        raise NotImplementedError

    def _why_never(self, document: Document) -> str:
        """Why such a document can't be drawn, whatever is typed; empty: it can."""
        return ""

    def _news(self) -> int:
        """Another number where the same text is drawn otherwise."""
        return 0

    def _took(self, read: _Read) -> None:
        """It is drawn anew: what was selected may have gone."""

    # ---------------------------------------------------------------------------------------------------------- shown

    @property
    def document(self) -> Document | None:
        """What is open; None: nothing of this kind is."""
        found = self._code.document
        return found if found is not None and found.loaded and self._shows(found) else None

    @property
    def read(self) -> _Read | None:
        """It as it stands; of a text that can't be read the last one that could be."""
        self._draw()
        return self._drawn[1]

    @property
    def picture(self) -> _Picture | None:
        self._draw()
        return self._drawn[2]

    @property
    def problem(self) -> str:
        """Why the text as it stands can't be drawn."""
        self._draw()
        return self._drawn[3]

    def _draw(self) -> None:
        document = self.document
        if document is None:
            self._drawn = (), None, None, ""
            return
        seen = (document.key, document.text, self._news())
        if seen == self._drawn[0]:
            return
        if why := self._why_never(document):
            self._drawn = seen, None, None, why
            return
        try:
            read = self._read(document.text)
            self._open(document.text)
        except ValueError as problem:
            same = self._drawn[0][:1] == seen[:1]
            self._drawn = seen, *(self._drawn[1:3] if same else (None, None)), str(problem)
            return
        self._drawn = seen, read, self._lay_out(read), ""
        self._took(read)

    # --------------------------------------------------------------------------------------------------------- edited

    def why_not_edit(self) -> str:
        """Code of the reason why nothing can be changed here."""
        if self.document is None:
            return "loading"
        return "unsound" if self.problem else ""

    def _edit(self, change: Callable[[_Text], object], subject: str = "") -> bool:
        """False: it was refused, and `said` says why. `subject`: see `History.change`."""
        document = self.document
        if document is None or self.why_not_edit():
            return False
        self.said = ""
        try:
            text = self._open(document.text)
            change(text)
        except ValueError as problem:
            self.said = str(problem)
            return False
        self._history.change(document, text.text, subject)
        return True

    # -------------------------------------------------------------------------------------------------- and back again

    @property
    def can_undo(self) -> bool:
        return self._history.can_undo(self.document)

    @property
    def can_redo(self) -> bool:
        return self._history.can_redo(self.document)

    def undo(self) -> None:
        if self._history.undo(self.document):
            self.said = ""

    def redo(self) -> None:
        if self._history.redo(self.document):
            self.said = ""
