"""Code that is deployed to an engine while it runs programs."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from engines.releases.closure import bundle_here, bundle_of, bundle_of_node
from handrail import messages as m
from handrail.bundles import manifest, pieces
from handrail.program_edit import ProgramText

PROGRAM = """title: Reach
resources:
  arm: {{kind: arm}}
states:
  asking:
    do: prompt
    with: {{text: "{text}", options: [go]}}
    transitions: [{{event: done.invoke.asking, target: moving}}, {{event: error.execution, target: badly}}]
  moving:
    do: behave
    with: {{behaviour: nudge, arm: arm}}
    transitions: [{{event: done.invoke.moving, target: well}}, {{event: error.execution, target: badly}}]
  well: {{final: true, outcome: succeeded}}
  badly: {{final: true, outcome: failed, detail: it did not}}
"""
BEHAVIOUR = """steps:
  - name: {step}
    motion: {{type: compliant_motion, duration: 1.0, shift: [0.06, 0, 0]}}
"""


NODE_PROGRAM = """title: Find
states:
  finding:
    do: node
    with: {node: chain, inputs: {value: 20}, outputs: [doubled]}
    transitions:
      - {event: done.invoke.finding, target: well, cond: _event.data.doubled == 42}
      - {event: done.invoke.finding, target: badly}
      - {event: error.execution, target: badly}
  well: {final: true, outcome: succeeded}
  badly: {final: true, outcome: failed, detail: it did not}
"""
CALLING = """title: Call
resources:
  arm: {kind: arm}
states:
  calling:
    do: program
    with: {program: nod, bind: {arm: arm}}
    transitions: [{event: done.invoke.calling, target: well}, {event: error.execution, target: badly}]
  badly: {final: true, outcome: failed}
  well: {final: true, outcome: succeeded}
"""
NODE = """from beside import twice
from engines.nodes import Input, Node, Output


class Double(Node):
    value = Input("number")
    doubled = Output("number")

    def step(self):
        self.doubled = twice(self.value + 1)
"""
COMPOSITE = """nodes: {double: {node: double}}
inputs: {value: double.value}
outputs: {doubled: double.doubled}
"""


def write(folder: Path, files: dict[str, str]) -> None:
    for path, text in files.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text)


def put(text: str, step: str = "nudge", **others: str) -> m.PutBundle:
    """`others`: what else is in the bundle's behaviour, and in its node."""
    files = {
        "rtc_programs/nod.yaml": PROGRAM.format(text=text).encode(),
        "behaviours/nudge.yaml": (BEHAVIOUR.format(step=step) + others.get("behaviour", "")).encode(),
    }
    if "node" in others:
        files["nodes/broken.py"] = others["node"].encode()
    bundle = manifest.bundle("nod", files)
    parts = [m.Piece(address=address, data=pieces.pack(content)) for address, content in bundle.contents.items()]
    return m.PutBundle(bundle=bundle.address, pieces=parts)


def test_a_run_goes_on_with_the_code_that_it_began_with_and_the_next_one_has_the_new(stack, daemon):
    assert stack.call(put("one?", "first")).release.number == 1
    run = stack.run("nod")
    first = stack.prompt(1)
    assert stack.call(put("one?", "second")).release.number == 2
    assert stack.wait(lambda e: isinstance(e, m.CodeChanged) and e.release.number == 2).engine == "engine"
    stack.call(m.AnswerPrompt(id=first.id, answer="go", by="test"))
    ended = stack.ended()
    assert (ended.status, ended.hash) == ("succeeded", run.hash)
    assert [call.steps[0].name for call in daemon.calls if isinstance(call, m.StartBehaviour)] == ["first"]

    again = stack.run("nod")
    stack.call(m.AnswerPrompt(id=stack.prompt(2).id, answer="go", by="test"))
    stack.wait(lambda e: isinstance(e, m.RunState) and e.run == again.run and e.status == "succeeded")
    assert [call.steps[0].name for call in daemon.calls if isinstance(call, m.StartBehaviour)] == ["first", "second"]


def test_a_run_whose_own_program_is_another_one_by_now_goes_on_in_that_with_its_behaviours(stack, daemon):
    stack.call(put("one?", "first"))
    run = stack.run("nod")
    first = stack.prompt(1)
    stack.call(put("two?", "second"))
    assert stack.prompt(2).text == "two?", "what it asks otherwise now is asked anew"
    assert "withdrawn" in stack.refusal(m.AnswerPrompt(id=first.id, answer="go")).message
    stack.call(m.AnswerPrompt(id=stack.prompt(2).id, answer="go", by="test"))
    ended = stack.ended()
    assert (ended.run, ended.status) == (run.run, "succeeded") and ended.hash != run.hash
    assert [call.steps[0].name for call in daemon.calls if isinstance(call, m.StartBehaviour)] == ["second"]


def test_what_is_deployed_survives_a_restart_and_goes_when_it_is_rolled_back(start):
    stack = start()
    bind = m.Deploy(program="nod", bindings={"arm": "right"})
    assert "nod" in stack.refusal(bind).value
    stack.call(put("one?"))
    before = stack.call(bind).hash
    stack.call(put("two?"))
    stack = start()
    assert stack.call(bind).hash != before
    assert stack.call(m.RollBack(by="me")).release.by == "me"
    assert stack.call(bind).hash == before
    listing = stack.call(m.GetReleases())
    assert [release.number for release in listing.releases] == [1, 2, 3]
    assert listing.releases[0].at_ns <= listing.releases[2].at_ns <= time.time_ns()
    assert set(listing.files) == {"rtc_programs/nod.yaml", "behaviours/nudge.yaml"}


