"""Numbers for people: a name that ends with its unit, and a value in SI, become a label and a text."""

from __future__ import annotations

import math

# suffix → (factor, decimals, unit shown)
_UNITS = {
    "m": (1000.0, 0, "mm"),
    "mm": (1.0, 0, "mm"),
    "rad": (180.0 / math.pi, 1, "°"),
    "deg": (1.0, 0, "°"),
    "s": (1.0, 1, "s"),
    "n": (1.0, 0, "N"),
    "nm": (1.0, 1, "N·m"),
    "c": (1.0, 0, "°C"),
}
_METRES_FROM = 1.0  # from here on, metres read better than millimetres


def quantity(name: str, value: float) -> tuple[str, str]:
    """('clearance_m', 0.031) → ('Clearance', '31 mm'). A name without a known unit keeps its words and a plain number."""
    if not has_unit(name):
        return label(name), plain(value)
    words, _, unit = name.rpartition("_")
    return label(words), in_unit(unit.lower(), value)


def has_unit(name: str) -> bool:
    """True for a name that ends with a unit that is known here, after at least one word."""
    words, _, unit = name.rpartition("_")
    return bool(words) and unit.lower() in _UNITS


def in_unit(unit: str, value: float) -> str:
    """A value in SI (or in the unit named) as text with the unit that people read."""
    if not math.isfinite(value):
        return "–"
    if unit == "m" and abs(value) >= _METRES_FROM:
        return f"{value:.2f} m"
    factor, decimals, shown = _UNITS[unit]
    text = f"{value * factor:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return f"{text}{shown}" if shown == "°" else f"{text} {shown}"


def plain(value: float) -> str:
    """A number without a unit: whole ones without a point."""
    if not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.3g}"


def label(name: str) -> str:
    """'limit_margin' → 'Limit margin'."""
    return name.replace("_", " ").strip().capitalize()
