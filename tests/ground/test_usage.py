"""What Linux says of a process."""

from __future__ import annotations

import os
import subprocess
import sys

from handrail import usage


def test_a_process_is_called_what_it_says_that_it_is():
    code = "from handrail.usage import show_as; show_as('reachability'); print('up', flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stdout is not None
        assert process.stdout.readline() == b"up\n"
        assert (process.pid, "reachability") in usage.descendants()[os.getpid()]
        process.stdin.close()
