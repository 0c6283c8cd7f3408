"""pytest in parallel, as `make test` runs it; what failed runs once more, by itself.

Tests with processes and deadlines of their own share the machine with each other, and sometimes with strangers. As CPython's
`regrtest --rerun` does, a few that failed get a second try with the machine to themselves: those that fail again fail the run,
those that pass are named at its end, so that nobody takes them for sound. Many failures at once are no matter of a busy machine:
then nothing runs again. All arguments go to pytest. Exit status: pytest's own.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

MOST = 3
"""failed tests that get a second try"""


def main() -> int:
    with tempfile.TemporaryDirectory(prefix="handrail-tests-") as folder:
        status = _pytest(folder, sys.argv[1:])
        if status != 1:  # 1: tests have failed; anything else but 0 is pytest's or the tests' own trouble
            return status
        failed = sorted(json.loads((Path(folder) / "v/cache/lastfailed").read_text()))
        if not 0 < len(failed) <= MOST:
            return status
        print(f"run_tests: {len(failed)} failed beside others; now by themselves", flush=True)
        again = _pytest(folder, [*sys.argv[1:], "-n", "0", "-v", "--last-failed"])
        if again == 0:
            print("run_tests: FLAKY, failed beside others and passed by themselves:", *failed, sep="\n  ", flush=True)
        return again


def _pytest(cache: str, arguments: list[str]) -> int:
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-o", f"cache_dir={cache}", *arguments], check=False
    ).returncode


if __name__ == "__main__":
    sys.exit(main())
