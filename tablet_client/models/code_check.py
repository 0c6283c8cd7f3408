"""What is wrong with a text before an engine has seen it, and where an engine says that something is wrong with it."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import PurePath

from handrail import yaml_file
from handrail.yaml_file import NotYAML

_PLACE = re.compile(r"([\w.\-/]+\.(?:py|ya?ml|scxml)):(\d+):?\s*")


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong."""

    line: int
    """from 1; 0: of the whole file"""
    message: str


def check(text: str, file: str) -> Problem | None:
    """The first thing that makes a text no Python, or no YAML, by the suffix of `file`; of another one nothing is known."""
    if file.endswith(".py"):
        return _python(text, file)
    if file.endswith((".yaml", ".yml")):
        try:
            yaml_file.parse(text)
        except NotYAML as error:
            return Problem(error.line or 0, error.problem)
    return None


def _python(text: str, file: str) -> Problem | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a text that is just being typed
            compile(text, file, "exec", dont_inherit=True)
    except SyntaxError as error:
        return Problem(min(error.lineno or 1, text.count("\n") + 1), error.msg)
    except (ValueError, RecursionError, MemoryError) as error:
        return Problem(0, str(error) or type(error).__name__)
    return None


def told(why: str, file: str) -> Problem:
    """What a refusal says of a file: after the last ``FILE:LINE`` that is of it, else all of it."""
    places = [each for each in _PLACE.finditer(why) if PurePath(each[1]).name == file]
    if not places:
        return Problem(0, why)
    return Problem(int(places[-1][2]), why[places[-1].end() :] or why)
