"""Words can be read on what they stand on, in dark and light: WCAG 2.1's contrast, 4.5 for text."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import tablet_client

THEME = (Path(tablet_client.__file__).parent / "qml" / "Theme.qml").read_text()
COLOURS = dict(
    re.findall(r'readonly property color (\w+): (dark \? "#[0-9a-f]{6}" : "#[0-9a-f]{6}"|"#[0-9a-f]{6}")', THEME)
)
GROUNDS = ("ground", "panel", "raised", "asks", "pressed")


def luminance(name: str, look: int) -> float:
    """Relative, of a colour in the dark (0) or light (1) look."""
    text = (re.findall(r"#([0-9a-f]{6})", COLOURS[name]) * 2)[look]
    parts = [int(text[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    r, g, b = (part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(words: str, ground: str, look: int) -> float:
    high, low = sorted((luminance(words, look), luminance(ground, look)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("look", [0, 1], ids=["dark", "light"])
@pytest.mark.parametrize(
    ("words", "grounds"),
    [
        *((words, GROUNDS) for words in ("text", "muted", "faint", "code", "accent", "good", "warning", "danger")),
        ("badText", ("badGround", "endGround", "endPressed")),
        ("textOnAccent", ("accentDeep",)),
        ("textOnAccent", ("stop",)),
    ],
)
def test_words_stand_out_from_every_ground_that_they_stand_on(words, grounds, look):
    least = min((contrast(words, ground, look), ground) for ground in grounds)
    assert least[0] >= 4.5, f"{words} on {least[1]}"


def test_every_colour_is_read():
    assert {"text", "muted", "faint", *GROUNDS} <= set(COLOURS) and len(COLOURS) >= 20
