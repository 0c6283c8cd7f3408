"""The command itself: what it lists, and what it says to nonsense."""

import subprocess
import sys
from importlib.metadata import entry_points

import pytest

from handrail import cli

VERBS = [
    "up",
    "top",
    "stop",
    "demo",
    "tablet",
    "shell",
    "can",
    "daemon",
    "hardware",
    "safety",
    "controllers",
    "drives",
    "program",
    "engine",
    "deploy",
    "deployments",
    "watch",
    "plan",
    "node",
    "learn",
    "template",
    "instance",
    "robot",
    "jog",
    "home",
    "new",
    "behaviour",
    "replay",
    "bench",
    "campaign",
    "pair",
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
def test_every_verb_is_installed_and_explains_itself(verb, monkeypatch, capsys):
    assert verb in {point.name for point in entry_points(group="handrail.verbs")}
    monkeypatch.setattr(sys, "argv", ["handrail", verb, "--help"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
    assert "Usage" in capsys.readouterr().out


def test_an_unknown_verb_is_refused():
    refused = handrail("levitate")
    assert refused.returncode == 2
    assert "levitate" in refused.stderr


def test_an_unknown_benchmark_is_told_which_there_are():
    refused = handrail("bench", "nothing")
    assert refused.returncode == 2
    assert "can_codec" in refused.stdout
