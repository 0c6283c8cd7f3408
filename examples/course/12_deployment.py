"""Code of one's own on the robot: a program is sent, runs there, and is taken back; and only what is of interest is heard of it."""

import tempfile
from pathlib import Path

import handrail
from engines.releases.closure import bundle_of
from handrail.messages import RunState

PROGRAM = """\
title: Wait a moment
parameters: {seconds: {default: 0.2, unit: s}}
states:
  waiting: {transitions: [{after: seconds, target: done}]}
  done: {final: true, outcome: succeeded, detail: "waited {seconds:g} s"}
"""

with handrail.connect() as robot, tempfile.TemporaryDirectory() as folder:
    engine = robot.engines()[0].name  # there may be several; an engine's name is part of what it makes
    mine = robot.at(engine)
    file = Path(folder) / "wait_a_moment.yaml"
    for text in (PROGRAM, PROGRAM.replace("0.2", "0.3")):
        file.write_text(text)
        release = robot.send_bundle(bundle_of(str(file)), engine=engine, note="lesson 12")
        print(f"release {release.number} by {release.by}: {', '.join(release.changed)}")

    with mine.subscribe(RunState, where={"status": ["succeeded", "failed"]}) as ends:
        mine.run(mine.deploy("wait_a_moment"))
        print("it ended:", ends.next(timeout_s=30.0).detail)

    back = robot.roll_back(engine=engine, note="lesson 12 is over")
    print(f"release {back.number} has the first one's code; {len(robot.releases(engine).releases)} are kept")
