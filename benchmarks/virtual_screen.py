"""An X screen that nobody sees, for windows of benchmarks, tests and pictures."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator


@contextlib.contextmanager
def virtual_screen(size: str = "1920x1200") -> Iterator[str]:
    """A screen of `size` on a display number that Xvfb chooses; yields its name. Raises OSError where Xvfb can't be started."""
    program = shutil.which("Xvfb")
    if program is None:
        raise OSError("Xvfb is not installed; expected the Debian package xvfb, or its like (make setup installs it)")
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [program, "-displayfd", str(writing), "-screen", "0", f"{size}x24", "-nolisten", "tcp", "-noreset"],
        pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    try:
        with os.fdopen(reading) as answer:
            number = answer.readline().strip()
        if not number:
            raise OSError("Xvfb did not start; run it by hand to see why: Xvfb :99")
        yield f":{number}"
    finally:
        server.kill()
        server.wait()
