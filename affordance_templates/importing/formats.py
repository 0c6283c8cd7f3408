"""Which format a file is in."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

from affordance_templates.importing import nasa, otdf
from affordance_templates.importing.imported import Imported
from handrail.config import ConfigError

_LARGEST = 2_000_000  # characters


def read(file: Path) -> Imported:
    """Read an OTDF, .atdf or JSON file; which one, its content says. Raises ConfigError, with the line where there is one."""
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise ConfigError(file, None, "", f"can't be read: {problem}") from problem
    if len(text) > _LARGEST:
        raise ConfigError(file, None, "", f"{len(text)} characters; expected at most {_LARGEST}")
    if text.lstrip().startswith("{"):
        try:
            data = json.loads(text)
        except (ValueError, RecursionError) as problem:
            raise ConfigError(file, getattr(problem, "lineno", None), "", f"not JSON: {problem}") from problem
        return nasa.imported(file, data)
    if "<!ENTITY" in text:
        raise ConfigError(file, None, "", "defines XML entities; expected none")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, RecursionError) as problem:
        line = problem.position[0] if isinstance(problem, ET.ParseError) else None
        raise ConfigError(file, line, "", f"not XML: {problem}") from problem
    if root.tag == "object":
        return otdf.Reader(file, root).imported()
    if root.tag == "affordance_template":
        return nasa.imported(file, nasa.as_json(root))
    raise ConfigError(file, 1, "", f"got <{root.tag}>; expected <object> (OTDF) or <affordance_template>")
