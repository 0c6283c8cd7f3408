"""`do: behave`: behaviours in programs, bound to the arm that the deployment names."""

from __future__ import annotations

from pathlib import Path

import pytest

from engines.programs import program
from handrail import messages as m
from handrail.config import ConfigError
from tests.engines.conftest import until


def press(stack) -> None:
    stack.run("press")
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="press", by="test"))


def test_a_behaviour_that_says_no_frame_and_no_joints_is_done_by_the_bound_arm(stack, daemon):
    press(stack)
    assert stack.ended().status == "succeeded"
    (call,) = [call for call in daemon.calls if isinstance(call, m.StartBehaviour)]
    assert [step.name for step in call.steps] == ["approach", "press", "retreat"]
    assert {step.motion.frame for step in call.steps} == {"tip"}
    assert all(step.motion.joints == ["angle", "depth"] for step in call.steps)


def test_an_end_condition_without_a_step_that_follows_is_an_end_of_its_own(stack, daemon):
    daemon.trip = lambda action: "travel"
    press(stack)
    assert stack.ended().detail == "retreat ended: travel"


def test_a_behaviour_that_fails_fails_the_program_with_its_reason(stack, daemon):
    daemon.trip = lambda action: "stopped"
    press(stack)
    assert stack.ended().status == "failed"
    assert "press: the operator stop was pressed" in stack.ended().detail


def test_stopping_the_run_cancels_the_behaviour(stack, daemon):
    daemon.slow = True
    press(stack)
    until(lambda: daemon.action is not None)
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    assert "CancelAction" in daemon.kinds()


@pytest.mark.parametrize(
    ("behaviour", "told"),
    [
        (
            "press_hard",
            r"states.go.with.behaviour: got 'press_hard': .*no such behaviour; expected one of broken, press",
        ),
        ("broken", r"states.go.with.behaviour: got 'broken': .*broken.yaml:3: steps\[0\].motion.duration: .*got -1"),
    ],
)
def test_a_program_with_a_behaviour_that_can_not_be_run_is_refused_whole(tmp_path, monkeypatch, behaviour, told):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "behaviours").mkdir()
    (tmp_path / "behaviours" / "broken.yaml").write_text(
        "steps:\n  - name: go\n    motion: {type: compliant_motion, duration: -1}\n"
    )
    file = tmp_path / "try_it.yaml"
    file.write_text(
        "title: Try it\nresources: {arm: {kind: arm}}\nstates:\n  go:\n    do: behave\n"
        f"    with: {{behaviour: {behaviour}, arm: arm}}\n    transitions: [{{event: '*', target: end}}]\n"
        "  end: {final: true, outcome: failed}\n"
    )
    with pytest.raises(ConfigError, match=told):
        program.read(file)


def test_the_documents_own_program_is_sound(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "programs.md").read_text()
    file = tmp_path / "press_twice.yaml"
    file.write_text(text.split("```yaml\n")[1].split("```")[0])
    assert f"press_twice: sound, 4 states, hash {program.read(file).hash}" in text