def test_a_joint_that_this_robot_does_not_have_is_refused(stack):
    refused = stack.refusal(put("one?", behaviour="joints: [elbow]\n"))
    assert refused.value == "behaviours/nudge.yaml"
    assert "elbow is none of two_joints's" in refused.expected


@pytest.mark.parametrize("text", ["class Broken(:\n", "import ("])
def test_a_node_that_is_no_python_is_refused(stack, text):
    refused = stack.refusal(put("one?", node=text))
    assert (refused.field, refused.value) == ("files", "nodes/broken.py")
    assert "line 1" in refused.expected


def test_a_node_of_parts_runs_with_what_travelled_with_it(stack, tmp_path, monkeypatch):
    workspace = {
        "rtc_programs/find.yaml": NODE_PROGRAM,
        "nodes/chain.yaml": COMPOSITE,
        "nodes/double.py": NODE,
        "nodes/beside.py": "def twice(value):\n    return 2 * value\n",
        "nodes/other.py": "",
    }
    write(tmp_path, workspace)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    found = bundle_of("find")
    assert sorted(found.manifest.files) == sorted(workspace.keys() - {"nodes/other.py"})
    monkeypatch.delenv("HANDRAIL_WORKSPACE")  # the robot has it from the bundle alone
    parts = [m.Piece(address=address, data=pieces.pack(content)) for address, content in found.contents.items()]
    stack.call(m.PutBundle(bundle=found.address, pieces=parts))
    deployed = stack.call(m.Deploy(program="find", bindings={}))
    stack.call(m.Run(deployment=deployed.id))
    ended = stack.ended()
    assert ended.status == "succeeded", ended.detail


def test_a_program_travels_with_those_that_it_runs(tmp_path, monkeypatch):
    workspace = {
        "rtc_programs/outer.yaml": CALLING,
        "rtc_programs/nod.yaml": PROGRAM.format(text="?"),
        "behaviours/nudge.yaml": BEHAVIOUR.format(step="nudge"),
    }
    write(tmp_path, workspace)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    assert bundle_of("outer").manifest.files.keys() == workspace.keys()


def test_a_node_that_is_a_part_of_itself_travels_to_where_that_is_refused(tmp_path, monkeypatch):
    workspace = {
        "rtc_programs/find.yaml": NODE_PROGRAM,
        "nodes/chain.yaml": "nodes: {again: {node: chain}}\noutputs: {}\n",
    }
    write(tmp_path, workspace)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    assert bundle_of("find").manifest.files.keys() == workspace.keys()


def test_a_node_that_was_saved_on_the_robot_is_compared_with_the_one_of_its_name_here(tmp_path, monkeypatch):
    text = NODE.replace("from beside import twice\n", "").replace("twice(", "2 * (")
    here, robot = tmp_path / "here", tmp_path / "robot"
    for folder in (here, robot):
        folder.mkdir()
    write(robot, {"nodes/double.py": text})
    saved = bundle_of_node("double", robot / "nodes" / "double.py")
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(here))
    assert bundle_here("nodes/double") is None and bundle_here("double") is None
    write(here, {"nodes/double.py": text})
    assert bundle_here(saved.manifest.program).address == saved.address
    write(here, {"nodes/double.py": text + "\n"})
    assert bundle_here("nodes/double").address != saved.address
    write(here, {"nodes/double.py": "def f(:"})
    with pytest.raises(ValueError, match=r"double\.py:1"):
        bundle_here("nodes/double")


def test_a_node_that_is_no_python_is_named_before_anything_travels(tmp_path, monkeypatch):
    write(tmp_path, {"rtc_programs/find.yaml": NODE_PROGRAM, "nodes/chain.py": "import os\ndef f(:\n"})
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    with pytest.raises(ValueError, match=r"nodes/chain\.py:2: .*; expected Python"):
        bundle_of("find")


def test_a_program_of_another_suffix_travels_under_the_one_that_it_is_found_by(tmp_path):
    file = tmp_path / "ask.yml"
    file.write_text(
        PROGRAM.format(text="?").replace("do: behave", "do: prompt").replace("behaviour: nudge, arm: arm", "text: on?")
    )
    assert list(bundle_of(str(file)).manifest.files) == ["rtc_programs/ask.yaml"]


def test_a_program_is_read_edited_and_saved_with_its_comments_and_not_over_somebody_elses_edit(stack):
    there = stack.call(m.GetProgram(program="press"))
    assert there.file == "press.yaml"
    edited = ProgramText(there.text)
    edited.set_field("asking", ["with", "text"], "Press?")
    release = stack.call(m.SaveProgram(program="press", text=edited.text, was=there.text, note="softer")).release
    assert (release.program, release.note) == ("press", "softer")
    assert stack.call(m.GetProgram(program="press")).text == edited.text
    assert edited.text.startswith("# Go on until the tool touches something")
    stack.run("press")
    assert stack.prompt().text == "Press?"
    old = stack.refusal(m.SaveProgram(program="press", text=there.text, was=there.text))
    assert "read it anew" in old.message
    edited.connect("asking", "pressing", event="x", cond="nobody > 3")
    wrong = stack.refusal(
        m.SaveProgram(program="press", text=edited.text, was=stack.call(m.GetProgram(program="press")).text)
    )
    assert "press.yaml" in wrong.expected and "unknown name 'nobody'" in wrong.expected
    assert "one of: " in stack.refusal(m.GetProgram(program="../press")).expected
    assert stack.refusal(m.SaveProgram(program="../x", text=there.text)).field == "program"
    stack.call(m.SaveProgram(program="press2", text=there.text))
    assert stack.call(m.GetReleases()).programs.keys() == {"press", "press2"}
