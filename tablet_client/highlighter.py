"""Colours of code, line by line: a line is coloured again when it changes, and those after it while a text is left open in it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pygments.lexer import Lexer
from pygments.lexers.data import YamlLexer
from pygments.lexers.html import XmlLexer
from pygments.lexers.python import PythonLexer
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Token
from PySide6.QtGui import QColor, QFont, QSyntaxHighlighter, QTextCharFormat, QTextDocument

_QUOTES = ("", "'''", '"""')
"""by the state that a line ends in"""
_TEXTS = re.compile(r"#.*|[rbfuRBFU]{0,2}('''|\"\"\"|'(?:\\.|[^'\\])*'?|\"(?:\\.|[^\"\\])*\"?)")
_DARK = {
    Keyword: "#c792ea", Name.Builtin: "#82aaff", Name.Function: "#82aaff", Name.Class: "#ffcb6b", Name.Decorator: "#ffcb6b",
    Name.Tag: "#82aaff", Name.Exception: "#ffcb6b", String: "#a5d6a7", Number: "#f78c6c", Comment: "#7f8c98",
    Operator.Word: "#c792ea", Keyword.Constant: "#f78c6c", Operator: "#9fb4c8", Punctuation: "#9fb4c8",
}  # fmt: skip
_LIGHT = {
    Keyword: "#8430a8", Name.Builtin: "#1c55b0", Name.Function: "#1c55b0", Name.Class: "#8a5a00", Name.Decorator: "#8a5a00",
    Name.Tag: "#1c55b0", Name.Exception: "#8a5a00", String: "#1f6f3a", Number: "#b1480f", Comment: "#68757f",
    Operator.Word: "#8430a8", Keyword.Constant: "#b1480f", Operator: "#44525e", Punctuation: "#44525e",
}  # fmt: skip


def pieces(text: str, state: int) -> tuple[list[tuple[int, int, bool]], int]:
    """A line of Python as (start, end, whether it is inside quotes of three), and what of these is open at its end."""
    found: list[tuple[int, int, bool]] = []
    at = code = 0
    if state > 0:
        end = text.find(_QUOTES[state])
        if end < 0:
            return [(0, len(text), True)], state
        at = code = end + 3
        found.append((0, at, True))
    while match := _TEXTS.search(text, at):
        quotes = match[1] if match[1] in _QUOTES[1:] else ""
        at = match.end()
        if not quotes:
            continue
        end = text.find(quotes, at)
        found += [(code, match.start(), False), (match.start(), len(text) if end < 0 else end + 3, True)]
        if end < 0:
            return found, _QUOTES.index(quotes)
        at = code = end + 3
    return [*found, (code, len(text), False)], 0


class Highlighter(QSyntaxHighlighter):
    """Of one document, by the suffix of its file."""

    def __init__(self, document: QTextDocument, file: str, dark: bool):
        super().__init__(document)
        self._python = file.endswith(".py")
        self._lexer: Lexer = PythonLexer() if self._python else XmlLexer() if file.endswith(".scxml") else YamlLexer()
        self._formats = _formats(dark)

    def use(self, dark: bool) -> None:
        """Take the colours for a dark or a light ground."""
        self._formats = _formats(dark)
        self.rehighlight()

    def highlightBlock(self, text: str) -> None:
        state = 0
        parts = [(0, len(text), False)]
        if self._python:
            parts, state = pieces(text, max(0, self.previousBlockState()))
        for start, end, quoted in parts:
            if quoted:
                self.setFormat(start, end - start, self._formats[String])
            else:
                for at, length, kind in self._tokens(text[start:end]):
                    self.setFormat(start + at, length, kind)
        self.setCurrentBlockState(state)

    def _tokens(self, text: str) -> Iterator[tuple[int, int, QTextCharFormat]]:
        for at, kind, value in self._lexer.get_tokens_unprocessed(text):
            while kind is not Token and kind not in self._formats:
                kind = kind.parent  # noqa: PLW2901 (as near as there is a colour for)
            if kind in self._formats:
                yield at, len(value), self._formats[kind]


def _formats(dark: bool) -> dict[object, QTextCharFormat]:
    made: dict[object, QTextCharFormat] = {}
    for kind, colour in (_DARK if dark else _LIGHT).items():
        made[kind] = QTextCharFormat()
        made[kind].setForeground(QColor(colour))
        made[kind].setFontItalic(kind is Comment)
        if kind in (Keyword, Name.Class):
            made[kind].setFontWeight(QFont.Weight.DemiBold)
    return made
