"""What a one-line edit of a large program costs the link: a part of ``handrail bench engines``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from benchmarks.rows import Row
from engines.releases.closure import bundle_of
from handrail.client import connect
from handrail.demo.children import Children
from handrail.link import keys
from handrail.runtime import Runtime, memory_folder

BYTES = 1000
_PORT = 48390
_START_S = 180.0


def deploying(robot: str, program: str, edited: str) -> list[Row]:
    """Bytes of calls and answers, both ways, as the client counts them at the link, for a first deployment and for an edit.

    :param program: the text of one of about 100 KB; `edited`: the same with one line changed
    """
    with tempfile.TemporaryDirectory(dir=memory_folder(), prefix="handrail-bench-") as folder:
        runtime, file = Runtime.at(Path(folder) / "run"), Path(folder) / "long.yaml"
        own = keys.ensure(Path(folder) / "keys")
        with Children(runtime.folder / "logs") as children:
            engine = children.start("engine", _command("engines.engine", "--robot", robot, runtime=runtime))
            link = children.start(
                "link", _command("handrail.link.gate", "--port", str(_PORT), "--keys", str(own), runtime=runtime)
            )
            engine.wait_for("engine ready", _START_S)
            link.wait_for("link ready", _START_S)
            with connect(f"tcp://127.0.0.1:{_PORT}", own, timeout_s=30.0) as client:
                spent = []
                for text in (program, edited):
                    file.write_text(text)
                    before = sum(client.traffic)
                    client.send_bundle(bundle_of(str(file)), cache=Path(folder) / "cache")
                    spent.append(sum(client.traffic) - before)
    size = round(len(program) / 1000)
    return [
        Row(name=f"a program of {size} KB deployed for the first time", value=spent[0], unit="bytes", goal="≤ a fifth",
            holds=spent[0] <= len(program) / 5),
        Row(name="one line of it changed", value=spent[1], unit="bytes", goal=f"≤ {BYTES}", holds=spent[1] <= BYTES),
    ]  # fmt: skip


def _command(module: str, *more: str, runtime: Runtime) -> list[str]:
    return [sys.executable, "-m", module, *more, "--runtime", str(runtime.folder)]
