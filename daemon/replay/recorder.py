"""The recorder of a robot that is up: everything that handrail.recorder writes, and the loop's tape, from the loop's start on.

python -m daemon.replay.recorder --runtime DIR --out FILE.mcap
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from daemon.replay.tape_file import TapeRecorder
from handrail.recorder import listen
from handrail.runtime import Runtime


def main() -> int:
    """Record until SIGTERM or Ctrl-C. Returns 1 where the file can't be written."""
    parser = argparse.ArgumentParser(
        prog="python -m daemon.replay.recorder", description="Records a robot and its loop."
    )
    parser.add_argument("--runtime", required=True, help="folder in which the robot's processes meet")
    parser.add_argument(
        "--out", required=True, type=Path, help="the MCAP file; where it exists, one with a number beside it"
    )
    given = parser.parse_args()
    tape = TapeRecorder(Runtime.at(given.runtime))
    try:
        listen(Runtime.at(given.runtime), free_name(given.out), tape)
    except OSError as error:
        print(f"recorder: {given.out}: {error.strerror}", file=sys.stderr, flush=True)
        return 1
    for cycle in tape.broken:
        print(f"recorder: the loop's tape broke off in cycle {cycle}: replay ends there", file=sys.stderr, flush=True)
    return 0


def free_name(file: Path) -> Path:
    """`file`, or where that exists one of the same name with a number: what was recorded is never written over."""
    number, free = 1, file
    while free.exists():
        number += 1
        free = file.with_stem(f"{file.stem}-{number}")
    return free


if __name__ == "__main__":
    sys.exit(main())
