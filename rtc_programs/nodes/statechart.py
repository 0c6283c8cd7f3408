"""A statechart that runs whole in a process of its own: what of SCXML no program can say (docs/programs.md)."""

import json
import tempfile
from pathlib import Path
from typing import Any

from statemachine.io import load

from engines.nodes import Case, Node, Output, Param

_LOOP = """\
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="python" initial="adding">
  <datamodel><data id="each" expr="[1, 2, 3]"/><data id="sum" expr="0"/><data id="one"/></datamodel>
  <state id="adding">
    <onentry><foreach array="each" item="one"><assign location="sum" expr="sum + one"/></foreach></onentry>
    <transition cond="sum == 6" target="good"/>
    <transition target="bad"/>
  </state>
  <final id="good"/>
  <final id="bad"/>
</scxml>
"""


class Statechart(Node):
    """Carries out an SCXML document as python-statemachine does, its scripts and the machines that it invokes among it.

    Its code is run, as any node's is. It hears no events but its own.
    """

    every = 0.02
    source = Param("", "the document")
    files = Param("{}", "files beside it: a JSON object, name → text")
    final = Output("text", "id of the outermost final state that it came to")

    cases = [Case(name="adds what is in a list", params={"source": _LOOP}, inputs=[{}], outputs={"final": "good"})]

    def start(self) -> None:
        self._folder = tempfile.TemporaryDirectory()  # for its life: what it invokes is read when it does
        for name, text in json.loads(self.files).items():
            Path(self._folder.name, name).write_text(text)
        document = Path(self._folder.name, "statechart.scxml")
        document.write_text(self.source)
        self._machine: Any = load(document, trusted=True)()

    def step(self) -> None:
        # What it has sent itself for later, and what machines that it invoked have sent it, comes when it is looked for.
        self._machine._engine.processing_loop()
        if self._machine.is_terminated:
            self.final = next(state.id for state in self._machine.configuration if state.parent is None)
