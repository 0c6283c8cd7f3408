"""SCXML files as programs: what they say is run, what no program can say is refused by its line and element."""

from __future__ import annotations

import pytest

from engines.activities.base import ActivityFailed
from engines.programs import program
from engines.programs.statechart import Chart
from handrail.config import ConfigError

from .test_statechart import Step

FILE = """\
<?xml version="1.0"?>
<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:h="https://handrail/scxml" version="1.0" name="Ask twice" initial="work">
  <datamodel>
    <data id="arm" h:resource="arm"/>
    <data id="most" expr="2" h:parameter="integer" h:min="1" h:max="5"/>
    <data id="n" expr="0"/>
  </datamodel>
  <final id="bad"><donedata><param name="outcome" expr="'failed'"/></donedata></final>
  <state id="work">
    <initial><transition target="asking"/></initial>
    <state id="resting"><transition target="asking"/></state>
    <state id="asking">
      <invoke type="prompt">
        <param name="text" expr="'Move the {arm} arm, {n} of {most}?'"/>
        <param name="options" expr="['yes', 'no']"/>
      </invoke>
      <transition event="done.invoke.asking" cond="n + 1 &lt; most" target="last"><assign location="n" expr="n + 1"/></transition>
      <transition event="done.invoke.asking" target="good"/>
    </state>
    <history id="last" type="deep"><transition target="resting"/></history>
    <transition event="error.*" target="bad"/>
  </state>
  <final id="good"><donedata><param name="detail" expr="'asked {n} times more'"/></donedata></final>
</scxml>
"""


@pytest.fixture
def read(tmp_path):
    def read(text=FILE):
        file = tmp_path / "twice.scxml"
        file.write_text(text)
        return program.read(file)

    return read


@pytest.fixture
def begin(read, wait_until):
    steps: list[Step] = []

    def begin():
        found = read()
        values = {name: each.default for name, each in found.parameters.items()}

        def make(state, values):
            steps.append(Step(state, values))
            return steps[-1]

        chart = Chart(found, {**found.variables, **values, "arm": "left"}, make)
        chart.begin()
        return chart

    def step(count):
        wait_until(lambda: len(steps) >= count)
        return steps[count - 1]

    begin.step = step
    return begin


def test_what_an_scxml_file_says_is_run(begin):
    chart = begin()
    assert begin.step(1).values["text"] == "Move the left arm, 0 of 2?"
    assert begin.step(1).values["options"] == ["yes", "no"]
    begin.step(1).end({"answer": "yes"})
    chart.step()
    assert begin.step(2).values["text"] == "Move the left arm, 1 of 2?"
    begin.step(2).end({"answer": "yes"})
    chart.step()
    assert (chart.ended.id, chart.ended.file.outcome) == ("good", "succeeded")
    assert chart.words(chart.ended.file.detail) == "asked 1 times more"


def test_a_failure_takes_the_way_for_errors_of_an_scxml_file(begin):
    chart = begin()
    begin.step(1).end(ActivityFailed("refused", "nobody there"))
    chart.step()
    assert (chart.ended.id, chart.ended.file.outcome) == ("bad", "failed")


def test_it_is_found_in_a_workspace_by_its_name(tmp_path, monkeypatch):
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "twice.scxml").write_text(FILE)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    assert program.read(program.files()["twice"]).title == "Ask twice"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<initial>", "<onentry><foreach/></onentry><initial>", r":10: <foreach>: no program has that here"),
        ("<initial>", "<onentry><raise/></onentry><initial>", r":10: <raise>: expected `event`"),
        ("<initial>", "<onentry><raise event='done.x'/></onentry><initial>", r":10: states\.work\.enter\[0\]: got 'done\.x'"),
        ("<initial>", "<onexit><send event='x' target='#_parent'/></onexit><initial>", r":10: <send>: target='#_parent'; expected"),
        ("<initial>", "<onexit><send event='x' delay='1h'/></onexit><initial>", r":10: <send>: delay '1h'; expected a time"),
        ("<initial>", "<onexit><log expr='nobody'/></onexit><initial>", r":10: states\.work\.exit\[0\]\.log: unknown name"),
        ("<initial>", "<onexit><if cond='n == 1'/></onexit><initial>", r":10: states\.work\.exit\[0\]\.then: missing"),
        ("<initial>", "words<initial>", r":10: <state>: has 'words' in it; expected elements"),
        ("</scxml>", "<script>x</script></scxml>", r":24: <script>: no program has that here"),
        ("<assign ", "<cancel sendid='x'/><assign ", r":17: <cancel>: no program has that here"),
        ('version="1.0" name', 'version="1.0" datamodel="xpath" name', r":2: <scxml>: datamodel='xpath'; expected"),
        ('initial="work"', 'initial="nobody"', r":2: start: got 'nobody'; expected one of"),
        ('target="bad"', 'target="worse"', r":21: states\.work\.transitions\[0\]\.target: no state 'worse'"),
        ("n + 1 &lt; most", "f(n)", r":17: states\.work\.states\.asking\.transitions\[0\]\.cond: .* not an expression"),
        ('type="prompt"', 'type="pray"', r":13: states\.work\.states\.asking\.do: no activity 'pray'"),
        ('type="prompt"', 'type="prompt" src="x.scxml"', r":13: <invoke>: no program has its attribute 'src'"),
        ("</scxml>", "", r":25: not XML: "),
        ("<scxml xmlns=", '<!DOCTYPE a [<!ENTITY b "c">]><scxml xmlns=', r":2: <!DOCTYPE>: "),
        ('id="n" expr="0"', 'id="n" expr="f()"', r":6: <data>: got 'f\(\)'; expected a number"),
        ('<state id="resting">', "<state>", r":11: <state>: has no id"),
        ('<state id="resting">', '<state id="asking">', r":12: <state>: 'asking' is there already, in line 11; expected one"),
        ('<data id="n"', '<data id="n" expr="1"/><data id="n"', r":6: <data>: 'n' is there already, in line 6; expected one"),
    ],
)  # fmt: skip
def test_what_no_program_can_say_is_refused_by_line_and_element(read, old, new, told):
    assert old in FILE
    with pytest.raises(ConfigError, match=r"twice\.scxml" + told):
        read(FILE.replace(old, new, 1))


def test_a_file_that_is_not_in_utf_8_is_refused_by_its_line(tmp_path):
    file = tmp_path / "twice.scxml"
    text = FILE.replace('version="1.0"?', 'version="1.0" encoding="ISO-8859-1"?').replace("Ask twice", "Frag über")
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(ConfigError, match=r"twice\.scxml:2: not XML: .*invalid token"):
        program.read(file)
    file.write_bytes(text.encode())
    assert program.read(file).title == "Frag über"
