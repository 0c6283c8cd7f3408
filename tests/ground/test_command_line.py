"""The command itself: what it lists, and what it says to nonsense."""

import subprocess
import sys
from importlib.metadata import entry_points

import pytest

VERBS = [
    "up",
    "stop",
    "demo",
    "tablet",
    "can",
    "daemon",
    "hardware",
    "safety",
    "controllers",
    "drives",
    "program",
    "robot",
    "behaviour",
    "replay",
    "bench",
    "campaign",
]


def handrail(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "handrail.cli", *words], capture_output=True, text=True, timeout=60, check=False
    )


def test_help_lists_every_verb():
    text = handrail("--help").stdout
    for verb in VERBS:
        assert f" {verb} " in text


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_installed_and_explains_itself(verb):
    assert verb in {point.name for point in entry_points(group="handrail.verbs")}
    shown = handrail(verb, "--help")
    assert shown.returncode == 0, shown.stderr
    assert "Usage" in shown.stdout


def test_an_unknown_verb_is_refused():
    refused = handrail("levitate")
    assert refused.returncode == 2
    assert "levitate" in refused.stderr


def test_an_unknown_benchmark_is_told_which_there_are():
    refused = handrail("bench", "nothing")
    assert refused.returncode == 2
    assert "can_codec" in refused.stdout
