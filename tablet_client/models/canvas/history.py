"""What was done to a document on the canvas, and back again."""

from __future__ import annotations

from tablet_client.models.code import Code, Document

_KEPT = 200
"""steps"""


class History:
    """Of all documents that were edited here; each has its own."""

    def __init__(self, code: Code):
        self._code = code
        self._done: dict[str, list[str]] = {}
        self._undone: dict[str, list[str]] = {}
        self._last = ("", "", "")
        """document, text and subject of the last change"""

    def change(self, document: Document, text: str, subject: str = "") -> None:
        """One step more; nothing that was undone comes again. What follows of the same `subject` is one step with it (a slider)."""
        if text == document.text:
            return
        if not subject or self._last != (document.key, document.text, subject):
            steps = self._done.setdefault(document.key, [])
            steps.append(document.text)
            del steps[:-_KEPT]
        self._last = (document.key, text, subject)
        self._undone[document.key] = []
        self._code.put(document.key, text)

    def can_undo(self, document: Document | None) -> bool:
        return document is not None and bool(self._done.get(document.key))

    def can_redo(self, document: Document | None) -> bool:
        return document is not None and bool(self._undone.get(document.key))

    def undo(self, document: Document | None) -> bool:
        """False: there is nothing to take back."""
        return self._back(document, self._done, self._undone)

    def redo(self, document: Document | None) -> bool:
        """False: nothing was taken back."""
        return self._back(document, self._undone, self._done)

    def _back(self, document: Document | None, steps: dict[str, list[str]], others: dict[str, list[str]]) -> bool:
        if document is None or not steps.get(document.key):
            return False
        others.setdefault(document.key, []).append(document.text)
        self._code.put(document.key, steps[document.key].pop())
        return True
