"""`make soak`: every test that takes longer than `make test` may, one after the other, each with its progress on the terminal.

What has passed is not run again for the same commit, so that an interrupted soak goes on where it was; results, logs and the fault
campaign's file are in soak_output/. `--share 0.02` makes every part a fiftieth as long, to see that it starts and ends rightly.
Options that are not its own go to pytest: `-k campaign` runs that part alone. Exit status 0: all parts have passed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

FOLDER = Path("soak_output")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python tools/soak.py", description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="how much of each part (0 to 1)")
    parser.add_argument("--fresh", action="store_true", help="begin anew instead of going on")
    options, rest = parser.parse_known_args()
    FOLDER.mkdir(exist_ok=True)
    file = FOLDER / "results.jsonl"
    if options.fresh:
        file.unlink(missing_ok=True)
    commit, parts = _commit(), _parts(rest)
    done = {(row["commit"], row["share"], row["part"]): row for row in _read(file) if row["passed"]}
    failed = 0
    for number, part in enumerate(parts, 1):
        name = part.rpartition("::")[2]
        if row := done.get((commit, options.share, part)):
            print(f"soak {number}/{len(parts)}: {name} passed before, in {row['wall_s']:.0f} s", flush=True)
            continue
        print(f"soak {number}/{len(parts)}: {name} begins at {time.strftime('%H:%M:%S')}", flush=True)
        began = time.monotonic()
        passed = _run(part, commit, options.share)
        wall = time.monotonic() - began
        print(f"soak {number}/{len(parts)}: {name} {'passed' if passed else 'FAILED'} after {wall:.0f} s", flush=True)
        failed += not passed
        row = {"commit": commit, "share": options.share, "part": part, "passed": passed, "wall_s": round(wall, 1)}
        with file.open("a") as stream:
            stream.write(json.dumps(row) + "\n")
    print(f"soak: {len(parts) - failed} of {len(parts)} parts passed", flush=True)
    return 1 if failed or not parts else 0


def _run(part: str, commit: str, share: float) -> bool:
    """Run one part with its output on the terminal and in its log. KeyboardInterrupt ends it and is passed on."""
    kept = FOLDER / f"{commit[:12]}-{share:g}"
    kept.mkdir(exist_ok=True)
    environment = {**os.environ, "HANDRAIL_SOAK_SHARE": str(share), "HANDRAIL_SOAK_FOLDER": str(kept.resolve())}
    command = [sys.executable, "-m", "pytest", "-m", "soak", "-s", part]
    log = kept / f"{part.rpartition('::')[2]}.log"
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment) as running:
        assert running.stdout is not None
        with log.open("wb") as stream:
            for line in running.stdout:
                sys.stdout.buffer.write(line)
                sys.stdout.flush()
                stream.write(line)
    return running.returncode == 0


def _parts(rest: list[str]) -> list[str]:
    """Node ids of the tests that are marked `soak`."""
    command = [sys.executable, "-m", "pytest", "-m", "soak", "--collect-only", "--no-header", *rest]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return [line.strip() for line in found.splitlines() if "::" in line]


def _commit() -> str:
    """What is run: the commit, and whether files differ from it."""
    head = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=False).stdout.strip()
    changed = subprocess.run(["git", "diff", "--quiet", "HEAD"], check=False).returncode
    return f"{head or 'unknown'}{'+' if changed else ''}"


def _read(file: Path) -> list[dict[str, object]]:
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text().splitlines() if line.endswith("}")]


if __name__ == "__main__":
    sys.exit(main())
